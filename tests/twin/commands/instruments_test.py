"""dynamics --iv, as an engineer with a coarse encoder meets it: what it chooses, what it says, what it refuses.
Arguments: tribotwin."""
import json, os, sys

import numpy as np

import harness
from harness import check, check_refused, content, finish, path

program = os.path.abspath(sys.argv[1])
INERTIA, GRAVITY_NM, COULOMB_NM, VISCOUS = 0.5, 4.0, 3.0, 2.0  # kg m^2, Nm, Nm, Nm s/rad
MODEL = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="swing" axis="0 1 0"/>
  <inertial pos=".2 0 0" mass="2" diaginertia=".1 .1 .1"/></body></worldbody></mujoco>
"""


def record(name, seed, repeats=True, step_rad=2 * np.pi / 8192):
    """Four times five harmonics of a period of 3.1007 s; else frequencies without a common period."""
    random = np.random.default_rng(seed)
    t = np.arange(0, 12.6, 0.002)
    q, v, a = np.zeros((3, len(t)))
    for k in range(5):
        w, amplitude = 2 * np.pi / 3.1007 * (k + 1 if repeats else np.sqrt(k + 2)), 0.8 / (1 + k)
        x = w * t + random.uniform(0, 6)
        q, v, a = q + amplitude * np.sin(x), v + amplitude * w * np.cos(x), a - amplitude * w * w * np.sin(x)
    torque = INERTIA * a - GRAVITY_NM * np.cos(q) + COULOMB_NM * np.sign(v) + VISCOUS * v
    torque += 0.3 * random.standard_normal(len(t))
    q = step_rad * np.round(q / step_rad)
    header = "time_s,position_swing_rad,torque_swing_nm"
    np.savetxt(path(f"{name}.csv"), np.column_stack([t, q, torque]), "%.9g", ",", header=header, comments="")


def fit(*options):
    r = harness.run(program, "dynamics", "swing.xml", "repeated.csv", *options, "--json", "--threads", 1)
    check(options, r.returncode == 0, (r.returncode, r.stderr))
    return json.loads(r.stdout)


def inertia(found):
    """Value and sigma."""
    return next((e["value"], e["sigma"]) for e in found["base_parameters"].values() if e["unit"] == "kg m^2")


open(path("swing.xml"), "w").write(MODEL)
record("repeated", 1)
record("once", 1, repeats=False)

# ---- The band is given: least squares is too low by more than its interval, instrumental variables are not.
least_squares, instrumental = fit("--cutoff", 40), fit("--cutoff", 40, "--iv", "-o", "iv.yaml")
(low, low_sigma), (value, sigma) = inertia(least_squares), inertia(instrumental)
check("least squares is biased", low < INERTIA - 4 * low_sigma, (low, low_sigma))
check("instrumental variables are not", abs(value - INERTIA) < 2 * sigma < 0.05 * INERTIA, (value, sigma))
check("both say so", least_squares["estimator"] == "least_squares" and "estimator: instr" in content("iv.yaml"))
check("estimator", instrumental["estimator"] == "instrumental_variables")
check(
    "how auto chose is said", any("chose by least squares" in n for n in instrumental["notes"]), instrumental["notes"]
)
predicted = harness.run(program, "predict", "swing.xml", "iv.yaml", "repeated.csv", "--json")
check("predict reads it", predicted.returncode == 0, predicted.stderr)

# ---- What is left open is chosen among what instrumental variables know.
alone = fit("--iv")
trials = [trial["what"] for trial in alone["choice"]["trials"]]
check("there is a choice of cut-offs and friction", any("cut-off" in w for w in trials[1:]), trials)
check("... and of vs", any(w.startswith("friction that falls") for w in trials), trials)
unknown = [w for w in trials if any(no in w for no in ("load", "asymmetry", "outliers", "prior", "lag", "polynomial"))]
check("of nothing else", not unknown, unknown)
value, sigma = inertia(alone)
check("its inertia holds", abs(value - INERTIA) < 2 * sigma < 0.05 * INERTIA, (value, sigma))

# ---- What does not go with it.
for options, says in (
    (["--friction", "coulomb_viscous_load"], "coulomb_viscous_stribeck"),
    (["--friction", "stribeck"], "not linear or depends on load"),
    (["--asymmetry"], "--asymmetry"),
    (["--robust", "huber"], "--robust"),
    (["--prior", 30], "--prior"),
    (["--essential"], "--essential"),
    (["--lag", "auto"], "--lag auto"),
    (["--thermal", "iv.yaml"], "--thermal"),
    (["--drive-gains"], "--drive-gains"),
):
    r = harness.run(program, "dynamics", "swing.xml", "repeated.csv", "--iv", *options, "-o", "refused.yaml", "--quiet")
    check_refused(f"--iv {options}", r, ["--iv", says])
r = harness.run(program, "dynamics", "swing.xml", "once.csv", "--iv", "-o", "refused.yaml", "--quiet")
check_refused("no repetition", r, ["--iv", "once.csv", "no motion is repeated"])
check("nothing is written", not os.path.exists(path("refused.yaml")))
finish()
