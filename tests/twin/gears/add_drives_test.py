"""tribotwin add-drives as its user meets it: from a URDF to a run. Arguments: program, source tree."""
import json, os, shutil, sys
import xml.etree.ElementTree as ET

import harness
from harness import check, check_refused, content, finish, path

program, source = sys.argv[1], sys.argv[2]


def run(*arguments, **options):
    return harness.run(program, *arguments, **options)


def add(*arguments):
    return run("add-drives", *arguments)


shutil.copy(os.path.join(source, "tests", "twin", "gears", "arm.urdf"), path("arm.urdf"))

# The tour: add-drives, run.
r = add("arm.urdf", "-o", "arm.xml")
check("add-drives", r.returncode == 0 and r.stdout.split() == ["arm.xml", "arm.yaml"], (r.stdout, r.stderr))
for says in ("damping 0.5 and frictionloss 0.2 removed", "starting points", "harmonic_130", "effort of the URDF"):
    check("it says: " + says, says in r.stderr, r.stderr)
text = content("arm.xml")
check("the file warns, too", "starting points" in text and "Zhou 2024" in text)
model = ET.fromstring(text)
check(
    "a drive per joint",
    [p.get("joint") for p in model.iter("plugin") if p.get("joint")] == ["turntable", "shoulder", "telescope"],
)
r = run("run", "arm.yaml", "-o", "work", "--quiet")
summary = json.load(open(path("work/summary.json"))) if r.returncode == 0 else {}
check("an hour of work", r.returncode == 0 and summary["simulated_s"] >= 3590, r.stderr)
check(
    "nothing is wrong with it",
    not [w for w in summary["warnings"] if "energy" in w or "outside" in w],
    summary["warnings"],
)
guessed = [h["joint"] for h in summary["health"] if h["check"] == "starting_points" and h["verdict"] == "note"]
check("whose parameters are guesses", guessed == ["turntable", "shoulder", "telescope"], summary["health"])
check("which is a warning", any("are guesses" in w and "--params" in w for w in summary["warnings"]))
check("it warms up", all(j["temperature_degC"]["max"] > 25.05 for j in summary["joints"]), summary["joints"])
r = run("run", "arm.yaml", "-o", "said", "--set", "duration_s=10")
check(
    "the terminal says it, too",
    "note: turntable, shoulder, telescope: friction and heat are guesses" in r.stderr,
    r.stderr,
)
r = run("run", "arm.yaml", "-o", "steps", "--quiet", "--set", "multirate.enabled=false", "--set", "duration_s=300")
summary = json.load(open(path("steps/summary.json")))
check("energy", abs(summary["energy_balance_J"]) < 1e-3 * summary["friction_work_J"], summary["energy_balance_J"])

# Choices.
r = add("arm.urdf", "--joint", "shoulder=erob80_100", "-o", "one.xml", "--scenario", "first_hour.yaml")
check(
    "one joint, its class, another name",
    r.stdout.split() == ["one.xml", "first_hour.yaml"] and "shoulder: erob80_100" in r.stderr,
    r.stderr,
)
r = run("curve", "one.xml", "--joint", "shoulder", "--speeds", "1:100:3")
check("which curve reads", r.returncode == 0 and "the law of shoulder is a guess" in r.stderr, r.stderr)
r = add("arm.urdf", "--gear", "cycloidal", "-o", "big.xml", "--quiet")
check(
    "a family for all hinges",
    r.returncode == 0 and content("big.xml").count('value="extended"') == 2 and r.stderr == "",
    r.stderr,
)

# Identified parameters.
speeds = [1, 2, 5, 10, 20, 40, 80, 120, 160]
with open(path("curve.csv"), "w") as f:
    f.write("speed_rad_s,friction_norm\n")
    f.writelines(f"{v},{0.03 + 0.02 * 2.718281828 ** -((v / 10) ** 1.36) + 1e-4 * v}\n" for v in speeds)
run("identify", "--law", "stribeck", "curve.csv", "-o", "params.yaml", "--quiet")
r = add("arm.urdf", "--params", "shoulder=params.yaml", "-o", "known.xml")
instance = next((i for i in ET.fromstring(content("known.xml")).iter("instance") if i.get("name") == "shoulder"), None)
keys = {c.get("key"): c.get("value") for c in instance}
check(
    "--params",
    keys["law"] == "stribeck"
    and abs(float(keys["Fc"]) - 0.03) < 1e-3
    and keys["torque_max_nm"] == "130"
    and "R_th" in keys,
    (keys, r.stderr),
)
run("run", "known.yaml", "-o", "known", "--quiet", "--set", "duration_s=10")
guessed = [h["joint"] for h in json.loads(content("known/summary.json"))["health"] if h["verdict"] == "note"]
check("identified parameters are no guesses", guessed == ["turntable", "telescope"], guessed)
with open(path("currents.csv"), "w") as f:
    f.write("time_s,position_shoulder_rad,current_shoulder_a\n0,0,1\n0.1,0,1\n")
for model, ratio, guess in (
    ("arm.xml", [], True),
    ("arm.xml", ["--gear-ratio", "50"], False),
    ("known.xml", [], False),
):
    r = run(
        "dynamics", "--friction", "coulomb_viscous", model, "currents.csv", "--torque-constant", "shoulder=0.1", *ratio
    )
    said = "shoulder: --torque-constant uses gear ratio 100, which is a guess" in r.stderr
    check("a guessed gear ratio of currents: %s %s" % (model, ratio), said == guess, r.stderr)
r = run("export", "params.yaml", "--mjcf", "--tau-max", "130", "--gear-ratio", "100", "--name", "shoulder")
exported = ET.fromstring(r.stdout)
check(
    "export --mjcf gives the same elements",
    {c.get("key"): c.get("value") for c in exported.find("extension/plugin/instance")}.items()
    >= {k: keys[k] for k in ("law", "Fc", "vs")}.items()
    and exported.find("worldbody/body/joint").get("solimpfriction") == ".9999 .9999 .001 .5 2"
    and exported.find("actuator/plugin").get("actdim") == "3",
    r.stdout,
)

# Efforts, and a folder that does not exist yet.
with open(path("no_effort.urdf"), "w") as f:
    f.write(content("arm.urdf").replace('effort="130"', 'effort="0"'))
r = add("no_effort.urdf", "-o", "guess/arm.xml")
check("a guessed effort is a warning", "warning: the model gives no usable effort" in r.stderr, r.stderr)
check("a new folder", r.stdout.split() == ["guess/arm.xml", "guess/arm.yaml"], (r.stdout, r.stderr))
r = add("no_effort.urdf", "--effort", "shoulder=150", "-o", "guess/known.xml")
check("--effort", "150 Nm (given)" in r.stderr and "warning" not in r.stderr, r.stderr)

# Refusals leave nothing behind.
before = sorted(os.listdir(harness.work))
for name, arguments, says in (
    ("no output", ["arm.urdf"], "needs -o"),
    ("output is the input", ["arm.urdf", "-o", "arm.urdf", "--force"], "arm.urdf"),
    ("a file that exists", ["arm.urdf", "-o", "arm.xml"], ["arm.xml", "--force"]),
    ("no such file", ["none.urdf", "-o", "x.xml"], "none.urdf"),
    ("a file as folder", ["arm.urdf", "-o", "arm.urdf/x.xml"], "arm.urdf"),
    ("new folders go again", ["none.urdf", "-o", "none/deep/x.xml"], "none.urdf"),
    ("no file", ["arm.urdf", "-o", "/dev/stdout"], ["/dev/stdout", "give a file"]),
    ("no MJCF", ["arm.urdf", "-o", "x.urdf"], ["is MJCF", "name it x.xml"]),
    ("an effort of 0", ["arm.urdf", "--effort", "shoulder=0", "-o", "x.xml"], "--effort 'shoulder=0'"),
    ("an effort of no joint", ["arm.urdf", "--effort", "elbow=9", "-o", "x.xml"], "'elbow' gets no drive"),
    (
        "no such joint",
        ["arm.urdf", "--joint", "elbow", "-o", "x.xml"],
        ["no joint 'elbow'", "turntable, shoulder, telescope"],
    ),
    ("no such class", ["arm.urdf", "--joint", "shoulder=harmonik", "-o", "x.xml"], "did you mean 'harmonic'?"),
    ("no name", ["arm.urdf", "--joint", "=harmonic", "-o", "x.xml"], "NAME=CLASS"),
    ("a hinge's class on a slide", ["arm.urdf", "--joint", "telescope=harmonic", "-o", "x.xml"], "is for hinges"),
    (
        "parameters twice",
        ["arm.urdf", "--params", "params.yaml", "--params", "params.yaml", "-o", "x.xml"],
        "one file each",
    ),
    ("no parameters", ["arm.urdf", "--params", "curve.csv", "-o", "x.xml"], "curve.csv"),
    ("drives already", ["arm.xml", "-o", "x.xml"], ["arm.xml:", "has drives already"]),
    ("scenario is the model", ["arm.urdf", "-o", "x.xml", "--scenario", "x.xml"], "x.xml"),
):
    check_refused(name, add(*arguments), says, lines=None)
cut = content("arm.urdf")
with open(path("cut.urdf"), "w") as f:
    f.write(cut[: len(cut) // 2])
with open(path("red.urdf"), "w") as f:
    f.write(content("arm.urdf").replace('joint name="shoulder"', 'joint name="sh&#27;[31mRED"'))
r = add("red.urdf", "-o", "red.xml")
check(
    "names in notes do not steer the terminal",
    r.returncode == 0 and "\x1b" not in r.stderr and "sh\\x1b[31mRED" in r.stderr,
    (r.returncode, r.stderr),
)
for name in ("red.urdf", "red.xml", "red.yaml"):
    os.remove(path(name))
with open(path("bare.urdf"), "w") as f:
    f.write(content("arm.urdf").replace('<cylinder radius="0.08" length="0.2"/>', '<mesh filename="package://"/>'))
r = add("bare.urdf", "-o", "bare.xml")
check("a package without a file", r.returncode == 0 and "1 of its meshes left out" in r.stderr, r.stderr)
for name in ("bare.urdf", "bare.xml", "bare.yaml"):
    os.remove(path(name))
os.mkdir(path("meshes"))
with open(path("meshes/vast.stl"), "wb") as f:
    f.truncate(1 << 40)
with open(path("vast.urdf"), "w") as f:
    mesh = '<mesh filename="package://arm/meshes/vast.stl"/>'
    f.write(content("arm.urdf").replace('<cylinder radius="0.08" length="0.2"/>', mesh))
check_refused(
    "a mesh of a package that is too long", add("vast.urdf", "-o", "x.xml"), ["vast.urdf:10: ", "vast.stl", "longer"]
)
shutil.rmtree(path("meshes")), os.remove(path("vast.urdf"))
nowhere = {**os.environ, "TMPDIR": "/nonexistent"}
r = run("add-drives", "arm.urdf", "-o", "x.xml", env=nowhere)
check_refused("no folder for temporary files", r, ["arm.urdf: ", "set TMPDIR"], 1)
check_refused("a cut file", add("cut.urdf", "-o", "x.xml"), ["cut.urdf:", "not well-formed"], lines=None)
check(
    "nothing is left of them", sorted(set(os.listdir(harness.work)) - {"cut.urdf"}) == before, os.listdir(harness.work)
)
finish()
