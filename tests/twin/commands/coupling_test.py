"""Wrists whose motors turn with several joints, as an engineer meets them: the option, PARAMS.yaml, wrong sums.
Arguments: tribotwin, source tree."""
import json, os, sys

import numpy as np

import harness
from harness import check, check_refused, finish, work

program = os.path.abspath(sys.argv[1])

WRIST = """<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="pitch" axis="0 1 0"/><inertial pos=".1 0 0" mass="2" diaginertia=".01 .02 .02"/>
  <body pos=".2 0 0"><joint name="roll" axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia=".01 .02 .02"/>
  </body></body></worldbody>{}</mujoco>
"""
BELT = """<tendon><fixed name="belt"><joint joint="pitch" coef="1"/><joint joint="roll" coef="1"/></fixed></tendon>
<actuator><motor name="m1" joint="pitch"/><motor name="m2" tendon="belt"/></actuator>"""
FRICTION = {"pitch": (2, 1), "roll": (0.5, 0.2), "motor_roll": (1.5, 0.8)}  # Fc, Fv


def record(name, seed):
    """Closed form: the roll axis is one of symmetry. The motor of roll turns with pitch + roll; its rotor has 0.05
    kg m^2. Columns: joint torques, or motor torques in NAME_motors.csv."""
    random = np.random.default_rng(seed)
    t = np.arange(0, 15, 0.01)
    q, v, a = np.zeros((3, 2, len(t)))
    for j in range(2):
        for k in range(3):
            w, amplitude, phase = 2 * np.pi * (0.17 + 0.13 * k + 0.05 * j), 0.8 / (1 + k), random.uniform(0, 6)
            q[j] += amplitude * np.sin(w * t + phase)
            v[j] += amplitude * w * np.cos(w * t + phase)
            a[j] -= amplitude * w * w * np.sin(w * t + phase)
    friction = lambda rotor, speed: FRICTION[rotor][0] * np.sign(speed) + FRICTION[rotor][1] * speed
    motor = 0.05 * a.sum(axis=0) + friction("motor_roll", v.sum(axis=0))
    pitch = (0.02 + 2 * 0.01 + 0.02 + 0.04) * a[0] - 9.81 * (2 * 0.1 + 1 * 0.2) * np.cos(q[0]) + friction("pitch", v[0])
    roll = 0.01 * a[1] + friction("roll", v[1]) + motor
    noise = 0.02 * random.standard_normal((2, len(t)))
    pitch, roll = pitch + noise[0], roll + noise[1]
    for file, names, torques in (
        (name, ("pitch", "roll"), (pitch + motor, roll)),
        (name + "_motors", ("pitch", "motor_roll"), (pitch + motor - roll, roll)),
    ):
        header = "time_s,position_pitch_rad,position_roll_rad," + ",".join(f"torque_{n}_nm" for n in names)
        np.savetxt(f"{work}/{file}.csv", np.column_stack([t, *q, *torques]), "%.9g", ",", header=header, comments="")


def run(*arguments, code=0):
    r = harness.run(program, *arguments)
    check(arguments, r.returncode == code, (r.returncode, r.stdout[-1000:], r.stderr))
    return r


def fit(*arguments):
    law = () if "--friction" in arguments else ("--friction", "coulomb_viscous")
    return json.loads(run("dynamics", *arguments, *law, "--json", "--force").stdout)


def errors(model, data):
    joints = json.loads(run("predict", model, "robot.yaml", data, "--json").stdout)["joints"]
    return [joints[j]["rms"] for j in ("pitch", "roll")]


open(f"{work}/wrist.xml", "w").write(WRIST.format(""))
open(f"{work}/belt.xml", "w").write(WRIST.format(BELT))
record("train", 1)
record("test", 2)
SUM = "roll = pitch + roll"

without = fit("wrist.xml", "train.csv", "-o", "robot.yaml")
check("without the coupling the wrist is badly explained", without["joints"]["roll"]["relative_error"] > 0.2, without)
check("and badly predicted", min(errors("wrist.xml", "test.csv")) > 0.3)

for name, arguments, motor in (
    ("--coupling", ("wrist.xml", "train.csv", "--coupling", SUM), "motor_roll"),
    ("motor torques", ("wrist.xml", "train_motors.csv", "--coupling", SUM), "motor_roll"),
    ("a tendon", ("belt.xml", "train.csv"), "m2"),
    ("auto", ("wrist.xml", "train.csv", "--friction", "auto"), "motor_roll"),
):
    found = fit(*arguments, "-o", "robot.yaml")
    check(f"{name}: the motor", found["coupling"] == {motor: {"joint": "roll", "turns_with": {"pitch": 1, "roll": 1}}})
    for rotor, truth in FRICTION.items():
        got = found["friction"][motor if rotor == "motor_roll" else rotor]
        for key, value in zip(("Fc", "Fv"), truth):
            near = abs(got[key]["value"] - value) < 5 * got[key]["sigma"] and got[key]["sigma"] < 0.1
            check(f"{name}: {rotor}.{key}", near, (value, got[key]))
    check(f"{name}: predict", max(errors(arguments[0], "test.csv")) < 0.06, errors(arguments[0], "test.csv"))
check("motor torques are predicted as those of joints", max(errors("wrist.xml", "test_motors.csv")) < 0.06)

# The next experiment counts the motor as the fit does.
found = fit("wrist.xml", "train.csv", "--coupling", SUM, "-o", "robot.yaml")["friction"]
for name, arguments, motor in (
    ("--coupling", ("wrist.xml", "--coupling", SUM, "--given", "train.csv"), "motor_roll"),
    ("a tendon", ("belt.xml", "--given", "train.csv"), "m2"),
    ("--params", ("wrist.xml", "--params", "robot.yaml"), "motor_roll"),
):
    r = run("excite", *arguments, "--evaluations", "20", "--heating", "0", "--json", "--quiet")
    design = json.loads(r.stdout)["friction"]["parameters"]
    for rotor in FRICTION:
        for key in ("Fc", "Fv"):
            one, sigma = design[(motor if rotor == "motor_roll" else rotor) + "." + key], found[rotor][key]["sigma"]
            check(f"excite, {name}: {rotor}.{key}", 0.4 < one["sigma_before"] / sigma < 2.5, (one, sigma))
            check(f"excite, {name}: better after", one["sigma_after"] < one["sigma_before"], one)
none = json.loads(
    run(
        "excite",
        "belt.xml",
        "--friction",
        "coulomb_viscous",
        "--coupling",
        "none",
        "--evaluations",
        "20",
        "--heating",
        "0",
        "--json",
        "--quiet",
    ).stdout
)
check("excite, none", "m2.Fc" not in none["friction"]["parameters"], none)
both = run("excite", "wrist.xml", "--coupling", SUM, "--params", "robot.yaml", code=2)
check_refused("excite: two sources of the coupling", both, ["--coupling and --params"])
check("none", "coupling" not in fit("belt.xml", "train.csv", "--coupling", "none"))

for name, says, couplings in (
    ("unknown joint", ["--coupling 'rol=pitch+roll'", "did you mean 'roll'"], ["rol=pitch+roll"]),
    ("no sum", ["--coupling 'roll='", "joint is missing", "JOINT=SUM"], ["roll="]),
    ("zero row", ["--coupling 'roll=roll-roll+pitch'", "does not turn with roll"], ["roll=roll-roll+pitch"]),
    ("no coupling", ["--coupling 'roll=2*roll'", "no coupling"], ["roll=2*roll"]),
    ("singular", ["--coupling", "do not determine the joints"], ["roll=pitch+roll", "pitch=2*pitch+2*roll"]),
    ("twice", ["--coupling", "'roll' has two"], ["roll=pitch+roll", "roll=pitch-roll"]),
):
    options = [x for c in couplings for x in ("--coupling", c)]
    check_refused(name, run("dynamics", "wrist.xml", "train.csv", *options, "-o", "no.yaml", code=2), says)
    check(f"{name}: nothing is written", not os.path.exists(f"{work}/no.yaml"))
text = open(f"{work}/robot.yaml").read()
for name, before, after, says in (
    ("a joint of another robot", "joint: roll", "joint: rol", ["bad.yaml", "joint", "'rol' is no joint"]),
    ("a sum of another robot", "pitch: 1,", "pith: 1,", ["bad.yaml", "'pith' is no joint"]),
):
    check(f"{name}: the case is one", before in text)
    open(f"{work}/bad.yaml", "w").write(text.replace(before, after, 1))
    check_refused(name, run("predict", "wrist.xml", "bad.yaml", "test.csv", code=2), says)
finish()
