"""Thermal models from recordings, against simulation and least squares of scipy. Arguments: tribotwin, source tree."""
import csv, datetime, json, os, re, subprocess, sys

import h5py
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lsim

import harness
from harness import check, check_refused, failures, finish, work

program, source = sys.argv[1:3]


def run(*arguments, code=0):
    r = harness.run(program, "thermal", *arguments)
    if r.returncode != code:
        check(arguments, False, (r.returncode, r.stdout[-2000:], r.stderr))
    return r


def fit(*arguments):
    return json.loads(run(*arguments, "--json", "--quiet").stdout)["joints"]


def refused(name, says, *arguments):
    check_refused(name, run(*arguments, code=2), says)


def write(file, columns):
    np.savetxt(
        f"{work}/{file}",
        np.column_stack(list(columns.values())),
        delimiter=",",
        header=",".join(columns),
        comments="",
        fmt="%.12g",
    )


# ---- A joint of Hao 2021's table (the ER3A's third) over days of changing power, integrated by scipy.
truth = {"c1": 0.07548, "c2": 0.00681, "t1": 55.032, "t2": 1423.12}


def warmed(time, power, ambient, start=(0, 0)):
    """Exact for power that is linear between the samples."""
    A, B = np.diag([-1 / truth["t1"], -1 / truth["t2"]]), [[truth["c1"]], [truth["c2"]]]
    return ambient + lsim((A, B, [[1, 1]], [[0]]), power, time, X0=start, interp=True)[1]


def day(file, seed, ambient, powers, hours=3.0, start=(0, 0)):
    time = np.arange(0, hours * 3600, 5.0)
    power = np.array(powers)[(time // 2400).astype(int) % len(powers)]
    temperature = warmed(time, power, ambient, start) + 0.05 * np.random.default_rng(seed).standard_normal(len(time))
    write(file, {"time_s": time, "power_w_arm": power, "temperature_arm_degC": temperature})
    return time, power, temperature


time, power, temperature = day("monday.csv", 1, 20, [1.5, 0.5, 2.5])
day("tuesday.csv", 2, 22, [2.5, 0.0, 1.0], start=(1.0, 4.0))
both = fit("monday.csv", "tuesday.csv", "-o", "arm.yaml")["arm"]
check("the second order is identifiable", both["order"] == 2 and both["unidentifiable"] == [], both)
off = {n: (p["value"] - truth[n]) / p["sigma"] for n, p in both["parameters"].items()}
check(
    "parameters within 3 of their sigmas, time constants within 2 %",
    max(map(abs, off.values())) < 3
    and all(abs(both["parameters"][n]["value"] / truth[n] - 1) < 0.02 for n in ("t1", "t2")),
    off,
)
check(
    "ambient temperature of each day",
    np.allclose([e["value"] for e in both["T_amb_degC"]], [20, 22], atol=0.05),
    both["T_amb_degC"],
)
check("noise", abs(both["rms_K"] - 0.05) < 0.002 and both["correlated_samples"] < 1.5, both)
check("a fit per day beside the merged one", set(both["files"]) == {"monday.csv", "tuesday.csv"})


def model(p):  # exact steps between samples, power as the mean of its neighbours
    c1, c2, t1, t2, ambient, x1, x2 = p
    out = np.full(len(time), ambient)
    for c, t, x in ((c1, t1, x1), (c2, t2, x2)):
        for k in range(len(time)):
            if k:
                x = x * np.exp(-5 / t) + c * t * (1 - np.exp(-5 / t)) * (power[k - 1] + power[k]) / 2
            out[k] += x
    return out


monday = both["files"]["monday.csv"]
r = least_squares(
    lambda p: model(p) - temperature, [0.05, 0.01, 100, 1000, 21, 0.1, 0.1], x_scale=[0.01, 0.001, 10, 100, 1, 1, 1]
)
sigma = np.sqrt(np.diag(np.linalg.inv(r.jac.T @ r.jac)) * 2 * r.cost / len(time))
mine = [monday["parameters"][n] for n in ("c1", "c2", "t1", "t2")]
check(
    "scipy's least squares finds the same minimum",
    np.all(np.abs([m["value"] for m in mine] - r.x[:4]) < 0.05 * sigma[:4]),
    (mine, r.x, sigma),
)
# Monday's residuals are nearly white: sigma differs by what their autocorrelation sums to.
check(
    "and the same sigmas",
    np.allclose([m["sigma"] for m in mine], sigma[:4] * np.sqrt(monday["correlated_samples"]), rtol=0.02),
    (mine, sigma, monday["correlated_samples"]),
)

# ---- Pagani (4): the closed form of a constant power from rest.
seconds = np.arange(0, 7200, 10.0)
steps = sum(truth[f"c{i}"] * truth[f"t{i}"] * -np.expm1(-seconds / truth[f"t{i}"]) for i in (1, 2))
write(
    "constant.csv",
    {"time_s": seconds, "power_w_arm": np.full(len(seconds), 2.0), "temperature_arm_degC": 20 + 2 * steps},
)
constant = fit("constant.csv", "--rested")["arm"]
check(
    "a step of known start identifies all, exactly",
    all(abs(p["value"] / truth[n] - 1) < 1e-4 for n, p in constant["parameters"].items()),
    constant,
)
free = fit("constant.csv", "--order", 2)["arm"]
check(
    "without that, time constants but no gains, and no temperature without them",
    set(free["unidentifiable"]) == {"c1", "c2", "T_amb"}
    and free["parameters"]["c1"]["value"] is None
    and abs(free["parameters"]["t2"]["value"] / truth["t2"] - 1) < 1e-3,
    free,
)
cold = warmed(time, power, 20)
write("exact.csv", {"time_s": time, "power_w_arm": power, "temperature_arm_degC": cold})
error = json.loads(run("--evaluate", "arm.yaml", "exact.csv", "--json").stdout)
check(
    "a prediction from the first temperature alone", error["worst_rms_K"] < 1.1, error
)  # the mean ambient of the two days is 1 K higher

# ---- A day that is too short says so.
day("short.csv", 3, 20, [2.0], hours=0.1)
short = fit("short.csv", "--order", 2)["arm"]
check("t2 is not identifiable from six minutes", "t2" in short["unidentifiable"], short)
check("the first order is taken then", fit("short.csv")["arm"]["order"] == 1)
said = run("short.csv", "--quiet").stdout
check("and it is said", "not identifiable from this record" in said, said)
row = next(line for line in said.splitlines() if " R_th " in line)
check("no number stands beside it", row.split()[2:4] == ["-", "-"] and "too short" in said and "record " in said, said)

# ---- Power from torque and motion: gravity gives back what it borrows.
fine = np.arange(0, 3600, 0.05)
angle, speed = np.sin(2 * fine), 2 * np.cos(2 * fine)
friction = np.where(fine < 1800, 4.0, 1.0) * np.sign(speed)  # Nm
heat = np.abs(friction * speed)
x = np.zeros(len(fine))
for k in range(1, len(fine)):
    x[k] = x[k - 1] * np.exp(-0.05 / 400) + 2 * (1 - np.exp(-0.05 / 400)) * (heat[k - 1] + heat[k]) / 2
common = {
    "time_s": fine,
    "torque_arm_nm": friction + 30 * np.cos(angle),
    "temperature_arm_degC": 25 + x + 0.01 * np.random.default_rng(4).standard_normal(len(fine)),
}
for name, motion in (("velocity_arm_rad_s", speed), ("position_arm_rad", angle)):
    write("moved.csv", common | {name: motion})
    p = fit("moved.csv", "--order", 1, "--cycle", 3.15)["arm"]["parameters"]
    check(
        f"heat from torque and {name}",
        abs(p["kappa"]["value"] / 400 - 1) < 0.01 and abs(p["R_th"]["value"] / 2 - 1) < 0.02,
        p,
    )

# ---- The ER3A twin's working day, and a slower one: heat and temperature of each cycle.
scenario = open(f"{source}/twin/scenarios/er3a_c60_day.yaml").read().replace("../../mjcf", f"{source}/mjcf")
for name, share in (("fast", 0.6), ("slow", 0.3)):
    open(f"{work}/{name}.yaml", "w").write(scenario.replace("speed_share: 0.6", f"speed_share: {share}"))
    subprocess.run(
        [program, "run", f"{name}.yaml", "-o", name, "--quiet"], cwd=work, check=True, timeout=300, capture_output=True
    )
    with h5py.File(f"{work}/{name}/telemetry.h5") as f:
        cycles = {"time_s": f["cycle_time_s"][:]}
        for j in range(1, 7):
            cycles[f"power_w_joint{j}"] = f[f"joint{j}/cycle_friction_power_W"][:]
            cycles[f"temperature_joint{j}_degC"] = f[f"joint{j}/cycle_temperature_degC"][
                :
            ] + 0.02 * np.random.default_rng(j).standard_normal(len(cycles["time_s"]))
    write(f"{name}.csv", cycles)

# ---- A multi-rate run: its record has every cycle, its samples only a few with gaps between.
tribotwin_run = lambda *a: subprocess.run(
    [program, *a], cwd=work, check=True, timeout=60, capture_output=True, text=True
)
tribotwin_run("export", "fast", "--csv")
of_record, of_cycles = fit("fast"), fit("fast/cycles.csv")
check(
    "the record of a multi-rate run gives what its cycles give",
    all(
        abs(of_record[j]["parameters"][n]["value"] / e["value"] - 1) < 0.02
        for j, joint in of_cycles.items()
        for n, e in joint["parameters"].items()
    ),
    (of_record, of_cycles),
)
check("and says so", "work cycles of the record are used" in run("fast").stderr)
refused("its samples alone are refused", ["gaps of", "cycles.csv", "--work-cycle"], "fast/telemetry.csv")
gap = np.where((time > 4000) & (time < 5800), False, True)
write("gap.csv", {"time_s": time[gap], "power_w_arm": power[gap], "temperature_arm_degC": temperature[gap]})
halves = fit("gap.csv")["arm"]
check(
    "half an hour without samples is not bridged",
    halves["unidentifiable"] == []
    and all(abs(e["value"] - truth[n]) < 3 * e["sigma"] for n, e in halves["parameters"].items())
    and "a new session" in run("gap.csv").stderr,
    halves,
)

blocks = re.findall(r'<instance name="j\d">(.*?)</instance>', open(f"{source}/mjcf/er3a_c60.xml").read(), re.S)
off = {}
for joint, block in zip(sorted(joints := fit("fast.csv", "slow.csv")), blocks):
    of_model = {n: float(v) for n, v in re.findall(r'key="(t\d)" value="(\S+?)"', block)}
    off |= {
        f"{joint}.{n}": joints[joint]["parameters"][n]["value"] / v - 1 if joints[joint]["order"] == 2 else np.inf
        for n, v in of_model.items()
    }
check("ER3A: time constants of two days merged within 10 %", len(off) == 12 and max(map(abs, off.values())) < 0.1, off)

# ---- The same from what a controller has: position and torque of working days, no thermometer; then the torques of
# another day.
model = f"{source}/mjcf/er3a_c60.xml"
law = {
    f"joint{j}": {n: float(v) for n, v in re.findall(r'key="(t\d|c\d|a)" value="(\S+?)"', block)}
    for j, block in enumerate(blocks, 1)
}


def tribotwin(*arguments, code=0):
    r = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, cwd=work, timeout=300)
    if r.returncode != code:
        failures.append(arguments)
        print("FAIL", arguments, r.returncode, r.stdout[-2000:], r.stderr, flush=True)
    return r.stdout


def rows(file):
    text = open(f"{work}/{file}").read().splitlines()
    return text[0].split(","), np.array([[float(c or "nan") for c in line.split(",")] for line in text[1:]])


def worked(name, seed, motion):
    """A day of two and a half hours as the controller records it: 10^6 increments per turn, torque noise 1 % of
    torque_max; skipped cycles are gaps."""
    json.dump(
        {
            "model": model,
            "duration_s": 9000,
            "ambient_degC": 20,
            "motion": {"type": "cycle"} | motion,
            "multirate": {"tolerance_K": 0.5},
            "telemetry_rate_hz": 100,
        },
        open(f"{work}/{name}.yaml", "w"),
    )
    tribotwin("run", f"{name}.yaml", "-o", f"day_{name}", "--quiet")
    tribotwin(
        "export",
        f"day_{name}",
        "--recording",
        "--encoder",
        1e6,
        "--torque-noise",
        0.01,
        "--seed",
        seed,
        "-o",
        "whole.csv",
        "--force",
    )
    names, values = rows("whole.csv")
    write(f"{name}.csv", {n: values[:, k] for k, n in enumerate(names) if not n.startswith("temperature")})
    with h5py.File(f"{work}/day_{name}/telemetry.h5") as f:
        return np.diff(f["cycle_time_s"][:]).min(), values[:, 0]


there_and_back = {
    "ramp_s": 0.25,
    "dwell_s": 0.3,
    "waypoints": [{"position_rad": [s * q for q in (1.2, 0.5, 0.5, 1.8, 1.2, 2.5)]} for s in (-1, 1)],
}
cycles = {
    f"warm{share}": worked(f"warm{share}", 1000 * share, there_and_back | {"speed_share": share / 10})
    for share in (6, 4, 3)
}
days = [f"{name}.csv" for name in cycles]
periods = ",".join(f"{period:.4f}" for period, _ in cycles.values())
merged = fit(*days, "--cycle", periods, "--rested", "-o", "thermal.yaml")
off, times = {}, {}
for joint, j in merged.items():
    if j["order"] == 2 and not j["unidentifiable"]:
        for n, e in j["parameters"].items():
            value = law[joint]["a"] * law[joint][n[6:]] if n.startswith("alpha") else law[joint][n]
            off[f"{joint}.{n}"] = (e["value"] - value) / e["sigma"]
            times |= {f"{joint}.{n}": e["value"] / value - 1} if n[0] == "t" else {}
print(
    "     torque alone: time constants off by at most",
    max(map(abs, times.values()), default=np.inf),
    "sigmas",
    max(map(abs, off.values()), default=np.inf),
)
check(
    "torque alone identifies alpha c and t of six joints within 3.5 sigmas, which are the scatter",
    len(off) == 24
    and max(map(abs, off.values())) < 3.5
    and 0.6 < np.sqrt(np.mean(np.square(list(off.values())))) < 1.5,
    off,
)
check(
    "time constants of three days merged within 10 %", len(times) == 12 and max(map(abs, times.values())) < 0.1, times
)
ratio = {joint: 1 / j["files"]["warm6.csv"]["final_to_cold"] for joint, j in merged.items()}
check(
    "ER3A at 60 %: cold friction up to 70 % above the final one",
    1.6 < max(ratio.values()) < 1.75 and min(ratio.values()) > 1.3,
    ratio,
)
with h5py.File(f"{work}/day_warm6/telemetry.h5") as f:
    share = {j: f[f"joint{j}/cycle_friction_power_W"][:] for j in range(1, 7)}
    at = np.searchsorted(f["cycle_time_s"][:], 5400)
print("     cold over final friction:", {j: round(r, 3) for j, r in ratio.items()})
left = {j: p[at] / p[-1] - 1 for j, p in share.items()}
print("     friction after 1.5 h over the final one, less 1:", {j: round(r, 4) for j, r in left.items()})
check("and steady after 1.5 h, to 3 %", max(left.values()) < 0.03, left)
names, values = rows("warm6.csv")
write("minutes.csv", {n: values[values[:, 0] < 240, k] for k, n in enumerate(names)})
short = fit("minutes.csv", "--cycle", periods.split(",")[0], "--rested", "--order", 2)
check("four minutes do not identify t2", all("t2" in j["unidentifiable"] for j in short.values()), short)
# The default order too: the final share of the friction is withheld or right.
for joint, j in fit("minutes.csv", "--cycle", periods.split(",")[0], "--rested").items():
    p, final = j["parameters"], law[joint]["a"] * sum(law[joint][f"c{i}"] * law[joint][f"t{i}"] for i in (1, 2))
    p = p.get("alpha_R_th", {"value": None})
    check(
        f"{joint}: alpha R_th of four minutes is withheld or within two sigmas",
        p["value"] is None or abs(p["value"] - final) < 2 * p["sigma"],
        (p, final),
    )
refused("torque alone, not rested", ["warm6.csv", "--rested"], "warm6.csv", "--cycle", 3)
moving = np.gradient(values[:, names.index("position_joint1_rad")], values[:, 0])
there = [np.argmax((values[:, 0] > t) & (moving > 0.5 * moving.max())) for t in (100, 3000)]
cut = np.r_[there[0] - 2000 : there[0], there[1] : there[1] + 2000]
columns = {n: values[cut, k] for k, n in enumerate(names)}
for j in range(1, 7):
    q = values[:, names.index(f"position_joint{j}_rad")]
    columns[f"velocity_joint{j}_rad_s"] = np.gradient(q, values[:, 0])[cut]
write("cut.csv", columns)
tribotwin(
    "dynamics", "--friction", "coulomb_viscous", model, "cut.csv", "--cutoff", 10, "--quiet"
)  # no slope is taken across a gap
known = fit(
    "warm6.csv", "--cycle", periods.split(",")[0], "--rested", "--order", 2, "--alpha", -0.0128, "-o", "kelvin.yaml"
)["joint5"]["parameters"]
kelvin = open(f"{work}/kelvin.yaml").read().split("joint5:")[1]
check(
    "with alpha known, in kelvins",
    abs(float(re.search(r"c1: (\S+)", kelvin).group(1)) / (known["alpha_c1"]["value"] / -0.0128) - 1) < 1e-9,
    kelvin,
)

names, values = rows("whole.csv")  # the last one, with its temperatures
write("measured.csv", {n: values[:, k] for k, n in enumerate(names)})
alpha = {joint: j["alpha"] for joint, j in fit("measured.csv", "--cycle", periods.split(",")[-1]).items()}
check(
    "with temperatures, alpha itself within 3 sigmas and 5 %",
    all(abs(e["value"] + 0.0128) < min(3.5 * e["sigma"], 0.05 * 0.0128) for e in alpha.values()),
    alpha,
)

# Algorithm 1: other waypoints, another speed, the first half minute and the last quarter of an hour.
worked(
    "other",
    9,
    {
        "speed_share": 0.5,
        "ramp_s": 0.3,
        "waypoints": [
            {"position_rad": w}
            for w in (
                [-0.8, 0.4, -0.8, 1.2, 0.9, -1.5],
                [0.9, -0.3, 0.3, -1.4, -0.4, 2.0],
                [0.2, 0.5, 0.1, 0.6, 1.1, -0.6],
            )
        ],
    },
)
names, values = rows("warm6.csv")
for end, part in (("cold", values[:, 0] < 60), ("hot", values[:, 0] > 8000)):
    write(f"{end}.csv", {n: values[part, k] for k, n in enumerate(names)})
    tribotwin(
        "dynamics",
        model,
        f"{end}.csv",
        "--cutoff",
        10,
        "--friction",
        "polynomial",
        "-o",
        f"{end}_robot.yaml",
        "--quiet",
    )
warm = json.loads(
    tribotwin(
        "dynamics",
        model,
        "warm6.csv",
        "--cutoff",
        10,
        "--friction",
        "polynomial",
        "--thermal",
        "thermal.yaml",
        "-o",
        "robot.yaml",
        "--quiet",
        "--json",
    )
)
# Temperatures are in units of the guessed alpha, -0.01 / K, which friction at its own temperatures must find again.
alpha = {joint: p["a"]["value"] for joint, p in warm["friction"].items()}
check("friction and temperature agree", all(abs(a / -0.01 - 1) < 0.03 for a in alpha.values()), alpha)
windows = {"cold": "0,30", "hot": "8000,9000"}
error = {}
for parameters in ("robot", "cold_robot", "hot_robot"):
    for end, window in windows.items():
        joints = json.loads(
            tribotwin(
                "predict",
                model,
                f"{parameters}.yaml",
                "other.csv",
                "--cutoff",
                10,
                "--window",
                window,
                "--json",
                "--quiet",
            )
        )["joints"]
        error[parameters, end] = np.array([j["relative_to_range"] for j in joints.values()])
        print("    ", parameters, end, "[% of range]", np.round(100 * error[parameters, end], 2))
check(
    "torque of another motion without a thermometer: below 3 % of the range, cold and hot",
    max(error["robot", "cold"].max(), error["robot", "hot"].max()) < 0.03,
    error,
)
check(
    "friction of one end of the day is at least twice as wrong at the other",
    np.all(error["cold_robot", "hot"] > 2 * error["robot", "hot"])
    and np.all(error["hot_robot", "cold"] > 2 * error["robot", "cold"]),
    error,
)
tribotwin("predict", model, "robot.yaml", "other.csv", "--cutoff", 10, "-o", "predicted.csv", "--quiet")
names, values = rows("predicted.csv")
with h5py.File(f"{work}/day_other/telemetry.h5") as f:
    for j in range(1, 7):
        rise = (values[-1, names.index(f"temperature_joint{j}_degC")] - 20) * alpha[f"joint{j}"] / law[f"joint{j}"]["a"]
        check(
            f"joint{j}: the temperature itself within 1 K, alpha given",
            abs(rise + 20 - f[f"joint{j}/temperature_degC"][-1]) < 1,
            rise,
        )


def refused_by(name, says, *arguments):
    r = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, cwd=work, timeout=60)
    check(
        name,
        r.returncode == 2
        and r.stdout == ""
        and len(r.stderr.strip().splitlines()) == 1
        and all(s in r.stderr for s in says),
        r.stderr,
    )


refused_by(
    "a start without a thermal model",
    ["--thermal"],
    "predict",
    model,
    "cold_robot.yaml",
    "other.csv",
    "--start",
    30,
    "--quiet",
)
refused_by(
    "five starts for six joints",
    ["5 temperatures", "6 joints"],
    "predict",
    model,
    "robot.yaml",
    "other.csv",
    "--start",
    "20,20,20,20,20",
    "--quiet",
)
refused_by(
    "friction that does not know temperature",
    ["coulomb_viscous", "polynomial"],
    "dynamics",
    "--friction",
    "coulomb_viscous",
    model,
    "cold.csv",
    "--thermal",
    "thermal.yaml",
    "--quiet",
)
refused_by(
    "thermal models of another robot",
    ["arm.yaml", "'joint1'"],
    "dynamics",
    model,
    "cold.csv",
    "--friction",
    "polynomial",
    "--thermal",
    "arm.yaml",
    "--quiet",
)
names, values = rows("cold.csv")
write("bad.csv", {n: -values[:, k] if n.startswith("torque") else values[:, k] for k, n in enumerate(names)})
refused(
    "torque of the other sign",
    ["bad.csv", "other sign"],
    "bad.csv",
    "--cycle",
    periods.split(",")[0],
    "--rested",
    "--quiet",
)

# ---- A real arm: UR3, two sessions of a day; heat of the windings per ohm.
recording = f"{source}/../shared/data/ur3_cobotops/dataset_02052023.csv"
if os.path.exists(recording):
    rows = list(csv.reader(open(recording, encoding="utf-8-sig"), delimiter=";"))
    stamp = np.array(
        [datetime.datetime.fromisoformat(r[1].strip('"').replace("Z", "+00:00")).timestamp() for r in rows[1:]]
    )
    number = lambda cell: float(cell.replace(",", ".")) if cell.strip() else np.nan
    values = np.array([[number(c) for c in r[2:14]] for r in rows[1:]])
    second = np.argmax(np.diff(stamp)) + 1
    for file, part in (("first.csv", slice(0, second)), ("second.csv", slice(second, None))):
        write(
            file,
            {"time_s": stamp[part] - stamp[0]}
            | {
                n: c
                for j in range(6)
                for n, c in (
                    (f"power_w_joint{j}", values[part, 2 * j] ** 2),
                    (f"temperature_joint{j}_degC", values[part, 2 * j + 1]),
                )
            },
        )
    joints = fit("first.csv", "-o", "ur3.yaml")
    check("49 minutes identify one time constant", all(j["order"] == 1 for j in joints.values()), joints)
    check(
        "the last joint's current has no effect, and that is said",
        "R_th" in joints["joint5"]["unidentifiable"],
        joints["joint5"],
    )
    rms = {
        n: j[0]["rms_K"]
        for n, j in json.loads(run("--evaluate", "ur3.yaml", "second.csv", "--json", "--quiet").stdout)[
            "joints"
        ].items()
    }
    print("     UR3, second session predicted from the first [K rms]:", {n: round(v, 3) for n, v in rms.items()})
    check(
        "one by one: four joints within 0.5 K, the hot wrists within 0.8 K",
        all(rms[f"joint{j}"] < 0.5 for j in (0, 1, 2, 5)) and max(rms.values()) < 0.8,
        rms,
    )
    # Whether joints warm their neighbours is decided by the first session: its last third from the first two.
    third = len(values[:second]) * 2 // 3
    for file, part in (("begin.csv", slice(0, third)), ("end.csv", slice(third, second))):
        write(
            file,
            {"time_s": stamp[part] - stamp[0]}
            | {
                n: c
                for j in range(6)
                for n, c in (
                    (f"power_w_joint{j}", values[part, 2 * j] ** 2),
                    (f"temperature_joint{j}_degC", values[part, 2 * j + 1]),
                )
            },
        )
    held_out = {}
    for option, name in (("--quiet", "alone"), ("--chain", "chain")):
        run("begin.csv", option, "-o", f"{name}.yaml", "--force")
        held_out[name] = [
            j[0]["rms_K"]
            for j in json.loads(run("--evaluate", f"{name}.yaml", "end.csv", "--json", "--quiet").stdout)[
                "joints"
            ].values()
        ]
    check(
        "the first session's last third: the chain is better",
        np.sqrt(np.mean(np.square(held_out["chain"]))) < 0.85 * np.sqrt(np.mean(np.square(held_out["alone"])))
        and max(held_out["chain"]) < 0.8 * max(held_out["alone"]),
        held_out,
    )
    run("first.csv", "--chain", "-o", "chain.yaml", "--force")
    predicted = json.loads(run("--evaluate", "chain.yaml", "second.csv", "--json", "--quiet").stdout)["joints"]
    rms = [j[0]["rms_K"] for j in predicted.values()]
    print("     UR3 as a chain [K rms]:", np.round(rms, 3))
    check(
        "a chain: its band knows the second session's warmer surroundings",
        all(j[0]["inside"] > 0.99 and 4 < j[0]["half_width_K"] < 6 for j in predicted.values()),
        predicted,
    )
    predicted = json.loads(run("--evaluate", "chain.yaml", "first.csv", "--json", "--quiet").stdout)["joints"]
    inside = np.mean([j[0]["inside"] for j in predicted.values()])
    check("a chain: of its own session the band is narrow and holds", 0.88 < inside < 0.98, predicted)
    check("a chain: five joints within 0.5 K, the last within 0.55 K", max(rms[:5]) < 0.5 and rms[5] < 0.55, rms)
else:
    print("SKIP the recording of ../shared/data is not beside this checkout")

# ---- Data that are not what they say.
good = {"time_s": time, "power_w_arm": power, "temperature_arm_degC": temperature}


def refused_columns(name, says, **changed):
    columns = {n: c for n, c in (good | changed).items() if c is not None}
    write("bad.csv", columns)
    refused(name, ["bad.csv", *says], "bad.csv")


# Two bodies that warm each other, integrated by scipy.
two = np.array([[-1 / 1200 - 1 / 900, 1 / 900], [1 / 900, -1 / 2500 - 1 / 900]])
pair = lsim(
    (two, np.eye(2), np.eye(2), np.zeros((2, 2))),
    np.column_stack([0.01 * power + 22 / 1200, 0.004 * power[::-1] + 30 / 2500]),
    time,
    X0=[20, 25],
    interp=True,
)[1]
pair += 0.02 * np.random.default_rng(7).standard_normal(pair.shape)
write(
    "pair.csv",
    {
        "time_s": time,
        "power_w_a": power,
        "temperature_a_degC": pair[:, 0],
        "power_w_b": power[::-1],
        "temperature_b_degC": pair[:, 1],
    },
)
chain = json.loads(run("pair.csv", "--chain", "--json", "--quiet").stdout)
found = {"exchange": (chain["exchange_1_s"], 1 / 900)} | {
    f"{joint}.{n}": (chain["joints"][joint][n], v)
    for joint, of in (("a", {"gain": 0.01, "t": 1200, "T_amb": 22}), ("b", {"gain": 0.004, "t": 2500, "T_amb": 30}))
    for n, v in of.items()
}
check(
    "a chain of two bodies within 3 sigmas and 3 %",
    chain["unidentifiable"] == []
    and all(
        abs(e["value"] - v) < 3.5 * e["sigma"] + 1e-3 * v and abs(e["value"] / v - 1) < 0.03 for e, v in found.values()
    ),
    found,
)
refused_columns("no temperature", ["temperature_JOINT_degC"], temperature_arm_degC=None)
refused_columns("no power", ["power_arm_w", "torque_arm_nm"], power_w_arm=None)
refused_columns("no time", ["time_s"], time_s=None)
refused_columns("kelvins", ["kelvins"], temperature_arm_degC=temperature + 273)
refused_columns("a temperature that stands", ["always"], temperature_arm_degC=np.full(len(time), 20.0))
refused_columns("time that runs back", ["does not come after"], time_s=time[::-1])
open(f"{work}/bad.csv", "w").write("time_s,power_w_arm,temperature_arm_degC\n0,1,20\n1,x,20\n")
refused("no number", ["bad.csv:3", "'x'"], "bad.csv")
write("bad.csv", {n: c[:10] for n, c in good.items()})
refused("ten rows", ["at least 20"], "bad.csv")
open(f"{work}/bad.yaml", "w").write(open(f"{work}/arm.yaml").read().replace("t2: ", "t3: ", 1))
refused(
    "a cycle for each of two files, but three of them",
    ["--work-cycle", "3 values for 2 files"],
    "monday.csv",
    "tuesday.csv",
    "--cycle",
    "1,2,3",
)
refused("a mistyped key", ["bad.yaml", "t3"], "--evaluate", "bad.yaml", "monday.csv")
open(f"{work}/bad.yaml", "w").write(open(f"{work}/arm.yaml").read().replace("arm:", "leg:", 1))
refused("another robot's file", ["bad.yaml", "'arm'"], "--evaluate", "bad.yaml", "monday.csv")

finish()
