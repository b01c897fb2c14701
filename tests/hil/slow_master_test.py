"""A Python master of 10 ms, whose set points make steps of the torque, and a shadow of the session: the torques that
the drives send are those that the motion needs. Arguments: tribotwin-hil, source tree."""
import csv, math, os, struct, sys, time

import harness
from harness import check, finish, work
from master import Master, is_state
from session import connect, hold_scenario, said, start

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
address = "socketcand://127.0.0.1:29651/can0"
nodes = range(1, 7)
PERIOD_S, CYCLES = 0.010, 800
os.chdir(work)


def drives_follow(name, *more):
    """NAME.log: every joint goes 0.25 rad back and forth at 0.5 Hz."""
    drives = start(hil, "drive", scenario, "--can", address, "--quiet", "--realtime", "--record", name + ".log", *more)
    master = Master(connect(address, "socketcand", "can0"), nodes)
    master.nmt(1)
    master.cycle()
    gear = {n: master.read(n, 0x6091, 1) / master.read(n, 0x6091, 2) for n in nodes}
    counts = {n: 65536 * gear[n] / (2 * math.pi) for n in nodes}
    for n in nodes:
        master.send_torque(n)
    for word in (0x06, 0x07, 0x0F):
        master.control(word)
        master.cycle()
        time.sleep(0.005)
    home, begin = dict(master.position), time.monotonic()
    for k in range(CYCLES):
        angle = 0.125 * (1 - math.cos(math.pi * PERIOD_S * k))
        master.cycle({n: round(home[n] + counts[n] * angle) for n in nodes}, wait=False)
        while (left := begin + PERIOD_S * (k + 1) - time.monotonic()) > 0:
            master.take(master.bus.recv(left))
    check(name + ": the drives follow", all(is_state(master.status[n], "operation enabled") for n in nodes), said())
    master.bus.shutdown()
    drives.terminate()
    check(name + ": the drives end when asked", drives.wait(10) == 0, said())


def residuals(log, joint):
    """|torque measured - expected| [Nm], in rising order."""
    r = harness.run(hil, "shadow", scenario, "--can", f"log:{log}.log", "--csv", f"{log}.csv")
    check(log + ": judged", r.returncode == 0, (r.returncode, r.stdout, r.stderr))
    with open(log + ".csv") as f:
        cells = [row[joint + ".residual_nm"] for row in csv.DictReader(f)]
    return sorted(abs(float(cell)) for cell in cells if cell not in ("", "nan"))


drives_follow("slow", "--cycle", "10")
joint2 = residuals("slow", "joint2")
print(
    f"    joint 2: {len(joint2)} residuals, median {joint2[len(joint2) // 2]:.1f}, "
    f"nine of ten below {joint2[len(joint2) * 9 // 10]:.1f}, largest {joint2[-1]:.0f} Nm"
)
check("joint 2: the torques fit the motion", len(joint2) > 500 and joint2[len(joint2) // 2] < 100)
finish()
