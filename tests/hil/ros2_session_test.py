"""The folder of `tribotwin-hil ros2` in the hands of a master that does what ros2_canopen does: boot, init, modes, a
motion, a fault, shutdown. Arguments: tribotwin-hil, source tree, address of the drives, python-can's interface and
channel."""
import json, math, subprocess, sys

from harness import check, content, finish, work
from master import is_state
from ros2_master import CSP, CST, CSV, IP, PP, PV, Ros2Master, concise
from session import connect, hold_scenario, said, start

hil, source, address, interface, channel = sys.argv[1:6]
scenario = hold_scenario(source)
start_rad = [0, -0.1, -1.2, 0, 0, 0]  # of the scenario
cycle_s = 0.01

subprocess.run([hil, "ros2", scenario, "-o", work + "/bus"], check=True)
# At another cycle than bus.yml's: the master sets 1006h and 60C2h.
process = start(hil, "drive", scenario, "--can", address, "--stats", work + "/stats.json", "--quiet")
master = Ros2Master(connect(address, interface, channel), work + "/bus")
drives = master.drives


def positions():
    return [d.position() for d in drives]


def near(found, wanted, tolerance):
    return all(abs(a - b) < tolerance for a, b in zip(found, wanted))


wrong = master.boot()
check("boot: identities are those of the EDS", not wrong, wrong)
left = {(i, s): v for i, s, v in concise(drives[0].part, drives[0].eds)}  # the last value of each
stored = {k: master.read_object(drives[0], *k) for k in left}
check("the drive holds what was written", stored == left, {"%04X:%d" % k: v for k, v in stored.items() if v != left[k]})
master.be_patient()
check("every TPDO comes with every SYNC", master.turn(5))
check("joint states are those of the scenario", near(positions(), start_rad, 1e-4), positions())

check("init: enabled", master.init(drives), [hex(d.values[0x6041, 0]) for d in drives])
check("without a mode", all(d.values[0x6061, 0] == 0 for d in drives))
master.turn(50)
check("it holds", near(positions(), start_rad, 1e-3), positions())
check("cyclic position mode", master.enter(drives, CSP))
master.turn(50)
check("and holds until a target comes, though 607Ah is 0", near(positions(), start_rad, 1e-3), positions())

for d, rad in zip(drives, start_rad):
    d.command(rad)
worst_rad = speed_rad_s = 0
begin = master.syncs
while (t := cycle_s * (master.syncs - begin)) < 4:
    wanted = start_rad[1] + 0.025 * (1 - math.cos(math.pi / 2 * t))
    before = drives[1].position()
    drives[1].command(wanted)
    master.turn()
    worst_rad = max(worst_rad, abs(drives[1].position() - wanted))
    speed_rad_s = max(speed_rad_s, (drives[1].position() - before) / cycle_s)
check("0.05 rad and back", worst_rad < 5e-3 and near(positions(), start_rad, 5e-3), (worst_rad, positions()))
check("one SYNC is 10 ms", abs(speed_rad_s / (0.025 * math.pi / 2) - 1) < 0.2, speed_rad_s)

one = drives[5]
check("cyclic velocity mode", master.enter([one], CSV))
one.command(0.1)
master.turn(100)
check("0.1 rad/s", abs(one.velocity() - 0.1) < 5e-3, one.velocity())
one.command(0)
master.turn(50)
check("cyclic torque mode", master.enter([one], CST))
one.command(150)
master.turn(20)
check("150 per mille of 650 Nm", abs(one.effort() - 97.5) < 7, one.effort())
check("back to velocity", master.enter([one], CSV))
one.command(0)
master.turn(50)
check("profile velocity", master.enter([one], PV))
one.command(0.1)
master.turn(200)
check("0.1 rad/s along the ramp", abs(one.velocity() - 0.1) < 5e-3, one.velocity())
one.command(0)
master.turn(200)
check("profile position", master.enter([one], PP))
for rad in (0.5, 0.2):
    one.command(rad)
    master.turn(300)
    check(f"to {rad} rad along the ramps", abs(one.position() - rad) < 5e-3, one.position())
check("interpolated position", master.enter([one], IP))
for k in range(101):
    one.command(0.2 + 0.001 * k)
    master.turn()
master.turn(50)
check("0.1 rad in points", abs(one.position() - 0.3) < 5e-3, one.position())
check("no emergency so far", not master.emergencies, master.emergencies)

check("halt: quick stop", master.reach([drives[0]], "quick stop active"), hex(drives[0].values[0x6041, 0]))
check("ends in switch on disabled", master.reach([drives[0]], "switch on disabled"))
check("recover", master.recover([drives[0]]))
drives[0].command(start_rad[0] + 0.5)
master.turn(100)
check("a jump of 0.5 rad becomes a motion", abs(drives[0].position() - 0.5) < 5e-3, drives[0].position())
master.write(drives[0].node, 0x6065, 0, "I", 10)  # following error window
drives[0].command(start_rad[0])
master.turn(100)
check("one that it cannot follow: following error", master.emergencies == [(1, (0x8611, 0x21))], master.emergencies)
check("fault", is_state(drives[0].values[0x6041, 0], "fault"), hex(drives[0].values[0x6041, 0]))
drives[0].target = None
check("recover from the fault", master.recover([drives[0]]), hex(drives[0].values[0x6041, 0]))
before = positions()
check("shutdown: mode 0, switch on disabled", master.shut_down(drives), [hex(d.values[0x6041, 0]) for d in drives])
master.turn(50)
check("brakes hold", near(positions(), before, 1e-3), (before, positions()))
master.bus.shutdown()
process.terminate()
check("the drives end when asked", process.wait(10) == 0, said())
stats = json.loads(content("stats.json"))["drives"]
check(
    "no SDO was refused, no PDO was short or late",
    all(d[k] == 0 for d in stats for k in ("sdo_aborts", "pdo_short", "pdo_late")),
    stats,
)
finish()
