"""What one command writes every reader reads without renaming, in every format; foreign tables give the same numbers.
Arguments: tribotwin, source tree, tribotwin-hil."""
import json, os, sys

import h5py
import numpy as np
import scipy.io
import yaml

import harness
from harness import check, check_refused, content, finish, path, work
from pendulum import PENDULUM

program, source, hil = map(os.path.abspath, sys.argv[1:4])
JOINTS = ("shoulder_pan_joint", "j_2")


def run(*arguments, code=0):
    p = harness.run(program, *arguments)
    check(" ".join(map(str, arguments))[:100], p.returncode == code, (p.returncode, p.stdout[-300:], p.stderr))
    return p


def refused(name, says, *arguments):
    check_refused(name, harness.run(program, *arguments), says)


def write(name, text):
    with open(path(name), "w", newline="") as f:
        f.write(text)
    return name


def read(name):
    with open(path(name)) as f:
        names = f.readline().strip().split(",")
        return dict(zip(names, np.genfromtxt(f, delimiter=",").T))


def numbers(parts, name=""):
    """Every number of a JSON document, by its place."""
    if isinstance(parts, (int, float)) and not isinstance(parts, bool):
        return {name: parts}
    entries = parts.items() if isinstance(parts, dict) else enumerate(parts) if isinstance(parts, list) else ()
    return {k: v for key, part in entries for k, v in numbers(part, f"{name}.{key}").items()}


def same(name, a, b, bar=1e-12):
    # Verdicts are of bins whose bounds are samples; they and ranges are of temperatures only where there is a column.
    left_out = ".verdict.", ".training.temperature."
    a, b = ({k: v for k, v in numbers(x).items() if not any(part in k for part in left_out)} for x in (a, b))
    # A sigma is a difference of solutions that nearly agree, and keeps fewer digits than they do.
    bars = {k: 1e3 * bar if k.endswith(".sigma") else bar for k in a}
    off = {k: (a[k], b.get(k)) for k in a if k not in b or abs(a[k] - b[k]) > bars[k] * max(1, abs(a[k]))}
    check(name, a.keys() == b.keys() and len(a) > 3 and not off, dict(list(off.items())[:5]))


# ---- Two joints with names that a careless reader takes apart wrongly.
drive, body = (
    PENDULUM[PENDULUM.index("<instance") : PENDULUM.index("</plugin></ext")],
    """<body name="%s" pos="%s">
  <inertial pos="0 0 -0.1" mass="%s" diaginertia="2e-3 3e-3 1e-3"/>
  <joint name="%s" axis="0 1 0" armature="0.0014" frictionloss="0.01" solreffriction=".001 1"
    solimpfriction=".9999 .9999 .001 .5 2" limited="true" range="-2.5 2.5"/>%s</body>""",
)
inner = body % ("b", "0 0 -0.2", 0.2, JOINTS[1], "")
write(
    "arm.xml",
    '<mujoco><compiler angle="radian"/><extension><plugin plugin="tribotwin.drive">'
    + drive
    + drive.replace('"servo"', '"second"')
    + "</plugin></extension><worldbody>"
    + body % ("a", "0 0 0.5", 0.3, JOINTS[0], inner)
    + "</worldbody><actuator>"
    + "".join(
        f'<plugin name="{i}" joint="{j}" plugin="tribotwin.drive" instance="{i}" actdim="3"/>'
        for i, j in zip(("servo", "second"), JOINTS)
    )
    + "</actuator></mujoco>",
)

# ---- excite to run to export to dynamics, predict and diagnose residuals.
run(
    "excite",
    "arm.xml",
    "-o",
    "motion.csv",
    "--evaluations",
    50,
    "--inertia-only",
    "--period",
    5,
    "--periods",
    2,
    "--quiet",
)
scenario = "model: arm.xml\ntelemetry_rate_hz: 250\nduration_s: 10\nmotion: {type: recording, file: %s}\n"
write("run.yaml", scenario % "motion.csv")
run("run", "run.yaml", "-o", "rec", "--quiet")
run("export", "rec", "--csv")
run("export", "rec", "--recording", "-o", "controller.csv")
run("export", "rec", "--mcap", "-o", "rec.mcap")
refused("a second export into the same file", ["rec.mcap", "--force"], "export", "rec", "--mcap", "-o", "rec.mcap")
check("beside the record", run("export", "rec", "--mcap").stdout == "rec/telemetry.mcap\n")
table = read("rec/telemetry.csv")
check("telemetry.csv is as it always was", "j_2.position_rad" in table and "shoulder_pan_joint.torque_nm" in table)

np.savez(path("rec.npz"), **table)
np.savez_compressed(path("deflated.npz"), **table)
fields = np.zeros(len(table["time_s"]), dtype=[(name, ">f8") for name in table])
for name in table:
    fields[name] = table[name]
np.save(path("rec.npy"), fields)
renamed = {"position": "q", "torque": "tau"}
plain = np.column_stack([table["time_s"]] + [table[f"{j}.{q}"] for q in ("position_rad", "torque_nm") for j in JOINTS])
np.save(path("plain.npy"), plain)
np.save(path("fortran.npy"), np.asfortranarray(plain))
np.save(path("lying.npy"), plain.T)
scipy.io.savemat(path("rec.mat"), {"data": {"t": table["time_s"], "q": plain[:, 1:3], "tau": plain[:, 3:5]}})
scipy.io.savemat(
    path("small.mat"), {"data": {"t": table["time_s"], "q": plain[:, 1:3], "tau": plain[:, 3:5]}}, do_compression=True
)
with h5py.File(path("v73.mat"), "w", userblock_size=512) as f:
    for name, values in {"t": table["time_s"][None, :], "q": plain[:, 1:3].T, "tau": plain[:, 3:5].T}.items():
        kind = h5py.h5t.C_S1.copy()  # ends with a NUL, as MATLAB writes it
        kind.set_size(6)
        attribute = h5py.h5a.create(
            f.create_dataset(name, data=values).id, b"MATLAB_class", kind, h5py.h5s.create(h5py.h5s.SCALAR)
        )
        attribute.write(np.array(b"double", dtype="S6"), mtype=kind)
with open(path("v73.mat"), "r+b") as f:
    f.write(b"MATLAB 7.3 MAT-file, made by a test".ljust(124) + b"\x00\x02IM")


def map_of(name, time, q, tau):
    columns = {"time_s": time}
    for k, j in enumerate(JOINTS):
        columns |= {f"position_{j}_rad": q(k), f"torque_{j}_nm": tau(k)}
    with open(path(name), "w") as f:
        yaml.safe_dump(columns, f)


map_of("plain.yaml", "[:,0]", lambda k: f"[:,{1 + k}]", lambda k: f"[:,{3 + k}]")
map_of("lying.yaml", "[0,:]", lambda k: f"[{1 + k},:]", lambda k: f"[{3 + k},:]")
map_of("mat.yaml", "data.t", lambda k: f"data.q(:,{1 + k})", lambda k: f"data.tau(:,{1 + k})")
map_of("v73.yaml", "t", lambda k: f"q(:,{1 + k})", lambda k: f"tau(:,{1 + k})")

# The foreign CSV: ';', decimal commas, a byte order mark, CRLF, degrees, milliseconds, motor currents.
GEAR, KT = 288.35, {"shoulder_pan_joint": 0.05, "j_2": 0.08}


def comma(x):
    return repr(float(x)).replace(".", ",")


rows = [
    ["Zeit [ms]"]
    + [f"{j}.position_deg" for j in JOINTS]
    + ["current_shoulder_pan_joint_mA", "current_j_2_A", "Bemerkung", ""]
]
for i in range(len(plain)):
    rows.append(
        [comma(1e3 * plain[i, 0])]
        + [comma(np.degrees(plain[i, 1 + k])) for k in range(2)]
        + [
            comma(1e3 * plain[i, 3] / (KT["shoulder_pan_joint"] * GEAR)),
            comma(plain[i, 4] / (KT["j_2"] * GEAR)),
            "x",
            "",
        ]
    )
with open(path("foreign.csv"), "w", newline="", encoding="utf-8-sig") as f:
    f.write("".join(";".join(row) + "\r\n" for row in rows).replace("Zeit [ms]", "time_ms"))
constants = ["--torque-constant", "0.05", "--torque-constant", "j_2=0.08"]

reference = json.loads(
    run(
        "dynamics",
        "--friction",
        "coulomb_viscous",
        "arm.xml",
        "rec/telemetry.csv",
        "-o",
        "params.yaml",
        "--json",
        "--quiet",
    ).stdout
)
predicted = json.loads(run("predict", "arm.xml", "params.yaml", "rec", "-o", "predicted.csv", "--json").stdout)
for name, options in {
    "rec": [],
    "rec/telemetry.h5": [],
    "rec.npz": [],
    "deflated.npz": [],
    "rec.npy": [],
    "plain.npy": ["--columns", "plain.yaml"],
    "fortran.npy": ["--columns", "plain.yaml"],
    "lying.npy": ["--columns", "lying.yaml"],
    "rec.mat": ["--columns", "mat.yaml"],
    "small.mat": ["--columns", "mat.yaml"],
    "v73.mat": ["--columns", "v73.yaml"],
    "foreign.csv": constants,
    "rec.mcap": [],
    "rec/telemetry.mcap": ["--topic", "/joint_states"],
}.items():
    fit = json.loads(
        run("dynamics", "--friction", "coulomb_viscous", "arm.xml", name, *options, "--json", "--quiet").stdout or "{}"
    )
    # The distance to the nearest possible bodies is searched for, and ends elsewhere within its tolerance.
    for result in (fit, reference):
        result.pop("distance_sigma", None)
    # Degrees and amperes are rounded elsewhere.
    same(f"dynamics of {name}", reference, fit, 1e-11 if name == "foreign.csv" else 1e-12)
    if "position" in options or name in ("rec.npy", "rec.mat", "foreign.csv", "rec.mcap"):
        e = json.loads(run("predict", "arm.xml", "params.yaml", name, *options, "--json").stdout or "{}")
        same(f"predict of {name}", predicted, e)
p = run("dynamics", "--friction", "coulomb_viscous", "arm.xml", "rec.mcap")
check(
    "which topic and time are said", "topic '/joint_states', 2500 messages; time is header.stamp" in p.stderr, p.stderr
)
refused("a topic that is not there", ["--topic '/x'", "/joint_states"], "thermal", "rec.mcap", "--topic", "/x")
with open(path("rec.mcap"), "rb") as f:
    whole = f.read()
with open(path("cut.mcap"), "wb") as f:
    f.write(whole[: len(whole) * 2 // 3])
p = run("dynamics", "--friction", "coulomb_viscous", "arm.xml", "cut.mcap")
check("a recorder that was killed: its chunks are read, and it is said", "cut.mcap: IS CUT OFF" in p.stderr, p.stderr)
with open(path("damaged.mcap"), "wb") as f:
    f.write(whole[:5000] + b"x" + whole[5001:])
refused(
    "damage", ["damaged.mcap: byte ", "damaged"], "dynamics", "--friction", "coulomb_viscous", "arm.xml", "damaged.mcap"
)
check(
    "what a controller records, too",
    run("dynamics", "--friction", "coulomb_viscous", "arm.xml", "controller.csv", "--quiet").returncode == 0,
)
p = run(
    "diagnose", "residuals", "predicted.csv", "--joint", "j_2", "--window", 0.5, "--learn", 8, "--json", code=None or 0
)
check("residuals of predict", json.loads(p.stdout)["joint"] == "j_2" and len(json.loads(p.stdout)["windows"]) > 10)
shadow = read("predicted.csv")
header = "time_s" + "".join(f",{j}.measured_nm,{j}.predicted_nm,{j}.residual_nm,{j}.temperature_degC" for j in JOINTS)
columns = [shadow["time_s"]]
for j in JOINTS:
    tau, expected = shadow[f"torque_{j}_nm"], shadow[f"predicted_{j}_nm"]
    columns += [tau, expected, tau - expected, shadow[f"temperature_{j}_degC"]]
np.savetxt(path("shadow.csv"), np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.17g")
q = run("diagnose", "residuals", "shadow.csv", "--joint", "j_2", "--window", 0.5, "--learn", 8, "--json")
same("the same as a shadow writes them", json.loads(p.stdout), json.loads(q.stdout), 1e-6)
with open(f"{source}/hil/shadow/shadow.cc") as f:
    check(
        "which are the columns of tribotwin-hil shadow --csv",
        ",{0}.measured_nm,{0}.predicted_nm,{0}.residual_nm,{0}.temperature_degC" in f.read(),
    )

# ---- A record is a motion to run.
for name in (
    "rec",
    "rec/telemetry.h5",
    "rec/telemetry.csv",
    "rec.npz",
    "rec.mcap, topic: /joint_states",
    "controller.csv",
):
    write("again.yaml", (scenario % name).replace("duration_s: 10\n", "duration_s: 0.1\n"))
    run("run", "again.yaml", "-o", "again", "--force", "--quiet")
write("map.yaml", (scenario % "plain.npy}").replace("}}", ", columns: plain.yaml}").replace("10\n", "0.1\n"))
run("run", "map.yaml", "-o", "again", "--force", "--quiet")

# ---- Currents must not pass as torques, units must be known; the messages say what would be right.
amperes = content("foreign.csv").replace("current_j_2_A", "torque_j_2_A")
write("amperes.csv", amperes)
refused(
    "amperes under a torque's name",
    ["amperes.csv:1: ", "'torque_j_2_A'", "a current", "current_JOINT_a", "--torque-constant"],
    "dynamics",
    "--friction",
    "coulomb_viscous",
    "arm.xml",
    "amperes.csv",
    *constants,
)
refused(
    "a current without a constant",
    ["foreign.csv:1: ", "torque_"],
    "dynamics",
    "--friction",
    "coulomb_viscous",
    "arm.xml",
    "foreign.csv",
)
refused(
    "a constant of another joint",
    ["foreign.csv:1: ", "--torque-constant"],
    "dynamics",
    "--friction",
    "coulomb_viscous",
    "arm.xml",
    "foreign.csv",
    "--torque-constant",
    "j_3=1",
)
for value in ("x", "-1", "j_2=", "j_2=nan"):
    refused(
        "a constant " + value,
        ["--torque-constant"],
        "dynamics",
        "--friction",
        "coulomb_viscous",
        "arm.xml",
        "foreign.csv",
        "--torque-constant",
        value,
    )
write("grad.csv", content("foreign.csv").replace("j_2.position_deg", "j_2.position_grad"))
refused(
    "gradians",
    ["grad.csv:1: ", "'j_2.position_grad'", "rad, mrad, deg"],
    "dynamics",
    "--friction",
    "coulomb_viscous",
    "arm.xml",
    "grad.csv",
    *constants,
)
write("both.csv", content("foreign.csv").replace(";x;\n", ";1.5;\n").replace("Bemerkung", "position_j_3_rad"))
check(
    "a column of no interest may be anything",
    run("dynamics", "--friction", "coulomb_viscous", "arm.xml", "both.csv", *constants, "--quiet").returncode == 0,
)
objects = np.array([{"a": 1}, None], dtype=object)
np.savez(path("pickle.npz"), time_s=objects, power_arm_w=np.ones(2), temperature_arm_degC=np.ones(2), allow_pickle=True)
refused("a pickle", ["pickle.npz", "Python objects"], "thermal", "pickle.npz")

# ---- Heat: thermal reads the record of a run, and its cycles.
write("hot.yaml", "model: irb6620.xml\n")
hours = ["--set", "duration_s=3600", "--set", "telemetry_rate_hz=1", "--quiet"]
run("run", "irb6620_warmup", "-o", "warm", *hours)
run("export", "warm", "--csv")
warm = read("warm/telemetry.csv")
np.savez(path("warm.npz"), **warm)
cycles = [f for f in os.listdir(path("warm")) if f == "cycles.csv"]
run("export", "warm", "--mcap", "-o", "warm.mcap")


def thermal(name):
    return harness.run(program, "thermal", name, "--json", "--quiet", "--order", 1)


# The record has every work cycle of a multi-rate run; its samples alone leave the heat of the others out.
for alike, code in ((("warm", "warm/telemetry.h5"), 0), (("warm/telemetry.csv", "warm.npz", "warm.mcap"), 2)):
    fits = [thermal(name) for name in alike]
    for name, fit in zip(alike, fits):
        check(
            f"thermal of {name}: as of the other",
            (fit.returncode, fit.stdout) == (code, fits[0].stdout),
            (fit.returncode, fit.stdout, fit.stderr),
        )
    check(
        "thermal reads a record, and refuses gaps",
        len(json.loads(fits[0].stdout)["joints"]) > 0 if code == 0 else "cycles.csv" in fits[0].stderr,
        fits[0].stderr,
    )
if cycles:
    rows = read("warm/cycles.csv")
    check("cycles.csv has its names", "joint2.cycle_friction_power_W" in rows, rows.keys())
    if len(rows["time_s"]) >= 20:
        run("thermal", "warm/cycles.csv", "--order", 1, "--quiet")
        run("thermal", "warm.mcap", "--topic", "/cycle_states", "--order", 1, "--quiet")

# ---- Friction curves: curve and lab write what identify and diagnose read; a foreign table gives the same law.
run(
    "curve", f"{source}/mjcf/irb6620.xml", "--joint", "joint2", "--temperature", 50, "--load", 0.3, "--csv", "curve.csv"
)
curve = read("curve.csv")
law = ["--law", "stribeck", "--fix", "alpha=1.3", "--json", "--quiet"]
reference = json.loads(run("identify", "curve.csv", *law).stdout)
rows = ["speed_rpm;friction_percent;load_norm;temperature_degF"]
for i in range(len(curve["speed_rad_s"])):
    rows.append(
        ";".join(
            comma(x)
            for x in (
                curve["speed_rad_s"][i] * 30 / np.pi,
                curve["friction_norm"][i] * 100,
                curve["load_norm"][i],
                curve["temperature_degC"][i] * 1.8 + 32,
            )
        )
    )
write("foreign_curve.csv", "\n".join(rows) + "\n")
fit = json.loads(run("identify", "foreign_curve.csv", *law).stdout)
for key, e in reference["parameters"].items():
    check(
        f"identify of a foreign curve: {key}",
        abs(fit["parameters"][key]["value"] - e["value"]) <= 1e-12 * max(1, abs(e["value"])),
        (e["value"], fit["parameters"][key]["value"]),
    )
np.savez(path("curve.npz"), **curve)
same("identify of curve.npz", reference, json.loads(run("identify", "curve.npz", *law).stdout))
scipy.io.savemat(path("curve.mat"), {"speed_rad_s": curve["speed_rad_s"], "friction_norm": curve["friction_norm"]})
same("identify of curve.mat", reference, json.loads(run("identify", "curve.mat", *law).stdout))

# ---- A joint of a record, by name.
steps = "".join(f"    - position_rad: {{j_2: {x}}}\n" for x in (-0.8, 0.8, -0.8, 0.8))
write(
    "passes.yaml",
    "model: arm.xml\ntelemetry_rate_hz: 250\nduration_s: 40\nmotion:\n  type: cycle\n  speed_share: 0.2\n  waypoints:\n"
    + steps,
)
run("run", "passes.yaml", "-o", "passes", "--quiet")
run("export", "passes", "--csv")
run("export", "passes", "--mcap", "-o", "passes.mcap")
options = ["--law", "stribeck", "--gear-ratio", GEAR, "--tau-max", 0.52, "--quiet"]
results = [
    harness.run(program, "identify", name, "--joint", "j_2", *options)
    for name in ("passes", "passes/telemetry.h5", "passes/telemetry.csv", "passes.mcap")
]
for r in results:
    check(
        "identify of a joint of a record",
        (r.returncode, r.stdout) == (results[0].returncode, results[0].stdout) and "column" not in r.stderr,
        (r.returncode, r.stderr),
    )
refused(
    "a record of several joints", ["shoulder_pan_joint, j_2", "--joint"], "identify", "passes/telemetry.csv", *options
)

# ---- calibrate from a table as from JSON.
t = np.arange(0, 1, 0.004)
entries = [
    {"timestamp": x, "goal_position": 0.5 * np.sin(3 * x), "position": 0.48 * np.sin(3 * x - 0.05), "temp": 30.0}
    for x in t
]
write("pendulum.xml", PENDULUM)
write("one.json", json.dumps({"entries": entries}))
np.savez(
    path("one.npz"),
    time_s=t,
    set_point_rad=[e["goal_position"] for e in entries],
    position_rad=[e["position"] for e in entries],
    temperature_degC=np.full(len(t), 30.0),
)
write(
    "one.csv",
    "t;goal;position_rad;temperature_K\n"
    + "".join(
        f"{comma(e['timestamp'])};{comma(np.degrees(e['goal_position']))};{comma(e['position'])};303,15\n"
        for e in entries
    ),
)
write("one.yaml", "time_s: t\nset_point_rad: {from: goal, unit: deg}\n")
maes = []
for name, options in {"one.json": [], "one.npz": [], "one.csv": ["--columns", "one.yaml"]}.items():
    write(
        "fit.yaml",
        f"""recordings: {{files: {name}}}
search: {{starts: 1, evaluations: 20}}
control: {{error_gain: 0.0028774, supply_V: 7.4, resistance_ohm: 3.4, kt_nm_A: 0.36, kp: 400}}
variants:
  - label: load
    model: pendulum.xml
    law: load
    drive: {{Fc0: {{start: 0.02, low: 0.002, high: 0.2}}, Fcl: 0.2, Fs0: 0, Fsl: 0.1, vs: 100, alpha: 1.4, Fv: 3e-5}}
""",
    )
    p = run("calibrate", "fit.yaml", *options, "-o", "found_" + name, "--json", "--quiet")
    maes.append(p.stdout)
values = [[v for k, v in numbers(json.loads(m or "{}")).items() if "value" in k or "mae" in k] for m in maes]
check(
    "calibrate of JSON, .npz and a mapped CSV",
    len(values[0]) > 0 and all(len(v) == len(values[0]) and np.allclose(v, values[0], rtol=1e-9) for v in values),
    values,
)
finish()
