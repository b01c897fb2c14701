"""Faults on purpose, as a controller's developer scripts them: what the drives do, and that they come back.
Arguments as of drive_test.py."""
import struct, subprocess, sys, time

from harness import check, finish, work
from master import Master, is_state
from session import connect, hold_scenario, in_vm, said, start

hil, source, address, interface, channel = sys.argv[1:6]
scenario = hold_scenario(source)
nodes = range(1, 7)


with open(work + "/faults.yaml", "w") as f:
    f.write(
        """faults:
  - {kind: safe_torque_off, time_s: 0.2, duration_s: 0.1, node: 6}
  - {kind: silence, time_s: 0.5, duration_s: 0.1, node: 4}
  - {kind: over_temperature, time_s: 1.0, duration_s: 0.05, node: 5, temperature_degC: 140}
  - {kind: encoder_freeze, time_s: 1.5, duration_s: 0.4, node: 2}
  - {kind: duplicate, time_s: 2.1, duration_s: 0.15, probability: 0.5}
  - {kind: corrupt, time_s: 2.3, duration_s: 0.1, node: 1, probability: 0.2}
  - {kind: delay, time_s: 2.5, duration_s: 0.1, delay_s: 0.004, probability: 0.1}
  - {kind: link_down, time_s: 3.1, duration_s: 1}
  - {kind: bus_off, time_s: 4.6, duration_s: 0.2}
"""
    )
r = subprocess.run(
    [hil, "drive", scenario, "--can", "memory:x", "--faults", "/dev/null"], capture_output=True, text=True
)
check("no list", r.returncode == 2, (r.returncode, r.stderr))
with open(work + "/bad.yaml", "w") as f:
    f.write("faults: [{kind: silence, time_s: 1, duration_s: 1}]")
r = subprocess.run(
    [hil, "drive", scenario, "--can", "memory:x", "--faults", work + "/bad.yaml"], capture_output=True, text=True
)
check(
    "a fault without its drive",
    r.returncode == 2 and "node" in r.stderr and "bad.yaml" in r.stderr,
    (r.returncode, r.stderr),
)

process = start(
    hil, "drive", scenario, "--can", address, "--faults", work + "/faults.yaml", "--stats", work + "/stats.json"
)
master = Master(connect(address, interface, channel), nodes)
for n in nodes:
    master.read(n, 0x1000)
master.write(4, 0x1402, 5, "H", 30)
master.write(2, 0x6065, 0, "I", 200000)
master.write(2, 0x6066, 0, "H", 20)
master.be_patient(900 if in_vm else 500)  # longer than this the link is down
master.nmt(1)
seconds, due = 0.0, 0.0


def cycle(targets=None, silent=(), max_seconds=0.5):
    """One SYNC, and the answers of all drives but the silent ones."""
    global seconds, due
    due = max(due + 0.002, time.monotonic())
    time.sleep(max(0, due - time.monotonic()))
    before = dict(master.tpdo3)
    for n in nodes:
        if targets:
            master.send(0x400 + n, struct.pack("<Hi", 0x0F, targets[n]))
    master.sync()
    seconds += 0.002
    master.until(lambda: all(master.tpdo3[n] > before[n] for n in nodes if n not in silent), max_seconds)


def enable(which):
    for word in (0x80, 0x00, 0x06, 0x07, 0x0F):
        master.control(word, which)
        cycle()
        cycle()
    return all(is_state(master.status[n], "operation enabled") for n in which)


def run_until(t, step=None):
    global target
    while seconds < t:
        if step:
            target = {n: target[n] + step.get(n, 0) for n in nodes}
        cycle(target, silent=(4,) if 0.49 < seconds < 0.61 else ())


cycle()
check("enabled", enable(nodes), master.status)
target = dict(master.position)
run_until(0.25)
check(
    "safe torque off: fault without voltage, EMCY 9000h, torque 0",
    is_state(master.status[6], "fault")
    and not master.status[6] & 0x10
    and (6, 0x9000) in [(n, code) for n, (code, _) in master.emergencies]
    and master.read(6, 0x6077, 0, "h") == 0
    and master.read(6, 0x60FD) == 8,
    (hex(master.status[6]), master.emergencies),
)
check("and no way to enable it", not enable([6]), hex(master.status[6]))
run_until(0.35)
check("until it ends", enable([6]), hex(master.status[6]))
target = dict(master.position)
run_until(0.5)
silent_from = master.tpdo3[4]
run_until(0.59)
check("a silent drive says nothing", master.tpdo3[4] - silent_from <= 2, (silent_from, master.tpdo3[4]))
run_until(0.7)
check(
    "without commands it went to fault by its own deadline",
    is_state(master.status[4], "fault") or is_state(master.status[4], "fault reaction active"),
    hex(master.status[4]),
)
run_until(0.9)
check("its history says why", master.read(4, 0x1003, 1) & 0xFFFF == 0x8250, hex(master.read(4, 0x1003, 1)))
check("the others stayed", all(is_state(master.status[n], "operation enabled") for n in nodes if n != 4), master.status)
master.write(4, 0x1402, 5, "H", 0)  # no set points while it is enabled: a pause of 30 ms is not far
check("it comes back", enable([4]), hex(master.status[4]))
master.emergencies.clear()
run_until(1.2)
check(
    "over-temperature: EMCY 4310h",
    (5, 0x4310) in [(n, code) for n, (code, _) in master.emergencies],
    master.emergencies,
)
check("it comes back", enable([5]), hex(master.status[5]))
target = dict(master.position)
master.emergencies.clear()
run_until(1.9, {2: 2500})
check(
    "a frozen encoder: following error",
    (2, 0x8611) in [(n, code) for n, (code, _) in master.emergencies],
    master.emergencies,
)
run_until(2.0)
check("it comes back", enable([2]), hex(master.status[2]))
target = dict(master.position)
run_until(2.95)
master.listen(0.05)  # duplicates are still on their way
check(
    "duplicates, damage and delay end no session",
    process.poll() is None and all(is_state(master.status[n], "operation enabled") for n in nodes if n != 1),
    master.status,
)
if not is_state(
    master.status[1], "operation enabled"
):  # a damaged controlword may have stopped it: that is what it says
    enable([1])
target = dict(master.position)
master.emergencies.clear()
run_until(3.02)
back = lambda: all((n, 0x8140) in [(m, code) for m, (code, _) in master.emergencies] for n in nodes)
end = time.monotonic() + 20
while not back() and time.monotonic() < end:  # the master goes on; nothing gets through for 1 s
    cycle(target, max_seconds=0.01)
check("a link that was down: EMCY 8140h after it, SYNC lost before", back(), master.emergencies)
cycle(target)  # the EMCY may come before the status of that cycle
check("nobody is enabled", all(not is_state(master.status[n], "operation enabled") for n in nodes), master.status)
check("they come back", enable(nodes), master.status)
master.bus.shutdown()
process.terminate()
check("the session ends in order", process.wait(10) == 0, said())
log = said()
check("and says what happened to the bus", "cut by a fault of the list" in log, log)
finish()
