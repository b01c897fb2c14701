"""Wrong usage of tribotwin-hil: one line that says what would be right, exit code 2; and the examples of --help.
Arguments: tribotwin-hil, source tree."""
import os, socket, sys

import harness
from harness import check, finish, work
from session import hold_scenario

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
for folder in ("twin", "mjcf"):
    os.symlink(os.path.join(source, folder), os.path.join(work, folder))


def run(*arguments):
    return harness.run(hil, *arguments, timeout=60)


def refused(name, *arguments, says, code=2):
    r = run(*arguments)
    lines = r.stderr.strip().splitlines()
    check(
        name,
        r.returncode == code
        and any(says in line for line in lines)
        and (len(lines) == 1 or "--help" in r.stderr)
        and r.stdout == "",
        (r.returncode, r.stdout, r.stderr),
    )


with open(os.path.join(work, "bad.eds"), "w") as f:
    f.write("[FileInfo]\nrubbish\n")
refused(
    "conform: no EDS", "conform", "--can", "memory:x", "--eds", "bad.eds", says="bad.eds:2: must be [SECTION], or KEY="
)
refused("conform: no such node", "conform", "--can", "memory:x", "--node", "128", says="128")
refused("conform: no such check", "conform", "--can", "memory:x", "--only", "sdo,x", says="no check is called 'x'")
refused("conform: homing is a motion", "conform", "--can", "memory:x", "--homing", says="--motion")
refused("conform: nobody answers", "conform", "--can", "memory:x", "--quiet", says="node 1 does not answer", code=1)

taken = socket.socket()
taken.bind(("127.0.0.1", 0))
taken.listen()
port = taken.getsockname()[1]
refused("port taken", "drive", scenario, "--can", f"socketcand://127.0.0.1:{port}/can0", says=str(port))
refused("not loopback", "drive", scenario, "--can", "socketcand://0.0.0.0:29700/can0", says="loopback")
refused("not an address", "drive", scenario, "--can", "tcp:nowhere", says="socketcand://")
refused("a log is not a bus", "drive", scenario, "--can", "log:x.log", says="replay")
refused(
    "no such interface",
    "drive",
    scenario,
    "--can",
    "vcan7",
    says="CAN" if not os.path.exists("/proc/net/can") else "vcan7",
)
refused(
    "impossible budget", "drive", scenario, "--can", "memory:x", "--bitrate", "1e6", "--cycle", "1", says="% of the bus"
)
for command, option in (
    ("drive", "--cycle"),
    ("drive", "--duration"),
    ("drive", "--bitrate"),
    ("budget", "--cycle"),
    ("budget", "--bitrate"),
    ("eds", "--cycle"),
    ("ros2", "--cycle"),
    ("shadow", "--limit"),
    ("shadow", "--limit-time"),
    ("conform", "--boot-time"),
):
    for value in ("nan", "inf"):
        given = () if command == "conform" else (scenario,)
        where = ("--can", "memory:x") if command in ("drive", "shadow", "conform") else ()
        refused(f"{command} {option} {value}", command, *given, *where, f"{option}={value}", says="finite")
refused("unknown profile", "drive", scenario, "--can", "memory:x", "--profile", "ethercat", says="ethercat")
refused("node numbers beyond 127", "drive", scenario, "--can", "memory:x", "--first-node", "125", says="at most 127")
refused("both clocks", "drive", scenario, "--can", "memory:x", "--realtime", "--sync-lockstep", says="excludes")
refused("no scenario", "drive", "nowhere.yaml", "--can", "memory:x", says="nowhere.yaml")
refused("no log", "replay", scenario, "nowhere.log", says="nowhere.log")
refused("no log to shadow", "shadow", scenario, "--can", "log:nowhere.log", says="nowhere.log")
refused("no such node", "eds", scenario, "--node", "9", says="nodes 1 to 6")
both = "--can", "memory:a=joint1,joint2,joint3", "--can"
for name, buses, says in (
    ("one bus twice", both + ("memory:a=joint4,joint5,joint6",), "both are the bus memory:a"),
    ("an interface twice", ("--can", "vcan7=joint1", "--can", "socketcan:vcan7=joint2"), "both are the bus vcan7"),
    ("a joint on both buses", both + ("memory:b=joint3,joint4,joint5,joint6",), "joint3 is in --can memory:a="),
    ("a joint twice on one bus", ("--can", "memory:a=joint1,joint1"), "joint1 is in --can memory:a="),
    ("a joint on no bus", both + ("memory:b=joint4,joint5",), "joint6 is on no bus"),
    ("a joint on no bus of one", ("--can", "memory:a=joint1"), "joint2 is on no bus"),
    ("no such joint", both + ("memory:b=joint4,elbow",), "no joint 'elbow'; there are joint1, joint2"),
    ("no joints", both + ("memory:b=",), "no joint ''"),
    (
        "a bus without joints",
        both + ("memory:b",),
        "--can memory:b: which joints are on it? For example --can memory:a=",
    ),
    ("no bus", both + ("=joint4,joint5,joint6",), "names no bus"),
    ("three buses", both + ("memory:b=joint4", "--can", "memory:c=joint5,joint6"), "3 buses"),
):
    refused(name, "drive", scenario, *buses, says=says)
    refused(name + ", budget", "budget", scenario, *buses, says=says)
wired = both + ("memory:b=joint4,joint5,joint6",)
refused("a bus that cannot be", "drive", scenario, *both, "tcp:x=joint4,joint5,joint6", says="socketcand://")
refused(
    "two buses: impossible budget", "drive", scenario, *wired, "--bitrate", "1e6", "--cycle", "0.5", says="memory:a: "
)
for fault, says in (
    ("kind: silence, node: 4, bus: can1", "nodes 1 to 3"),
    ("kind: silence, node: 2", "bus: is needed"),
    ("kind: link_down, bus: can2", "can0"),
):
    with open(os.path.join(work, "faults.yaml"), "w") as f:
        f.write("faults: [{%s, time_s: 0, duration_s: 1}]\n" % fault)
    refused("faults on two buses: " + fault, "drive", scenario, *wired, "--faults", "faults.yaml", says=says)
r = run("budget", scenario, *wired, "--cycle", "1")
check(
    "budget per bus: three drives at 1 kHz fit",
    r.returncode == 0 and [line.split(":")[1] for line in r.stdout.splitlines()] == ["a", "b"],
    (r.returncode, r.stdout, r.stderr),
)
with open(os.path.join(work, "bad.log"), "w") as f:
    f.write("(1.000000) can0 080#\nrubbish\n")
refused("a log with a line that is none", "replay", scenario, "bad.log", "--fast", says="bad.log:2")
refused("a log in which no drive speaks", "shadow", scenario, "--can", "log:bad.log", says="bad.log:2")
with open(os.path.join(work, "quiet.log"), "w") as f:
    f.write("(1.000000) can0 080#\n(1.002000) can0 080#\n")
refused("nothing heard", "shadow", scenario, "--can", "log:quiet.log", says="no position was heard of joint1")
refused(
    "a log that is a recording",
    "drive",
    scenario,
    "--can",
    "memory:x",
    "--record",
    "quiet.log",
    says="quiet.log: holds a session already",
)
os.mkdir(os.path.join(work, "live"))
with open(os.path.join(work, "live", "telemetry.h5"), "w") as f:
    f.write("somebody's")
refused(
    "a folder that holds a session",
    "drive",
    scenario,
    "--can",
    "memory:x",
    "-o",
    "live",
    says="telemetry.h5: holds a session already",
)
check(
    "and both stay as they were",
    open(os.path.join(work, "quiet.log")).read().count("\n") == 2
    and open(os.path.join(work, "live", "telemetry.h5")).read() == "somebody's",
)
r = run("budget", scenario, "--cycle", "1")
check(
    "budget beyond the bus: the figures, and exit 2",
    r.returncode == 2 and "% of the bus" in r.stdout and len(r.stderr.splitlines()) == 1,
    (r.returncode, r.stdout, r.stderr),
)
for profile in ("cia402", "mirror"):
    check("budget " + profile, run("budget", scenario, "--profile", profile).returncode == 0)
for command in ("budget", "eds", "dbc", "ros2"):
    text = run(command, "--help").stdout
    example = text[text.index("Example:") :].splitlines()[1].split()
    check("example of --help: " + " ".join(example), run(*example[1:]).returncode == 0)
finish()
