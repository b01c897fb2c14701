"""tribotwin identify on recordings sample by sample: bouc_wen and lugre, as their users meet them. scipy integrates the
plant and judges values and sigmas. Arguments: tribotwin, source tree."""
import json, os, re, shutil, subprocess, sys

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import harness
from harness import check, check_refused, finish, work

program, source = sys.argv[1:3]
random = np.random.default_rng(5)


def write(name, header, *columns):
    np.savetxt(
        os.path.join(work, name), np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.12g"
    )
    return name


def run(*arguments):
    return harness.run(program, *arguments)


def identify(*arguments):
    r = run("identify", "--json", *arguments)
    return json.loads(r.stdout) if r.returncode == 0 else r


def refused(name, *arguments, says, code=2):
    check_refused(name, run("identify", *arguments), says, code)


def within(found, truth, sigmas=3):
    return all(
        abs(found["parameters"][n]["value"] - p) < sigmas * found["parameters"][n]["sigma"] for n, p in truth.items()
    )


def replaced(model, name, instance):
    begin = model.index(f'<instance name="{name}">')
    return (
        model[:begin]
        + re.search("<instance.*</instance>", instance, re.S)[0]
        + model[model.index("</instance>", begin) + len("</instance>") :]
    )


# ---- The spring of mjcf/rh380n_bench.xml under some 3 kNm at 20, 35 and 50 degC; a torque sensor of 5 Nm noise.
GEAR = dict(
    k00=1.9e6, k01=6e3, k02=-20, k10=8e7, k11=2e5, k12=0, k20=2e12, k21=0, k22=0, w=0.65, beta=1500, gamma=300, n=1.2
)
t = np.arange(0, 8, 0.004)
torsion = lambda t: 1.1e-3 * np.sin(2 * np.pi * 0.25 * t) + 0.25e-3 * np.sin(2 * np.pi * 1.1 * t)
rate = lambda t: 2 * np.pi * (0.275e-3 * np.cos(2 * np.pi * 0.25 * t) + 0.275e-3 * np.cos(2 * np.pi * 1.1 * t))
b, c, n, w = (GEAR[k] for k in ("beta", "gamma", "n", "w"))
x = solve_ivp(
    lambda t, x: rate(t) - b * abs(rate(t)) * abs(x) ** (n - 1) * x - c * rate(t) * abs(x) ** n,
    (0, 8),
    [0.0],
    t_eval=t,
    rtol=1e-9,
    atol=1e-13,
    max_step=0.004,
).y[0]
phi = torsion(t)
for T in (20, 35, 50):
    k = sum(
        (GEAR[f"k{i}0"] + GEAR[f"k{i}1"] * T + GEAR[f"k{i}2"] * T * T) * abs(phi) ** p for i, p in enumerate((0, 1, 3))
    )
    tau = k * (w * phi + (1 - w) * x) + random.normal(0, 5, t.size)
    write(f"{T}.csv", "time_s,torsion_rad,torque_nm,temperature_degC", t, phi, tau, np.full(t.size, T))
gear = identify("--law", "bouc_wen", "20.csv", "35.csv", "50.csv", "-o", "gear.yaml")
check(
    "Bouc-Wen: within 3 sigma of the truth",
    not isinstance(gear, subprocess.CompletedProcess) and within(gear, GEAR),
    gear,
)
check(
    "Bouc-Wen: normalised MSE below 1e-3, residuals are the sensor's noise",
    gear["normalised_mse"] < 1e-4 and abs(gear["residual"]["std"] / 5 - 1) < 0.03,
    (gear["normalised_mse"], gear["residual"]),
)
check(
    "Bouc-Wen: everything is identifiable",
    gear["unidentifiable"] == [] and gear["samples"] == 3 * t.size,
    gear["unidentifiable"],
)
one = identify("--law", "bouc_wen", "35.csv")
check(
    "one temperature",
    set(one["unidentifiable"]) == {"k01", "k02", "k11", "k12", "k21", "k22"}
    and one["parameters"]["k01"]["status"] == "held",
    one["unidentifiable"],
)
instance = run("export", "gear.yaml", "--mjcf", "--name", "gear", "--drive", "motor")
check(
    "export prints the instance",
    instance.returncode == 0
    and '<instance name="gear">' in instance.stdout
    and 'key="torsion_max_rad"' in instance.stdout,
    instance.stderr,
)
bench = open(source + "/mjcf/rh380n_bench.xml").read()
with open(work + "/bench.xml", "w") as f:
    f.write(replaced(bench, "gear", instance.stdout))
shutil.copy(source + "/mjcf/scene.xml", work)
r = run("curve", "bench.xml", "--joint", "motor", "--temperature", 30, "--speeds", "1:100:3")
check("which the bench loads", r.returncode == 0, r.stderr)
refused(
    "degrees of torsion",
    "--law",
    "bouc_wen",
    write("deg.csv", "time_s,torsion_rad,torque_nm", t, 1e3 * phi, tau),
    says="are these degrees",
)
refused(
    "a torsion of the wrong sign",
    "--law",
    "bouc_wen",
    write("sign.csv", "time_s,torsion_rad,torque_nm", t, -phi, tau),
    says="opposite sign of torsion_rad",
)
refused(
    "kelvins",
    "--law",
    "bouc_wen",
    write("K.csv", "time_s,torsion_rad,torque_nm,temperature_degC", t, phi, tau, np.full(t.size, 308.0)),
    says="kelvins",
)
refused("no torsion", "--law", "bouc_wen", write("no.csv", "time_s,torque_nm", t, tau), says="no column torsion_rad")
refused(
    "time that stands",
    "--law",
    "bouc_wen",
    write("still.csv", "time_s,torsion_rad,torque_nm", 0 * t, phi, tau),
    says="must increase",
)
refused(
    "no hysteresis",
    "--law",
    "bouc_wen",
    write("elastic.csv", "time_s,torsion_rad,torque_nm", t, phi, 2e6 * phi + random.normal(0, 5, t.size)),
    says="no hysteresis",
    code=1,
)
refused(
    "a temperature in one file only",
    "--law",
    "bouc_wen",
    "35.csv",
    write("noT.csv", "time_s,torsion_rad,torque_nm", t, phi, tau),
    says="lacks a column temperature_degC",
)
refused("options of curves", "--law", "bouc_wen", "--fix", "n=1", "35.csv", says="--fix: belongs to friction curves")

# ---- Static curves of the motor first, then its bristles from reversals; motor side, gear ratio 1.
STATIC = dict(
    Fc0=1.6,
    FcT=0.02,
    FcTT=0,
    Fs0=2.4,
    FsT=0.025,
    FsTT=1e-4,
    vs0=6,
    vsT=0.05,
    vsTT=-2e-4,
    delta=1.4,
    Fv0=0.034,
    FvT=-8e-4,
    FvTT=6e-6,
)
BRISTLES = dict(sigma0=60, sigma1=0.6, vd=2)


def parts(p, v, T):
    Fc, Fs, vs, Fv = (p[a + "0"] + p[a + "T"] * T + p[a + "TT"] * T * T for a in ("Fc", "Fs", "vs", "Fv"))
    return Fc + (Fs - Fc) * np.exp(-abs(v / vs) ** p["delta"]), Fv * v


v, T = np.tile(0.5 * 300 ** (np.arange(24) / 23), 7), np.repeat(np.linspace(20, 50, 7), 24)
write(
    "curves.csv",
    "speed_rad_s,friction_nm,temperature_degC",
    v,
    sum(parts(STATIC, v, T)) + random.normal(0, 0.005, v.size),
    T,
)
static = identify("--law", "stribeck_T", "--tau-max", 20, "--gear-ratio", 1, "curves.csv", "-o", "static.yaml")
check(
    "stribeck_T: within 3 sigma of the truth",
    not isinstance(static, subprocess.CompletedProcess) and within(static, STATIC),
    static,
)
found = {name: e["value"] for name, e in static["parameters"].items()}
t, T = np.arange(0, 8, 0.004), 30.0
speed = lambda t: 0.08 * np.sin(2 * np.pi * 1.3 * t) + np.exp(0.5 * t - 3) * np.sin(2 * np.pi * 0.7 * t)
dz = lambda w, z: w - BRISTLES["sigma0"] * abs(w) * z / parts(STATIC, w, T)[0]
z = solve_ivp(lambda t, z: dz(speed(t), z), (0, 8), [0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=0.004).y[0]
w = speed(t)
tau = (
    BRISTLES["sigma0"] * z
    + BRISTLES["sigma1"] * np.exp(-((w / BRISTLES["vd"]) ** 2)) * dz(w, z)
    + parts(STATIC, w, T)[1]
    + random.normal(0, 0.05, t.size)
)
reversals = write("reversals.csv", "time_s,velocity_rad_s,torque_nm,temperature_degC", t, w, tau, np.full(t.size, T))
lugre = identify("--law", "lugre", "--static", "static.yaml", reversals, "-o", "lugre.yaml")
check(
    "LuGre: within 3 sigma of the truth",
    not isinstance(lugre, subprocess.CompletedProcess) and within(lugre, BRISTLES) and lugre["normalised_mse"] < 1e-3,
    lugre,
)

# The same fit by scipy: the exact step once more, over the law as identified.
g, h = parts(found, w, T)
way = 0.5 * (w[1:] + w[:-1]) * np.diff(t)
g_between = parts(found, way / np.diff(t), T)[0]


def predicted(p):
    z, deflection = p[3] * parts(found, 0.0, T)[0] / p[0], np.empty(t.size)
    for i in range(t.size):
        deflection[i] = z
        if i < way.size:
            end = g_between[i] / p[0]
            z = z - (np.copysign(end, way[i]) - z) * np.expm1(-abs(way[i]) / end)
    return p[0] * deflection + p[1] * np.exp(-((w / p[2]) ** 2)) * (w - abs(w) * deflection * p[0] / g) + h - tau


judge = least_squares(predicted, [40, 1.0, 1.0, 0], x_scale=[60, 0.6, 2, 1], diff_step=1e-5, xtol=1e-12, ftol=1e-12)
sigma = np.sqrt(np.diag(np.linalg.inv(judge.jac.T @ judge.jac)) * 2 * judge.cost / (t.size - 4))[:3]
values, sigmas = (np.array([lugre["parameters"][n][k] for n in BRISTLES]) for k in ("value", "sigma"))
check(
    "LuGre: scipy's minimum",
    np.all(abs(values - judge.x[:3]) < 0.02 * sigma) and abs(lugre["cost"] / (2 * judge.cost) - 1) < 1e-5,
    ((values - judge.x[:3]) / sigma, lugre["cost"] / 2 / judge.cost),
)
check(
    "LuGre: scipy's sigmas, up to what correlation adds",
    np.all(sigmas > 0.98 * sigma) and np.all(sigmas < 1.15 * sigma),
    sigmas / sigma,
)
instance = run("export", "lugre.yaml", "--mjcf", "--name", "motor")
keys = dict(re.findall(r'key="(\w+)" value="([^"]*)"', instance.stdout))
check(
    "export: a drive with bristles",
    instance.returncode == 0
    and keys["friction"] == "lugre"
    and np.isclose(float(keys["sigma0"]), values[0])
    and keys["law"] == "stribeck_T",
    instance.stderr,
)
with open(work + "/bench.xml", "w") as f:
    f.write(replaced(bench, "motor", instance.stdout))
r = run("curve", "bench.xml", "--joint", "motor", "--temperature", 30, "--speeds", "1:100:3")
check(
    "which the bench loads",
    r.returncode == 0
    and np.allclose(
        np.loadtxt(r.stdout.splitlines()[1:], delimiter=",")[:, 4], sum(parts(found, np.array([1, 50.5, 100]), T))
    ),
    r.stderr,
)
refused("bristles over nothing", "--law", "lugre", reversals, says="--static PARAMS.yaml")
refused(
    "a law for a law", "--law", "stribeck_T", "--static", "static.yaml", "curves.csv", says="belongs to --law lugre"
)
refused(
    "no temperature",
    "--law",
    "lugre",
    "--static",
    "static.yaml",
    write("lnoT.csv", "time_s,velocity_rad_s,torque_nm", t, w, tau),
    says="temperature_degC is needed",
)
refused(
    "friction that drives",
    "--law",
    "lugre",
    "--static",
    "static.yaml",
    write("lsign.csv", "time_s,velocity_rad_s,torque_nm,temperature_degC", t, w, -tau, np.full(t.size, T)),
    says="drives the motion",
)
refused("several at once", "--law", "stribeck,lugre", "curves.csv", says="by itself")

finish()
