"""A recorded session is repeated frame by frame: in real time, with injected faults, beside a node that takes a drive's
identifiers; and what cannot be repeated is refused. Arguments: tribotwin-hil, source tree."""
import os, re, shutil, struct, sys, time

import h5py, numpy as np

import harness
from harness import check, finish, work
from master import Master, SdoAbort, is_state
from session import connect, hold_scenario, said, start

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
address = "socketcand://127.0.0.1:29617/can0"
nodes = range(1, 7)
rate = ("--set", "telemetry_rate_hz=500")
os.chdir(work)


def begin(name, *more):
    """Drives that record NAME.log and the folder NAME, and their master."""
    drives = start(
        hil,
        "drive",
        scenario,
        "--can",
        address,
        "--quiet",
        "--record",
        f"{name}.log",
        "-o",
        name,
        *rate,
        *map(str, more),
    )
    return drives, Master(connect(address, "socketcand", "can0"), nodes)


def enable(master):
    master.nmt(1)
    for word in (0x80, 0x00, 0x06, 0x07, 0x0F):
        master.control(word)
        master.cycle()
        master.cycle()
    return all(is_state(master.status[n], "operation enabled") for n in nodes)


def move(master, cycles, silent=()):
    """Joint 4 moves back and forth, by cycles of at least 4 ms."""
    home = dict(master.position)
    for k in range(cycles):
        for n in nodes:
            target = home[n] + (20000 * (k % 200) // 200 if n == 4 else 0)
            master.send(0x400 + n, struct.pack("<Hi", 0x0F, target))
        before = dict(master.tpdo3)
        master.sync()
        master.until(lambda: all(master.tpdo3[n] > before[n] for n in nodes if n not in silent), 0.05)
        time.sleep(0.003)


def end(drives, master):
    master.bus.shutdown()
    drives.terminate()
    check("the drives end when asked", drives.wait(10) == 0, said())


def replay(log, *more):
    return harness.run(hil, "replay", scenario, log, "--fast", *more)


def same_telemetry(a, b):
    with h5py.File(f"{work}/{a}/telemetry.h5") as a, h5py.File(f"{work}/{b}/telemetry.h5") as b:
        rows = [f["time_s"].shape[0] for f in (a, b)]
        return rows[0] == rows[1] > 100 and all(
            np.array_equal(a[j][c][:], b[j][c][:]) for j in a if isinstance(a[j], h5py.Group) for c in a[j]
        )


def repeats(name, log, *more):
    r = replay(f"{log}.log", "-o", f"{log}_again", *rate, *more)
    check(
        name + ": the same frames",
        r.returncode == 0 and ": 0 differ, 0 missing, 0 added" in r.stdout,
        (r.returncode, r.stdout, r.stderr),
    )
    check(name + ": the same telemetry, bit for bit", same_telemetry(log, f"{log}_again"))


def refused(name, log, *more, says, code=2):
    r = replay(log, *more)
    check(name, r.returncode == code and all(s in r.stderr for s in says), (r.returncode, r.stdout, r.stderr))


# In real time the robot moves with the clock: what the log does not say is in the file beside it.
drives, master = begin("clock", "--realtime", "--cycle", 4)
check("in real time: enabled", enable(master), master.status)
move(master, 300)
moved = abs(master.position[4])
time.sleep(0.7)  # no SYNC: the watch of the SYNC stops them, and the reaction is repeated too
check("and stopped by the lost SYNC", {c for _, (c, _) in master.emergencies} <= {0x8700, 0x8250}, master.emergencies)
end(drives, master)
check("the arm moved", moved > 1000, moved)
repeats("in real time", "clock", "--cycle", 4)

# Injected faults: of frames, of the link, of drives.
FAULTS = (  # kind, begin and duration [s], more keys
    ("over_temperature", 0.3, 0.05, "node: 5, temperature_degC: 140"),
    ("encoder_freeze", 0.5, 0.3, "node: 4"),
    ("safe_torque_off", 0.6, 0.1, "node: 2"),
    ("drop", 0.9, 0.2, "probability: 0.1"),
    ("delay", 1.1, 0.2, "delay_s: 0.004, probability: 0.2"),
    ("duplicate", 1.3, 0.2, "probability: 0.5"),
    ("silence", 1.5, 0.1, "node: 6"),
    ("link_down", 1.7, 0.3, "node: 0"),
)
for clock in ("--sync-lockstep", "--realtime"):
    log, before_s = "faults" + clock, 1.5 if clock == "--realtime" else 0
    with open("faults.yaml", "w") as f:
        f.write("faults:\n")
        for kind, at, duration, more in FAULTS:
            f.write(f"  - {{kind: {kind}, time_s: {before_s + at}, duration_s: {duration}, {more}}}\n")
    drives, master = begin(log, clock, "--faults", "faults.yaml", "--cycle", 4)
    check(f"faults {clock}: enabled", enable(master), master.status)
    master.write(4, 0x6065, 0, "I", 3000)
    master.write(4, 0x6066, 0, "H", 10)
    move(master, 500)
    end(drives, master)
    codes = {code for _, (code, _) in master.emergencies}
    check(f"faults {clock}: they happened", {0x4310, 0x8611, 0x9000} <= codes, master.emergencies)
    repeats(f"faults {clock}", log, "--cycle", 4)

# A second node with the number of a drive: its frames are not the drive's.
drives, master = begin("foreign", "--cycle", 4)
check("two of one number: enabled", enable(master), master.status)
for k in range(50):
    master.send(0x184, [0x37, 0x12])
    master.send(0x704, [0x05])
    move(master, 1)
    master.send(0x384, bytes(6))
end(drives, master)
foreign = [l for l in open("foreign.log") if re.search(" (184#3712|704#05|384#000000000000)$", l)]
check("the log holds them", len(foreign) >= 150, len(foreign))
repeats("two of one number", "foreign", "--cycle", 4)


# How the drives started is in the file beside the log: an EDS, a DCF, a store, no node numbers. The files may change.
def own_eds(node):
    return harness.run(hil, "eds", scenario, "--node", node).stdout


with open("other.eds", "w") as f:
    f.write(own_eds(3) + "\n[3000]\nParameterName=gain\nDataType=3\nAccessType=rw\nDefaultValue=-7\n")
with open("node2.dcf", "w") as f:
    f.write(
        own_eds(2)
        .replace("[DeviceInfo]", "[DeviceComissioning]\nNodeID=2\n\n[DeviceInfo]")
        .replace("[1017]\n", "[1017]\nParameterValue=77\n")
        .replace("[605A]\n", "[605A]\nParameterValue=6\n")
    )
files = ("--eds", "other.eds", "--dcf", "node2.dcf")
drives, master = begin("files", *files, "--cycle", 4)
check("an EDS and a DCF: enabled", enable(master), master.status)
check("they hold", (master.read(5, 0x3000, 0, "h"), master.read(2, 0x1017, 0, "H")) == (-7, 77))
move(master, 100)
end(drives, master)
repeats("an EDS and a DCF", "files", "--cycle", 4)
r = replay("files.log", *files, "--cycle", 4)
check("the options may be given", r.returncode == 0, (r.returncode, r.stderr))
shutil.copy("node2.dcf", "same.dcf")
with open("node2.dcf", "a") as f:
    f.write("; changed\n")
refused("a DCF that has changed", "files.log", "--cycle", 4, *files, says=["--dcf node2.dcf", "leave the option out"])
r = replay("files.log", "--dcf", "same.dcf", "--cycle", 4)
check("the same DCF of another name", r.returncode == 0, (r.returncode, r.stderr))
os.remove("other.eds")
os.remove("node2.dcf")
r = replay("files.log", "--cycle", 4)
check("the files may be gone", r.returncode == 0, (r.returncode, r.stderr))
refused("an option that was none", "clock.log", "--cycle", 4, "--unconfigured", says=["without --unconfigured"])
refused("a file that was none", "clock.log", "--cycle", 4, "--dcf", "same.dcf", says=["without --dcf"])

os.mkdir("disk")
drives, master = begin("stored", "--store", "disk/s", "--cycle", 4)
SAVE = 0x65766173
master.nmt(0x80)
master.write(2, 0x605A, 0, "h", 6)
master.write(2, 0x1010, 1, "I", SAVE)
shutil.copy("disk/s", "kept")
shutil.rmtree("disk")
try:
    master.write(3, 0x1010, 1, "I", SAVE)
except SdoAbort as abort:
    check("a store that cannot be written", abort.code == 0x06060000, abort)
master.nmt(0x81, 2)
check("node 2 boots", master.until(lambda: 2 in master.boots))
check("with what it kept", master.read(2, 0x605A, 0, "h") == 6)
check("a store: enabled", enable(master), master.status)
move(master, 50)
end(drives, master)
repeats("a store that begins and fails", "stored", "--cycle", 4)
check("a replay writes no store", not os.path.exists("disk"))
shutil.copy("kept", "s")
drives, master = begin("kept_before", "--store", "s", "--cycle", 4)
check("a store from before: enabled", enable(master), master.status)
check("it holds", master.read(2, 0x605A, 0, "h") == 6)
move(master, 50)
master.control(0)
for _ in range(200):
    master.cycle()
master.write(4, 0x605A, 0, "h", 5)
master.write(4, 0x1010, 1, "I", SAVE)
end(drives, master)
repeats("a store from before", "kept_before", "--cycle", 4)
r = replay("kept_before.log", "--store", "s", "--cycle", 4)
check("a store that has changed since is noted", r.returncode == 0 and "--store s: is not what" in r.stderr, r.stderr)
os.remove("s")
r = replay("kept_before.log", "--cycle", 4)
check("or gone", r.returncode == 0, (r.returncode, r.stderr))

drives, master = begin("numbered", "--unconfigured", "--cycle", 4)
for _ in nodes:
    identity = master.lss_scan()
    check(f"LSS finds {identity}", identity and master.lss_number(identity[3]) == 0)
    master.lss_state(0)
    check("it boots", master.until(lambda: identity[3] in master.boots), master.boots)
check("numbered by LSS: enabled", enable(master), master.status)
move(master, 50)
end(drives, master)
repeats("numbered by LSS", "numbered", "--cycle", 4)

# Another scenario: the difference says so.
r = replay("numbered.log", "--cycle", 4, "--set", "seed=77", "--set", "temperature_degC=20")
check("another scenario", r.returncode == 1 and "another scenario" in r.stderr, (r.returncode, r.stderr))

# A session that was killed: what reached the disk repeats.
drives, master = begin("killed", "--realtime", "--cycle", 4)
check("to be killed: enabled", enable(master), master.status)
move(master, 200)
drives.kill()
drives.wait(10)
master.bus.shutdown()
r = replay("killed.log", "--cycle", 4)
compared = re.search(r"(\d+) from the drives: 0 differ, 0 missing, 0 added", r.stdout)
check(
    "a killed session repeats as far as it goes",
    r.returncode == 1 and compared and int(compared[1]) > 500 and "compared up to" in r.stderr,
    (r.returncode, r.stdout, r.stderr),
)

# What does not belong together, or is no session file, is refused: no verdict then.
refused("another cycle than recorded", "clock.log", "--cycle", 2, says=["clock.log.session", "--cycle 4", "--cycle 2"])
shutil.copy("clock.log.session", "foreign_of_clock.log.session")
shutil.copy("foreign.log", "foreign_of_clock.log")
refused(
    "the session file of another log",
    "foreign_of_clock.log",
    "--cycle",
    4,
    says=["foreign_of_clock.log.session", "belong"],
)
lines = open("clock.log.session").readlines()
for name, wrong, says in (
    ("a line that is none", lines[:20] + ["1000 x\n"] + lines[20:], ":21: "),
    ("an event that is none", lines[:20] + ["0 event=abc\n"] + lines[20:], "must be a mapping"),
    ("an event that is no YAML", lines[:20] + ["0 event=[\n"] + lines[20:], "not well-formed YAML (end of sequence"),
    ("a file that is none", ["hello\n"], ":1: "),
    ("an empty file", [], "empty"),
):
    shutil.copy("clock.log", "wrong.log")
    with open("wrong.log.session", "w") as f:
        f.writelines(wrong)
    refused("a session file with " + name, "wrong.log", "--cycle", 4, says=["wrong.log.session", says])
with open("wrong.log.session", "w") as f:  # as after kill -9
    f.writelines(lines[: len(lines) // 2])
refused("a session that was killed", "wrong.log", "--cycle", 4, says=["wrong.log.session", "compared up to"], code=1)
shutil.copy("clock.log", "alone.log")
refused("a log without its session file", "alone.log", "--cycle", 4, says=["alone.log.session", "--realtime"], code=1)
r = harness.run(hil, "drive", scenario, "--can", "memory:x", "--realtime", "--duration", 0.1, "--record", "clock.log")
check("a record is not replaced", r.returncode == 2 and "clock.log" in r.stderr, r.stderr)
os.remove("clock.log")
r = harness.run(hil, "drive", scenario, "--can", "memory:x", "--realtime", "--duration", 0.1, "--record", "clock.log")
check("nor is its session file", r.returncode == 2 and "clock.log.session" in r.stderr, r.stderr)
os.mkfifo("pipe")
reader = os.open("pipe", os.O_RDONLY | os.O_NONBLOCK)
r = harness.run(hil, "drive", scenario, "--can", "memory:x", "--realtime", "--duration", 0.1, "--record", "pipe")
check("a pipe has no file beside it, and that is said", r.returncode == 0 and "will not repeat" in r.stderr, r.stderr)
os.close(reader)

finish()
