"""Thermal models from recordings, against simulation and least squares of scipy. Arguments: tribotwin, source tree."""
import csv, datetime, json, os, re, subprocess, sys, tempfile

import h5py
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lsim

program, source = sys.argv[1:3]
work = tempfile.mkdtemp(prefix="tribotwin_thermal_")
failures = []


def check(name, condition, detail=""):
    print("ok  " if condition else "FAIL", name, "" if condition else detail, flush=True)
    if not condition:
        failures.append(name)


def run(*arguments, code=0):
    r = subprocess.run([program, "thermal", *map(str, arguments)], capture_output=True, text=True, cwd=work, timeout=300)
    if r.returncode != code:
        failures.append(arguments)
        print("FAIL", arguments, r.returncode, r.stdout[-2000:], r.stderr, flush=True)
    return r


def fit(*arguments):
    return json.loads(run(*arguments, "--json", "--quiet").stdout)["joints"]


def refused(name, says, *arguments):
    r = run(*arguments, code=2)
    check(name, r.stdout == "" and len(r.stderr.strip().splitlines()) == 1 and all(s in r.stderr for s in says), r.stderr)


def write(file, columns):
    np.savetxt(f"{work}/{file}", np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="", fmt="%.12g")


# ---- A joint of paper 3's table (the ER3A's third) over days of changing power, integrated by scipy.
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
check("the second order is told", both["order"] == 2 and both["unidentifiable"] == [], both)
off = {n: (p["value"] - truth[n]) / p["sigma"] for n, p in both["parameters"].items()}
check("parameters within 3 of their sigmas, time constants within 2 %", max(map(abs, off.values())) < 3 and all(abs(both["parameters"][n]["value"] / truth[n] - 1) < 0.02 for n in ("t1", "t2")), off)
check("ambient temperature of each day", np.allclose([e["value"] for e in both["T_amb_degC"]], [20, 22], atol=0.05), both["T_amb_degC"])
check("noise", abs(both["rms_K"] - 0.05) < 0.002 and both["correlated_samples"] < 1.5, both)
check("a fit per day beside the merged one", set(both["files"]) == {"monday.csv", "tuesday.csv"})


def model(p):   # exact steps between samples, power as the mean of its neighbours
    c1, c2, t1, t2, ambient, x1, x2 = p
    out = np.full(len(time), ambient)
    for c, t, x in ((c1, t1, x1), (c2, t2, x2)):
        for k in range(len(time)):
            if k:
                x = x * np.exp(-5 / t) + c * t * (1 - np.exp(-5 / t)) * (power[k - 1] + power[k]) / 2
            out[k] += x
    return out


monday = both["files"]["monday.csv"]
r = least_squares(lambda p: model(p) - temperature, [0.05, 0.01, 100, 1000, 21, 0.1, 0.1], x_scale=[0.01, 0.001, 10, 100, 1, 1, 1])
sigma = np.sqrt(np.diag(np.linalg.inv(r.jac.T @ r.jac)) * 2 * r.cost / len(time))
mine = [monday["parameters"][n] for n in ("c1", "c2", "t1", "t2")]
check("scipy's least squares finds the same minimum", np.all(np.abs([m["value"] for m in mine] - r.x[:4]) < 0.05 * sigma[:4]), (mine, r.x, sigma))
# Monday's residuals are nearly white: sigma differs by what their autocorrelation sums to.
check("and the same sigmas", np.allclose([m["sigma"] for m in mine], sigma[:4] * np.sqrt(monday["correlated_samples"]), rtol=0.02), (mine, sigma, monday["correlated_samples"]))

# ---- P5 (4): the closed form of a constant power from rest.
seconds = np.arange(0, 7200, 10.0)
steps = sum(truth[f"c{i}"] * truth[f"t{i}"] * -np.expm1(-seconds / truth[f"t{i}"]) for i in (1, 2))
write("constant.csv", {"time_s": seconds, "power_w_arm": np.full(len(seconds), 2.0), "temperature_arm_degC": 20 + 2 * steps})
constant = fit("constant.csv", "--rested")["arm"]
check("a step of known start tells all, exactly", all(abs(p["value"] / truth[n] - 1) < 1e-4 for n, p in constant["parameters"].items()), constant)
free = fit("constant.csv", "--order", 2)["arm"]
check("without that, time constants but no gains", set(free["unidentifiable"]) == {"c1", "c2"} and abs(free["parameters"]["t2"]["value"] / truth["t2"] - 1) < 1e-3, free)
cold = warmed(time, power, 20)
write("exact.csv", {"time_s": time, "power_w_arm": power, "temperature_arm_degC": cold})
error = json.loads(run("--evaluate", "arm.yaml", "exact.csv", "--json").stdout)
check("a prediction from the first temperature alone", error["worst_rms_K"] < 1.1, error)   # the mean ambient of the two days is 1 K higher

# ---- A day that is too short says so.
day("short.csv", 3, 20, [2.0], hours=0.1)
short = fit("short.csv", "--order", 2)["arm"]
check("t2 is not identifiable from six minutes", "t2" in short["unidentifiable"], short)
check("the first order is taken then", fit("short.csv")["arm"]["order"] == 1)
check("and it is said", "not identifiable from this record" in run("short.csv", "--quiet").stdout)

# ---- Power from torque and motion: gravity gives back what it borrows.
fine = np.arange(0, 3600, 0.05)
angle, speed = np.sin(2 * fine), 2 * np.cos(2 * fine)
friction = np.where(fine < 1800, 4.0, 1.0) * np.sign(speed)   # Nm
heat = np.abs(friction * speed)
x = np.zeros(len(fine))
for k in range(1, len(fine)):
    x[k] = x[k - 1] * np.exp(-0.05 / 400) + 2 * (1 - np.exp(-0.05 / 400)) * (heat[k - 1] + heat[k]) / 2
common = {"time_s": fine, "torque_arm_nm": friction + 30 * np.cos(angle), "temperature_arm_degC": 25 + x + 0.01 * np.random.default_rng(4).standard_normal(len(fine))}
for name, motion in (("velocity_arm_rad_s", speed), ("position_arm_rad", angle)):
    write("moved.csv", common | {name: motion})
    p = fit("moved.csv", "--order", 1, "--cycle", 3.15)["arm"]["parameters"]
    check(f"heat from torque and {name}", abs(p["kappa"]["value"] / 400 - 1) < 0.01 and abs(p["R_th"]["value"] / 2 - 1) < 0.02, p)

# ---- The ER3A twin's working day, and a slower one: heat and temperature of each cycle.
scenario = open(f"{source}/twin/scenarios/er3a_c60_day.yaml").read().replace("../../mjcf", f"{source}/mjcf")
for name, share in (("fast", 0.6), ("slow", 0.3)):
    open(f"{work}/{name}.yaml", "w").write(scenario.replace("speed_share: 0.6", f"speed_share: {share}"))
    subprocess.run([program, "run", f"{name}.yaml", "-o", name, "--quiet"], cwd=work, check=True, timeout=300, capture_output=True)
    with h5py.File(f"{work}/{name}/telemetry.h5") as f:
        cycles = {"time_s": f["cycle_time_s"][:]}
        for j in range(1, 7):
            cycles[f"power_w_joint{j}"] = f[f"joint{j}/cycle_friction_power_W"][:]
            cycles[f"temperature_joint{j}_degC"] = f[f"joint{j}/cycle_temperature_degC"][:] + 0.02 * np.random.default_rng(j).standard_normal(len(cycles["time_s"]))
    write(f"{name}.csv", cycles)
blocks = re.findall(r'<instance name="j\d">(.*?)</instance>', open(f"{source}/mjcf/er3a_c60.xml").read(), re.S)
off = {}
for joint, block in zip(sorted(joints := fit("fast.csv", "slow.csv")), blocks):
    of_model = {n: float(v) for n, v in re.findall(r'key="(t\d)" value="(\S+?)"', block)}
    off |= {f"{joint}.{n}": joints[joint]["parameters"][n]["value"] / v - 1 if joints[joint]["order"] == 2 else np.inf for n, v in of_model.items()}
check("ER3A: time constants of two days merged within 10 %", len(off) == 12 and max(map(abs, off.values())) < 0.1, off)

# ---- A real arm: UR3, two sessions of a day; heat of the windings per ohm.
recording = f"{source}/../shared/data/ur3_cobotops/dataset_02052023.csv"
if os.path.exists(recording):
    rows = list(csv.reader(open(recording, encoding="utf-8-sig"), delimiter=";"))
    stamp = np.array([datetime.datetime.fromisoformat(r[1].strip('"').replace("Z", "+00:00")).timestamp() for r in rows[1:]])
    number = lambda cell: float(cell.replace(",", ".")) if cell.strip() else np.nan
    values = np.array([[number(c) for c in r[2:14]] for r in rows[1:]])
    second = np.argmax(np.diff(stamp)) + 1
    for file, part in (("first.csv", slice(0, second)), ("second.csv", slice(second, None))):
        write(file, {"time_s": stamp[part] - stamp[0]} | {n: c for j in range(6) for n, c in ((f"power_w_joint{j}", values[part, 2 * j] ** 2), (f"temperature_joint{j}_degC", values[part, 2 * j + 1]))})
    joints = fit("first.csv", "-o", "ur3.yaml")
    check("49 minutes tell one time constant", all(j["order"] == 1 for j in joints.values()), joints)
    check("the last joint's current has no effect, and that is said", joints["joint5"]["unidentifiable"] == ["R_th"], joints["joint5"])
    rms = {n: j[0]["rms_K"] for n, j in json.loads(run("--evaluate", "ur3.yaml", "second.csv", "--json", "--quiet").stdout)["joints"].items()}
    print("     UR3, second session predicted from the first [K rms]:", {n: round(v, 3) for n, v in rms.items()})
    check("four joints within 0.5 K, the hot wrists within 0.8 K", all(rms[f"joint{j}"] < 0.5 for j in (0, 1, 2, 5)) and max(rms.values()) < 0.8, rms)
else:
    print("SKIP the recording of ../shared/data is not beside this checkout")

# ---- Data that are not what they say.
good = {"time_s": time, "power_w_arm": power, "temperature_arm_degC": temperature}


def refused_columns(name, says, **changed):
    columns = {n: c for n, c in (good | changed).items() if c is not None}
    write("bad.csv", columns)
    refused(name, ["bad.csv", *says], "bad.csv")


refused_columns("no temperature", ["temperature_JOINT_degC"], temperature_arm_degC=None)
refused_columns("no power", ["power_w_arm", "torque_arm_nm"], power_w_arm=None)
refused_columns("no time", ["time_s"], time_s=None)
refused_columns("kelvins", ["kelvins"], temperature_arm_degC=temperature + 273)
refused_columns("a temperature that stands", ["always"], temperature_arm_degC=np.full(len(time), 20.0))
refused_columns("time that runs back", ["does not come after"], time_s=time[::-1])
open(f"{work}/bad.csv", "w").write("time_s,power_w_arm,temperature_arm_degC\n0,1,20\n1,x,20\n")
refused("no number", ["bad.csv:3", "'x'"], "bad.csv")
write("bad.csv", {n: c[:10] for n, c in good.items()})
refused("ten rows", ["at least 20"], "bad.csv")
open(f"{work}/bad.yaml", "w").write(open(f"{work}/arm.yaml").read().replace("t2: ", "t3: ", 1))
refused("a cycle for each of two files, but three of them", ["--cycle", "3 values for 2 files"], "monday.csv", "tuesday.csv", "--cycle", "1,2,3")
refused("a mistyped key", ["bad.yaml", "t3"], "--evaluate", "bad.yaml", "monday.csv")
open(f"{work}/bad.yaml", "w").write(open(f"{work}/arm.yaml").read().replace("arm:", "leg:", 1))
refused("another robot's file", ["bad.yaml", "'arm'"], "--evaluate", "bad.yaml", "monday.csv")

sys.exit(len(failures) > 0)
