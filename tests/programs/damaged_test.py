"""Programs on damaged inputs: cut off at several lengths, with bits that are others, and on what is no such file at
all. Each run ends in time with exit code 0, 1 or 2; where it is not 0, with one message of ours that names the file,
and no word of a library. Arguments: tribotwin, tribotwin-hil, source tree; by hand also how many flips (8)."""
import concurrent.futures, json, os, random, re, shutil, signal, sys

import h5py
import numpy as np
from fleet_plant import HEADER, Plant
from foreign import FOREIGN
from harness import check, content, finish, path, run

tribotwin, hil, source = sys.argv[1:4]
FLIPS = int(sys.argv[4]) if len(sys.argv) > 4 else 8


def write(name, data):
    with open(path(name), "wb") as f:
        f.write(data)


def damages(data, seed):
    """Pairs of what was done, and the bytes afterwards."""
    dice = random.Random(seed)
    for part in (0, 0.3, 0.7):
        yield f"cut off at {part:g}", data[: int(part * len(data))]
    yield "without the last byte", data[:-1]
    for count in [1] * FLIPS + [30] * (FLIPS // 2):
        flipped = bytearray(data)
        places = [dice.randrange(8 * len(data)) for _ in range(count)]
        for bit in places:
            flipped[bit // 8] ^= 1 << bit % 8
        yield f"bits {places[:3]}.. other", bytes(flipped)


def problem_of(process, name):
    """What is wrong with how a program ended; nothing where it did well."""
    said = process.stderr
    if process.returncode not in (0, 1, 2):
        return f"exit code {process.returncode}"
    if FOREIGN.search(said) or FOREIGN.search(process.stdout):
        return f"a foreign word: {(FOREIGN.search(said) or FOREIGN.search(process.stdout))[0]}"
    if re.search(r"[\x00-\x08\x0b-\x1f\x7f]", said):
        return "control characters"
    messages = [line for line in said.splitlines() if not line.startswith(("note:", "warning:"))]
    if process.returncode and (len(messages) != 1 or os.path.basename(name) not in messages[0]):
        return "not one message that names the file"
    return ""


def try_all(kind, name, data, command):
    """The command, a function of the input's name and of a number for outputs, on each damage of the input."""
    cases = list(enumerate(damages(data, kind)))

    def one(case):
        number, (what, bytes_) = case
        folder = f"{kind}{number}"
        os.makedirs(path(folder), exist_ok=True)
        shutil.copy(f"{source}/mjcf/scene.xml", path(folder))  # which the model includes
        write(f"{folder}/{name}", bytes_)
        process = run(*command(f"{folder}/{name}", folder), timeout=60)
        return what, process, problem_of(process, name)

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        done = list(pool.map(one, cases))
    for what, process, problem in done:
        if problem:
            check(f"{kind}, {what}", False, (problem, process.returncode, process.stderr[-600:]))
    refused = sum(process.returncode != 0 for _, process, _ in done)
    check(f"{kind}: {len(done)} damages, {refused} refused", refused > 3)


def bytes_of(name):
    return content(name, "rb")


# ---- Whole inputs.
SHORT = ("--set", "duration_s=0.1", "--set", "telemetry_rate_hz=500", "--quiet")
with open(f"{source}/twin/scenarios/irb6620_hold.yaml", "rb") as f:
    scenario = f.read().replace(b"../../mjcf", b"mjcf")
write("scenario.yaml", scenario)
made = [
    run(tribotwin, "run", "scenario.yaml", "-o", "whole", *SHORT),
    run(tribotwin, "curve", f"{source}/mjcf/irb6620.xml", "--joint", "joint2", "--load", "0.3", "--csv", "curve.csv"),
    run(tribotwin, "identify", "--law", "stribeck", "curve.csv", "-o", "params.yaml"),
]
check("the whole inputs are read", all(r.returncode == 0 for r in made), [(r.args[1], r.stderr) for r in made])
# A master that starts six drives and sends SYNC, and what might be their answers.
frames = ["000#0100"] + ["080#", *(f"18{node}#0000" for node in range(1, 7))] * 15
log = "".join(f"({1 + n / 500:017.6f}) can0 {frame}\n" for n, frame in enumerate(frames))
write("whole.log", log.encode())
compared = run(hil, "replay", "scenario.yaml", "whole.log", "--fast")
check("the whole log is compared", compared.returncode == 1 and "106 frames" in compared.stdout, compared.stderr)
columns = dict(zip(HEADER.split(","), zip(*(row.split(",") for row in Plant(2).rows(6)))))
with h5py.File(path("plant.h5"), "w") as f:
    for column, values in columns.items():
        text = column in ("robot", "joint", "date")
        f[column] = np.array(values, h5py.string_dtype() if text else float)
learned = run(tribotwin, "fleet", "learn", "plant.h5", "-o", "plant.db")
check("the whole table is learned", learned.returncode == 0, learned.stderr)

# A caller that ignores SIGCHLD leaves that to its programs.
for command in ((tribotwin, "recover", "whole"), (tribotwin, "fleet", "learn", "plant.h5", "-o", "ignored.db")):
    process = run(*command, preexec_fn=lambda: signal.signal(signal.SIGCHLD, signal.SIG_IGN))
    check(f"{command[1]} where SIGCHLD is ignored", process.returncode == 0, process.stderr)

# ---- Damaged ones.
try_all("scenario", "s.yaml", scenario, lambda f, to: (tribotwin, "run", f, "-o", to + "/out", *SHORT))
try_all("csv", "c.csv", bytes_of("curve.csv"), lambda f, to: (tribotwin, "identify", "--law", "stribeck", f))
try_all(
    "params",
    "p.yaml",
    bytes_of("params.yaml"),
    lambda f, to: (tribotwin, "export", f, "--mjcf", "--tau-max", "1", "--gear-ratio", "100"),
)
try_all(
    "record",
    "telemetry.h5",
    bytes_of("whole/telemetry.h5"),
    lambda f, to: (tribotwin, "export", os.path.dirname(f), "--csv"),
)
try_all("log", "l.log", log.encode(), lambda f, to: (hil, "replay", "scenario.yaml", f, "--fast", "-o", to + "/out"))
with open(f"{source}/mjcf/irb6620.xml", "rb") as f:
    model = f.read()
try_all("model", "m.xml", model, lambda f, to: (tribotwin, "curve", f, "--joint", "joint2"))
try_all(
    "table",
    "t.h5",
    bytes_of("plant.h5"),
    lambda f, to: (tribotwin, "fleet", "learn", f, "-o", to + "/plant.db", "--quiet"),
)

# ---- Names that are not UTF-8, in JSON.
named = os.fsdecode(b"named \xff")
shutil.copytree(path("whole"), path(named))
for command in (
    (tribotwin, "recover", named, "--json"),
    (tribotwin, "export", named, "--csv", "--json"),
    (tribotwin, "fleet", "learn", "plant.h5", "-o", named + ".db", "--json"),
    (hil, "replay", "scenario.yaml", "whole.log", "--fast", "-o", named + ".run", "--json"),
):
    process = run(*command, errors="replace")
    good = process.returncode in (0, 1) and isinstance(json.loads(process.stdout or "0"), dict)
    check(f"{command[1]} --json where a name has any bytes", good, (process.returncode, process.stderr[-300:]))

# ---- What is no such file at all.
os.mkdir(path("folder"))
write("long.csv", b"a," * (1 << 24) + b"\n1,2\n")
write(
    "bomb.yaml",
    b"a: &a [0,0,0,0,0,0,0,0]\n"
    + b"".join(b"%c: &%c [%s]\n" % (98 + i, 98 + i, b",".join([b"*%c" % (97 + i)] * 9)) for i in range(9)),
)
os.mkfifo(path("fifo.h5"))
with h5py.File(path("vast.h5"), "w") as f:
    for column in columns:
        f.create_dataset(column, (1 << 31,), "f8", chunks=(1024,))
with h5py.File(path("chunks.h5"), "w") as f:
    for column, values in columns.items():
        text = column in ("robot", "joint", "date")
        data = np.resize(np.array(values, h5py.string_dtype("ascii", 20) if text else float), 40_000)
        data[-1] = "never" if column == "date" else data[-1]
        f.create_dataset(column, data=data, chunks=(1,))
learn = (tribotwin, "fleet", "learn", "-o", "new.db")
# Many of everything: a reader whose time grows with the square would not be done in time.
names = [f"position_j{joint}_rad" for joint in range(90_000)]
write("wide.csv", "".join(",".join(["time_s", *row]) + "\n" for row in (names, ["0"] * len(names))).encode())
write(
    "many.xml",
    b'<mujoco><extension><plugin plugin="tribotwin.drive"><instance name="a">\n'
    + b'<config key="a" value="some text"/>\n' * 300_000
    + b'<config value="1" of="nothing"/></instance></plugin></extension></mujoco>',
)
write(
    "many.dbc",
    "".join(f"BO_ {2**31 + i} M{i}: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" B\n" for i in range(100_000)).encode()
    + b"SIG_VALTYPE_ 2147583648 t : 1;\n",
)
for name, command in (
    ("fifo.h5", (*learn, "fifo.h5")),
    ("vast.h5", (*learn, "vast.h5")),
    ("chunks.h5", (*learn, "chunks.h5")),
    ("wide.csv", (tribotwin, "identify", "--law", "stribeck", "wide.csv")),
    ("many.xml", (tribotwin, "curve", "many.xml", "--joint", "joint2")),
    (
        "many.dbc",
        (hil, "shadow", "scenario.yaml", "--can", "log:whole.log", "--map", "many.dbc", "--signal", "torque=M1.s"),
    ),
    ("/dev/zero", (tribotwin, "run", "/dev/zero", "-o", "out")),
    ("folder", (tribotwin, "run", "folder", "-o", "out")),
    ("bomb.yaml", (tribotwin, "run", "bomb.yaml", "-o", "out")),
    ("/dev/zero", (tribotwin, "identify", "--law", "stribeck", "/dev/zero")),
    ("long.csv", (tribotwin, "identify", "--law", "stribeck", "long.csv")),
    ("/dev/zero", (tribotwin, "curve", "/dev/zero", "--joint", "joint2")),
    ("/dev/zero", (hil, "replay", "scenario.yaml", "/dev/zero", "--fast")),
):
    process = run(*command, timeout=20)
    problem = problem_of(process, name)
    said = (problem, process.returncode, process.stderr[-300:])
    check(" ".join(map(os.path.basename, command)), process.returncode == 2 and not problem, said)
finish()
