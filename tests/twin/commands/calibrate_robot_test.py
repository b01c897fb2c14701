"""tribotwin calibrate on an arm without torque sensors and on benches of several masses: what simulated recordings were
made with is found within its sigmas, each setting of a recording counts or is refused. Arguments: program."""
import json, os, sys

import numpy as np

import harness
from harness import check, finish, path
from pendulum import PENDULUM

program = sys.argv[1]
random = np.random.default_rng(1)


def run(*arguments):
    return harness.run(program, *arguments, timeout=300)


def write(name, content):
    with open(path(name), "w") as f:
        f.write(content if isinstance(content, str) else json.dumps(content))


def table(name, columns):
    np.savetxt(path(name), np.transpose(list(columns.values())), delimiter=",", header=",".join(columns), comments="")


def simulated(name, scenario, control):
    """The record of a run, its set points and positions sampled as often as the set points came."""
    write(name + ".yaml", scenario + "control: " + control + "\ntelemetry_rate_hz: 100\n")
    r = run("run", name + ".yaml", "-o", name, "--force", "--quiet")
    check("a run to calibrate on: " + name, r.returncode == 0, r.stderr)
    run("export", name, "--csv", "--force")
    return np.genfromtxt(path(name, "telemetry.csv"), delimiter=",", names=True, deletechars="")


# ---- An arm of two joints: friction and masses from positions alone, because the gains of the servos are known.
def arm(masses, friction):
    instances = "".join(
        '<instance name="%s"><config key="law" value="stribeck"/><config key="Fc" value="%g"/>'
        '<config key="Fs" value="0"/><config key="vs" value="10"/><config key="alpha" value="1"/>'
        '<config key="Fv" value="%g"/><config key="torque_max_nm" value="10"/>'
        '<config key="gear_ratio" value="50"/></instance>' % (name, *values)
        for name, values in zip("se", friction)
    )
    bodies = [(m, 0.01 * m, 0.01 * m, 0.001 * m) for m in masses]
    return """<mujoco model="arm"><extension><plugin plugin="tribotwin.drive">%s</plugin></extension>
  <option timestep="0.001"/>
  <default><joint frictionloss="0.01" solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/></default>
  <worldbody><body name="upper" pos="0 0 1"><inertial pos="0 0 -.15" mass="%g" diaginertia="%g %g %g"/>
    <joint name="shoulder" axis="0 1 0" armature="0.02"/>
    <body name="fore" pos="0 0 -.3"><inertial pos="0 0 -.12" mass="%g" diaginertia="%g %g %g"/>
      <joint name="elbow" axis="0 1 0" armature="0.01"/></body></body></worldbody>
  <actuator><plugin name="s" joint="shoulder" plugin="tribotwin.drive" instance="s" actdim="3" dyntype="user"/>
    <plugin name="e" joint="elbow" plugin="tribotwin.drive" instance="e" actdim="3" dyntype="user"/></actuator>
</mujoco>""" % (
        instances,
        *bodies[0],
        *bodies[1],
    )


truth = {
    "drive.shoulder.Fc": 0.06,
    "drive.shoulder.Fv": 4e-4,
    "drive.elbow.Fc": 0.04,
    "drive.elbow.Fv": 2.5e-4,
    "body.upper.mass_kg": 1.3,
    "body.fore.mass_kg": 0.8,
}
write("true.xml", arm((1.3, 0.8), ((0.06, 4e-4), (0.04, 2.5e-4))))
write("guess.xml", arm((1, 1), ((0.03, 1e-3), (0.03, 1e-3))))
servo = (
    "{type: servo, position_gain_1_s: {shoulder: 8, elbow: 9}, speed_gain_nm_s_rad: {shoulder: 2, elbow: 1}, "
    "integral_time_s: 0"
)
t = np.arange(0, 6, 0.01)
os.mkdir(path("arm"))
for k in range(2):
    goals = [
        0.8 * np.sin((0.94 + 0.63 * k) * t) + 0.4 * np.sin(3.1 * t + 0.7 * k),
        0.9 * np.sin((1.26 + 0.82 * k) * t) - 0.5 * np.sin(2.7 * t + k) + 0.5 * np.sin(k),
    ]
    goals = [g - g[0] for g in goals]
    table("goals.csv", {"time_s": t, "position_shoulder_rad": goals[0], "position_elbow_rad": goals[1]})
    made = simulated(
        "arm_run%d" % k, "model: true.xml\nmotion: {type: recording, file: goals.csv}\n", servo + ", gravity: false}"
    )
    columns = {"time_s": made["time_s"]}
    for joint, goal in zip(("shoulder", "elbow"), goals):
        columns["set_point_%s_rad" % joint] = np.interp(made["time_s"], t, goal)
        columns["position_%s_rad" % joint] = made[joint + ".position_rad"] + random.normal(0, 1e-3, len(made))
    table("arm/%d.csv" % k, columns)

fit = (
    """recordings: {files: arm/*.csv}
search: {starts: 1, evaluations: 200}
control: %s}
drive:
  Fc: {start: 0.03, low: 0, high: 0.15}
  Fv: {start: 1e-3, low: 1e-5, high: 0.01, scale: logarithmic}
  Fs: 0
  vs: 10
  alpha: 1
body: {mass_kg: {upper: {start: 1, low: 0.3, high: 3}, fore: {start: 1, low: 0.3, high: 3}}}
variants: [{label: arm, model: guess.xml, law: stribeck}]
"""
    % servo
)
write("fit.yaml", fit)
r = run("calibrate", "fit.yaml", "-o", "found", "--threads", "2")
check("an arm is calibrated", r.returncode == 0 and r.stderr == "", r.stderr)
with open(path("found/calibration.json")) as f:
    found = json.load(f)["variants"][0]["all"]
check("in few evaluations", found["evaluations"] <= 120, found["evaluations"])
check("down to the noise of the encoders", abs(found["learning_mae_mrad"] - 0.8) < 0.08, found["learning_mae_mrad"])
for name, value in truth.items():
    got = found["parameters"][name]
    check("%s within 3.5 sigma" % name, abs(got["value"] - value) < 3.5 * got["sigma"], got)
    check("%s: a sigma that says something" % name, 0 < got["sigma"] < 0.03 * value, got)
check("a law per joint", all(os.path.exists(path("found/arm.%s.params.yaml" % j)) for j in ("shoulder", "elbow")))
r = run("run", "found/arm.yaml", "-o", "again", "--quiet", "--set", "telemetry_rate_hz=1000")
check("the twin found runs", r.returncode == 0, r.stderr)
run("export", "again", "--csv")
again = np.genfromtxt(path("again", "telemetry.csv"), delimiter=",", names=True, deletechars="")
recorded = np.genfromtxt(path("arm/0.csv"), delimiter=",", names=True, deletechars="")
at = np.ceil(recorded["time_s"] * 1000 - 1e-6).astype(int)
inside = at < len(again)
error = [
    again[j + ".position_rad"][at[inside]] - recorded["position_%s_rad" % j][inside] for j in ("shoulder", "elbow")
]
reported = found["recordings"][0]["mae_mrad"]
check("its error is the reported one", abs(1e3 * np.mean(np.abs(error)) / reported - 1) < 2e-3, reported)


def refused(name, text, old, new, *says):
    if old not in text:
        return check(name, False, "the case is stale")
    write("wrong.yaml", text.replace(old, new))
    r = run("calibrate", "wrong.yaml", "-o", "wrong")
    lines = r.stderr.strip().splitlines()
    check("refused: " + name, r.returncode == 2 and len(lines) == 1 and all(s in lines[0] for s in says), r.stderr)


one = "recordings: {files: arm/*.csv"
refused("mass of which body", fit, one, one + ", settings: [{files: '*', mass: 2}]", "which body", "payload")
refused("gain of another controller", fit, one, one + ", settings: [{files: '*', kp: 2}]", "kp", "servo")
refused("key of another controller", fit, "integral_time_s: 0", "integral_time_s: 0, kt_nm_A: 1", "kt_nm_A", "type")
refused("a servo without its gain", fit, "speed_gain_nm_s_rad", "torque_limit_nm", "speed_gain_nm_s_rad is missing")
refused("no such body", fit, "fore: {", "foer: {", "did you mean 'fore'")
refused("no such joint", fit, "elbow: 9", "elbo: 9", "did you mean 'elbow'")
refused("payload without a mass", fit, one, one + ", settings: [{files: '*', payload: {}}]", "mass_kg")
refused("slope of absolute errors", fit, "search: {", "error: absolute\nsearch: {method: gauss_newton, ", "squared")
table("half.csv", {"time_s": t, "set_point_elbow_rad": t, "position_elbow_rad": t})
refused("a joint that was not recorded", fit, "arm/*.csv", "half.csv", "half.csv", "shoulder")

# ---- The records of runs, whose set points are in their scenarios: the true twin follows them exactly.
write(
    "smooth.yaml",
    "model: true.xml\nduration_s: 2\nmotion: {type: cycle, waypoints: [{position_rad: {shoulder: 0}}, "
    "{position_rad: {shoulder: 0.5, elbow: -0.8}}], speed_rad_s: 1}\ncontrol: %s, gravity: false}\n" % servo,
)
r = run("run", "smooth.yaml", "-o", "smooth", "--quiet", "--set", "telemetry_rate_hz=200")
check("a run with a planned motion", r.returncode == 0, r.stderr)
for name, files, bar in (("held", "arm_run1", 1e-6), ("planned", "smooth/telemetry.h5", 0.05)):
    records = fit[: fit.index("drive:")] + "body: {mass_kg: {upper: {start: 1.3, low: 0.3, high: 3}}}\n"
    records = records.replace("arm/*.csv", files).replace("evaluations: 200", "evaluations: 1")
    write("records.yaml", records + "variants: [{label: arm, model: true.xml, law: stribeck}]\n")
    r = run("calibrate", "records.yaml", "-o", "record_" + name, "--json", "--quiet")
    check("the record of a run, set points %s" % name, r.returncode == 0, r.stderr)
    mae = json.loads(r.stdout)["variants"][0]["all"]["learning_mae_mrad"]
    check("its twin is the same", mae < bar, mae)
r = run("run", "record_planned/arm.yaml", "-o", "planned_again", "--quiet")
check("the scenario found has the motion of the run", r.returncode == 0, r.stderr)

# ---- Benches: a pendulum with two masses and lengths, as the recordings say; and a servo that slews and warms up.
firmware = "error_gain: 0.0028774, supply_V: 7.4, resistance_ohm: 3.4, kp: 400, duty_slew_1_s: 20, duty_limit: 0.9"
t = np.arange(0, 2, 0.01)
goal = 0.7 * np.sin(2 * t * t)
os.mkdir(path("bench"))
for mass, length in ((0.49, 0.1), (0.3, 0.15)):
    write("pendulum.xml", PENDULUM.replace('mass="0.49" diaginertia="1e-6', 'mass="%g" diaginertia="1e-6' % mass))
    with open(path("pendulum.xml")) as f:
        text = f.read().replace('pos="0 0 -0.1"', 'pos="0 0 -%g"' % length)
    share = mass / 0.49
    write("pendulum.xml", text.replace("1e-6 1e-6 1e-6", "%g %g %g" % (3 * (1e-6 * share,))))
    entries = [{"timestamp": x, "goal_position": g, "position": 0.0, "temp": 40} for x, g in zip(t, goal)]
    write("goals.json", {"entries": entries})
    made = simulated(
        "bench_run",
        "model: pendulum.xml\nmotion: {type: recording, file: goals.json}\n",
        "{type: dc_position, %s, kt_nm_A: 0.36, resistance_per_K: 0.004}" % firmware,
    )
    for entry, q in zip(entries, np.interp(t, made["time_s"], made["hinge.position_rad"])):
        entry["position"] = q
    write("bench/m%g.json" % mass, {"mass": mass, "length": length, "kd": 0, "vin": 7.4, "entries": entries[:-2]})
write("pendulum.xml", PENDULUM)
bench = (
    """recordings: {files: bench/*.json}
hold_out: {folds: by mass}
search: {starts: 1, evaluations: 60}
control: {%s, resistance_per_K: 0.004, kt_nm_A: {start: 0.33, low: 0.2, high: 0.6}}
variants:
  - {label: load, model: pendulum.xml, law: load, drive: {Fc0: 0.03, Fcl: 0.3, Fs0: 0, Fsl: 0.1, vs: 100, alpha: 1.4,
      Fv: 3e-5}}
"""
    % firmware
)
write("bench.yaml", bench)
r = run("calibrate", "bench.yaml", "-o", "benches", "--threads", "2")
check("two masses, held out in turn", r.returncode == 0 and "1 of 2 recordings have mass 0.3 kg" in r.stderr, r.stderr)
with open(path("benches/calibration.json")) as f:
    found = json.load(f)["variants"][0]
check("each predicts the other", found["held_out_mae_mrad"] < 0.2, found["held_out_mae_mrad"])
kt = found["all"]["parameters"]["control.kt_nm_A"]["value"]
check("the motor's constant", abs(kt / 0.36 - 1) < 2e-3, kt)
write("bound.yaml", bench.replace("{start: 0.33, low: 0.2, high: 0.6}", "{start: 0.33, low: 0.3, high: 0.34}"))
r = run("calibrate", "bound.yaml", "-o", "bound", "--json", "--quiet")
check("a bound that is too low ends the search there", r.returncode == 0, r.stderr)
got = json.loads(r.stdout or "{}")["variants"][0]["all"]["parameters"]["control.kt_nm_A"]
check("and has no sigma", got == {"value": 0.34, "sigma": None, "status": "at_bound"}, got)
same = "recordings: {files: bench/*.json"
r_same = same + ", settings: [{files: '*', mass: 0.49}]"
refused("folds of what is the same everywhere", bench, same, r_same, "every recording has mass 0.49")
refused("folds of what nobody has", bench, "by mass", "by payload", "no label 'payload'", "mass")
refused("a setting that is none", bench, same, same + ", settings: [{files: '*', masss: 1}]", "did you mean 'mass'")
refused("a mass that is none", bench, same, same + ", settings: [{files: '*', mass: -1}]", "mass")
free = bench.replace("variants:", "body: {mass_kg: {pendulum: 0.5}}\nvariants:")
refused("a mass given twice", free, "by mass", "by mass", "body.mass_kg", "m0.3.json")
for key, value, says in (("kd", 5, "no controller here"), ("offset", 0.1, "joint.ref"), ("mass", 0, "above 0")):
    with open(path("bench/m0.3.json")) as f:
        write("head.json", {**json.load(f), key: value})
    refused("a head with %s %g" % (key, value), bench, "files: bench/*.json", "files: head.json", key, says)


# ---- Speeds and torques that were commanded in place of positions, and a servo whose gain bends.
def commanded(unit):
    """Smooth commands of 4 s for shoulder and elbow."""
    t = np.arange(0, 4, 0.01)
    size = 1 if unit == "rad_s" else 2.2
    return t, [size * np.sin(3.1 * t) * (1 + 0.4 * np.sin(1.3 * t)), -0.5 * size * np.sin(4.3 * t + 0.4 * t * t)]


def record_of(columns, made, t, commands, unit):
    for joint, command in zip(("shoulder", "elbow"), commands):
        columns["set_point_%s_%s" % (joint, unit)] = np.interp(made["time_s"], t, command)
        columns["position_%s_rad" % joint] = made[joint + ".position_rad"] + random.normal(0, 5e-4, len(made))
    return columns


modes = (
    ("velocity", "rad_s", "speed_gain_nm_s_rad: {shoulder: 2, elbow: 1}, integral_time_s: 0", {}),
    ("torque", "nm", "torque_gain: {shoulder: 1, elbow: 0.9}", {"control.elbow.torque_gain": 0.9}),
)
for mode, unit, keys, also in modes:
    t, commands = commanded(unit)
    columns = {"time_s": t, **{"set_point_%s_%s" % (j, unit): c for j, c in zip(("shoulder", "elbow"), commands)}}
    table(mode + "_commands.csv", columns)
    gravity = ", gravity: false" if mode == "velocity" else ""
    made = simulated(
        mode + "_run",
        "model: true.xml\nmotion: {type: recording, file: %s_commands.csv}\n" % mode,
        "{type: %s, %s%s}" % (mode, keys, gravity),
    )
    table(mode + ".csv", record_of({"time_s": made["time_s"]}, made, t, commands, unit))
    free = keys.replace("0.9", "{start: 1, low: 0.5, high: 1.5}")
    fits = """recordings: {files: %s.csv}
search: {starts: 1, evaluations: 120}
correlation_s: 0.5
control: {type: %s, %s}
drive: {Fc: {start: 0.03, low: 0, high: 0.15}, Fv: {shoulder: 4e-4, elbow: 2.5e-4}, Fs: 0, vs: 10, alpha: 1}
variants: [{label: arm, model: true.xml, law: stribeck}]
""" % (
        mode,
        mode,
        free,
    )
    write(mode + "_fit.yaml", fits)
    r = run("calibrate", mode + "_fit.yaml", "-o", mode + "_found", "--json", "--threads", "2")
    check("commanded %s: calibrated" % mode, r.returncode == 0 and r.stderr == "", r.stderr)
    found = json.loads(r.stdout)["variants"][0]["all"]
    check("down to the noise, %s" % mode, abs(found["learning_mae_mrad"] - 0.4) < 0.08, found["learning_mae_mrad"])
    for name, value in {"drive.shoulder.Fc": 0.06, "drive.elbow.Fc": 0.04, **also}.items():
        got = found["parameters"][name]
        check("%s, %s within 3.5 sigma" % (mode, name), abs(got["value"] - value) < 3.5 * got["sigma"], got)
        check("%s, %s: a sigma that says something" % (mode, name), 0 < got["sigma"] < 0.1 * value, got)
    r = run("run", mode + "_found/arm.yaml", "-o", mode + "_again", "--quiet", "--set", "telemetry_rate_hz=100")
    check("%s: the twin found runs" % mode, r.returncode == 0, r.stderr)
    run("export", mode + "_again", "--csv")
    again = np.genfromtxt(path(mode + "_again", "telemetry.csv"), delimiter=",", names=True, deletechars="")
    n = min(len(again), len(made))
    error = 1e3 * np.mean(np.abs(again["elbow.position_rad"][:n] - made["elbow.position_rad"][:n]))
    check("%s: and moves as the true one" % mode, error < 1, error)
    records = fits.replace(mode + ".csv", mode + "_run").replace(
        "{start: 0.03, low: 0, high: 0.15}", "{shoulder: 0.06, elbow: 0.04}"
    )
    write("records.yaml", records.replace(free, keys))
    r = run("calibrate", "records.yaml", "-o", mode + "_record", "--json", "--quiet")
    check("the record of a run, commanded %s" % mode, r.returncode == 0, r.stderr)
    mae = json.loads(r.stdout)["variants"][0]["all"]["learning_mae_mrad"]
    check("%s: its twin is the same" % mode, mae < 1e-6, mae)
    other = "torque" if mode == "velocity" else "velocity"
    complete = "speed_gain_nm_s_rad: 1, integral_time_s: 0"
    for name, type, gains, says in (
        ("servo", "servo", "position_gain_1_s: 8, " + complete, "set_point_JOINT_rad,"),
        ("default", "dc_position", "error_gain: 1, supply_V: 1, resistance_ohm: 1, kt_nm_A: 1, kp: 1", "_rad,"),
        (other, other, complete if other == "velocity" else "torque_gain: 1", "set_point_JOINT_"),
    ):
        old = "control: {type: %s, %s}" % (mode, free)
        new = "control: {type: %s, %s}" % (type, gains)
        refused("%s, commanded %s" % (name, mode), fits, old, new, says, "type: %s" % mode, mode + ".csv")
    key = "position_gain_1_s" if mode == "velocity" else "integral_time_s"
    refused("an outer loop's key, " + mode, fits, "type: %s, " % mode, "type: %s, %s: 1, " % (mode, key), key, mode)

# Speeds and torques beside positions are fed forward by a servo; positions beside speeds count nothing.
t, speeds = commanded("rad_s")
torques = commanded("nm")[1]
goals = [np.concatenate([[0], np.cumsum(v[:-1]) * 0.01]) for v in speeds]
columns = {"time_s": t}
for j, joint in enumerate(("shoulder", "elbow")):
    columns["set_point_%s_rad" % joint] = goals[j]
    columns["set_point_%s_rad_s" % joint] = speeds[j]
    columns["set_point_%s_nm" % joint] = torques[j]
table("forward_commands.csv", columns)
recording = "model: true.xml\nmotion: {type: recording, file: forward_commands.csv}\n"
made = simulated("forward_run", recording, servo + ", gravity: false}")
for joint in ("shoulder", "elbow"):
    for unit in ("rad", "rad_s", "nm"):
        columns["set_point_%s_%s" % (joint, unit)] = columns["set_point_%s_%s" % (joint, unit)][: len(made)]
    columns["position_%s_rad" % joint] = made[joint + ".position_rad"][: len(t)]
columns["time_s"] = t[: len(made)]
table("forward.csv", columns)
table("backward.csv", {k: c for k, c in columns.items() if not k.endswith(("rad_s", "nm"))})
forward = (
    """recordings: {files: forward.csv}
search: {starts: 1, evaluations: 1}
control: %s}
variants: [{label: arm, model: true.xml, law: stribeck}]
"""
    % servo
)
mae = {}
for files in ("forward.csv", "forward_run", "backward.csv"):
    write("forward.yaml", forward.replace("forward.csv", files))
    r = run("calibrate", "forward.yaml", "-o", "fed_" + files, "--json", "--quiet")
    check("fed forward: " + files, r.returncode == 0 and r.stderr == "", r.stderr)
    mae[files] = json.loads(r.stdout)["variants"][0]["all"]["learning_mae_mrad"]
check("feed-forward counts", mae["forward.csv"] < 1e-3 and mae["forward_run"] < 1e-3 and mae["backward.csv"] > 50, mae)
write("forward.yaml", forward.replace(servo, "{type: velocity, speed_gain_nm_s_rad: 2, integral_time_s: 0"))
r = run("calibrate", "forward.yaml", "-o", "fed_velocity", "--json", "--quiet")
check("what is not read is said", "set_point_JOINT_rad of forward.csv counts nothing" in r.stderr, r.stderr)

refused("a torque gain without torques", fit, servo, servo + ", torque_gain: 1", "torque_gain", "set_point_JOINT_nm")
for name, file, control, says in (
    ("positions that are not there", "torque_commands.csv", servo + "}", ["follows positions", "type: torque"]),
    ("speeds that are not there", "goals.csv", "{type: velocity}", ["is velocity", "set_point_JOINT_rad_s"]),
    ("a gain of no loop", "velocity_commands.csv", "{type: velocity, position_gain_1_s: 1}", ["position_gain_1_s"]),
):
    write("no.yaml", "model: true.xml\nmotion: {type: recording, file: %s}\ncontrol: %s\n" % (file, control))
    harness.check_refused("run refuses " + name, run("run", "no.yaml", "-o", "no"), ["no.yaml", *says])

bends = "error_1_rad: 0.02, error_factor_1: 0.5, error_2_rad: 0.2, kp_1: 200, kp_factor_1: 0.8, kp_2: 600"
goals = {"entries": [{"timestamp": x, "goal_position": g, "position": 0.0} for x, g in zip(np.arange(200) / 100, goal)]}
write("goals.json", goals)
made = simulated(
    "bend_run",
    "model: pendulum.xml\nmotion: {type: recording, file: goals.json}\n",
    "{type: dc_position, %s, kt_nm_A: 0.36, %s}" % (firmware, bends),
)
positions = np.interp(np.arange(200) / 100, made["time_s"], made["hinge.position_rad"])
for entry, q in zip(goals["entries"], positions):
    entry["position"] = q + random.normal(0, 2e-4)
write("bend.json", {**goals, "entries": goals["entries"][:-2]})
bend = """recordings: {files: bend.json}
search: {starts: 1, evaluations: 80}
correlation_s: 0.2
control: {%s, kt_nm_A: 0.36, %s}
variants:
  - {label: load, model: pendulum.xml, law: load, drive: {Fc0: 0.03, Fcl: 0.3, Fs0: 0, Fsl: 0.1, vs: 100, alpha: 1.4,
      Fv: 3e-5}}
""" % (
    firmware,
    bends.replace("factor_1: 0.5", "factor_1: {start: 1, low: 0.1, high: 2}"),
)
write("bend.yaml", bend)
r = run("calibrate", "bend.yaml", "-o", "bend", "--json", "--quiet")
check("a gain that bends", r.returncode == 0, r.stderr)
found = json.loads(r.stdout or "{}")["variants"][0]["all"]
got = found["parameters"]["control.error_factor_1"]
check("its factor within 3.5 sigma", abs(got["value"] - 0.5) < max(3.5 * got["sigma"], 2e-3), got)
check("and its sigma says something", 0 < got["sigma"] < 0.1, got)
write("straight.yaml", bend[: bend.index(", error_1_rad")] + bend[bend.index("}\nvariants") :])
r = run("calibrate", "straight.yaml", "-o", "straight", "--json", "--quiet")
mae = json.loads(r.stdout)["variants"][0]["all"]["learning_mae_mrad"]
evolution = bend.replace("starts: 1, evaluations: 80", "starts: 1, evaluations: 33, method: cma_es")
write("evolution.yaml", evolution)
found_by = []
for threads in ("1", "3"):
    r = run("calibrate", "evolution.yaml", "-o", "threads" + threads, "--json", "--quiet", "--threads", threads)
    found_by.append(r.stdout)
check("candidates in parallel: not a bit differs", r.returncode == 0 and found_by[0] == found_by[1] != "", found_by)
check("a straight gain does not explain it", mae > 5 * found["learning_mae_mrad"], (mae, found["learning_mae_mrad"]))
check("no gain", run("run", "bend/load.yaml", "-o", "bend_again", "--quiet").returncode == 0)
for name, old, new, *says in (
    ("a factor without its knot", "error_1_rad: 0.02, ", "", "error_factor_1", "error_1_rad"),
    ("knots out of order", "error_2_rad: 0.2", "error_2_rad: 0.01", "error_2_rad", "above error_1_rad"),
    ("a knot without the one before", "kp_1: 200, kp_factor_1: 0.8, ", "", "kp_2", "kp_1 is missing"),
    ("a free knot", "error_2_rad: 0.2", "error_2_rad: {start: 0.2, low: 0.1, high: 1}", "error_2_rad", "known"),
    ("a fifth knot", "error_2_rad", "error_5_rad", "error_5_rad", "did you mean"),
):
    refused(name, bend, old, new, *says)
finish()
