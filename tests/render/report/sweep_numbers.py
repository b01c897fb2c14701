"""Every number outside the figures of a sweep's page, also of a grid of two factors, computed from its results.csv,
campaign.yaml and bands.csv; the interval of a standard deviation alone is that of statistics.json
(tests/twin/experiments/sweep holds it)."""
import csv, glob, json, math, os, re

import numpy as np
from scipy import stats
import yaml

from numbers_of_page import Numbers, day_of, engine_of, number, version


def shown(value, uncertainty):
    """Two digits of what is uncertain."""
    return f"{value:.{min(max(1 - math.floor(math.log10(uncertainty)), 0), 9)}f}"


def interval(low, high, half):
    return f"{shown(low, half)} … {shown(high, half)}"


class Output:
    def __init__(self, words, unit, values):
        self.words, self.unit, self.values = words, unit, np.array(values)
        self.difference_unit = "K" if unit == "°C" else unit
        n, self.mean, self.deviation = len(values), np.mean(values), np.std(values, ddof=1)
        self.half = stats.t.ppf(0.975, n - 1) * self.deviation / math.sqrt(n)
        self.ends = interval(self.mean - self.half, self.mean + self.half, self.half)
        self.low, self.high, self.span = min(values), max(values), max(values) - min(values)

    def quantile(self, p):
        return np.quantile(self.values, p, method="weibull")  # the p (n + 1)-th value

    def largest(self):
        return self.words if self.words.startswith("largest ") else "largest " + self.words

    def mean_text(self):
        return f"{shown(self.mean, self.half)} {self.unit}"


def rank_correlation(x, y):
    """Its value, and its interval by Fisher's transform."""
    r = float(stats.spearmanr(x, y)[0])
    half = 1.96 * math.sqrt((1 + r * r / 2) / (len(x) - 3))
    z = math.atanh(min(max(r, -1 + 1e-15), 1 - 1e-15))
    return r, math.tanh(z - half), math.tanh(z + half)


def quadratic(factors, z):
    """What a quadratic in both factors leaves, and the share of the variance that it explains, adjusted."""
    a, b = (np.interp(f, [min(f), max(f)], [-1, 1]) for f in factors)
    design = np.column_stack([np.ones_like(a), a, b, a * a, a * b, b * b])
    left = np.sum((z - design @ np.linalg.lstsq(design, z, rcond=None)[0]) ** 2) / (len(z) - 6)
    return math.sqrt(left), 1 - left / np.var(z, ddof=1)


def rows_and_campaign(folder):
    with open(os.path.join(folder, "results.csv")) as f:
        rows = list(csv.DictReader(f))
    with open(os.path.join(folder, "campaign.yaml")) as f:
        return rows, yaml.safe_load(f)


class Sweep:
    def __init__(self, folder, names):
        """`names`: words and unit of each column of an output."""
        self.folder = folder
        self.rows, self.campaign = rows_and_campaign(folder)
        with open(os.path.join(folder, "statistics.json")) as f:
            self.statistics = json.load(f)["outputs"]
        with open(os.path.join(folder, "bands.csv")) as f:
            self.bands = list(csv.DictReader(f))
        self.outputs = {key: Output(*name, self.column(key)) for key, name in names.items()}
        self.factors = {key: self.column(key) for key in self.campaign["factors"]}

    def column(self, key):
        return [float(row[key]) for row in self.rows]

    def strongest(self, key):
        effects = {name: rank_correlation(x, self.outputs[key].values) for name, x in self.factors.items()}
        return max(effects.items(), key=lambda effect: abs(effect[1][0]))

    def worst(self, key):
        return sorted(self.rows, key=lambda row: -float(row[key]))[:5]


def take_identity(n, sweep, design):
    files = [*glob.glob(sweep.folder + "/*.json"), *glob.glob(sweep.folder + "/*.csv")]
    with open(os.path.join(sweep.folder, "campaign.yaml")) as f:
        engine = engine_of(f.read())
    runs = f"{len(sweep.rows)} runs of scenario.yaml: {design}"
    n.take("identity", f"\n{day_of(*files)} · {runs} · tribotwin {version()} · MuJoCo {engine}\n")


def take_head(n, sweep):
    runs, design = len(sweep.rows), sweep.campaign["design"]
    first_key, first = next(iter(sweep.outputs.items()))
    name, (r, low, high) = sweep.strongest(first_key)
    take_identity(n, sweep, f"Sobol' sequence, seed {design['seed']}")
    n.take(
        "verdict",
        f"is {first.mean_text()} (95 %: {first.ends}) over {runs} runs, which lie between "
        f"{shown(first.low, first.span)} and {shown(first.high, first.span)} {first.unit}; of the factors, {name} "
        f"matters most (rank correlation {r:.2f}, 95 %: {low:.2f} … {high:.2f}).",
    )
    bad = [sum(row["status"] == word for row in sweep.rows) for word in ("failed", "warned")]
    n.take("runs", "\nruns\n{} of {}\nall there; {} failed, {} warned\n".format(runs, sweep.campaign["runs"], *bad))
    for o in sweep.outputs.values():
        n.take("tile: " + o.words, f"\nmean of {o.words}\n{o.mean_text()}\n95 %: {o.ends}\n")


def take_outputs(n, sweep):
    shares = ("2.5", "25", "50", "75", "97.5")
    header = [("median" if p == "50" else p + " %") for p in shares]
    n.take("columns", "\n".join(["\nmean", "95 %", "deviation", *header, "range\n"]))
    for key, o in sweep.outputs.items():
        fine = lambda x: shown(x, o.half)
        quantiles = [fine(o.quantile(float(p) / 100)) for p in shares]
        row = [f"{o.words} [{o.unit}]", fine(o.mean), o.ends, fine(o.deviation), *quantiles]
        n.take("row: " + o.words, "\n".join([*row, f"{fine(o.low)} … {fine(o.high)}\n"]))
        low, high = sweep.statistics[key]["deviation"]["confidence_95"]
        half = (high - low) / 2
        n.take(
            "distribution: " + o.words,
            f"Mean {o.mean_text()} (95 %: {o.ends}). Standard deviation {shown(o.deviation, half)} "
            f"{o.difference_unit} (95 %: {interval(low, high, half)}). Quantiles: 2.5 %, 25 %, 75 %, 97.5 %.",
        )


def take_worst(n, sweep):
    named = set()
    for key, o in sweep.outputs.items():
        for row in sweep.worst(key):
            named.add(int(row["run"]))
            value = f"{shown(float(row[key]), o.span / 20)} {o.unit}"
            factors = [f"{float(row[factor]):.5g}" for factor in sweep.factors]
            n.take("worst run", "\n".join(["", o.largest(), row["run"], value, *factors]) + "\n")
    return sorted(named)


def hold_quadratics(n, sweep):
    for key, o in sweep.outputs.items():
        left, explained = quadratic(sweep.factors.values(), o.values)
        rest = rf"a standard deviation of (\S+) {o.difference_unit}, of the other factors and of what is not quadratic"
        if left < 1e-12 * o.high:
            rest = "nothing but (rounding)"
        digits = lambda text: text == "rounding" or abs(number(text) / left - 1) < 1e-3
        n.match(
            "quadratic: " + o.words,
            rf"(?<=\n{o.words}\n)\s*A quadratic in both factors, fitted to (\d+) runs: it explains more than 99 % of "
            rf"the variance \(adjusted\) and leaves {rest}\.\n",
            lambda runs, text: int(runs) == len(sweep.rows) and explained > 0.99 and digits(text),
        )


def hold(page, check, folder, relative, names):
    """`relative`: the folder as the page calls it."""
    n, sweep = Numbers(page, check), Sweep(folder, names)
    runs = len(sweep.rows)
    take_head(n, sweep)
    take_outputs(n, sweep)
    for run in take_worst(n, sweep):
        n.take(f"run {run} again", f"tribotwin sweep {relative}/campaign.yaml --run {run} -o {relative}_run{run}")
    n.take(
        "over factors", f"{runs} runs; the other factors vary as well.", f"Each of {runs} runs, coloured by the output."
    )
    hold_quadratics(n, sweep)
    fewest = {row[column] for row in sweep.bands for column in row if column.endswith(".runs")}
    n.take("bands", f"Quantiles over {' to '.join(fewest)} runs at each of {len(sweep.bands)} times;")
    with open(os.path.join(folder, "campaign.yaml")) as f:
        n.take("campaign.yaml", f.read().replace(os.path.dirname(os.path.dirname(folder)) + "/", ""))
    # What is no measured number: names of factors, shares of intervals.
    n.take("factors", *sweep.factors)
    n.take("words", "+1 where the output always rises with the factor, -1 where", "Whiskers: 95 % intervals.")
    n.take("notes", "intervals are 95 % as of independent draws")
    n.finish("sweep")


class Grid:
    """Of all combinations of two factors."""

    def __init__(self, folder, names):
        self.folder = folder
        self.rows, self.campaign = rows_and_campaign(folder)
        self.factors = {key: list(map(str, values)) for key, values in self.campaign["factors"].items()}
        self.outputs = {key: Output(*name, [float(row[key]) for row in self.rows]) for key, name in names.items()}

    def strongest(self, key):
        """The factor with the largest total Sobol' index, the share of the variance that is left where the other factor
        is known; of a grid there is nothing to estimate."""
        first, second = self.factors
        cells = {(row[first], row[second]): float(row[key]) for row in self.rows}
        z = np.array([[cells[a, b] for b in self.factors[second]] for a in self.factors[first]])
        totals = {first: np.mean(np.var(z, axis=0)) / np.var(z), second: np.mean(np.var(z, axis=1)) / np.var(z)}
        return max(totals.items(), key=lambda total: total[1])

    def worst(self, key):
        return sorted(self.rows, key=lambda row: -float(row[key]))[: min((len(self.rows) + 3) // 4, 5)]


def four(value):
    """So many digits, where nothing says how sure they are."""
    return f"{value:.{max(0, 3 - math.floor(math.log10(abs(value))))}f}"


def take_grid_head(n, grid):
    runs, (key, o) = len(grid.rows), next(iter(grid.outputs.items()))
    name, total = grid.strongest(key)
    take_identity(n, grid, "full grid")
    n.take(
        "verdict",
        f"The mean of {o.words} is {four(o.mean)} {o.unit} over {runs} runs, which lie between {shown(o.low, o.span)} "
        f"and {shown(o.high, o.span)} {o.unit}; of the factors, {name} matters most (total Sobol' index {total:.2f}).",
    )
    n.take("runs", f"\nruns\n{runs} of {grid.campaign['runs']}\nall there; 0 failed, 0 warned\n")
    for o in grid.outputs.values():
        n.take("tile: " + o.words, f"\nmean of {o.words}\n{four(o.mean)} {o.unit}\nof all combinations\n")
    if len(grid.outputs) == 1:
        n.take("tile: factors", f"\nfactors\n{len(grid.factors)}\nthat the plan sets\n")


def take_grid_outputs(n, grid):
    shares = ("2.5", "25", "50", "75", "97.5")
    header = [("median" if p == "50" else p + " %") for p in shares]
    n.take("columns", "\n".join(["\nmean", "95 %", "deviation", *header, "range\n"]))
    for o in grid.outputs.values():
        fine = lambda x: shown(x, o.span / 20)
        quantiles = [fine(o.quantile(float(p) / 100)) for p in shares]
        row = [f"{o.words} [{o.unit}]", fine(o.mean), "–", fine(o.deviation), *quantiles]
        n.take("row: " + o.words, "\n".join([*row, f"{fine(o.low)} … {fine(o.high)}\n"]))
        n.take(
            "distribution: " + o.words,
            f"Mean {four(o.mean)} {o.unit}. Standard deviation {four(o.deviation)} {o.difference_unit}. Quantiles: "
            "2.5 %, 25 %, 75 %, 97.5 %.",
        )


def hold_grid(page, check, folder, relative, names):
    """As hold, of a sweep over a grid of two factors of which all runs are there."""
    n, grid = Numbers(page, check), Grid(folder, names)
    runs, named = len(grid.rows), set()
    take_grid_head(n, grid)
    take_grid_outputs(n, grid)
    for key, o in grid.outputs.items():
        for row in grid.worst(key):
            named.add(int(row["run"]))
            value = f"{shown(float(row[key]), o.span / 20)} {o.unit}"
            n.take("worst run", "\n".join(["", o.largest(), row["run"], value, *map(row.get, grid.factors)]) + "\n")
    for run in sorted(named):
        n.take(f"run {run} again", f"tribotwin sweep {relative}/campaign.yaml --run {run} -o {relative}_run{run}")
    n.take("over factors", f"{runs} runs; the other factors vary as well.")
    if "bands" in grid.campaign:
        n.take("bands", f"Quantiles over {runs} runs at each of {grid.campaign['bands']['times']} times;")
    with open(os.path.join(folder, "campaign.yaml")) as f:
        n.take("campaign.yaml", f.read().replace(os.path.dirname(os.path.dirname(folder)) + "/", ""))
    for key in grid.factors:
        if re.search(r"\d", key):  # a name is no number
            n.take("factor " + key, key)
    n.finish("grid")
