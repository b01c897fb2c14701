"""What a newcomer stumbles over: each row is a command line, its exit code and what its messages must and must not say.
Arguments: tribotwin-hil, source tree."""
import os, subprocess, sys, time

import harness
from harness import check, content, finish, path, work
from session import hold_scenario

hil, source = sys.argv[1:3]
hold = hold_scenario(source)
live = ("drive", "irb6620_hold", "--can", "memory:x", "--realtime", "--duration", "0.1")
for folder in ("twin", "mjcf"):
    os.symlink(os.path.join(source, folder), path(folder))


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)
    return name


bench = os.path.join(source, "mjcf", "rh380n_bench.xml")
scenario = content(hold)
model = os.path.join(source, "mjcf", "irb6620.xml")
write("endless.yaml", f"model: {model}\ncontrol: {{type: torque}}\n")
one_drive = write("one.yaml", f"model: {bench}\ncontrol: {{type: torque}}\n")
write("plain.xml", "<mujoco><worldbody><body><joint name='hinge'/><geom size='1'/></body></worldbody></mujoco>")
write("plain.yaml", "model: plain.xml\nduration_s: 1\n")
write("cut.log", "(1.000000) can0 080#\n(1.002000) can0 080#\n(1.00400")
write("wrong.log", "(1.000000) can0 080#\n(1.00400\n(1.002000) can0 080#\n")
os.mkdir(path("folder"))

# name, arguments, exit code, what is said, what is not said
rows = [
    ("unknown command", ["frobnicate"], 2, ["unknown command 'frobnicate'", "drive, replay"], ["subcommand"]),
    ("mistyped command", ["dirve"], 2, ["did you mean 'drive'?"], []),
    ("no command", [], 2, ["Usage: tribotwin-hil", "drive  ", "replay  "], []),
    ("mistyped option", ["drive", hold, "--cam", "vcan0"], 2, ["unknown option '--cam' of drive", "'--can'"], []),
    ("mistyped option, with =", ["budget", hold, "--cycel=4"], 2, ["unknown option '--cycel'", "'--cycle'"], ["=4"]),
    ("option before its command", ["--can", "x", "drive", hold], 2, ["--can belongs behind the command"], []),
    ("one argument too many", ["budget", hold, "more"], 2, ["unexpected argument 'more'"], []),
    *(
        (f"{option} {value}", [command, *given, option, value], 2, [option + ": must be a", value], ["0000"])
        for command, given, option, value in (
            ("shadow", [hold, "--can", "log:x"], "--limit", "-1"),
            ("shadow", [hold, "--can", "log:x"], "--limit-time", "-1"),
            ("drive", [hold, "--can", "memory:x"], "--duration", "-5"),
            ("replay", [hold, "x.log"], "--speed-factor", "0"),
            ("budget", [hold], "--cycle", "1e300"),
            ("budget", [hold], "--cycle", "often"),
            ("conform", ["--can", "memory:x"], "--node", "200"),
            ("eds", [hold], "--first-node", "1.5"),
        )
    ),
    *(
        (f"{command} {option} with an empty name", [command, *given, option, ""], 2, [option, "must not be empty"], [])
        for command, given, option in (
            ("drive", [hold, "--can", "memory:x"], "--output"),
            ("drive", [hold, "--can", "memory:x"], "--stats"),
            ("drive", [hold, "--can", "memory:x"], "--record"),
            ("drive", [hold], "--can"),
            ("replay", [hold, "x.log"], "--output"),
            ("shadow", [hold, "--can", "log:x"], "--output"),
            ("eds", [hold], "--output"),
            ("dbc", [hold], "--output"),
            ("ros2", [hold], "--output"),
            ("conform", ["--can", "memory:x"], "--output"),
        )
    ),
    ("a scenario with an empty name", ["budget", ""], 2, ["SCENARIO", "must not be empty"], []),
    ("a shipped scenario by name", ["budget", "irb6620_hold"], 0, [], []),
    ("a program is no log: replay", ["replay", hold, "/bin/ls"], 2, ["/bin/ls:1", "candump log"], []),
    ("a program is no log: shadow", ["shadow", hold, "--can", "log:/bin/ls"], 2, ["/bin/ls:1", "candump log"], []),
    ("a folder is no log", ["replay", hold, "folder"], 2, ["is a folder, not a candump log"], []),
    ("a cut log", ["shadow", hold, "--can", "log:cut.log"], 2, ["cut.log:3", "was cut", "remove the line"], []),
    ("a wrong line within a log", ["shadow", hold, "--can", "log:wrong.log"], 2, ["wrong.log:2"], ["was cut"]),
    ("a folder as a store", [*live, "--store", "folder"], 2, ["folder: is a folder; name a file"], ["-o"]),
    ("a device as a store", [*live, "--store", "/dev/null"], 2, ["--store /dev/null: must be a regular file"], []),
    ("an unknown key of --set", [*live, "--set", "nothing=1"], 2, ["--set nothing: is not known"], []),
    ("a wrong value of --set", [*live, "--set", "seed=few"], 2, ["yaml: --set seed: is 'few'"], ["yaml:1"]),
    ("an unknown mapping of --set", [*live, "--set", "some.thing=1"], 2, ["--set some: is not known"], []),
    ("a scenario without duration_s", [live[0], "endless.yaml", *live[2:]], 0, [], ["is missing"]),
    ("the same of another command", ["budget", "endless.yaml"], 0, [], ["is missing"]),
    ("a model without drives", ["budget", "plain.yaml"], 2, ["tribotwin add-drives", "-o"], []),
    ("a model is no scenario", ["budget", model], 2, ["not well-formed YAML"], []),
    ("one drive", ["drive", one_drive, *live[2:]], 0, ["1 drive, node 1, on"], ["1 to 1"]),
    ("no such node of one", ["eds", one_drive, "--node", "9"], 2, ["the scenario has node 1;"], ["1 to 1"]),
    ("no such node of six", ["eds", hold, "--node", "9"], 2, ["the scenario has nodes 1 to 6;"], []),
    ("ros2 rounds openly", ["ros2", hold, "--cycle", "2.5", "-o", "rounded"], 0, ["2500 us", "period 2 in"], []),
    ("ros2 knows the bit rate", ["ros2", hold, "--cycle", "4", "--bitrate", "5e5", "-o", "slow"], 0, ["% of the"], []),
    ("ros2 of whole cycles says nothing", ["ros2", hold, "--cycle", "10", "-o", "whole"], 0, [], ["note"]),
]
for name, arguments, code, says, hides in rows:
    r = harness.run(hil, *arguments, timeout=60)
    said = r.stderr
    check(
        name,
        r.returncode == code
        and all(s in said for s in says)
        and not any(h in said for h in hides)
        and max(map(len, said.splitlines()), default=0) < 400,
        (r.returncode, said),
    )
check("the README of ros2 names the bit rate", "At 500 kbit/s" in content(os.path.join("slow", "README.md")))


# ---- Waiting is said: for a reader or a writer of a pipe, for a SYNC.
def start(*arguments):
    return subprocess.Popen([hil, *map(str, arguments)], cwd=work, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)


def line_of(process, needle):
    """Reads messages until one holds `needle`; None at their end."""
    for line in process.stderr:
        if needle in line.decode():
            return line.decode()
    return None


harness.run(hil, "eds", hold, "-o", "drive.eds")
for name, arguments, needle, feeds in (
    ("drive --stats", [*live, "--stats", "pipe"], "waiting for a reader", False),
    ("dbc -o", ["dbc", hold, "-o", "pipe"], "waiting for a reader", False),
    ("drive --eds", [*live, "--eds", "pipe"], "waiting for a writer", True),
    ("budget SCENARIO", ["budget", "pipe"], "waiting for a writer", True),
):
    os.mkfifo(path("pipe"))
    process = start(*arguments)
    line = line_of(process, needle)
    check(f"{name} of a pipe: the wait is said", line is not None and line.startswith("note: pipe: is a pipe;"), line)
    with open(path("pipe"), "w" if feeds else "r") as f:
        if feeds:
            f.write(content("drive.eds") if "eds" in name else content("endless.yaml") + "duration_s: 1\n")
        else:
            received = f.read()
    check(f"{name} of a pipe: then it works", process.wait(60) == 0 and (feeds or len(received) > 100))
    os.remove(path("pipe"))
os.mkfifo(path("pipe"))
r = harness.run(hil, *live, "--store", "pipe", timeout=60)
check("a pipe is no store", r.returncode == 2 and "must be a regular file" in r.stderr, r.stderr)

process = start("drive", hold, "--can", "memory:x")
check("lockstep on memory: is said", line_of(process, "no master can reach it") is not None)
check("and that no SYNC came", line_of(process, "no SYNC yet") is not None)
process.terminate()
check("and it ends with a signal", process.wait(60) == 0)

# ---- Logs and their sessions.
mirror = ("--profile", "mirror")
r = harness.run(hil, *live[:-1], "2", *mirror, "--record", "short.log", timeout=60)
check("a session of 2 s is recorded", r.returncode == 0, r.stderr)
listen = ("shadow", live[1], "--can", "log:short.log", *mirror)
for name, arguments, says, hides in (
    ("a --duration beyond the log", ["--duration", "60"], ["short.log: ends after", "before the 60 s"], ["lockstep"]),
    ("a --duration within the log", ["--duration", "1.5"], [], ["ends after", "note: short.log"]),
    ("a log of another scenario", ["--set", "ambient_degC=20"], ["with another scenario than"], ["lockstep"]),
    ("--lockstep of a session in real time", ["--lockstep"], ["with --realtime; leave --lockstep out"], []),
):
    r = harness.run(hil, *listen, *arguments, timeout=60)
    check(
        name,
        r.returncode in (0, 2) and all(s in r.stderr for s in says) and not any(h in r.stderr for h in hides),
        r.stderr,
    )
session = content("short.log.session")
write("short.log.session", session.replace("clock realtime", "clock lockstep"))
r = harness.run(hil, *listen, timeout=60)
check("a log of lockstep without --lockstep", "give --lockstep --cycle 2" in r.stderr, r.stderr)
r = harness.run(hil, *listen, "--lockstep", "--cycle", "4", timeout=60)
check("and with another cycle", "was recorded with --cycle 2, not with --cycle 4" in r.stderr, r.stderr)
finish()
