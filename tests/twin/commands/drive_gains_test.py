"""Drive gains as an engineer meets them: currents of motions without and with a payload, PARAMS.yaml, wrong input.
Arguments: tribotwin, source tree."""
import json, os, sys

import numpy as np

import harness
from harness import check, check_refused, finish, work

program = os.path.abspath(sys.argv[1])

ARM = """<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="shoulder" axis="0 1 0" armature=".4"/><inertial pos=".25 0 0" mass="5" diaginertia=".01 .1 .1"/>
  <body pos=".5 0 0"><joint name="elbow" axis="0 1 0" armature=".2"/>
    <inertial pos=".15 0 0" mass="2" diaginertia=".01 .03 .03"/><site name="flange" pos=".4 0 0"/>
  </body></body></worldbody></mujoco>
"""
# Links and payload: mass, distance from the elbow (None: of the upper arm from the shoulder), inertia
LINKS = [(5, None, 0.1), (2, 0.15, 0.03)]
PAYLOAD = (2, 0.5, 0.01)
GAIN = np.array([12.0, 5.0])  # Nm/A
FRICTION = np.array([[3, 2], [1.5, 1]])  # Fc, Fv


def torques(q, v, a, bodies):
    """Of the arm in the vertical plane, by the principle of virtual work."""
    angle, speed, acceleration = (
        np.array([q[0], q[0] + q[1]]),
        np.array([v[0], v[0] + v[1]]),
        np.array([a[0], a[0] + a[1]]),
    )
    along, across = np.array([np.cos(angle), -np.sin(angle)]), np.array([-np.sin(angle), -np.cos(angle)])
    tau = np.array([0.4 * a[0], 0.2 * a[1]])
    for mass, distance, inertia in bodies:
        arms = (0.25, 0) if distance is None else (0.5, distance)
        force = sum(r * (across[:, k] * acceleration[k] - along[:, k] * speed[k] ** 2) for k, r in enumerate(arms))
        force[1] += 9.81
        elbow = arms[1] * across[:, 1]
        turning = inertia * acceleration[0 if distance is None else 1]
        tau[0] += mass * np.sum((arms[0] * across[:, 0] + elbow) * force, axis=0) + turning
        tau[1] += mass * np.sum(elbow * force, axis=0) + (0 if distance is None else turning)
    return tau


def record(name, seed, bodies, column="current_{}_a", scale=1 / GAIN):
    random = np.random.default_rng(seed)
    t = np.arange(0, 20, 0.02)
    q, v, a = np.zeros((3, 2, len(t)))
    phases = np.random.default_rng(seed // 2).uniform(0, 6, (2, 3))
    for j in range(2):
        for k in range(3):
            w, amplitude = 2 * np.pi * (0.17 + 0.13 * k + 0.05 * j), 0.8 / (1 + k)
            q[j] += amplitude * np.sin(w * t + phases[j][k])
            v[j] += amplitude * w * np.cos(w * t + phases[j][k])
            a[j] -= amplitude * w * w * np.sin(w * t + phases[j][k])
    tau = torques(q, v, a, bodies) + FRICTION[:, :1] * np.sign(v) + FRICTION[:, 1:] * v
    tau += 0.3 * random.standard_normal(tau.shape)
    joints = ("shoulder", "elbow")
    header = ",".join(["time_s"] + [f"position_{j}_rad" for j in joints] + [column.format(j) for j in joints])
    table = np.column_stack([t, *q, *(tau * np.reshape(scale, (2, 1)))])
    np.savetxt(f"{work}/{name}.csv", table, "%.9g", ",", header=header, comments="")


def run(*arguments, code=0):
    r = harness.run(program, *arguments)
    check(arguments, r.returncode == code, (r.returncode, r.stdout[-1000:], r.stderr))
    return r


def errors(data, *options):
    joints = json.loads(run("predict", "arm.xml", "robot.yaml", data, "--json", *options).stdout)["joints"]
    return [joints[j]["rms"] for j in ("shoulder", "elbow")]


open(f"{work}/arm.xml", "w").write(ARM)
loaded = LINKS + [PAYLOAD]
record("bare", 2, LINKS)
record("loaded", 3, loaded)
record("test", 6, LINKS)
record("test_loaded", 7, loaded)
KNOWN = ["--payload", "loaded.csv=2 kg +- 0.01 at 0.1 0 0", "--drive-gains"]
FIT = ["dynamics", "--friction", "coulomb_viscous", "arm.xml", "bare.csv", "loaded.csv"]

found = json.loads(run(*FIT, *KNOWN, "--json", "-o", "robot.yaml").stdout)
for joint, truth in zip(("shoulder", "elbow"), GAIN):
    got = found["drive_gains"][joint]
    check(f"{joint}: the gain", abs(got["value"] - truth) < 4 * got["sigma"] < 0.1 * truth, got)
    check(f"{joint}: its unit, nothing was assumed", got["unit"] == "Nm/A" and "of_assumed" not in got, got)
    check(f"{joint}: at least what the mass is uncertain by", got["sigma"] > 0.0049 * truth, got)
for (joint, truth), law in zip(zip(("shoulder", "elbow"), FRICTION), ("Fc", "Fc")):
    got = found["friction"][joint][law]
    check(f"{joint}: friction in Nm", abs(got["value"] - truth[0]) < 4 * got["sigma"], got)
check("no doubts", not any("centre of mass" in n or "mass right" in n for n in found["notes"]), found["notes"])
check("predict takes currents", max(errors("test.csv")) < 0.3, errors("test.csv"))
with_payload = ("--payload", "test_loaded.csv=2 kg at 0.1 0 0 inertia .01 .01 .01")
check("with a payload", max(errors("test_loaded.csv", *with_payload)) < 0.3, errors("test_loaded.csv", *with_payload))
check("which is needed", max(errors("test_loaded.csv")) > 2)

assumed = ["--torque-constant", "0.1", "--gear-ratio", "shoulder=100", "--gear-ratio", "elbow=60"]
r = run(*FIT, *KNOWN, *assumed)
rows = {line.split()[0]: line for line in r.stdout.splitlines() if "Nm/A" in line}
for joint, truth, says in (("shoulder", GAIN[0], 10), ("elbow", GAIN[1], 6)):
    share = float(rows[joint].split("%")[-2].split()[-1])
    check(f"{joint}: of that assumed", abs(share / 100 * says / truth - 1) < 0.05, rows[joint])
check("the condition of sigmas", "sigmas count what the payload's mass is known to" in r.stdout, r.stdout)
check("a mass that nobody weighed", "1 % more makes" in run(*FIT, KNOWN[0], "loaded.csv=2 kg", KNOWN[2]).stdout)

# Torques in Nm by wrong constants: the same option corrects them, here and in predict.
wrong = np.array([0.8, 1.25])
for name, seed, bodies in (("bare", 2, LINKS), ("loaded", 3, loaded), ("test", 6, LINKS)):
    record(name, seed, bodies, "torque_{}_nm", 1 / wrong)
found = json.loads(run(*FIT, *KNOWN, "--json", "-o", "robot.yaml", "--force").stdout)
for joint, truth in zip(("shoulder", "elbow"), wrong):
    got = found["drive_gains"][joint]
    check(f"{joint}: the correction", abs(got["value"] - truth) < 4 * got["sigma"] < 0.1, got)
    check(f"{joint}: of what was said", got["unit"] == "1" and got["of_assumed"] == got["value"], got)
check("predict corrects", max(errors("test.csv")) < 0.3, errors("test.csv"))

record("currents", 3, loaded)
for name, says, arguments in (
    ("no payload", ["--drive-gains", "Record the same motions once more with a payload"], [*FIT, "--drive-gains"]),
    (
        "always loaded",
        ["once more without it"],
        ["dynamics", "--friction", "coulomb_viscous", "arm.xml", "loaded.csv", *KNOWN],
    ),
    (
        "not a recording",
        ["'other.csv' is none of the recordings"],
        [*FIT, "--payload", "other.csv=2 kg", "--drive-gains"],
    ),
    ("no unit", ["--payload", "with its unit", "FILE="], [*FIT, "--payload", "loaded.csv=2", "--drive-gains"]),
    ("no place", ["its centre of mass is needed"], [*FIT, "--payload", "loaded.csv=2 kg"]),
    (
        "no such site",
        ["no site or body 'hook'", "flange"],
        [*FIT, "--payload", "loaded.csv=2 kg on hook", "--drive-gains"],
    ),
    (
        "currents beside torques",
        ["the gain of one is not that of the other"],
        [
            "dynamics",
            "--friction",
            "coulomb_viscous",
            "arm.xml",
            "bare.csv",
            "currents.csv",
            "--payload",
            "currents.csv=2 kg",
            "--drive-gains",
        ],
    ),
    ("not the payload's", ["the wrong way"], [*FIT, "--payload", "bare.csv=2 kg at 0.1 0 0", "--drive-gains"]),
):
    check_refused(name, run(*arguments, "-o", "no.yaml", code=2), says)
    check(f"{name}: nothing is written", not os.path.exists(f"{work}/no.yaml"))
r = run("predict", "arm.xml", "robot.yaml", "currents.csv", code=2)
check_refused("currents by a factor of torques", r, ["currents.csv", "shoulder", "factor of a torque column"])
text = open(f"{work}/robot.yaml").read()
open(f"{work}/bad.yaml", "w").write(text.replace('unit: 1}', 'unit: V}', 1).replace('unit: "1"}', "unit: V}", 1))
check_refused("a unit", run("predict", "arm.xml", "bad.yaml", "test.csv", code=2), ["bad.yaml", "must be 1"])
finish()
