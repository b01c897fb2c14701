"""What a session of drives shows and measures: the status line on narrow terminals, statistics of SYNC and answers, a
SYNC that is slower than agreed, the bit rate of the bus. Arguments: tribotwin-hil, source tree."""
import fcntl, json, os, pty, re, select, struct, subprocess, sys, termios, time

import harness
from harness import check, finish, path, work
from master import Master
from session import connect, hold_scenario, said, start

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
address = "socketcand://127.0.0.1:29618/can0"
nodes = range(1, 7)
os.chdir(work)


def lines_on_a_terminal(columns, seconds=1.6, environment=None, *more):
    """The status lines of drives in real time on a terminal of so many columns (0: it does not say)."""
    near, far = pty.openpty()
    fcntl.ioctl(far, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    drives = subprocess.Popen(
        [hil, "drive", scenario, "--can", address, "--realtime", *more],
        stderr=far,
        stdout=subprocess.DEVNULL,
        env={**os.environ, **(environment or {})},
    )
    os.close(far)
    shown, end = b"", time.monotonic() + seconds
    while time.monotonic() < end:
        if select.select([near], [], [], 0.1)[0]:
            shown += os.read(near, 4096)
    drives.terminate()
    drives.wait(10)
    os.close(near)
    return [line.split("\r")[0].split("\n")[0] for line in shown.decode().split("\r\033[K")[1:]]


for columns, environment, wide, has, lacks in (
    (200, {}, 200, ("drives ------ (E enabled, F fault)", "hottest", "syncs", "serving bus can0"), ()),
    (80, {}, 80, ("drives ------", " s, ", "syncs"), ("serving",)),
    (40, {}, 40, ("------", " s, "), ("serving", "hottest")),
    (20, {}, 20, (" s", "0 of 6 E"), ("drives",)),
    (0, {"COLUMNS": "50"}, 50, ("drives ------", " s, "), ("serving",)),
    (0, {"COLUMNS": "x"}, 80, ("drives ------", "syncs"), ("serving",)),
):
    lines = lines_on_a_terminal(columns, 1.6, environment)
    check(
        f"{columns} columns, {environment}: the status fits into {wide}",
        len(lines) >= 2
        and all(len(line) < wide and all(h in line for h in has) for line in lines)
        and not any(l in line for line in lines for l in lacks),
        lines,
    )


def session(stats, cycles, period_s, *more):
    """Statistics and stderr of a session with so many SYNCs."""
    before = len(said()) if os.path.exists(path("stderr")) else 0
    drives = start(hil, "drive", scenario, "--can", address, "--quiet", "--stats", stats, *more)
    master = Master(connect(address, "socketcand", "can0"), nodes)
    master.nmt(1)
    due = time.monotonic()
    for _ in range(cycles):
        due += period_s
        master.listen(max(0, due - time.monotonic()))
        master.cycle()
    master.bus.shutdown()
    drives.terminate()
    check("the session ends in order", drives.wait(10) == 0, said())
    return json.load(open(stats)), said()[before:]


# SYNC and its answer.
stats, text = session("fit.json", 300, 0.01, "--cycle", "10", "--realtime")
for key in ("sync_period_us", "sync_jitter_us", "sync_to_tpdo_us"):
    spread = stats.get(key, {})
    check(
        key + ": median, p99, max in order",
        set(spread) == {"median", "p99", "max"} and 0 < spread["median"] <= spread["p99"] <= spread["max"],
        spread,
    )
if "sync_period_us" in stats:
    print("    ", {k: v for k, v in stats.items() if k.startswith("sync_")})
    check("the period is the master's", 9_000 < stats["sync_period_us"]["median"] < 12_000, stats["sync_period_us"])
    check("an answer is faster than a period", stats["sync_to_tpdo_us"]["median"] < 5_000, stats["sync_to_tpdo_us"])
    check("a SYNC as agreed is not mentioned", "SYNC" not in text and 0.8 < stats["time_scale"] < 1.2, text)
counts = re.findall(r'"(overruns|skipped_us|lateness_\w+|syncs|frames_in)": ([\d.]+)', open("fit.json").read())
check("counts are integers", len(counts) >= 6 and all("." not in n for _, n in counts), counts)
check("of a bus without bit rate no share is stated", "bit_rate" not in stats and "bus_load" not in stats, stats)
total = sum(v for k, v in stats.items() if re.fullmatch(r"lateness_below_\d+_us", k))
check("every step in real time has its lateness", total > 2500, total)
check(
    "lateness is that of steps, not of the start",
    stats["lateness_median_us"] <= stats.get("lateness_p99_us", 0) <= stats["lateness_max_us"],
    stats,
)

# A SYNC of five times the cycle: slow motion, said once and kept.
stats, text = session("slow.json", 120, 0.01, "-o", "slow")
check(
    "a slow SYNC is said once, with both figures",
    text.count("1006h says 2 ms") == text.count("1006h says") == 1 and re.search(r"every (9|1\d)(\.\d+)? ms", text),
    text,
)
check("and counted", 0.15 < stats.get("time_scale", 0) < 0.25 and stats.get("cycle_us") == 2000, stats)
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
    r = harness.run(hil, "drive", scenario, "--can", "memory:x", "--realtime", "--duration", "2", "--stats", file)
    check(f"statistics in {name}: exit 2", r.returncode == 2 and file in r.stderr, (r.returncode, r.stderr))
check("at once", time.monotonic() - began < 2, time.monotonic() - began)

finish()
