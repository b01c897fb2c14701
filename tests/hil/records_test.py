"""Nothing recorded is lost, and exit 0 means done: what tribotwin-hil refuses to overwrite, what it says where nothing
was compared, how it ends on a signal, on a full disk and without a reader of what it says. Arguments: tribotwin-hil,
source tree."""
import atexit, hashlib, json, os, pty, re, resource, shutil, signal, subprocess, sys, time

import h5py

import harness
from harness import check, finish, path, work
from master import Master
from session import connect, hold_scenario

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
nodes = range(1, 7)
address = "socketcand://127.0.0.1:29612/can0"
realtime = ("drive", scenario, "--can", "memory:x", "--realtime", "--profile", "mirror", "--cycle", "4")
os.chdir(work)


def run(*arguments, **more):
    return harness.run(hil, *arguments, timeout=60, **{"cwd": None, **more})


def answers(name, code, *arguments, says=(), out="", **more):
    """One line on stderr that says all of `says`, and this exit code. `out` stands on stdout, whatever the blanks."""
    r = run(*arguments, **more)
    lines = r.stderr.splitlines()
    check(
        name,
        r.returncode == code
        and len(lines) == (1 if says else 0)
        and all(s in r.stderr for s in says)
        and " ".join(out.split()) in " ".join(r.stdout.split()),
        (r.returncode, r.stdout, r.stderr),
    )
    return r


def shadow_of(log):
    return "shadow", scenario, "--lockstep", "--can", "log:" + log


def contents(*paths):
    found = []
    for path in paths:
        for folder, _, files in os.walk(path) if os.path.isdir(path) else [(".", None, [path])]:
            found += [
                (f, hashlib.sha256(open(os.path.join(folder, f), "rb").read()).hexdigest()) for f in sorted(files)
            ]
    return found


def begin(*arguments, **more):
    p = subprocess.Popen([hil, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)
    atexit.register(p.kill)
    return p


def waits_for(p, pipe):
    """Whether the program has opened the pipe and sleeps, which on a busy machine it is late to do."""
    folder = f"/proc/{p.pid}/fd"
    try:
        opened = any(os.path.realpath(os.path.join(folder, fd)) == path(pipe) for fd in os.listdir(folder))
        with open(f"/proc/{p.pid}/stat") as f:
            return opened and f.read().rsplit(")", 1)[1].split()[0] == "S"
    except FileNotFoundError:  # it has ended, or closed a file meanwhile
        return False


def ends(name, p, code, says="", out="", number=signal.SIGTERM):
    """After a signal; the limit leaves room for a busy machine."""
    p.send_signal(number)
    since = time.monotonic()
    try:
        stdout, stderr = p.communicate(timeout=5)
    except subprocess.TimeoutExpired:
        p.kill()
        p.communicate()
        check(name, False, "does not end")
        return
    check(name, p.returncode == code and says in (stderr or "") and out in stdout, (p.returncode, stdout, stderr))
    print("        %.2f s after the signal" % (time.monotonic() - since))


def until(condition, seconds=10):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return condition()


def size(path):
    return os.path.getsize(path) if os.path.exists(path) else 0


def simulated_s(statistics):
    return json.load(open(statistics))["simulated_s"] if os.path.exists(statistics) else 0


def is_complete(folder):
    with h5py.File(folder + "/telemetry.h5") as f:  # fails unless it was closed
        return bool(f["complete"][()])


def record_a_session():
    """session.log and live/: 900 cycles of which the last 890 have torques and drives that hold the arm; the first are
    those of the default mapping."""
    p = begin("drive", scenario, "--can", address, "--record", "session.log", "--stats", "stats.json", "-o", "live")
    time.sleep(1)
    master = Master(connect(address, "socketcand", "can0"), nodes)
    master.nmt(1)
    check("drives answer", all(master.cycle() for _ in range(10)))
    for n in nodes:
        master.send_torque(n)
    for word in (0x06, 0x07, 0x0F):
        master.control(word)
    for _ in range(890):
        master.cycle()
    master.bus.shutdown()
    ends("an open session ends by a signal: done", p, 0, says="interrupted at 1.8")


def logs_of_the_session():
    lines = open("session.log").readlines()
    of = lambda line: int(line.split()[2].split("#")[0], 16)
    with open("default.log", "w") as f:  # whoever did not hear the master map torques
        f.writelines(l for l in lines if of(l) & 0x780 not in (0x600, 0x480))
    with open("some.log", "w") as f:
        f.writelines(l for l in lines if of(l) & 0x780 not in (0x600, 0x480) or of(l) & 0x7F in (1, 2))
    with open("cut.log", "w") as f:
        f.writelines(lines[:-4])
    with open("gap.log", "w") as f:
        f.writelines(l for i, l in enumerate(lines) if i not in (len(lines) - 40, len(lines) - 80))
    with open("three.log", "w") as f:
        f.writelines(l for l in lines if of(l) & 0x7F not in (4, 5, 6) or of(l) < 0x81)
    with open("silent.log", "w") as f:  # joint3's torque ends
        f.writelines(l for i, l in enumerate(lines) if of(l) != 0x483 or i < len(lines) // 2)
    with open("short.log", "w") as f:
        f.writelines(lines[: lines.index([l for l in lines if " 080#" in l][8])])
    open("empty.log", "w").close()


record_a_session()
logs_of_the_session()

# 1. A record is not replaced.
before = contents("live", "session.log", "stats.json")
answers(
    "replay into the folder of a live session",
    2,
    "replay",
    scenario,
    "session.log",
    "--fast",
    "-o",
    "live",
    says=["live/telemetry.h5", "holds a session already", "--force"],
)
answers(
    "drive onto a record",
    2,
    *realtime,
    "--duration",
    "0.1",
    "--record",
    "session.log",
    says=["session.log", "holds a session already", "--force"],
)
answers(
    "drive onto statistics",
    2,
    *realtime,
    "--duration",
    "0.1",
    "--stats",
    "stats.json",
    says=["stats.json", "already", "--force"],
)
answers(
    "shadow onto a CSV", 2, *shadow_of("session.log"), "--csv", "stats.json", says=["stats.json", "already", "--force"]
)
answers("eds onto a file", 2, "eds", scenario, "-o", "stats.json", says=["stats.json: exists", "--force"])
answers("dbc onto a file", 2, "dbc", scenario, "-o", "stats.json", says=["stats.json: exists", "--force"])
check("all stays as it was", contents("live", "session.log", "stats.json") == before)
shutil.copytree("live", "again")
shutil.copy("session.log", "again.log")
answers(
    "--force replaces a session's folder",
    0,
    "replay",
    scenario,
    "session.log",
    "--fast",
    "-o",
    "again",
    "--force",
    out=" 0 differ, 0 missing, 0 added",
)
check("which holds the replay then", contents("again") != contents("live"))
answers("--force replaces files", 0, *realtime, "--quiet", "--duration", "0.1", "--record", "again.log", "--force")
check(
    "which holds the new session then",
    0 < size("again.log") < size("session.log"),
    (size("again.log"), size("session.log")),
)
for command in ("eds", "dbc"):
    with open("old." + command, "w") as f:
        f.write("old")
    answers(command + " --force", 0, command, scenario, "-o", "old." + command, "--force")
    check("which holds it then", size("old." + command) > 1000)
first = begin(*realtime, "--quiet", "--record", "shared.log")
check("a session grows", until(lambda: size("shared.log") > 0))
answers(
    "a second session on the same record",
    1,
    *realtime,
    "--quiet",
    "--duration",
    "0.1",
    "--record",
    "shared.log",
    "--force",
    says=["shared.log", "another session"],
)
ends("the first one goes on", first, 0)
check("its record is whole", open("shared.log").read().startswith("(") and open("shared.log").read().endswith("\n"))

# 2. An output is no input, also through links, also with --force.
os.symlink("session.log", "linked.log")
os.link("session.log", "hard.log")
os.symlink(".", "here")
os.mkdir("folder")
for folder in (".", "folder"):
    for xml in ("irb6620.xml", "scene.xml"):
        shutil.copy(os.path.join(source, "mjcf", xml), folder)
os.rename("irb6620.xml", "arm.xml")
os.rename("folder/irb6620.xml", "folder/arm.xml")
with open("own.yaml", "w") as f:
    f.write(re.sub(r"model: .*", "model: arm.xml", open(scenario).read()))
with open("faults.yaml", "w") as f:
    f.write("faults: [{kind: drop, time_s: 1, duration_s: 1}]\n")
shutil.copy("own.yaml", "folder/scenario.yaml")
shutil.copy("session.log", "folder/telemetry.h5")
before = contents("session.log", "own.yaml", "arm.xml", "faults.yaml", "folder")
shadow = ("shadow", "own.yaml", "--lockstep", "--can", "log:session.log", "--force", "--csv")
drive = ("drive", "own.yaml", "--can", "memory:x", "--realtime", "--duration", "0.1", "--force")
for name, arguments, says in (
    ("a log as its CSV", (*shadow, "session.log"), ("-o session.log", "--can log:session.log")),
    ("through a symbolic link", (*shadow, "linked.log"), ("-o linked.log", "--can log:session.log")),
    ("through a hard link", (*shadow, "hard.log"), ("-o hard.log", "--can log:session.log")),
    ("through a folder's link", (*shadow, "here/session.log"), ("-o here/session.log", "--can log:session.log")),
    ("a scenario as the CSV", (*shadow, "own.yaml"), ("-o own.yaml", "SCENARIO own.yaml")),
    ("a model as the CSV", (*shadow, "arm.xml"), ("-o arm.xml", "arm.xml of own.yaml")),
    (
        "a log in the folder of a replay",
        ("replay", "own.yaml", "folder/telemetry.h5", "--fast", "--force", "-o", "folder"),
        ("-o folder", "LOG folder/telemetry.h5"),
    ),
    (
        "a log as the folder of a replay",
        ("replay", "own.yaml", "session.log", "--fast", "--force", "-o", "session.log"),
        ("-o session.log", "LOG session.log"),
    ),
    (
        "a scenario in the folder of a replay",
        ("replay", "folder/scenario.yaml", "session.log", "--fast", "--force", "-o", "folder"),
        ("scenario.yaml of -o folder", "SCENARIO folder/scenario.yaml"),
    ),
    (
        "a scenario in the folder of a session",
        ("drive", "folder/scenario.yaml", *drive[2:], "-o", "folder"),
        ("scenario.yaml of -o folder", "SCENARIO folder/scenario.yaml"),
    ),
    ("a scenario as the record", (*drive, "--record", "own.yaml"), ("--record own.yaml", "SCENARIO own.yaml")),
    ("a scenario as the statistics", (*drive, "--stats", "own.yaml"), ("--stats own.yaml", "SCENARIO own.yaml")),
    (
        "faults as the statistics",
        (*drive, "--faults", "faults.yaml", "--stats", "./faults.yaml"),
        ("--stats ./faults.yaml", "--faults faults.yaml"),
    ),
    (
        "faults as the record",
        (*drive, "--faults", "faults.yaml", "--record", "faults.yaml"),
        ("--record faults.yaml", "--faults faults.yaml"),
    ),
    (
        "two outputs in one file",
        (*drive, "--record", "new", "--stats", "here/new"),
        ("--record new", "--stats here/new"),
    ),
    (
        "a record in the telemetry",
        (*drive, "--record", "new/telemetry.h5", "-o", "new"),
        ("--record new/telemetry.h5", "telemetry.h5 of -o new"),
    ),
    ("a scenario as the EDS", ("eds", "own.yaml", "--force", "-o", "own.yaml"), ("-o own.yaml", "SCENARIO own.yaml")),
    ("a model as the DBC", ("dbc", "own.yaml", "--force", "-o", "arm.xml"), ("-o arm.xml", "arm.xml of own.yaml")),
):
    answers(name, 2, *arguments, says=says)
check(
    "all stays as it was",
    contents("session.log", "own.yaml", "arm.xml", "faults.yaml", "folder") == before and not os.path.exists("new"),
)
answers("a device may be both", 2, *shadow_of("/dev/null"), "--csv", "/dev/null", says=["no position was heard"])

# 3. What was not compared is not well.
answers(
    "a limit without any torque",
    2,
    *shadow_of("default.log"),
    "--limit",
    "1",
    says=["--limit 1", "joint1, joint2, joint3, joint4, joint5, joint6", "6077h", "TPDO"],
    out="joint6 0 -",
)
answers(
    "a limit without some torques",
    2,
    *shadow_of("some.log"),
    "--limit",
    "1e6",
    says=["of joint3, joint4, joint5, joint6:", "6077h", "--joint"],
)
answers(
    "only joints that have some", 0, *shadow_of("some.log"), "--limit", "1e6", "--joint", "joint1", "--joint", "joint2"
)
answers(
    "a joint that there is not",
    2,
    *shadow_of("some.log"),
    "--limit",
    "1e6",
    "--joint",
    "joint9",
    says=["joint9", "joint1, joint2"],
)
answers("a limit that is kept", 0, *shadow_of("session.log"), "--limit", "1e6")
answers(
    "a limit over less than its time",
    2,
    *shadow_of("session.log"),
    "--limit",
    "1e6",
    "--limit-time",
    "5",
    says=["joint1", "5 s of --limit-time"],
)
answers(
    "a shadow without torques predicts, and says that it compares nothing",
    0,
    *shadow_of("default.log"),
    says=["no torque was heard of joint1", "nothing was compared"],
    out="joint1 0 -",
)
r = answers(
    "a torque that is heard no more",
    0,
    *shadow_of("silent.log"),
    "--limit",
    "1e6",
    says=["joint3: no torque for 0.5 s"],
)
samples = [int(line.split()[1]) for line in r.stdout.splitlines()[2:]]
# A session begins and ends within a cycle: some drives are heard once or twice more than others.
check("is compared no more", samples[2] < samples[1] - 100 and abs(samples[1] - samples[3]) < 5, samples)
answers("too few cycles for a prediction", 2, *shadow_of("short.log"), "--csv", "short.csv", says=["takes 0.24 s"])
check("and no CSV without rows", not os.path.exists("short.csv"))
answers("replay: all the same", 0, "replay", scenario, "session.log", "--fast", out=" 0 differ, 0 missing, 0 added")
answers(
    "replay of an empty log",
    2,
    "replay",
    scenario,
    "empty.log",
    "--fast",
    "-o",
    "nothing",
    says=["empty.log", "no frame"],
)
check("and no folder without frames", not os.path.exists("nothing"))
answers(
    "replay of other nodes",
    2,
    "replay",
    scenario,
    "session.log",
    "--fast",
    "--first-node",
    "20",
    says=["joint1, joint2, joint3, joint4, joint5, joint6", "--first-node 20"],
)
answers(
    "replay of some nodes",
    2,
    "replay",
    scenario,
    "three.log",
    "--fast",
    says=["of joint4, joint5, joint6;", "--first-node 1"],
)
answers(
    "replay of a log whose end is missing",
    1,
    "replay",
    scenario,
    "cut.log",
    "--fast",
    says=["cut.log", "not recorded"],
    out=" 0 missing, 4 added",
)
answers("replay of a log with gaps", 1, "replay", scenario, "gap.log", "--fast", says=["gap.log"], out=" 2 added")

# 4. A signal ends everything, and what was written is whole.
os.mkfifo("fifo")
p = begin(*shadow_of("fifo"))
until(lambda: waits_for(p, "fifo"))
ends("shadow of a pipe without writer", p, 1, says="interrupted")
p = begin("replay", scenario, "fifo", "--fast")
until(lambda: waits_for(p, "fifo"))
ends("replay of a pipe without writer", p, 1, says="interrupted")
p = begin(*shadow_of("fifo"), "--csv", "part.csv")
with open("fifo", "w") as f:
    f.write("".join(open("session.log").readlines()[:-1]) + "(17")  # and no end
    f.flush()
    check("the CSV of a pipe grows", until(lambda: size("part.csv") > 0 and open("part.csv").read().count("\n") > 300))
    ends("shadow of a pipe that says nothing more", p, 1, says="interrupted", out="joint1")
rows = open("part.csv").read()
check(
    "its CSV has whole lines",
    rows.endswith("\n") and len({line.count(",") for line in rows.splitlines()}) == 1 and rows.count("\n") > 300,
    rows[-200:],
)
answers("shadow of /dev/zero", 2, *shadow_of("/dev/zero"), says=["/dev/zero:1: longer than"])
shutil.copytree("live", "slow")
p = begin("replay", scenario, "session.log", "--rate", "0.001", "-o", "slow", "--force")
check("a slow replay runs", until(lambda: os.path.exists("slow/replaced") and size("slow/telemetry.h5") > 0))
ends("a replay that sleeps", p, 1, says="interrupted after")
check("its telemetry is closed, not complete", not is_complete("slow"))
check(
    "what it was to replace is kept",
    is_complete("slow/replaced") and "slow/replaced" in json.load(open("slow/summary.json"))["warnings"][-1],
    contents("slow"),
)
check("its record is no whole one", json.load(open("slow/summary.json"))["interrupted"])
p = begin("drive", scenario, "--can", "memory:x", "--quiet", "--stats", "quiet.json")
time.sleep(1)
ends("drives that hear nothing", p, 0, says="interrupted at 0.000 s")
check("their statistics are written", json.load(open("quiet.json"))["frames_in"] == 0)
p = begin(
    *realtime,
    "--quiet",
    "--duration",
    "60",
    "--record",
    "cut_short.log",
    "--stats",
    "cut_short.json",
    "-o",
    "cut_short",
)
check("a long session runs", until(lambda: size("cut_short.log") > 5000))
ends("drives with a duration that is cut short", p, 1, says="of 60 s", number=signal.SIGINT)
check(
    "what they wrote is closed",
    open("cut_short.log").read().endswith("\n")
    and simulated_s("cut_short.json") > 0
    and json.load(open("cut_short/summary.json"))["interrupted"]
    and not is_complete("cut_short"),
)
p = begin("shadow", scenario, "--can", "memory:x", "--duration", "60")
time.sleep(1)
ends("a shadow with a duration that is cut short", p, 1, says="of 60 s")
for name, arguments in (
    ("scenario", ("drive", "fifo", "--can", "memory:x")),
    ("list of faults", (*realtime, "--faults", "fifo")),
):
    p = begin(*arguments)
    time.sleep(0.5)
    ends("a pipe as " + name, p, -signal.SIGTERM)
with open("scene.xml") as f:
    fine = f.read().replace('timestep="0.001"', 'timestep="0.000001"')
with open("scene.xml", "w") as f:
    f.write(fine)
p = begin("drive", "own.yaml", "--can", address, "--quiet", "--cycle", "1000", "--record", "long.log")
time.sleep(1)
master = Master(connect(address, "socketcand", "can0"), nodes)
master.nmt(1)
master.sync()
time.sleep(0.5)
ends("a cycle of a million steps", p, 0, says="interrupted at 0.0")
master.bus.shutdown()
check("its SYNC was recorded", " 080#" in open("long.log").read())
p = begin("drive", "own.yaml", *realtime[2:], "--quiet")
time.sleep(1)
ends("drives that cannot keep up with the clock", p, 0, says="interrupted at 0.")

with open("scene.xml", "w") as f:
    f.write(fine.replace('timestep="0.000001"', 'timestep="0.0000001"'))
answers(
    "a step that no bus can count",
    2,
    "drive",
    "own.yaml",
    *realtime[2:],
    says=["scene.xml", "timestep is '0.0000001'", "1e-06 .. 1 s"],
)

# 6. Nobody listens to what is said, or nobody can: the drives go on, and exit codes are what they are.
p = begin(*realtime, "--stats", "unheard.json")
time.sleep(1)
p.stderr.close()
p.stderr = None
time.sleep(0.5)
check("drives whose stderr nobody reads any more go on", p.poll() is None, p.returncode)
ends("and end in order", p, 0)
check("with their statistics", simulated_s("unheard.json") > 1)
reading, writing = os.pipe()
os.set_blocking(writing, False)
try:
    while True:
        os.write(writing, bytes(4096))
except BlockingIOError:
    os.set_blocking(writing, True)
p = subprocess.Popen([hil, *realtime, "--duration", "0.5"], stderr=writing)
atexit.register(p.kill)
check(
    "drives do not wait for a reader that stopped",
    until(lambda: p.poll() is not None) and p.returncode == 0,
    p.returncode,
)
near, far = pty.openpty()
p = subprocess.Popen([hil, *realtime, "--stats", "terminal.json"], stderr=far, stdout=subprocess.DEVNULL)
atexit.register(p.kill)
os.close(far)
check("drives show their state on a terminal", any(b"hottest" in os.read(near, 1000) for _ in range(5)))
os.close(near)
time.sleep(1)
check("drives whose terminal is gone go on", p.poll() is None, p.returncode)
p.terminate()
check("and end in order", p.wait(5) == 0 and simulated_s("terminal.json") > 0.9, p.returncode)
full = open("/dev/full", "w")
for name, more in (("closed", {"preexec_fn": lambda: os.close(2)}), ("full", {"stderr": full})):
    quiet = lambda *a: subprocess.run([hil, *a], stdout=subprocess.PIPE, timeout=60, **more).returncode
    check(f"stderr {name}: a session", quiet(*realtime, "--duration", "0.1") == 0)
    check(f"stderr {name}: wrong input", quiet("replay", scenario, "nowhere.log") == 2)
    check(f"stderr {name}: wrong usage", quiet("drive", scenario) == 2)
    check(f"stderr {name}: a failed comparison", quiet("replay", scenario, "cut.log", "--fast") == 1)
for name, more in (("closed", {"preexec_fn": lambda: os.close(1)}), ("full", {"stdout": full})):
    for arguments in (
        ("--help",),
        ("--version",),
        ("budget", scenario),
        ("eds", scenario),
        ("dbc", scenario),
        ("replay", scenario, "session.log", "--fast"),
        shadow_of("session.log"),
    ):
        r = subprocess.run([hil, *arguments], stderr=subprocess.PIPE, text=True, timeout=60, **more)
        check(
            f"stdout {name}: {arguments[0]} did not deliver",
            r.returncode == 1 and "stdout" in r.stderr.splitlines()[-1],
            (r.returncode, r.stderr),
        )
subprocess.run(
    [hil, *shadow_of("session.log"), "--csv", "closed.csv"],
    stderr=subprocess.DEVNULL,
    timeout=60,
    preexec_fn=lambda: os.close(1),
)
check(
    "a CSV does not get what a closed stdout should",
    size("closed.csv") > 1000 and "samples" not in open("closed.csv").read(),
)

with open("both.txt", "w") as f:
    subprocess.run([hil, *shadow_of("session.log"), "--csv", "/dev/stdout"], stdout=f, timeout=60)
both = open("both.txt").read()
check(
    "a CSV on stdout comes before the table",
    both.startswith("time_s,") and "\n1.0" in both and "samples" in both.splitlines()[-7],
    both[:100] + both[-600:],
)

# 7. A full disk ends the record, not the drives.
limit = lambda bytes: lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (bytes, bytes))
for name, where, bytes, why, more in (
    ("the record", "/dev/full", None, "No space left on device", ("--record", "/dev/full")),
    ("a limited record", "full.log", 60_000, "File too large", ("--record", "full.log")),
    (
        "the telemetry",
        "full/telemetry.h5",
        400_000,
        "File too large",
        ("-o", "full", "--set", "telemetry_rate_hz=1000"),
    ),
):
    r = run(*realtime, "--quiet", "--duration", "2", "--stats", "full.json", *more, preexec_fn=bytes and limit(bytes))
    lines = r.stderr.splitlines()
    check(
        name + " on a full disk: one note, and exit 1 at the end",
        r.returncode == 1 and len(lines) == 2 and all(where in l and why in l for l in lines) and "go on" in lines[0],
        (r.returncode, r.stderr),
    )
    check("the drives went on", simulated_s("full.json") >= 2, r.stderr)
    if os.path.exists("full.json"):
        os.remove("full.json")
check(
    "a record on a full disk has whole lines",
    50_000 < size("full.log") <= 60_000 and open("full.log").read().endswith("\n"),
    size("full.log"),
)
check("no summary without telemetry", not os.path.exists("full/summary.json"))
r = run(*shadow_of("session.log"), "--csv", "full.csv", preexec_fn=limit(20_000))
lines = r.stderr.splitlines()
check(
    "a CSV on a full disk: exit 1, and the table all the same",
    r.returncode == 1 and all("full.csv" in l for l in lines) and len(lines) == 2 and "joint6" in r.stdout,
    (r.returncode, r.stdout, r.stderr),
)
check(
    "it has whole lines",
    19_000 < size("full.csv") <= 20_000 and open("full.csv").read().endswith("\n"),
    size("full.csv"),
)

finish()
