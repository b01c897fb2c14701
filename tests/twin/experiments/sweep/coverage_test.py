"""Bands of a sweep over an identified law cover the true warm-up with their nominal probability: friction curves of the
true law with noise, identified, the covariance swept through a warm-up, the band compared with the run of the true law.
Arguments: tribotwin[, repeats (6), runs of each sweep (40)]. By hand: 200 repeats of 120 runs, 20 minutes."""
import csv, json, sys

import numpy as np

import harness
from harness import check, finish, path
from reference_law import M_STAR, law

program = sys.argv[1]
repeats, runs = (int(x) for x in (sys.argv[2:] + ["6", "40"])[:2])
NAMES = "Fc0 Fcl Fs0 FsT Fsl vs0 vsT vsl alpha Fv0 FvT TV0".split()
NOISE = 1.5e-3  # of torque_max, 3 % of friction
ARM = """<mujoco><option timestep="0.008" integrator="implicit"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="drive">
    <config key="law" value="extended"/> %s <config key="temperature_min_degC" value="25"/>
    <config key="temperature_max_degC" value="85"/> <config key="load_max" value="0.6"/>
    <config key="torque_max_nm" value="1200"/> <config key="gear_ratio" value="134"/>
    <config key="thermal" value="first_order"/> <config key="T_amb" value="25"/>
    <config key="R_th" value="0.4"/> <config key="kappa" value="1000"/>
  </instance></plugin></extension>
  <worldbody><body pos="0 0 1"><inertial pos="0.4 0 0" mass="60" diaginertia="1 1 1"/>
    <joint name="hinge" axis="0 1 0" armature="20" frictionloss="1" solreffriction=".001 1"
      solimpfriction=".9999 .9999 .001 .5 2"/>
    <geom type="sphere" size=".1" mass="0" contype="0" conaffinity="0"/></body></worldbody>
  <actuator><plugin name="drive" joint="hinge" plugin="tribotwin.drive" instance="drive" actdim="3"/></actuator>
</mujoco>"""
PLAN = """scenario: scenario.yaml
parameters: params%d.yaml
design: {type: %s, runs: %d, seed: %d}
outputs: [joints.hinge.temperature_degC.end]
quantiles: [0.025, 0.975]
bands: {telemetry: [hinge.cycle_temperature_degC], times: 12}
"""
MARK = "hinge.cycle_temperature_degC"


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


def tribotwin(*arguments):
    r = harness.run(program, *arguments)
    if r.returncode:
        sys.exit(f"{arguments}: {r.returncode} {r.stderr}")
    return r


write("arm.xml", ARM % " ".join(f'<config key="{n}" value="{v}"/>' for n, v in zip(NAMES, M_STAR)))
write(
    "scenario.yaml",
    "model: arm.xml\nduration_s: 2500\nambient_degC: 25\nmultirate: {tolerance_K: 4}\n"
    "motion: {type: back_and_forth, joint: hinge, travel_rad: 2, speed_rad_s: 1.8, acceleration_rad_s2: 20}\n",
)
speed, load, degC = (
    x.ravel() for x in np.meshgrid(np.geomspace(2, 280, 16), [0, 0.2, 0.4, 0.6], np.linspace(25, 85, 7))
)
truth = law(M_STAR, speed, load, degC)
random = np.random.default_rng(1)


def repeat(k):
    """Per time, whether the band holds the truth; and the width of the band at the end."""
    header = "speed_rad_s,load_norm,temperature_degC,friction_norm"
    rows = np.column_stack([speed, load, degC, truth + NOISE * random.standard_normal(truth.size)])
    np.savetxt(path(f"curves{k}.csv"), rows, delimiter=",", header=header, comments="")
    tribotwin("identify", "--law", "extended", f"curves{k}.csv", "-o", f"params{k}.yaml", "--quiet")
    write(f"plan{k}.yaml", PLAN % (k, "latin_hypercube", runs, k + 1))
    harness.run(program, "sweep", f"plan{k}.yaml", "-o", f"sweep{k}", "--quiet")
    bands = list(csv.DictReader(open(path(f"sweep{k}", "bands.csv"))))
    failed = json.load(open(path(f"sweep{k}", "statistics.json")))["runs"]["failed"]
    low, high = (np.array([float(b[f"{MARK}.q{q}"]) for b in bands]) for q in ("0.025", "0.975"))
    return (low <= true) & (true <= high), high[-1] - low[-1], failed


# The true warm-up, by a sweep over what has no effect.
write(
    "true.yaml",
    PLAN.replace("parameters: params%d.yaml", "factors: {seed: [1, 2]}").replace(
        "%s, runs: %d, seed: %d", "random, runs: 2"
    ),
)
tribotwin("sweep", "true.yaml", "-o", "true", "--quiet")
true = np.array([float(b[f"{MARK}.q0.975"]) for b in csv.DictReader(open(path("true", "bands.csv")))])
check("the arm warms up", true[-1] - true[0] > 15, true)
held, widths, failed = zip(*(repeat(k) for k in range(repeats)))
held = np.array(held)[:, 1:]  # all begin at the same temperature
print(
    f"{repeats} repeats of {runs} runs: the 95 % band holds the truth in {100 * held.mean():.1f} % (all times), "
    f"{100 * held[:, -1].mean():.1f} % (end); by time {np.round(100 * held.mean(0), 1)}; "
    f"width at the end {np.mean(widths):.3f} K; {sum(failed)} runs failed"
)
check("no run failed", sum(failed) == 0, failed)
if repeats >= 200:
    check("the band holds the truth in 93 .. 97 %", 0.93 <= held.mean() <= 0.97, held.mean())
else:  # so few that are right by chance: 1 in 1,000 with true 95 %
    check("the band holds the truth", held[:, -1].sum() >= repeats - 2, held)
check("the band is no wider than the data make it", 0.05 < np.mean(widths) < 5, widths)
finish()
