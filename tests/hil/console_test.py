"""What a session of drives shows and measures: the status line on narrow terminals, statistics of SYNC and answers, a
SYNC that is slower than agreed, the bit rate of the bus. Arguments: tribotwin-hil, source tree."""
import fcntl, json, os, pty, re, select, statistics, struct, subprocess, sys, termios, time

import harness
from harness import check, finish, path, work
from master import Master
from session import connect, hold_scenario, said, start

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
address = "socketcand://127.0.0.1:29618/can0"
nodes = range(1, 7)
os.chdir(work)


def lines_on_a_terminal(columns, environment=None):
    """Two status lines of drives in real time on a terminal of so many columns (0: it does not say)."""
    near, far = pty.openpty()
    fcntl.ioctl(far, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    drives = subprocess.Popen(
        [hil, "drive", scenario, "--can", address, "--realtime"],
        stderr=far,
        stdout=subprocess.DEVNULL,
        env={**os.environ, **(environment or {})},
    )
    os.close(far)
    shown, end = b"", time.monotonic() + 30
    while shown.count(b"\r\033[K") < 3 and time.monotonic() < end:
        if select.select([near], [], [], 0.1)[0]:
            shown += os.read(near, 4096)
    drives.terminate()
    drives.wait(10)
    os.close(near)
    return [line.split("\r")[0].split("\n")[0] for line in shown.decode().split("\r\033[K")[1:3]]


for columns, environment, wide, has, lacks in (
    (200, {}, 200, ("drives ------ (E enabled, F fault)", "hottest", "syncs", "serving bus can0"), ()),
    (80, {}, 80, ("drives ------", " s, ", "syncs"), ("serving",)),
    (40, {}, 40, ("------", " s, "), ("serving", "hottest")),
    (20, {}, 20, (" s", "0 of 6 E"), ("drives",)),
    (0, {"COLUMNS": "50"}, 50, ("drives ------", " s, "), ("serving",)),
    (0, {"COLUMNS": "x"}, 80, ("drives ------", "syncs"), ("serving",)),
):
    lines = lines_on_a_terminal(columns, environment)
    check(
        f"{columns} columns, {environment}: the status fits into {wide}",
        len(lines) == 2
        and all(len(line) < wide and all(h in line for h in has) for line in lines)
        and not any(l in line for line in lines for l in lacks),
        lines,
    )


def session(stats, cycles, period_s, *more):
    """Statistics and stderr of a session with so many SYNCs; and what their master saw, as medians: the period of its
    SYNCs and the time until all drives had answered [s]. A busy machine makes both longer, here and there."""
    before = len(said()) if os.path.exists(path("stderr")) else 0
    drives = start(hil, "drive", scenario, "--can", address, "--quiet", "--stats", stats, *more)
    master = Master(connect(address, "socketcand", "can0"), nodes)
    master.nmt(1)
    due = time.monotonic()
    syncs, answers = [], []
    for _ in range(cycles):
        due += period_s
        master.listen(max(0, due - time.monotonic()))
        syncs.append(time.monotonic())
        master.cycle()
        answers.append(time.monotonic() - syncs[-1])
    master.bus.shutdown()
    drives.terminate()
    check("the session ends in order", drives.wait(10) == 0, said())
    period = statistics.median(after - this for this, after in zip(syncs, syncs[1:]))
    return json.load(open(stats)), said()[before:], period, statistics.median(answers)


def near(value, wanted):
    """Within a fifth: two processes on a busy machine do not see the same pauses."""
    return abs(value / wanted - 1) < 0.2


# SYNC and its answer.
stats, text, period_s, answer_s = session("fit.json", 300, 0.01, "--cycle", "10", "--realtime")
for key in ("sync_period_us", "sync_jitter_us", "sync_to_tpdo_us"):
    spread = stats.get(key, {})
    check(
        key + ": median, p99, max in order",
        set(spread) == {"median", "p99", "max"} and 0 < spread["median"] <= spread["p99"] <= spread["max"],
        spread,
    )
if "sync_period_us" in stats:
    print("    ", {k: v for k, v in stats.items() if k.startswith("sync_")})
    median_s = {k: 1e-6 * stats[k]["median"] for k in ("sync_period_us", "sync_to_tpdo_us")}
    check("the period is the master's", near(median_s["sync_period_us"], period_s), (median_s, period_s))
    check("an answer is sent before it arrives", median_s["sync_to_tpdo_us"] < answer_s, (median_s, answer_s))
    check("the time scale is that of the period", near(stats["time_scale"], 0.01 / period_s), (stats, period_s))
    check("in real time no SYNC is slow motion", "SYNC" not in text, text)
counts = re.findall(r'"(overruns|skipped_us|lateness_\w+|syncs|frames_in)": ([\d.]+)', open("fit.json").read())
check("counts are integers", len(counts) >= 6 and all("." not in n for _, n in counts), counts)
check("of a bus without bit rate no share is stated", "bit_rate" not in stats and "bus_load" not in stats, stats)
total = sum(v for k, v in stats.items() if re.fullmatch(r"lateness_below_\d+_us", k))
steps = 1000 * stats["simulated_s"]
check("every step in real time has its lateness", steps > 1000 and abs(total - steps) <= 2, (total, steps))
check(
    "lateness is that of steps, not of the start",
    stats["lateness_median_us"] <= stats.get("lateness_p99_us", 0) <= stats["lateness_max_us"],
    stats,
)

# A SYNC of five times the cycle: slow motion, said once and kept.
stats, text, period_s, _ = session("slow.json", 120, 0.01, "-o", "slow")
told = re.search(r"every ([\d.]+) ms", text)
check(
    "a slow SYNC is said once, with both figures",
    text.count("1006h says 2 ms") == text.count("1006h says") == 1 and told and 5 < float(told.group(1)) < 1000,
    text,
)
check("and counted", near(stats.get("time_scale", 0), 0.002 / period_s) and stats.get("cycle_us") == 2000, stats)
warnings = json.load(open("slow/summary.json"))["warnings"]
check("and in the summary", any("1006h says 2 ms" in w for w in warnings), warnings)


# The bit rate: stated, or the device's; a bus without one carries any cycle.
def runs(name, *more, code=0, says=""):
    r = harness.run(hil, "drive", scenario, "--realtime", "--duration", "0.05", "--quiet", *more)
    check(name, r.returncode == code and says in r.stderr, (r.returncode, r.stderr))


for can in ("memory:x", address):
    runs(f"{can}: 1 kHz without a bit rate", "--can", can, "--cycle", "1")
    runs(f"{can}: 1 kHz at 1 Mbit/s", "--can", can, "--cycle", "1", "--bitrate", "1000000", code=2, says="1000 kbit/s")
    runs(f"{can}: 500 Hz at 250 kbit/s", "--can", can, "--bitrate", "250000", code=2, says="250 kbit/s")
runs("a bit rate that CAN does not have", "--can", "memory:x", "--bitrate", "5000", code=2, says="--bitrate")
runs("a stated bit rate", "--can", "memory:x", "--cycle", "4", "--bitrate", "500000", "--stats", "rate.json")
rate = json.load(open("rate.json")) if os.path.exists("rate.json") else {}
check("its load is stated", rate.get("bit_rate") == 500000 and 0 <= rate.get("bus_load", -1) < 1, rate)
r = harness.run(hil, "budget", scenario, "--bitrate", "500000")
check("budget at a stated bit rate", r.returncode == 2 and "% of the bus" in r.stdout, (r.returncode, r.stdout))

# Statistics that cannot be written are noticed before the session.
began = time.monotonic()
for name, file in (("a folder that takes none", "/proc/stats.json"), ("no folder", "nowhere/stats.json")):
    r = harness.run(hil, "drive", scenario, "--can", "memory:x", "--realtime", "--duration", "60", "--stats", file)
    check(f"statistics in {name}: exit 2", r.returncode == 2 and file in r.stderr, (r.returncode, r.stderr))
check("before the session", time.monotonic() - began < 60, time.monotonic() - began)

finish()
