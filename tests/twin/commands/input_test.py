"""Wrong input of every kind is refused where it is read: exit 2, one line that names file, line and key, nothing
written. Each case was seen to pass, to hang or to crash. Arguments: tribotwin, source tree, tribotwin-hil."""
import json, os, re, resource, shutil, subprocess, sys

import h5py
import numpy as np

import harness
from harness import check, check_refused, content, finish, work

program, source, hil = map(os.path.abspath, sys.argv[1:4])


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
    resource.setrlimit(resource.RLIMIT_FSIZE, (64 << 20, 64 << 20))


def run(*arguments, which=program, cwd=work):
    try:
        return harness.run(which, *arguments, cwd=cwd, timeout=30, preexec_fn=limited)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(arguments, -1, "", "does not end")


def tree():
    return sorted(os.path.join(folder, f) for folder, _, files in os.walk(work) for f in files)


def refused(name, says, *arguments, which=program, cwd=work, code=2):
    before = tree()
    check_refused(name, run(*arguments, which=which, cwd=cwd), says, code)
    check(name + ": nothing is written", tree() == before, sorted(set(tree()) - set(before)))


def write(name, text):
    os.makedirs(os.path.dirname(os.path.join(work, name)), exist_ok=True)
    open(os.path.join(work, name), "w").write(text)
    return name


# ---- A model's time step.
pendulum = """<mujoco model="pendulum">
  <compiler angle="radian"/>
  <option timestep="0.001" tolerance="1e-12"/>
  <extension>
    <plugin plugin="tribotwin.drive">
      <instance name="servo">
        <config key="law" value="stribeck"/> <config key="Fc" value="0.05"/> <config key="Fs" value="0.01"/>
        <config key="Fv" value="1e-5"/>
        <config key="vs" value="10"/> <config key="alpha" value="1"/>
        <config key="torque_max_nm" value="1"/>
        <config key="gear_ratio" value="100"/>
      </instance>
    </plugin>
  </extension>
  <worldbody>
    <body name="pendulum">
      <inertial pos="0 0 -0.1" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
      <joint name="joint" axis="0 1 0" armature="0.002" damping="0" frictionloss="1" solreffriction=".003 1"
        solimpfriction=".9999 .9999 .001 .5 2"/>
    </body>
  </worldbody>
  <actuator>
    <plugin name="servo" joint="joint" plugin="tribotwin.drive" instance="servo" actdim="3"/>
  </actuator>
</mujoco>
"""
option = pendulum.count("\n", 0, re.search("<option", pendulum).start()) + 1
SCENARIO = "model: pendulum.xml\nduration_s: 0.1\nmotion: {type: hold}\n"
write("pendulum.xml", pendulum)
write("run.yaml", SCENARIO)
check(
    "what the cases change runs",
    run("run", "run.yaml", "-o", "good").returncode == 0,
    run("run", "run.yaml", "-o", "good").stderr,
)
for value in ("0", "-0.001", "1e-300", "nan", "inf", "2", "1e300"):
    write("step.xml", re.sub('timestep="[^"]*"', f'timestep="{value}"', pendulum))
    write("step.yaml", SCENARIO.replace("pendulum", "step"))
    says = [f"step.xml:{option}: ", "timestep", "1e-06 .. 1"]
    refused(f"time step {value}", says, "run", "step.yaml", "-o", "out")
    refused(
        f"time step {value}, on the bus",
        says,
        "drive",
        "step.yaml",
        "--can",
        "socketcand://127.0.0.1:29611/can0",
        "--duration",
        "0.1",
        which=hil,
    )
for value in ("0", "-1", "1e-300", ".nan", ".inf"):
    refused(
        f"time step {value} of a scenario",
        ["run.yaml", "timestep_s"],
        "run",
        "run.yaml",
        "-o",
        "out",
        "--set",
        f"timestep_s={value}",
    )

# ---- Runs without a step, and without an end.
for value in ("0", "-1", "1e-300", ".nan", ".inf", "1e300", "1e-6"):
    refused(
        f"duration {value}", ["run.yaml", "duration_s"], "run", "run.yaml", "-o", "out", "--set", f"duration_s={value}"
    )
for value in ("0", "1e300", ".nan", "-1"):
    refused(
        f"telemetry rate {value}",
        ["run.yaml", "telemetry_rate_hz"],
        "run",
        "run.yaml",
        "-o",
        "out",
        "--set",
        f"telemetry_rate_hz={value}",
    )
for name, times in (("endless", "0\n1e300"), ("standing", "0\n0"), ("backwards", "1\n0")):
    write("points.csv", "time_s,position_joint_rad\n" + "".join(f"{t},0\n" for t in times.split()))
    write("points.yaml", "model: pendulum.xml\nmotion: {type: recording, file: points.csv}\n")
    refused(f"a recording that is {name}", ["points.csv:3: ", "time"], "run", "points.yaml", "-o", "out")
refused(
    "a recording of one instant",
    ["duration_s"],
    "run",
    write("once.yaml", "model: pendulum.xml\nmotion: {type: recording, file: once.csv}\n")
    if write("once.csv", "time_s,position_joint_rad\n5,0\n")
    else "",
    "-o",
    "out",
)
for entry in (
    '"timestamp": 1e300, "goal_position": 0',
    '"timestamp": 1, "goal_position": 1e300',
    '"timestamp": 1, "goal_position": 0, "position": -1e308',
    '"timestamp": 1, "goal_position": 0, "temp": 1e20',
):
    write("points.json", '{"kp": 400, "entries": [{"timestamp": 0, "goal_position": 0}, {%s}]}' % entry)
    write("points.yaml", "model: pendulum.xml\nmotion: {type: recording, file: points.json}\n")
    refused(f"a recording with {entry}", ["points.json", "entry 1"], "run", "points.yaml", "-o", "out")
arm = f"model: {source}/mjcf/irb6620.xml\n"
for name, text in (
    ("far", arm + "duration_s: 1\nmotion: {type: cycle, waypoints: [{position_rad: 0}, {position_rad: 1e299}]}\n"),
    (
        "slow",
        "model: pendulum.xml\nduration_s: 1\n"
        "motion: {type: back_and_forth, joint: joint, travel_rad: 1000, speed_rad_s: 1e-9}\n",
    ),
):
    refused(f"a cycle that is too {name}", ["long.yaml:"], "run", write("long.yaml", text), "-o", "out")

# ---- Names that become folders and files.
for name in ("../../x", "/tmp/tribotwin_absolute", "..", ".", "a/b", '"a\\nb"', '"\\x07"', "x" * 201):
    refused(
        f"scenario named {name[:20]}", ["run.yaml", "name", "file name"], "run", "run.yaml", "--set", f"name={name}"
    )
write("vary.yaml", SCENARIO + "vary:\n  - {name: [a, ..]}\n")
for values in (
    "{temperature_degC: ['..', 20]}",
    "{temperature_degC: ['']}",
    "{name: ['a/']}",
    "{model: ['../../..']}",
    "{name: ['" + 150 * "x" + "'], description: ['" + 150 * "y" + "']}",
):
    write("vary.yaml", SCENARIO + f"vary:\n  - {values}\n")
    refused(f"vary {values[:40]}", ["vary.yaml:5: vary", "file name"], "run", "vary.yaml", "-o", "out")
study = open(f"{source}/twin/scenarios/br609_diagnosis.yaml").read().replace("../../mjcf", f"{source}/mjcf")
for name in ("../../joint2", "/tmp/joint2", "..", '""'):
    write("study.yaml", re.sub(r"^(joints:\n *)(joint\d)", lambda m: m[1] + name, study, flags=re.M))
    refused(f"a study of joint {name}", ["study.yaml:", "joints"], "lab", "study.yaml", "-o", "out")
curves = open(f"{source}/twin/scenarios/irb6620_load_campaign.yaml").read().replace("../../mjcf", f"{source}/mjcf")
for name in ("../x", '"a\\0b"'):
    refused(
        f"a campaign named {name}",
        ["curves.yaml:", "name", "file name"],
        "lab",
        write("curves.yaml", re.sub("^name:.*\n", "", curves, flags=re.M) + f"name: {name}\n"),
        "-o",
        "out",
    )
    refused(
        f"a campaign of days named {name}",
        ["days.yaml:", "name", "file name"],
        "lab",
        write("days.yaml", f"name: {name}\nprocedure: working_days\nmodel: {source}/mjcf/er3a_c60.xml\n"),
        "-o",
        "out",
    )

# ---- Cells of CSV files: finite, and what their quantity can be.
time = np.arange(0, 3600, 10.0)
power = 1 + np.sin(time / 300)
temperature = 20 + 5 * (1 - np.exp(-time / 900)) + 0.3 * np.cos(time / 300)


def heat(name, column=None, row=None, value=None):
    table = {"time_s": time, "power_w_arm": power, "temperature_arm_degC": temperature}
    rows = [",".join(table)] + [",".join("%.9g" % c[i] for c in table.values()) for i in range(len(time))]
    if column is not None:
        cells = rows[row].split(",")
        cells[column] = value
        rows[row] = ",".join(cells)
    return write(name, "\n".join(rows) + "\n")


r = run("thermal", heat("heat.csv"), "-o", "thermal.yaml", "--quiet")
check("what the cases change is fitted", r.returncode == 0, r.stderr)
for value in ("1e200", "1e20", "-1e308", "1e9"):
    refused(f"power {value}", ["bad.csv:101: ", "power_w_arm", value, " W"], "thermal", heat("bad.csv", 1, 100, value))
for value in ("-274", "1e5"):
    refused(
        f"temperature {value}",
        ["bad.csv:101: ", "temperature_arm_degC", "-273.15", "degC"],
        "thermal",
        heat("bad.csv", 2, 100, value),
    )
latin = content("heat.csv").replace("_arm_", "_Gelenk\u00fc_").replace("power_w_arm", "power_Gelenk\u00fc_w")
with open(f"{work}/latin.csv", "wb") as f:
    f.write(latin.encode("latin-1"))
r = run("thermal", "latin.csv", "--json", "-o", "latin.yaml", "--quiet")
check(
    "a joint in Latin-1 is that in UTF-8, in what is printed and written",
    r.returncode == 0
    and list(json.loads(r.stdout)["joints"]) == ["Gelenk\u00fc"]
    and "Gelenk\u00fc:" in content("latin.yaml"),
    (r.returncode, r.stderr),
)

for name in ("utf16.csv", "utf16.yaml"):
    with open(f"{work}/{name}", "wb") as f:
        f.write(latin.encode("utf-16"))
refused("a CSV in UTF-16", ["utf16.csv:1: ", "UTF-16"], "thermal", "utf16.csv")
refused("a scenario in UTF-16", ["utf16.yaml:1: ", "UTF-16"], "run", "utf16.yaml")
write("again.csv", content("heat.csv"))
refused("the same record twice", ["heat.csv and again.csv", "same content"], "thermal", "heat.csv", "again.csv")
refused("time 1e300", ["bad.csv:361: ", "time_s", " s"], "thermal", heat("bad.csv", 0, 360, "1e300"))
refused("time that stands", ["bad.csv:101: ", "time_s"], "thermal", heat("bad.csv", 0, 100, "980"))

speeds = np.geomspace(1, 280, 12)


def curve(name, value=None, column=1):
    rows = [[v, 0.05 + 1e-4 * v, 0.3, 40] for v in speeds]
    if value is not None:
        rows[5][column] = value
    return write(
        name,
        "speed_rad_s,friction_norm,load_norm,temperature_degC\n"
        + "".join(",".join(map(str, row)) + "\n" for row in rows),
    )


for column, name in enumerate(("speed_rad_s", "friction_norm", "load_norm", "temperature_degC")):
    for value in ("-1e308", "1e308"):
        refused(
            f"{name} {value}", ["bad.csv:7: ", name], "identify", "--law", "stribeck", curve("bad.csv", value, column)
        )

# ---- What identify writes is what all else reads.
curve("curve.csv")
listed = run("identify", "--law", "none", "curve.csv").stderr
for law in re.search("can are (.*)", listed)[1].split(", "):
    if law in ("bouc_wen", "lugre"):
        continue
    for old in ("free.yaml", "fixed.yaml"):
        if os.path.exists(f"{work}/{old}"):
            os.remove(f"{work}/{old}")
    units = ["--tau-max", "10", "--gear-ratio", "10"]
    free = run("identify", "--law", law, "curve.csv", "--json", "-o", "free.yaml", "--quiet", *units)
    fixes = []
    if free.returncode == 0:
        check(
            f"{law}: what is identified is read",
            run("curve", "free.yaml", "--quiet").returncode == 0,
            run("curve", "free.yaml").stderr,
        )
        for name, p in json.loads(free.stdout)["parameters"].items():
            fixes += ["--fix", f"{name}={p['value']!r}"]
        r = run("identify", "--law", law, "curve.csv", "--json", "-o", "fixed.yaml", "--quiet", *units, *fixes)
        check(
            f"{law}: all parameters fixed",
            r.returncode == 0 and all(p["status"] == "fixed" for p in json.loads(r.stdout)["parameters"].values()),
            (r.returncode, r.stderr),
        )
        check(
            f"{law}: ... what is written is read",
            run("curve", "fixed.yaml", "--quiet").returncode == 0,
            run("curve", "fixed.yaml").stderr,
        )
        r = run("identify", "--law", law, "curve.csv", "--quiet", *units, *fixes)
        check(
            f"{law}: ... no number of the table is infinite or none",
            r.returncode == 0 and not re.search(r"\b(nan|inf)\b", r.stdout),
            r.stdout,
        )
    else:
        # One temperature does not separate these laws' levels; where they come out the wrong way round they are no
        # such law.
        check(
            f"{law}: is not written",
            law in ("steady_state_extended", "stribeck_T")
            and free.returncode == 1
            and "no law that can be used" in free.stderr
            and not os.path.exists(f"{work}/free.yaml"),
            (free.returncode, free.stderr),
        )
flat = write("flat.csv", "speed_rad_s,friction_norm\n" + "".join(f"{v},0.05\n" for v in speeds))
r = run("identify", "--law", "stribeck", flat, "-o", "flat.yaml", "--tau-max", "10", "--gear-ratio", "10")
check(
    "friction that never changes",
    r.returncode in (0, 1, 2) and not re.search(r"\b(nan|inf)\b", r.stdout),
    r.stdout + r.stderr,
)
if r.returncode == 0:
    check(
        "... what is written is read",
        run("curve", "flat.yaml", "--quiet").returncode == 0,
        run("curve", "flat.yaml").stderr,
    )
odd = write("odd\t'name.csv", content("curve.csv"))
r = run("identify", "--law", "stribeck", odd, "-o", "odd.yaml", "--quiet", "--tau-max", "10", "--gear-ratio", "10")
check(
    "a file with a tab and a quote in its name",
    r.returncode != 0 or run("curve", "odd.yaml", "--quiet").returncode == 0,
    (r.stderr, run("curve", "odd.yaml").stderr),
)

# ---- Null keys and other kinds of nodes, in every YAML file.
thermal = content("thermal.yaml")
refused(
    "a joint ~ in THERMAL.yaml",
    ["null.yaml:", "key"],
    "thermal",
    "heat.csv",
    "--evaluate",
    write("null.yaml", re.sub("^  arm:", "  ~:", thermal, flags=re.M)),
)
refused(
    "a key that is a list",
    ["null.yaml:", "key"],
    "thermal",
    "heat.csv",
    "--evaluate",
    write("null.yaml", re.sub("^  arm:", "  ? [a, b]\n  :", thermal, flags=re.M)),
)
refused(
    "a null key in a scenario",
    ["null.yaml:2", "key"],
    "run",
    write("null.yaml", SCENARIO.replace("\n", "\n~: 3\n", 1)),
    "-o",
    "out",
)

# ---- The record of a run: time goes forward.
shutil.copytree(f"{work}/good", f"{work}/still")
for name, times in (
    ("constant", lambda t: 0 * t),
    ("backwards", lambda t: t[::-1]),
    ("none", lambda t: t * np.nan),
    ("endless", lambda t: t * 1e300),
    ("too fine", lambda t: t * 1e-300),
):
    with h5py.File(f"{work}/still/telemetry.h5", "r+") as f, h5py.File(f"{work}/good/telemetry.h5") as good:
        f["time_s"][:] = times(good["time_s"][:])
    refused(f"a record whose time is {name}", ["still/telemetry.h5", "time_s"], "export", "still", "--recording")
with h5py.File(f"{work}/still/telemetry.h5", "r+") as f, h5py.File(f"{work}/good/telemetry.h5") as good:
    f["time_s"][:] = good["time_s"][:]
    f["joint/torque_nm"][3] = np.nan
refused(
    "a record with a torque that is none",
    ["still/telemetry.h5", "joint", "torque_nm"],
    "export",
    "still",
    "--recording",
)

# ---- MJCF: what nobody knows, and errors of the engine at the line of the user's file.
config = pendulum.count("\n", 0, re.search("<config", pendulum).start()) + 1
load = lambda text: ("curve", write("bad.xml", text), "--joint", "joint")
for name, before, after, says in (
    ("a misspelt config", "<config key=", "<confg key=", [f"bad.xml:{config}: ", "<confg", "config"]),
    ("a misspelt attribute", "<config key=", '<config kye="law" key=', [f"bad.xml:{config}: ", "kye"]),
    ("an attribute of the instance", "<instance name=", '<instance nmae="x" name=', ["bad.xml:", "nmae"]),
    (
        "an element in a config",
        '<config key="gear_ratio"',
        '<config key="T_amb" value="20"><x/></config><config key="gear_ratio"',
        ["bad.xml:", "<x>"],
    ),
    (
        "a misspelt plugin",
        '<plugin plugin="tribotwin.drive">',
        '<plugin plugin="tribotwin.drvie">',
        ["bad.xml:", "tribotwin.drvie", "tribotwin.drive"],
    ),
    ("text in an instance", '<instance name="servo">', '<instance name="servo">gear_ratio = 3', ["bad.xml:", "text"]),
    ("an element that the engine does not know", "<worldbody>", "<worldbody>\n<bdy/>\n", ["bad.xml:", "bdy"]),
    ("an attribute that the engine does not know", "<joint name=", "<joint nmae=\"x\" name=", ["bad.xml:", "nmae"]),
):
    text = re.sub(before, lambda m: after, pendulum, count=1)
    check(f"{name}: the case is one", text != pendulum)
    expected = text.count("\n", 0, text.index(after)) + 1
    says = [f"bad.xml:{expected + (after.count(chr(10)) - 1 if after.endswith(chr(10)) else 0)}: "] + says[1:]
    refused(name, says, *load(text))
belt = '</worldbody>\n<tendon><fixed name="belt"><joint joint="joint" coef="1"/></fixed></tendon>'
text = pendulum.replace("</worldbody>", belt).replace('joint="joint" plugin', 'tendon="belt" plugin')
line = text.count("\n", 0, text.index('tendon="belt" plugin')) + 1
refused("a drive on a tendon", [f"bad.xml:{line}: ", "acts on a joint", "<motor>"], *load(text))
body = pendulum.index("</worldbody>")
for name, element, says in (
    ("a body without mass", "<body name='b'><joint name='free'/></body>", "mass"),
    ("an unknown material", "<geom size='.1' material='none'/>", "material"),
):
    text = pendulum[:body] + "\n\n" + element + "\n" + pendulum[body:]
    refused(name, [f"bad.xml:{text.count(chr(10), 0, text.index(element)) + 1}: ", says], *load(text))
write("part.xml", "<mujocoinclude>\n\n<body name='b'>\n<geom size='.1' colour='red'/></body>\n</mujocoinclude>")
refused(
    "an error in an included file",
    ["part.xml:4: ", "colour"],
    *load(pendulum[:body] + "<include file='part.xml'/>" + pendulum[body:]),
)
write("light.xml", "<mujocoinclude>\n\n\n<body name='b'><joint name='free'/></body>\n</mujocoinclude>")
refused(
    "a body without mass in an included file",
    ["light.xml:4: ", "mass"],
    *load(pendulum[:body] + "<include file='light.xml'/>" + pendulum[body:]),
)
refused(
    "30,000 nested elements",
    ["bad.xml:", "nested"],
    *load(pendulum[:body] + 30000 * "<body>" + 30000 * "</body>" + pendulum[body:]),
)
refused(
    "too much user data",
    ["bad.xml:", "nuserdata"],
    *load(pendulum[:body] + pendulum[body:].replace("</mujoco>", '<size nuserdata="2147483647"/></mujoco>')),
)

finish()
