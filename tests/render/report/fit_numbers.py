"""Every number outside the figures of a page of an identified or given law without gears and direction, against its
parameter file and the data. Residuals are those of reference_law.law, of the law 'extended'."""
import math, re

import numpy as np
import yaml

from numbers_of_page import Numbers, take_identity
from reference_law import law

CURVE_POINTS, SCATTER_POINTS = 300, 2000
OF_MAXIMUM = "of the maximum torque"


def typeset(text):
    mantissa, _, power = text.partition("e")
    power = power and "·10" + str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return mantissa.removesuffix(".") + power


def significant(v, digits=3):
    return typeset(f"{v:#.{min(max(digits, 1), 9)}g}") if v else "0"


def by_sigma(v, sigma):
    """To the second digit of sigma."""
    place = lambda x: math.floor(math.log10(abs(x)))
    return significant(v, place(v) - place(sigma) + 2 if v else 1)


def correlation(r):
    gap = 1 - abs(r)
    return f"{r:.{min(5, math.ceil(-math.log10(gap))) if 0 < gap < 0.005 else 2}f}"


class Samples:
    def __init__(self, file, p):
        self.v, self.l, self.T, y = np.loadtxt(file, delimiter=",", skiprows=1).T
        self.count, self.residual = len(y), y - law(p, self.v, self.l, self.T)
        self.std, self.largest = np.std(self.residual), np.max(np.abs(self.residual))
        self.rms = np.sqrt(np.mean(self.residual**2))
        self.explained = 100 * (1 - np.sum(self.residual**2) / np.sum((y - np.mean(y)) ** 2))


class Levels:
    """Of load or temperature, at which there are curves over the other."""

    def __init__(self, column):
        low, high = min(column), max(column)
        self.column, self.varies = column, high > low
        self.window = 0.05 * (high - low) + 1e-6 * (1 + abs(high))
        ranks = [math.floor(share * (len(column) - 1) + 0.5) for share in (0.1, 0.9)]
        self.at = list(np.sort(column)[ranks])
        if self.at[1] - self.at[0] <= 2 * self.window:
            self.at = self.at[:1]

    def captions(self, before, decimals, unit):
        """ "at a load of 0.07 ± 0.04", and how many samples are so near."""
        for level in self.at:
            beside = f" ± {self.window:.{decimals}f}" if self.varies else ""
            near = np.count_nonzero(np.abs(self.column - level) <= self.window)
            yield f" {before} {level:.{decimals}f}{beside}{unit}.", near


def drawn(count, most):
    return f"{most} of the {count} samples are drawn, chosen evenly" if count > most else f"{count} samples"


class File:
    """Parameters as the file gives them."""

    def __init__(self, name):
        with open(name) as f:
            self.text = f.read()
        given = yaml.safe_load(self.text)
        self.law, self.data, self.range = given["law"], given.get("data", []), given.get("range")
        self.values = {name: float(v) for name, v in given["parameters"].items()}
        self.status, self.sigma = given.get("status", {}), given.get("sigma", {})
        self.intervals, self.correlation = given.get("confidence_95", {}), given.get("correlation", {})
        self.lacking, self.notes = given.get("unidentifiable", []), given.get("notes", [])
        self.units = dict(re.findall(r"^  (\w+): [^#\n]*# (\S+)$", self.text, re.M))

    def p(self):
        return np.array(list(self.values.values()))

    def identified(self):
        return sum(self.status.get(n) == "estimated" and n not in self.lacking for n in self.values)

    def strongest(self):
        """The pair with the strongest correlation, and this."""
        names = list(self.correlation)
        pairs = [(self.correlation[a][k], a, b) for i, a in enumerate(names) for k, b in enumerate(names) if i < k]
        return max(pairs, key=lambda pair: abs(pair[0]))


def take_verdict(n, f, own, other):
    count, std = len(f.values), significant(own.std)
    if other:
        n.take(
            "verdict",
            f"is off by {significant(other.rms)} {OF_MAXIMUM} (RMS) on data that it was not identified from, "
            f"{other.rms / own.std:.1f} times its residual on its own.",
            f"not those of the identification: {other.count} samples, whose residuals have a standard deviation of "
            f"{significant(other.std)} {OF_MAXIMUM}.",
            f"residual of these data, RMS\n{significant(other.rms)}\n{OF_MAXIMUM}\n",
            "off by more than 2 times its residual on other data",
        )
    else:
        known = "All" if f.identified() == count else f"{f.identified()} of the"
        from_data = f"were identified from {own.count} samples of {f.data[0]}."
        n.take("verdict", f"{known} {count} parameters of law '{f.law}' {from_data}")
        r, a, b = f.strongest()
        n.take("correlation", f"strongest correlation\n{a} and {b}\ncorrelation {correlation(r)}\n")
    n.take(
        "residuals",
        f"residuals have a standard deviation of {std} {OF_MAXIMUM}; the law explains {own.explained:.2f} % of the",
        f"residual, std\n{std}\n{OF_MAXIMUM}\n",
        f"maximum residual\n{significant(own.largest)}\n{OF_MAXIMUM}\n",
        f"explained\n{own.explained:.2f} %\n",
    )
    n.take(
        "range",
        f"Holds up to {max(own.v):.4g} rad/s, for loads up to {max(own.l):.3g} {OF_MAXIMUM}, at {min(own.T):.3g} to "
        f"{max(own.T):.3g} °C.",
    )


def take_parameters(n, f):
    fixed = sum(s == "fixed" for s in f.status.values()) if f.status else len(f.values)
    n.take("known", f"parameters known\n{f.identified() + fixed} of {len(f.values)}\n")
    for name, v in f.values.items():
        cells, s = [typeset(f"{v:.6g}"), "–", "–"], float(f.sigma.get(name, 0))
        if s:
            low, high = (by_sigma(float(end), s) for end in f.intervals[name])
            cells = [by_sigma(v, s), significant(s, 2), f"{low} … {high}"]
        unit = f.units.get(name)
        shown = [{"-": "of τmax", "1": "-"}.get(unit, unit)] if unit else []
        n.take("parameter " + name, "\n".join(["", name, *cells, *shown, ""]))
    equation = re.match(r"# friction.*? = (.*?);", f.text)
    if equation:
        n.take("equation", f"friction / τmax = {equation[1]}\n")
        n.take("meanings", "standstill friction at 0 °C", "Stribeck velocity at 0 °C")


def take_figures(n, f, shown):
    """Captions of the curves and residuals of the samples `shown`."""
    load, temperature = Levels(shown.l), Levels(shown.T)
    curves = list(load.captions("at a load of", 2, ""))
    if load.varies:
        curves += temperature.captions("at", 1, " °C")
    band = "Without bands: not every parameter that was looked for has a sigma."
    if len(f.sigma) == len(f.values):
        band = "Bands: where the law is with 95 % confidence, by the covariance of its parameters."
        n.take("what if", "with its band, where the law is with 95 % confidence; the dashed")
    for where, near in curves:
        n.take("curves" + where, f"Law '{f.law}'{where} {band} Points: {drawn(near, CURVE_POINTS)}.")
    n.take("histogram", f"Histogram of the residuals of all {shown.count} samples,")
    for what in ("speed", "temperature", "load") if load.varies else ("speed", "temperature"):
        classes = f"{drawn(shown.count, SCATTER_POINTS)}; the lines are mean and standard deviation of all in classes"
        n.take("residuals over " + what, f"{classes} of {what}.")
    n.take("words", "scatter about 0 alike", "where their mean leaves 0,", "Bold from 0.9.")
    n.take("ellipses", "95 % (filled), 99 % (dashed)")


def hold(page, check, program, command, parameters, *data):
    """`data`: the file that the parameters are from, and, where they are compared with another, that; nothing where
    they are given and the page is of a law alone. The program reads the last of them."""
    f, n = File(parameters), Numbers(page, check)
    n.take("the file", f.text)
    n.take("the command", command)
    take_identity(n, program, parameters, *data[-1:])
    if data:
        own, *other = (Samples(one, f.p()) for one in data)
        n.take("remarks", *f.notes)
        take_verdict(n, f, own, other[0] if other else None)
        take_figures(n, f, other[0] if other else own)
    else:
        n.take("range of the law itself", "Holds up to 280 rad/s.", "motor speed\nup to 280 rad/s\n")
    take_parameters(n, f)
    n.take("95 % intervals", "\n95 % interval\n")
    n.finish("fit")
