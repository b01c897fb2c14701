"""Every number outside the figures of a diagnosis page, against healthy.yaml, the measured levels and what
tribotwin diagnose check and watch say. What they do not say, healthy friction and its 95 %, is computed here."""
import re

import numpy as np
from scipy import optimize, stats
import yaml

from numbers_of_page import Numbers, version

FEATURES = ("Fc", "Fs", "Vs", "Fv", "beta")
WORDS = (
    "Coulomb friction Fc",
    "standstill friction Fs",
    "speed Vs below which friction rises",
    "viscous friction Fv",
    "exponent beta of viscous friction",
)
MEANINGS = {"wear": "worn contact surfaces", "load": "more load on the joint than in the healthy curves"}
REGIONS = (slice(0, 3), slice(3, 5))


class Healthy:
    def __init__(self, text):
        h = yaml.safe_load(text)
        self.text = text
        self.count, self.distances = h["observations"], list(h["thresholds"].values())
        self.torque_max_nm = h.get("torque_max_nm", 0)
        self.ends = [h["temperature"][end] for end in ("low_degC", "high_degC")]
        regions = [h["baseline"][region] for region in ("region1", "region2")]
        self.coefficients = [np.array(r["coefficients"]) for r in regions]
        self.covariance = [np.array(r["covariance"]) for r in regions]
        self.together = np.array(h["baseline"]["together"])
        self.sensitivity, self.load_effect = h["load"]["sensitivity"], np.array(h["load"]["effect"])

    def moved(self, pattern, severity):
        """By a cause: logarithms of the first four features, and beta."""
        if pattern == "wear":
            return np.log1p(severity) * np.array([1, 1, 1, 0, 0])
        assert pattern == "load" and "indicators" not in self.text  # else the sensitivity is that of their mean load
        return np.log1p(self.sensitivity * severity) / self.sensitivity * self.load_effect

    def expected(self, o):
        x = np.array([1, o["temperature_degC"] - np.mean(self.ends)])
        return np.concatenate([x @ c for c in self.coefficients])

    def deviation(self, o):
        f = [o["features"][name] for name in FEATURES]
        return np.append(np.log(f[:4]), f[4]) - self.expected(o)

    def sigma_covariance(self, o):
        """Of a healthy joint's next curve. T^2 says how exact this curve is: T^2 = d' C^-1 d / variance."""
        d, scale = self.deviation(o), np.zeros(5)
        for region, at, c in zip(("region1", "region2"), REGIONS, self.covariance):
            scale[at] = np.sqrt(d[at] @ np.linalg.solve(c, d[at]) / o[region]["statistic"])
        return scale[:, None] * self.together * scale

    def friction_change(self, o, v, friction):
        """Of the mean of the levels, and how far 95 % of healthy joints are from it, in %."""

        def total(y):
            Fc, Fs, Vs, Fv = np.exp(y[:4])
            return np.sum(Fc + (Fs - Fc) * np.exp(-((v / Vs) ** 1.3)) + Fv * v ** y[4])

        at = self.expected(o)
        slope = np.array([(total(at + 1e-6 * e) - total(at - 1e-6 * e)) / 2e-6 for e in np.eye(5)])
        half = 1.96 * np.sqrt(slope @ self.sigma_covariance(o) @ slope)
        return 100 * (np.sum(friction) / total(at) - 1), 100 * half / total(at)


def percent(p):
    return "> 99 %" if p > 0.99 else "< 1 %" if p < 0.01 else f"{100 * p:.0f} %"


def cause(o):
    """A pattern as a page calls it."""
    return "none" if o["pattern"] == "healthy" else o["pattern"].replace("_", " ")


def margin_tile(by, left, low, high, threshold):
    """How far it is to the wear threshold, or beyond it: the interval turns with the sign."""
    name = "left to" if left > 0 else "beyond"
    value, *ends = [100 * x for x in ((left, low, high) if left > 0 else (-left, -high, -low))]
    more = f"by {by}; 95 %: {ends[0]:.1f} … {ends[1]:.1f} %; the threshold is {100 * threshold:.1f} %"
    return f"{name} the wear threshold\n{value:.1f} %\n{more}\n"


def margin_of(o):
    """By an observation of `check --json` alone."""
    left, half = o["equivalent_load_threshold"] - o["equivalent_load"], 1.96 * o["equivalent_load_sigma"]
    return margin_tile("the latest curve", left, left - half, left + half, o["equivalent_load_threshold"])


class Line:
    """A straight line through all equivalent loads over their days."""

    def __init__(self, days, seen):
        x = np.column_stack([np.ones(len(days)), days])
        y, sigma = (np.array([o[key] for o in seen]) for key in ("equivalent_load", "equivalent_load_sigma"))
        self.threshold, self.last = seen[0]["equivalent_load_threshold"], days[-1]
        self.line = np.linalg.lstsq(x, y, rcond=None)[0]
        error, freedom = y - x @ self.line, len(y) - 2
        self.covariance = np.linalg.inv(x.T @ x) * (error @ error) / freedom
        self.quantile = stats.t.ppf(0.975, freedom)
        self.straight = stats.chi2.sf(np.sum((error / sigma) ** 2), freedom) > 0.01

    def at(self, day, side=0):
        """And an end of its 95 %: the upper one with 1, the lower one with -1."""
        x = np.array([1, day])
        return x @ self.line + side * self.quantile * np.sqrt(x @ self.covariance @ x)

    def left(self, side=0):
        return self.threshold - self.at(self.last, side)

    def tile(self):
        return margin_tile("a straight line", self.left(), self.left(1), self.left(-1), self.threshold)

    def reaches(self, side=0):
        """The day after the last one, or any where the line itself is beyond the threshold; None: never."""
        begin, end = (self.last, 1e6) if self.left() > 0 else (-1e6, self.last)
        beyond = lambda day: self.at(day, side) - self.threshold
        if beyond(begin) > 0:
            return begin
        return optimize.brentq(beyond, begin, end) if beyond(end) > 0 else None


def date_after(first, day):
    return np.datetime64(first) + np.timedelta64(round(day), "D")


def take_trend(n, line, dates):
    """When the wear threshold is reached, or was: to the day."""
    day = r"(\d{4}-\d\d-\d\d)"
    same = lambda said, day: abs((np.datetime64(said) - date_after(dates[0], day)).astype(int)) <= 1
    if not line.straight:
        n.check("number: no date where they follow no line", "so no date is given" in n.text, n.text[:4000])
    elif line.left() <= 0:
        wanted = rf"has been exceeded since about {day}, by"
        n.match("trend", wanted, lambda said: same(said, line.reaches()))
    else:
        wanted = rf"is reached about {day} \(95 %: {day} … (?:{day}|never, as the rise may be chance)\)"
        middle, early, late = (line.reaches(side) for side in (0, 1, -1))
        is_late = lambda said: late is None if said is None else same(said, late)
        n.match("trend", wanted, lambda m, a, b: same(m, middle) and same(a, early) and is_late(b))


def share(h, load_norm, of=""):
    """Of the maximum torque, and in Nm."""
    nm = f" ({load_norm * h.torque_max_nm:.2g} Nm)" if h.torque_max_nm else ""
    return f"{100 * load_norm:.1f} %{of}{nm}"


def sentence(h, i, o, several):
    """What the page says of a curve. `several`: its file holds others."""
    far = [
        f"{name} {np.sqrt(o[region]['statistic'] / o[region]['limit']):.1f} times"
        for region, name in (("region1", "contact surfaces"), ("region2", "lubricant"))
        if o[region]["anomalous"]
    ]
    of_file = f", curve {o['curve']}" if several else ""
    said = f"{i}. {o['file']}{of_file}, {o['temperature_degC']:.1f} °C: {' and '.join(far)} "
    said += "as far from healthy as a healthy curve may be. "
    if o["perhaps_healthy"]:
        said += (
            f"Of this curve alone, chance is likelier than any known cause (probability {percent(o['confidence'])})."
        )
    else:
        said += f"It looks like {MEANINGS[o['pattern']]}, {much(o)} (confidence {percent(o['confidence'])})."
    if o["region1"]["anomalous"] and o["equivalent_load"] > 2 * o["equivalent_load_sigma"]:
        way = "beyond" if o["equivalent_load"] > o["equivalent_load_threshold"] else "short of"
        said += f" Its equivalent load is {share(h, o['equivalent_load'], ' of the maximum torque')}, "
        said += f"{way} the wear threshold of {share(h, o['equivalent_load_threshold'])}."
    return said + "\n"


def much(o):
    return f"{100 * o['severity']:.2g} %" + (" of the maximum torque" if o["pattern"] == "load" else "")


def near(shown, true, half_digit):
    return abs(float(shown) - true) <= half_digit * 1.02


def take_evidence(n, h, o):
    """The table of what speaks for the cause. The column of the cause itself is 0 for features it leaves alone."""
    found, reach = h.deviation(o), 1.96 * np.sqrt(np.diag(h.sigma_covariance(o)))
    moved = h.moved(o["pattern"], o["severity"])
    relative = lambda x: 100 * np.expm1(x)
    for i, word in enumerate(WORDS):
        unit, show, digit = (" %", relative, 0.05) if i < 4 else ("", float, 0.0005)
        number = r"([+-][\d.]+)" + unit
        row = rf"\n{word}\n{number}\n± ([\d.]+){unit}\n{number}\n[^\n]*\n"
        true = [show(found[i]), show(reach[i]), show(moved[i])]
        n.match("evidence: " + word, row, lambda a, b, c: all(near(x, t, digit) for x, t in zip((a, b, c), true)))


def take_other_causes(n, h, o):
    """Of wear beside more load: how much of it alone explains the deviation best."""
    others = {name: p for name, p in o["probabilities"].items() if name not in (o["pattern"], "healthy") and p >= 0.01}
    for name, p in others.items():
        d, weight = h.deviation(o), np.linalg.inv(h.sigma_covariance(o))
        misfit = lambda s: (d - h.moved(name, s)) @ weight @ (d - h.moved(name, s))
        s = 100 * optimize.minimize_scalar(misfit, bounds=(0, 1), method="bounded").x
        row = rf"\n{MEANINGS[name]}\n{percent(p)}\n([\d.]+) %(?: of the maximum torque)?\n"
        n.match("other cause: " + name, row, lambda shown: abs(float(shown) / s - 1) < 0.1 + 0.5 / s)


def take_friction(n, h, last, levels):
    change, half = h.friction_change(last, *levels)
    n.match(
        "friction, latest",
        r"([+-][\d.]+) %\nagainst a healthy joint at this temperature; 95 % of healthy curves lie within ± ([\d.]+) %",
        lambda a, b: near(a, change, 0.05) and near(b, half, 0.05),
    )


def hold(page, check, command, healthy, seen, watched, levels, dates, days):
    """`seen`: observations of `check --json`, in order, the last one with a known cause. `watched`: `watch --json` of
    the same. `levels`: speed and friction of the latest curve. `dates`: of each curve; `days`: since the first."""
    n, h, last = Numbers(page, check), Healthy(healthy), seen[-1]
    bad = [o for o in seen if o["anomalous"]]
    n.take("healthy.yaml", healthy)
    n.take("the command", command)
    n.take("identity", f"data of {max(dates)} · page made with tribotwin {version()}\n")
    take_friction(n, h, last, levels)
    n.take("anomalous", f"{len(bad)} of {len(seen)}\ncurves\n")
    shared = lambda o: sum(other["file"] == o["file"] for other in seen) > 1
    n.take("sentences", *(sentence(h, i + 1, o, shared(o)) for i, o in enumerate(seen) if o["anomalous"]))
    cause_of_latest = f"{MEANINGS[last['pattern']]}, {much(last)} (confidence {percent(last['confidence'])})."
    n.take("the cause", f"; the latest looks like {cause_of_latest}", f"It looks like {cause_of_latest}")
    sure = sum(not o["perhaps_healthy"] for o in bad)
    are_not = "is not that" if sure == 1 else "are not those"
    n.take("verdict", f"{sure} of {len(seen)} curves {are_not} of a healthy joint")
    n.take("rule", "too many beyond a limit for chance (1 %)")
    nm = f" ({last['equivalent_load'] * h.torque_max_nm:.2g} Nm)" if h.torque_max_nm else ""
    tile = f"{100 * last['equivalent_load']:.1f} ± {100 * last['equivalent_load_sigma']:.1f} %\n"
    n.take("equivalent load", tile + f"of the maximum torque{nm}, one sigma: ")
    line = Line(days, seen)
    n.take("margin", line.tile() if line.straight else margin_of(last))
    n.take(
        "compared with",
        f"with {h.count} unloaded curves of the healthy joint, {h.ends[0]:.0f} to {h.ends[1]:.0f} °C; ",
        "4.55 % of healthy curves",
    )
    if len(seen) - len(bad) > 1:
        n.take("healthy ones", f"The other {len(seen) - len(bad)} curves are those of a healthy joint.")
    state = lambda o, region: "anomalous" if o[region]["anomalous"] else "healthy"
    yes = lambda o, region: "yes" if o[region]["anomalous"] else "no"
    for i, o in enumerate(seen):
        cells = [str(i + 1), dates[i], f"{o['temperature_degC']:.1f}"]
        row = cells + [state(o, "region1"), state(o, "region2"), cause(o), percent(o["confidence"])]
        n.take(f"row {i + 1}", "\n" + "\n".join(row) + "\n")
        row = [str(i + 1), cells[-1]]
        for region in ("region1", "region2"):
            row += [f"{o[region]['distance']:.3f}", f"{o[region]['statistic']:.2f}", yes(o, region)]
        row += [f"{o['equivalent_load']:.3f}", o["pattern"], f"{o['confidence']:.2f}"]
        n.take(f"appendix, row {i + 1}", "\n" + "\n".join(row) + "\n")
    take_evidence(n, h, last)
    take_other_causes(n, h, last)
    n.take("the latest curve", f"Measured levels of curve {len(seen)} at {last['temperature_degC']:.1f} °C")
    alarm = watched["first_alarm"]
    n.take("alarm", f"Curve {alarm} raises the first alarm.")
    once = round(1 / watched["false_alarm"])
    n.take("chart", f"({watched['threshold']:.2f}) there is one false alarm in {once} healthy curves")
    n.take(
        "limits",
        "its thresholds are {:g} and, for wear, {:g}".format(*h.distances),
        "anomalous beyond {:.2f} in region 1, {:.2f} in region 2".format(
            last["region1"]["limit"], last["region2"]["limit"]
        ),
    )
    n.take(
        "regions",
        "The ellipsoid of region 1 seen along each of its axes, and the ellipse of region 2: filled within {:g} "
        "standard deviations, dashed at {:g}.".format(*np.sqrt(h.distances)),
    )
    take_trend(n, line, dates)
    # What is no measured number: shares of intervals, numbers of regions, the paper.
    words = ("Zhou 2024 (15)", "Zhou 2024", "T² 1", "T² 2", "distance 1", "distance 2", "anomalous 1", "anomalous 2")
    n.take("words", "where 95 % of the curves", "healthy curves, 95 %", "\nregion 1\n", "\nregion 2\n", *words)
    n.take("rule", "(chi-squared, 1 % of straight trends are refused)", "at which the distance in region 1 reaches")
    n.finish("diagnosis")
