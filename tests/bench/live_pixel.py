"""From the step of a robot to the pixel: `tribotwin-hil drive --web --realtime` at 1 kHz, one page in chromium. When
each step was is in the session file of --record; a row is seen in the first painted frame whose histories have it.
Arguments: build folder, turns (5 without), seconds of a turn (20 without)."""
import os, re, statistics, subprocess, sys, tempfile, time

source = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(source, "tests", "twin", "live", "page"))
import devtools

build = sys.argv[1]
turns = int(sys.argv[2]) if len(sys.argv) > 2 else 5
seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 20

# What follows a frame's callbacks as a message comes after its painting.
WATCH = """(() => {
  const seen = window.seen = [], after = new MessageChannel();
  let newest = 0;
  after.port1.onmessage = () => seen.push([performance.timeOrigin + performance.now(), newest]);
  const look = () => {
    requestAnimationFrame(look);
    newest = Number(document.querySelector('#figures').dataset.row);
    after.port2.postMessage(0);
  };
  requestAnimationFrame(look);
})()"""

IN_SIGHT = """[...document.querySelectorAll('.history')].map(h => h.getBoundingClientRect())
  .filter(r => r.top < innerHeight && r.bottom > 0).length"""


def steps_of(log):
    """Wall clock of each step of the robot [ms]: that of its turn of the session, in which it is the next thing."""
    with open(log + ".session") as file:
        head, turns = file.read().split("turns\n")
    now_us, times = int(re.search(r"start_us (\d+)", head)[1]), []
    for line in turns.splitlines():
        found = re.match(r"(\d+)(?: .*?\bsteps=(\d+))?", line)
        if found:
            now_us += int(found[1])
            times += [1e-3 * now_us] * int(found[2] or 0)
    return times


def turn(folder):
    log = os.path.join(folder, "r.log")
    with open(os.path.join(folder, "said"), "w+") as said:
        drive = subprocess.Popen(
            [os.path.join(build, "bin", "tribotwin-hil"), "drive"]
            + [os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml"), "--quiet", "--can", "memory:pixel"]
            + ["--realtime", "--set", "telemetry_rate_hz=1000", "--web", "127.0.0.1:0", "--record", log],
            stderr=said,
        )
        browser = devtools.Browser(folder)
        try:
            address = browser.until(lambda: re.search(r"web: (http://\S+)", open(said.name).read()), 10)[1]
            tab = browser.tab()
            tab.window(1440, 900)
            tab.go(address)
            tab.until("document.querySelectorAll('.history').length === 4", 30)
            tab.value("document.querySelector('#plots').scrollIntoView()")  # what is not seen is not drawn
            time.sleep(5)
            drawn = tab.value(IN_SIGHT)
            tab.value(WATCH)
            time.sleep(seconds)
            seen = tab.value("seen")
        finally:
            browser.close()
            drive.terminate()
            drive.wait(20)
    return steps_of(log), seen, drawn


def main():
    medians, highs = [], []
    for _ in range(turns):
        with tempfile.TemporaryDirectory() as folder:
            steps, seen, drawn = turn(folder)
        frames = [(wall, newest) for wall, newest in seen]
        late, at = [], 0
        first, last = frames[0][1] + 1, frames[-1][1]
        for step in range(first, last + 1):
            while frames[at][1] < step:
                at += 1
            late.append(frames[at][0] - steps[step])
        late.sort()
        rate = 1e3 * (len(frames) - 1) / (frames[-1][0] - frames[0][0])
        pictures = len({newest for _, newest in frames}) / (frames[-1][0] - frames[0][0]) * 1e3
        medians.append(statistics.median(late))
        highs.append(late[int(0.99 * len(late))])
        print(
            f"{len(late)} rows: step to pixel median {medians[-1]:.1f} ms, 99 % {highs[-1]:.1f} ms, most "
            f"{late[-1]:.1f} ms; {drawn} histories in sight, {rate:.0f} frames, {pictures:.0f} new pictures a second; "
            f"load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
    print(f"medians: {statistics.median(medians):.1f} ms, 99 % {statistics.median(highs):.1f} ms "
          f"({min(highs):.1f} .. {max(highs):.1f})")  # fmt: skip


main()
