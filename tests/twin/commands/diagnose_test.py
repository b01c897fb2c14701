"""tribotwin diagnose against numpy and scipy: features, distances, limits; refusals, exit codes, files. Arguments:
tribotwin, source tree."""
import json, os, re, sys

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

import harness
from harness import check, check_refused, finish, work

program, source = sys.argv[1:3]
random = np.random.default_rng(8)
v = np.array([0.17, 0.87, 1.75, 2.62, 3.49, 5.24, 8.73, 13.96, 17.45, 26.18, 52.36, 78.54, 104.7, 139.6, 174.5])
load = np.array([0.39, 0.39, 0.39, 0.39, 0.39, 0.39, 0.39, 0.38, 0.38, 0.36, 0.35, 0.30, 0.32, 0.34, 0.36])
HEADER = "curve,speed_rad_s,load_norm,temperature_degC,friction_norm,friction_nm,stderr_nm"
tau_max, k = 130.0, 0.6


def run(*arguments, code=0):
    r = harness.run(program, "diagnose", *arguments, timeout=120)
    check(
        f"exit code {code}: {' '.join(map(str, arguments))[:80]}",
        r.returncode == code,
        (r.returncode, r.stdout[-1000:], r.stderr),
    )
    return r


def refused(name, says, *arguments):
    before = sorted(os.listdir(work))
    check_refused(name, run(*arguments, code=2), says)
    check(name + ": nothing is written", sorted(os.listdir(work)) == before)


def curve(T, wear=0.0, extra=0.0):
    l = load + extra
    Fc, Fs, Vs = (
        (1 + wear) * (4.752 + 0.0162 * T + 3.24 * l),
        (1 + wear) * (7.8 + 4.68 * l),
        (1 + wear) * (2 + 0.025 * T),
    )
    friction = (
        Fc
        + (Fs - Fc) * np.exp(-((v / Vs) ** 1.3))
        + 3.39855 * np.exp(-T / 32) * v ** (0.5 + 0.0025 * T)
        + random.normal(0, 0.05, v.size)
    )
    return np.column_stack([v, l, np.full(v.size, T), friction / tau_max, friction, np.full(v.size, 0.05)])


def write(name, curves, keep=lambda column: True):
    rows = np.vstack([np.column_stack([np.full(len(c), i + 1), c]) for i, c in enumerate(curves)])
    columns = [i for i, c in enumerate(HEADER.split(",")) if keep(c)]
    np.savetxt(
        f"{work}/{name}",
        rows[:, columns],
        delimiter=",",
        header=",".join(HEADER.split(",")[i] for i in columns),
        comments="",
        fmt="%.12g",
    )


def judged(*arguments, code=0):
    return json.loads(run("check", *arguments, "--json", "--quiet", code=code).stdout)["observations"]


temperatures = np.linspace(25, 58, 20)
healthy = [curve(T) for T in temperatures]
checked = [curve(25), curve(58), curve(25, wear=0.1), curve(58, wear=0.1), curve(58, extra=0.23)]
write("healthy.csv", healthy)
write("checked.csv", checked)
run("learn", "healthy.csv", "-o", "healthy.yaml", "--quiet")
seen = judged("healthy.yaml", "checked.csv", code=3)


# ---- The same by scipy.
def fitted(f):
    def model(p):
        return p[0] + (p[1] - p[0]) * np.exp(-((v / p[2]) ** 1.3)) + p[3] * v ** p[4]

    r = least_squares(
        lambda p: model(p) - f, [6.5, 9.5, 3, 1, 0.6], x_scale=[5, 5, 3, 1, 0.5], xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return r.x, np.linalg.inv(r.jac.T @ r.jac)


def features(c):
    l, f = c[:, 1], c[:, 4]
    p, H = fitted(f)
    for _ in range(2):
        boundary = p[0] + (p[1] - p[0]) * np.exp(-((v / p[2]) ** 1.3))
        p, H = fitted(f - boundary * k * (l - l.mean()) / (1 + k * l.mean()))
    J = np.diag(np.r_[1 / p[:4], 1])
    return p, J @ H @ J


def log(p):
    return np.r_[np.log(p[:4]), p[4]]


learned = [features(c) for c in healthy]
raw, z = np.array([p for p, _ in learned]), np.array([log(p) for p, _ in learned])
T0 = (temperatures[0] + temperatures[-1]) / 2
X = np.column_stack([np.ones(20), temperatures - T0])
for i, c in enumerate(checked):
    p, H = features(c)
    got = [seen[i]["features"][n] for n in ("Fc", "Fs", "Vs", "Fv", "beta")]
    check(f"features of curve {i + 1}", np.allclose(got, p, rtol=2e-5), (got, p))
    for region, at in (("region1", slice(0, 3)), ("region2", slice(3, 5))):
        count = at.stop - at.start
        d = p[at] - raw[:, at].mean(0)
        distance = d @ np.linalg.solve(np.cov(raw[:, at].T), d)
        scatter = np.array([np.linalg.det(h[at, at]) ** (1 / count) for _, h in learned])
        typical = np.sort(scatter)[10]
        W = np.diag(typical / scatter)
        gram = np.linalg.inv(X.T @ W @ X)
        B = gram @ X.T @ W @ z[:, at]
        R = z[:, at] - X @ B
        S, nu = R.T @ W @ R / 18, 18
        x = np.array([1, c[0, 2] - T0])
        e = log(p)[at] - x @ B
        statistic = e @ np.linalg.solve(S, e) / (np.linalg.det(H[at, at]) ** (1 / count) / typical + x @ gram @ x)
        limit = count * nu / (nu - count + 1) * stats.f.isf(0.0455, count, nu - count + 1)
        r = seen[i][region]
        check(
            f"curve {i + 1}, {region}: distance, T^2, limit",
            np.allclose([r["distance"], r["statistic"], r["limit"]], [distance, statistic, limit], rtol=2e-3),
            (r, distance, statistic, limit),
        )
        check(
            f"curve {i + 1}, {region}: verdict",
            r["anomalous"] == (statistic > limit)
            and r["beyond_two_sigma"] == (distance > 4)
            and r["beyond_wear_threshold"] == (distance > 36),
            r,
        )
check(
    "wear is found cold and hot, and named",
    [o["region1"]["anomalous"] for o in seen[2:4]] == [True] * 2 and [o["pattern"] for o in seen[2:4]] == ["wear"] * 2,
    seen[2:4],
)
check(
    "load is found, named and sized",
    seen[4]["region1"]["anomalous"] and seen[4]["pattern"] == "load" and abs(seen[4]["equivalent_load"] - 0.23) < 0.04,
    seen[4],
)
check(
    "a sentence for each",
    all(
        re.match(r"checked.csv, curve \d \(\d\d.\d degC\): ", o["sentence"]) and 0 <= o["confidence"] <= 1 for o in seen
    ),
)
check(
    "false alarms can be chosen",
    judged("healthy.yaml", "checked.csv", "--false-alarm", "1e-3", code=3)[0]["region1"]["limit"]
    > seen[0]["region1"]["limit"],
)

# ---- Without temperature the limit is Hotelling's prediction limit, p (n^2 - 1) / (n (n - p)) F, of a statistic
# without 1 + 1/n.
no_temperature = lambda column: column != "temperature_degC"
write("cold.csv", [curve(25) for _ in range(14)], no_temperature)
write("once.csv", [curve(25)], no_temperature)
run("learn", "cold.csv", "-o", "cold.yaml", "--quiet")
r = judged("cold.yaml", "once.csv", "--false-alarm", "0.01")[0]
n = 14
for region, p in (("region1", 3), ("region2", 2)):
    hotelling = p * (n * n - 1) / (n * (n - p)) * stats.f.isf(0.01, p, n - p)
    check(
        f"{region}: Hotelling's prediction limit",
        np.isclose(r[region]["limit"] * (1 + 1 / n), hotelling, rtol=1e-9),
        (r[region], hotelling),
    )

# ---- Loaded curves show the effect of load.
write("loaded.csv", [curve(T, extra=0.1) for T in (25, 40, 58)])
run("learn", "healthy.csv", "--loaded", "loaded.csv", "--lever", "0.5", "-o", "loaded.yaml", "--quiet")
o = judged("loaded.yaml", "checked.csv", code=3)[4]
check(
    "equivalent load in kg",
    np.isclose(o["equivalent_load_kg"], o["equivalent_load"] * tau_max / (9.81 * 0.5))
    and abs(o["equivalent_load"] - 0.23) < 0.04,
    o,
)

# ---- Over time.
write("wearing.csv", [curve(random.uniform(25, 58), wear=0.002 * i) for i in range(40)])
write("staying.csv", [curve(random.uniform(25, 58)) for _ in range(40)])
w = json.loads(run("watch", "healthy.yaml", "wearing.csv", "--json", "--quiet", code=3).stdout)
check("growing wear sounds", w["first_alarm"] and w["first_alarm"] < 40, w["first_alarm"])
left = w["margin"]["load_norm"]
check(
    "the margin has an interval",
    left["low"] < left["value"] < left["high"] and w["margin"]["observations"]["value"] is not None,
    w["margin"],
)
check("growing wear follows a line", w["margin"]["straight"], w["margin"])
write("sudden.csv", [curve(T) for T in np.linspace(25, 58, 12)] + [curve(40, wear=0.12)])
sudden = json.loads(run("watch", "healthy.yaml", "sudden.csv", "--json", "--quiet", code=3).stdout)["margin"]
latest = judged("healthy.yaml", "sudden.csv", code=3)[-1]
left, half = latest["equivalent_load_threshold"] - latest["equivalent_load"], 1.96 * latest["equivalent_load_sigma"]
check(
    "a change at once follows no line: the margin is that of the last observation, and nothing is extrapolated",
    not sudden["straight"]
    and np.allclose([sudden["load_norm"][end] for end in ("low", "value", "high")], [left - half, left, left + half])
    and sudden["observations"]["value"] is None,
    (sudden, latest),
)
said = run("watch", "healthy.yaml", "sudden.csv", "--quiet", code=3).stdout
check("and it is said", "do not follow a straight line" in said and "does not grow" not in said, said[-400:])
w = json.loads(run("watch", "healthy.yaml", "staying.csv", "--json", "--quiet", "--false-alarm", "1e-4").stdout)
check("a healthy joint is silent", w["first_alarm"] is None)

# ---- Residuals of a shadow: rms 1 Nm, from 3000 s on 1.15 Nm.
time = np.arange(0, 4000, 0.05)
residual = random.normal(0, 1, time.size) * np.where(time < 3000, 1, 1.15)
np.savetxt(
    f"{work}/shadow.csv",
    np.column_stack([time, residual, residual, residual, np.full(time.size, 40.0)]),
    delimiter=",",
    comments="",
    fmt="%.6g",
    header="time_s,joint2.measured_nm,joint2.predicted_nm,joint2.residual_nm,joint2.temperature_degC",
)
w = json.loads(run("residuals", "shadow.csv", "--joint", "joint2", "--window", "20", "--json", code=3).stdout)
check("a change of the residuals sounds soon, not before", 3000 < w["first_alarm_s"] <= 3200, w["first_alarm_s"])

# ---- Refusals.
write("few.csv", healthy[:5])
refused("too few", ["5 curve(s)", "8 or more", "cold start"], "learn", "few.csv", "-o", "x.yaml")
write("same.csv", [healthy[0]] * 9)
refused("collinear", ["collinear", "record"], "learn", "same.csv", "-o", "x.yaml")
bad = [c.copy() for c in healthy]
bad[3][4, 4] = np.nan
write("nan.csv", bad)
refused("not finite", ["nan.csv:51", "measure these levels again"], "learn", "nan.csv", "-o", "x.yaml")
refused("not finite, checked", ["nan.csv:51"], "check", "healthy.yaml", "nan.csv")
write("slow.csv", [c[:9] for c in healthy])
refused(
    "speeds short of viscous friction",
    ["slow.csv, curve", "record speeds", "Stribeck"],
    "learn",
    "slow.csv",
    "-o",
    "x.yaml",
)
write("short.csv", [c[::4] for c in healthy])
refused("too few levels", ["short.csv, curve 1", "samples cannot determine"], "learn", "short.csv", "-o", "x.yaml")
other = [c * [1, 1, 1, 2, 1, 1] for c in healthy]
write("other.csv", other)
refused(
    "mixed joints",
    ["other.csv", "65", "130", "different joints or units"],
    "learn",
    "healthy.csv",
    "other.csv",
    "-o",
    "x.yaml",
)
refused("another joint checked", ["other.csv", "another joint or another unit"], "check", "healthy.yaml", "other.csv")
write("norm.csv", healthy, lambda column: not column.endswith("_nm"))
refused("mixed units", ["norm.csv", "--tau-max"], "learn", "healthy.csv", "norm.csv", "-o", "x.yaml")
refused("loaded curves", ["loaded.csv", "--loaded"], "learn", "healthy.csv", "loaded.csv", "-o", "x.yaml")
refused(
    "unloaded as loaded", ["--loaded", "payload"], "learn", "healthy.csv", "--loaded", "staying.csv", "-o", "x.yaml"
)
write("cool.csv", [healthy[0]], no_temperature)
refused("no temperature", ["cool.csv", "temperature_degC"], "check", "healthy.yaml", "cool.csv")
with open(f"{work}/healthy.yaml") as f:
    text = f.read()
for name, pattern, new, says in (
    ("unknown key", "observations:", "observatons:", ["observatons", "observations"]),
    ("another law", "law: steady_state", "law: stribeck", ["law", "steady_state"]),
    ("no covariance", r"covariance: \[\[[^,]*,", "covariance: [[-1,", ["covariance", "positive definite"]),
    ("not a number", r"mean: \[[^,]*,", "mean: [.nan,", ["mean", "finite"]),
):
    with open(f"{work}/broken.yaml", "w") as f:
        f.write(re.sub(pattern, new, text, count=1))
    refused(f"healthy.yaml: {name}", ["broken.yaml:", *says], "check", "broken.yaml", "checked.csv")
refused("no residuals", ["residual_JOINT_nm", "the header names curve"], "residuals", "healthy.csv")
refused("another joint's residuals", ["joint9", "joint2"], "residuals", "shadow.csv", "--joint", "joint9")
refused("a short shadow", ["windows", "record"], "residuals", "shadow.csv", "--window", "1000")

finish()
