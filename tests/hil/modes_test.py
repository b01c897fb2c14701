"""Profile position, profile velocity, homing and interpolated position, by a master in python-can that knows CiA 402
alone. Arguments as of drive_test.py."""
import math, sys

from harness import check, finish
from master import Master, is_state
from session import connect, hold_scenario, said, start

hil, source, address, interface, channel = sys.argv[1:6]
process = start(hil, "drive", hold_scenario(source), "--can", address)
master = Master(connect(address, interface, channel), range(1, 7))
NODE = 4
BIT_10, BIT_12, BIT_13 = 0x400, 0x1000, 0x2000


def cycles(until, most=3000):
    """SYNCs until the statusword of the drive satisfies `until`."""
    for _ in range(most):
        master.cycle()
        if until(master.status[NODE]):
            return True
    return False


def command(word):
    master.control(word, [NODE])
    master.cycle()
    master.cycle()
    return master.status[NODE]


def bits(word, wanted):
    return word & (BIT_10 | BIT_12 | BIT_13) == wanted


def mode(number):
    master.write(NODE, 0x6060, 0, "b", number)
    master.cycle()
    return master.read(NODE, 0x6061, 0, "b") == number


master.be_patient()
master.nmt(1)
per_rad = 65536 * master.read(NODE, 0x6091, 1) / master.read(NODE, 0x6091, 2) / (2 * math.pi)
check("the drive has the modes", master.read(NODE, 0x6502) & 0b1100101 == 0b1100101, hex(master.read(NODE, 0x6502)))
methods = [master.read(NODE, 0x60E3, k + 1, "b") for k in range(master.read(NODE, 0x60E3, 0, "B"))]
check("and homing methods", {1, 2, 17, 18, 33, 34, 35, 37} == set(methods), methods)

check("profile position", mode(1))
for word, state in ((0x06, "ready to switch on"), (0x07, "switched on"), (0x0F, "operation enabled")):
    check(state, master.reach(state, word, [NODE]), hex(master.status[NODE]))
for ramp in (0, 3):
    goal = round((0.2 if ramp else 0.1) * per_rad)
    master.write(NODE, 0x6086, 0, "h", ramp)
    master.write(NODE, 0x607A, 0, "i", goal)
    check(f"ramp {ramp}: acknowledged", command(0x1F) & (BIT_12 | BIT_10) == BIT_12, hex(master.status[NODE]))
    check(f"ramp {ramp}: ready for the next", not command(0x0F) & BIT_12, hex(master.status[NODE]))
    check(f"ramp {ramp}: target reached", cycles(lambda word: word & BIT_10), hex(master.status[NODE]))
    off = abs(master.position[NODE] - goal)
    check(f"ramp {ramp}: within the window", off <= master.read(NODE, 0x6067), off)

check("profile velocity", mode(3))
check("it stands", cycles(lambda word: bits(word, BIT_10 | BIT_12)), hex(master.status[NODE]))
master.write(NODE, 0x60FF, 0, "i", 60_000)
check("60 rpm: not yet", not command(0x0F) & BIT_10, hex(master.status[NODE]))
check("60 rpm: reached", cycles(lambda word: bits(word, BIT_10)), hex(master.status[NODE]))
check("and measured", abs(master.read(NODE, 0x606C, 0, "i") - 60_000) < 10_000, master.read(NODE, 0x606C, 0, "i"))
check("halted it stands", command(0x10F) is not None and cycles(lambda word: bits(word, BIT_10 | BIT_12)))
master.write(NODE, 0x60FF, 0, "i", 0)
command(0x0F)

check("homing", mode(6))
master.write(NODE, 0x607C, 0, "i", 1000)
master.write(NODE, 0x6098, 0, "b", 34)
before = master.position[NODE]
command(0x1F)
check("home is attained", cycles(lambda word: bits(word, BIT_10 | BIT_12)), hex(master.status[NODE]))
moved = master.position[NODE] + 1000
check("less than two turns from the index pulse", 0 <= moved < 2 * 65536, (before, master.position[NODE]))
command(0x0F)

check("interpolated position", mode(7))
here = master.position[NODE]
for k in range(200):
    master.write(NODE, 0x60C1, 1, "i", here + 20 * k)
    master.control(0x1F, [NODE])
    master.cycle()
check("it interpolates", master.status[NODE] & BIT_12, hex(master.status[NODE]))
check("and follows", abs(master.position[NODE] - here - 20 * 199) < 500, master.position[NODE] - here)
check("bit 4 ends it", not command(0x0F) & BIT_12, hex(master.status[NODE]))
check("still enabled", is_state(master.status[NODE], "operation enabled"), hex(master.status[NODE]))
check("without a word of trouble", not master.emergencies, master.emergencies)
master.bus.shutdown()
process.terminate()
check("the session ends in order", process.wait(10) == 0, said())
finish()
