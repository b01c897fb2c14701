"""Six IRB 6620 drives on two buses, three on each, by two masters in one program. Arguments: tribotwin-hil, source
tree, addresses of the buses for the drives, then python-can's interface and the two channels."""
import json, math, os, re, shutil, struct, sys, time

import h5py, numpy as np

import harness
from harness import check, finish, nightly, work
from master import Master, is_state
from session import connect, hold_scenario, in_vm, said, start

hil, source = sys.argv[1:3]
addresses, interface, channels = sys.argv[3:5], sys.argv[5], sys.argv[6:8]
scenario = hold_scenario(source)
nodes = (1, 2, 3)
joints = ("joint1,joint2,joint3", "joint4,joint5,joint6")
rate = ("--set", "telemetry_rate_hz=500")
os.chdir(work)


def watch_sync(master, milliseconds):
    """Long where no SYNC is to be missed: a busy machine may stop this program for more than 100 ms."""
    for n in nodes:
        master.write(n, 0x2120, 1, "H", milliseconds)


def begin(name, *more):
    buses = [word for address, names in zip(addresses, joints) for word in ("--can", f"{address}={names}")]
    drives = start(hil, "drive", scenario, *buses, "--record", f"{name}.log", "--stats", f"{name}.json", "-o", name,
                   *rate, *more)  # fmt: skip
    masters = [Master(connect(a, interface, c), nodes) for a, c in zip(addresses, channels)]
    for m in masters:
        m.until(lambda: len(m.heartbeat) == len(nodes), 10)
        m.nmt(1)
        for n in nodes:
            m.send_torque(n)
        watch_sync(m, 2000)
    return drives, masters


def cycle(masters, targets=None, wait=0.5):
    """Set points and SYNCs of these masters, then all answers."""
    before = [dict(m.tpdo3) for m in masters]
    for i, m in enumerate(masters):
        for n in nodes if targets else ():
            m.send(0x400 + n, struct.pack("<Hi", 0x0F, targets[i][n]))
    for m in masters:
        m.sync()
    return all(m.until(lambda: all(m.tpdo3[n] > b[n] for n in nodes), wait) for m, b in zip(masters, before))


def are(state, *masters):
    return all(is_state(m.status.get(n, 0), state) for m in masters for n in nodes)


def enable(masters):
    for word in (0x80, 0x00, 0x06, 0x07, 0x0F):
        for m in masters:
            m.control(word)
        cycle(masters)
        cycle(masters)
    return are("operation enabled", *masters)


def move(masters, cycles):
    """All drives turn back and forth by up to two turns of the motor. How many cycles had no answer."""
    home = [dict(m.position) for m in masters]
    missed = 0
    for k in range(cycles):
        turn = round(65536 * (1 - math.cos(2 * math.pi * k / 1000)))
        missed += not cycle(masters, [{n: h[n] + turn for n in nodes} for h in home])
        time.sleep(0.001)
    return missed


def end(drives, masters):
    for m in masters:
        m.bus.shutdown()
    drives.terminate()
    check("the drives end when asked", drives.wait(10) == 0, said())


def repeats(name, log, *more):
    r = harness.run(hil, "replay", scenario, f"{log}.log", "--fast", "-o", f"{log}_again", "--force", *rate, *more)
    check(
        name + ": the same frames",
        r.returncode == 0 and ": 0 differ, 0 missing, 0 added" in r.stdout,
        (r.returncode, r.stdout, r.stderr),
    )
    with h5py.File(f"{log}/telemetry.h5") as f, h5py.File(f"{log}_again/telemetry.h5") as g:
        rows = [x["time_s"].shape[0] for x in (f, g)]
        same = all(np.array_equal(f[j][c][:], g[j][c][:]) for j in f if isinstance(f[j], h5py.Group) for c in f[j])
        check(name + ": the same telemetry, bit for bit", same and rows[0] == rows[1] > 100, rows)


# Who is where.
drives, masters = begin("session")
left, right = masters
names = [[m.read(n, 0x1008, 0, "s").split()[-1] for n in nodes] for m in masters]
check("joints on their buses, nodes 1 to 3 on each", [",".join(n) for n in names] == list(joints), names)
check("serial numbers of a robot differ", [m.read(n, 0x1018, 4) for m in masters for n in nodes] == [1, 2, 3, 4, 5, 6])
check("enabled on both", enable(masters), (left.status, right.status))
check("the masters reach their own drives alone", left.position != right.position, (left.position, right.position))
start_s = time.monotonic()
cycles = 500 if in_vm and not nightly else 1500
missed = move(masters, cycles)
print(f"    {cycles} cycles in {time.monotonic() - start_s:.1f} s")
check("every cycle is answered on both", missed == 0, missed)
check("all stay enabled", are("operation enabled", *masters), (left.status, right.status))

# One bus falls silent: the other goes on.
watch_sync(right, 100)
cycle(masters)
hold = [dict(left.position)]
missed = sum(not cycle([left], hold) or time.sleep(0.001) is not None for k in range(300))
left.listen(0)
quiet = not [e for e in left.emergencies if e[1][0] == 0x8700]
right.listen(0.02)
check("the other bus has all its answers", missed == 0, missed)
check("SYNC lost: EMCY 8700h of its drives", {n for n, (c, _) in right.emergencies if c == 0x8700} == set(nodes))
check("no EMCY on the other bus", quiet and are("operation enabled", left), (left.emergencies, left.status))
cycle(masters)
check("and they are in fault", are("fault", right), right.status)
watch_sync(right, 2000)
check("enabled on both again", enable(masters), (left.status, right.status))
check("and moved", move(masters, 100) == 0)
end(drives, masters)

stats = json.load(open("session.json"))
buses = stats["buses"]
check("statistics of each bus", [b["channel"] for b in buses] == ["can0", "can1"] and "syncs" not in stats, stats)
check("both had their SYNCs", buses[0]["syncs"] >= buses[1]["syncs"] + 250 > cycles, buses)
check("one moved on alone", buses[1]["sync_alone"] > 200 and buses[0]["sync_alone"] < 10, buses)
check("jitter and answers of each", all(b["sync_jitter_us"] and b["sync_to_tpdo_us"] for b in buses), buses)
check("load and loss of each", all(b["bus_load_1_mbit"] > 0 and b["bus"]["receive_lost"] == 0 for b in buses), buses)
check("drives name their bus", [d["channel"] for d in stats["drives"]] == ["can0"] * 3 + ["can1"] * 3)
lines = [line.split() for line in open("session.log")]
check("the log has both channels", {line[1] for line in lines} == {"can0", "can1"})
tpdos = {c: {line[2][:3] for line in lines if line[1] == c and line[2][:2] == "38"} for c in ("can0", "can1")}
check("with three drives on each", all(t == {"381", "382", "383"} for t in tpdos.values()), tpdos)

# Again, and beside a twin.
repeats("replay", "session")
wired = ("--can", f"can0={joints[0]}", "--can", f"can1={joints[1]}")
r = harness.run(hil, "replay", scenario, "session.log", "--fast", "--can", f"can0={joints[1]}", "--can",
                f"can1={joints[0]}")  # fmt: skip
check("other joints than recorded: exit 2", r.returncode == 2 and "session.log.session" in r.stderr, r.stderr)
shutil.copy("session.log", "alone.log")
shutil.copytree("session", "alone")
repeats("replay without the session file", "alone", *wired)
with open("renamed.log", "w") as f:
    f.write(open("session.log").read().replace(" can0 ", " left ").replace(" can1 ", " right "))
r = harness.run(hil, "replay", scenario, "renamed.log", "--fast", "--can", f"left={joints[0]}", "--can",
                f"right={joints[1]}")  # fmt: skip
check("a log with other channels", r.returncode == 0 and ": 0 differ" in r.stdout, (r.stdout, r.stderr))
r = harness.run(hil, "replay", scenario, "renamed.log", "--fast", *wired)
check("a channel that is no bus", r.returncode == 2 and "renamed.log" in r.stderr and "left" in r.stderr, r.stderr)
r = harness.run(hil, "shadow", scenario, "--lockstep", "--can", "log:session.log", "--limit", 100)
rows = [line.split() for line in r.stdout.splitlines()[2:]]
check("shadow: every joint by its bus", r.returncode == 0 and len(rows) == 6, (r.returncode, r.stdout, r.stderr))

# A link that is cut is that of one bus.
with open("faults.yaml", "w") as f:
    f.write("faults:\n  - {kind: link_down, time_s: 0.5, duration_s: 0.4, bus: can1}\n")
    f.write("  - {kind: encoder_freeze, time_s: 0.3, duration_s: 0.1, node: 2, bus: can1}\n")
drives, masters = begin("cut", "--faults", "faults.yaml")
left, right = masters
check("before the cut: enabled", enable(masters), (left.status, right.status))
watch_sync(right, 100)
hold = [dict(m.position) for m in masters]
right.emergencies.clear()
for k in range(600):
    cycle(masters, hold, wait=0.02 if k > 200 else 0.5)
    time.sleep(0.001)
right.until(lambda: len({n for n, (c, _) in right.emergencies if c == 0x8140}) == 3, 3)
check("EMCY 8140h on the bus that was cut", {n for n, (c, _) in right.emergencies if c == 0x8140} == set(nodes))
check("none on the other", not [e for e in left.emergencies if e[1][0] in (0x8140, 0x8700)], left.emergencies)
cycle(masters)
check("its drives are in fault, the others enabled", are("fault", right) and are("operation enabled", left),
      (left.status, right.status))  # fmt: skip
end(drives, masters)
repeats("replay of the cut", "cut")
finish()
