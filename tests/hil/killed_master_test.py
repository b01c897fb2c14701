"""A master process that dies by kill -9 in the middle of a motion, in every mode: brake, torque 0, fault, and the arm
stays. Arguments as of drive_test.py. As "master ADDRESS INTERFACE CHANNEL MODE" it is that master."""
import signal, struct, subprocess, sys, time

from harness import check, finish, nightly
from master import Master, is_state
from session import connect, hold_scenario, in_vm, said, start

CYCLE_S = 0.004
# Deadline of the SYNC [ms]: a busy machine may pause the master's process for a while, and the VM has one processor.
SYNC_DEADLINE_MS = 1500 if in_vm else 500
ramp = lambda begin, k: begin + 1000 * k
# Of a mode: number, node (2 carries the arm), RPDO, object in it, its type, set point of cycle k, low byte of the
# controlword in even and odd cycles, other objects.
MODES = {
    "CSP": (8, 2, 2, 0x607A0020, "i", ramp, (0x0F, 0x0F), ()),
    "CST": (10, 4, 4, 0x60710010, "h", lambda begin, k: 250, (0x0F, 0x0F), ()),
    "PP": (1, 2, 2, 0x607A0020, "i", lambda begin, k: begin + 655360, (0x0F, 0x3F), ((0x6081, 0, "I", 180_000),)),
    "CSV": (9, 4, 3, 0x60FF0020, "i", lambda begin, k: 2000 * min(k, 100), (0x0F, 0x0F), ()),
    "PV": (3, 2, 3, 0x60FF0020, "i", lambda begin, k: 200_000, (0x0F, 0x0F), ()),
    "IP": (7, 2, 2, 0x60C10120, "i", ramp, (0x1F, 0x1F), ()),
    "HM": (
        6,
        4,
        2,
        0x607A0020,
        "i",
        lambda begin, k: begin,
        (0x1F, 0x1F),
        ((0x6098, 0, "b", 17), (0x6099, 1, "I", 100_000)),
    ),
}
# By day: in the VM each takes ten seconds, and where cycles take fifty milliseconds IP's ramp is too slow to be seen.
LEFT_TO_SOCKETCAND = ("CST", "PV", "IP")


def set_up(master, node, number, rpdo, entry, objects):
    master.nmt(0x81, node)
    master.until(lambda: node in master.boots)
    for index, sub, kind, value in ((0x6060, 0, "b", number), (0x2120, 1, "H", SYNC_DEADLINE_MS), *objects):
        master.write(node, index, sub, kind, value)
    for index, sub, kind, value in (
        (0x1400 + rpdo, 1, "I", 0x80000000 | 0x480 + node),
        (0x1400 + rpdo, 2, "B", 1),
        (0x1600 + rpdo, 0, "B", 0),
        (0x1600 + rpdo, 2, "I", entry),
        (0x1600 + rpdo, 0, "B", 2),
        (0x1400 + rpdo, 1, "I", 0x480 + node),
    ):
        master.write(node, index, sub, kind, value)
    master.nmt(1, node)
    for word in (0x06, 0x07, 0x0F):
        master.control(word)
        master.cycle()


def be_master(address, interface, channel, mode):
    """Moves the drive until somebody kills this process; says when it moves."""
    number, node, rpdo, entry, kind, set_point, words, objects = MODES[mode]
    master = Master(connect(address, interface, channel), [node])
    set_up(master, node, number, rpdo, entry, objects)
    begin, k, said_so = master.position[node], 0, False
    while True:
        master.send(0x480 + node, struct.pack("<H" + kind, words[k % 2], set_point(begin, k)))
        master.sync()
        master.listen(CYCLE_S)
        k += 1
        if k % 25 == 0 and not said_so and abs(master.read(node, 0x606C, 0, "i")) > 20_000:
            print("moving", flush=True)
            said_so = True


def state(watcher, node):
    word = watcher.read(node, 0x6041, 0, "H")
    return word, watcher.read(node, 0x6077, 0, "h"), watcher.read(node, 0x606C, 0, "i"), watcher.read(node, 0x60FD)


def kill_in(mode, name, watcher, where):
    node, master = MODES[mode][1], subprocess.Popen(
        [sys.executable, __file__, "master", *where, mode], stdout=subprocess.PIPE, text=True
    )
    moved = master.stdout.readline() == "moving\n"
    watcher.listen(0.1)  # no SDO of two masters at once
    watcher.emergencies.clear()
    word = watcher.status.get(node, 0)
    master.send_signal(signal.SIGKILL)
    master.wait()
    watcher.listen(0.1)
    check(f"{name}: it moves, then its master is gone", moved and is_state(word, "operation enabled"), hex(word))
    rests = lambda now: is_state(now[0], "fault") and now[1] == 0 and abs(now[2]) < 5000 and not now[3] & 0x20000
    end = time.monotonic() + 10
    while not rests(now := state(watcher, node)) and time.monotonic() < end:
        watcher.listen(0.02)
    check(f"{name}: fault, brake, torque 0, at rest", rests(now), now)
    check(f"{name}: EMCY 8700h", (node, (0x8700, 0x11)) in watcher.emergencies, watcher.emergencies)
    per_degree = 65536 * watcher.read(node, 0x6091, 1) / watcher.read(node, 0x6091, 2) / 360
    there = watcher.read(node, 0x6064, 0, "i")
    watcher.listen(0.5)
    fell = abs(watcher.read(node, 0x6064, 0, "i") - there) / per_degree
    check(f"{name}: the brake holds the arm", fell < 0.1 and rests(state(watcher, node)), fell)


def main(hil, source, *where):
    for clock, modes in (((), ("CSP", "CST", "PP")), (("--realtime",), ("CSV", "PV", "IP", "HM"))):
        drives = start(hil, "drive", hold_scenario(source), "--can", where[0], "--cycle", "4", "--quiet", *clock)
        watcher = Master(connect(*where), range(1, 7))
        for mode in modes:
            if in_vm and mode in LEFT_TO_SOCKETCAND and not nightly:
                continue
            kill_in(mode, f"{mode} {'realtime' if clock else 'lockstep'}", watcher, where)
        watcher.bus.shutdown()
        drives.terminate()
        check("the session ends in order", drives.wait(10) == 0, said())
    finish()


if sys.argv[1] == "master":
    be_master(*sys.argv[2:])
else:
    main(*sys.argv[1:])
