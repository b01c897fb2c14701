"""A master that falls silent in torque mode, in lockstep: the robot comes to rest and the drive ends in fault without
any SYNC, and a replay says the same. Arguments: tribotwin-hil, source tree."""
import re, struct, sys

import harness
from harness import check, finish, work
from master import Master, is_state
from session import connect, hold_scenario, said, start

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
address = "socketcand://127.0.0.1:29614/can0"
node = 4


def send_pdo(master, index, identifier, kind):
    """Switches a PDO on; its transmission type is `kind`."""
    master.write(node, index, 1, "I", 0xC0000000 | identifier)
    master.write(node, index, 2, "B", kind)
    master.write(node, index, 1, "I", 0x40000000 | identifier)


for cycle_ms, cycles in ((2, 40), (200, 6)):
    log = f"{work}/{cycle_ms}.log"
    process = start(hil, "drive", scenario, "--can", address, "--record", log, "--cycle", str(cycle_ms), "--quiet")
    master = Master(connect(address, "socketcand", "can0"), [node])
    master.nmt(0x82)
    master.until(lambda: node in master.boots)
    master.be_patient(500)
    master.write(node, 0x6060, 0, "b", 10)
    send_pdo(master, 0x1404, 0x47F, 1)
    send_pdo(master, 0x1804, 0x4FF, 255)  # statusword and torque, whenever they change
    master.nmt(1)
    for word in (0x06, 0x07, 0x0F):
        master.control(word)
        master.sync()
        master.listen(0.02)
    for k in range(cycles):
        master.send(0x47F, struct.pack("<Hh", 0x0F, 400))
        master.sync()
        master.listen(1e-3 * cycle_ms)
    check(
        f"cycle {cycle_ms} ms: enabled and moving",
        is_state(master.status[node], "operation enabled") and master.read(node, 0x606C, 0, "i") > 1000000,
        hex(master.status[node]),
    )
    check("silence: fault", master.until(lambda: is_state(master.status[node], "fault"), 5), hex(master.status[node]))
    check("EMCY: SYNC lost", master.emergencies == [(node, (0x8700, 0x11))], master.emergencies)
    master.listen(0.3)
    state = master.read(node, 0x606C, 0, "i"), master.read(node, 0x6077, 0, "h")
    check("at rest, torque 0", state == (0, 0), state)
    master.control(0x80)
    check("reset without SYNC", master.until(lambda: is_state(master.status[node], "switch on disabled")))
    master.bus.shutdown()
    process.terminate()
    check("the drives end when asked", process.wait(10) == 0, said())
    r = harness.run(hil, "replay", scenario, log, "--fast", "--cycle", str(cycle_ms))
    check("a replay says the same", r.returncode == 0 and ": 0 differ, 0 missing, 0 added" in r.stdout, r.stdout)
    steps = [line for line in open(log) if re.search(" 4FF#", line)]
    check("the torque was followed on its way", len(steps) > 20, len(steps))

finish()
