"""Every number outside the figures of the page of a campaign over working days, computed from the files of its days,
its campaign.yaml, and the names of its tables. Time constants are those of time_constants.csv."""
import csv, json, math, os, re
from statistics import NormalDist

import numpy as np
import yaml

import base_parameter_groups
from numbers_of_page import Numbers, day_of, engine_of, typeset, version

IDENTIFIED_WITHIN = 0.02  # in each cycle, of a parameter whose change over a day is reported
quantile = NormalDist().inv_cdf


class Robot:
    """Its days, the first of which has no change."""

    def __init__(self, number, days):
        self.number, self.days = number, days

    def step(self, day, cycle, joint):
        """Relative change of friction since the cycle before, as a logarithm, and its standard deviation."""
        (now, now_sigma), (then, then_sigma) = (
            self.days[day]["cycles"][k]["level_nm"][joint] for k in (cycle, cycle - 1)
        )
        return math.log(now / then), math.hypot(now_sigma / now, then_sigma / then)

    def compare(self, joints, threshold):
        """Changes, and sigma and joint of every comparison."""
        self.changes, self.unchanged, compared = [], [0], []
        for day in range(1, len(self.days)):
            found = []
            for j, joint in enumerate(joints):
                for cycle in range(1, len(self.days[day]["cycles"])):
                    before = np.array([self.step(e, cycle, j) for e in self.unchanged])
                    (now, sigma), mean = self.step(day, cycle, j), np.mean(before[:, 0])
                    sigma = math.hypot(sigma, np.linalg.norm(before[:, 1]) / len(before))
                    compared.append((sigma, joint))
                    change = (joint, day, cycle, 100 * math.expm1(now), 100 * math.expm1(mean), abs(now - mean) / sigma)
                    found += [change] if change[-1] >= threshold else []
            self.changes += found
            self.unchanged += [] if found else [day]
        return compared

    def minutes(self, day, cycle):
        return self.days[day]["cycles"][cycle]["start_s"] / 60

    def spread(self, p):
        """Weighted mean and sigma over days without a change; standard deviation over days; change over a day."""
        values, sigmas = np.array([self.days[d]["base"][p] for d in self.unchanged]).T
        weights = sigmas**-2
        mean, over_a_day = np.sum(weights * values) / np.sum(weights), None
        for d in self.unchanged:
            cycles = np.array([cycle["base"][p] for cycle in self.days[d]["cycles"]])
            third = len(cycles) // 3
            if third and np.all(cycles[:, 1] < IDENTIFIED_WITHIN * abs(mean)):
                change = np.mean(cycles[-third:, 0]) - np.mean(cycles[:third, 0])
                over_a_day = max(over_a_day or 0, abs(change / mean))
        over_days = np.std(values, ddof=1) / abs(mean) if len(values) > 1 and over_a_day is not None else None
        return mean, np.sum(weights) ** -0.5, over_days, over_a_day


class Days:
    def __init__(self, folder):
        rows = lambda name: list(csv.DictReader(open(os.path.join(folder, name + ".csv"))))
        with open(os.path.join(folder, "campaign.yaml")) as f:
            self.campaign_text = f.read()
        self.campaign = yaml.safe_load(self.campaign_text)
        self.robots = []
        for robot in range(1, self.campaign["robots"] + 1):
            days = []
            for day in range(1, self.campaign["days"] + 1):
                with open(os.path.join(folder, "tests", f"robot{robot}_day{day}.json")) as f:
                    days.append(json.load(f))
            self.robots.append(Robot(robot, days))
        self.first = self.robots[0].days[0]
        first = [row for row in rows("inertial") if (row["robot"], row["test"], row["cycle"]) == ("1", "1", "1")]
        self.parameters = [(row["parameter"], row["unit"].replace("^2", "²")) for row in first]
        self.joints = list(dict.fromkeys(row["joint"] for row in rows("friction")))
        key = lambda row: (row["robot"], row["test"], row["joint"], row["parameter"])
        self.times = {key(row): row for row in rows("time_constants")}
        steps = [1 for r in self.robots for day in r.days[1:] for _ in day["cycles"][1:]]
        self.comparisons = len(steps) * len(self.joints)
        self.threshold = quantile(1 - 0.005 / self.comparisons)
        compared = [one for r in self.robots for one in r.compare(self.joints, self.threshold)]
        self.least = max(compared, key=lambda one: one[0])
        self.changes = [(r, *change) for r in self.robots for change in r.changes]


def share(x):
    return "–" if x is None else f"{100 * x:.2f} %"


def with_sigma(value, sigma):
    decimals = min(max(1 - math.floor(math.log10(sigma)), 0), 9)
    text = f"{value:.{decimals}f} ± {sigma:.{decimals}f}"
    return text[1:] if float(text.split()[0]) == 0 and text[0] == "-" else text


def take_head(n, d):
    c, cycles, named = d.campaign, d.first["cycles"], set()
    for robot, joint, day, cycle, found, expected, z in d.changes:
        if (robot.number, joint, day) in named:
            continue
        named.add((robot.number, joint, day))
        where = f"Robot {robot.number}, test {day + 1}: friction of {joint}"
        n.take(
            "verdict",
            f"{where} changed at {robot.minutes(day, cycle):.0f} min, by {found:+.1f} % from one cycle to the next "
            f"where earlier days had {expected:+.1f} % ({z:.0f} sigma). ",
        )
    sigma, joint = d.least
    seen = 100 * math.expm1((d.threshold + quantile(0.95)) * sigma)
    n.take(
        "what is seen",
        f"A change of {seen:.3g} % from one cycle to the next is seen in 95 % of cases ({joint}; smaller ones of other "
        f"joints), none on the first day or after {d.robots[0].minutes(0, -1):.2g} of a day's "
        f"{c['duration_s'] / 60:.2g} min.",
    )
    n.take("rule", "a change of 30 % could be missed, less than 50 % of a day is compared")
    robots = f"{c['robots']} robot{'s' if c['robots'] > 1 else ''}"
    length = f"{robots}, {c['days']} days of {c['duration_s'] / 3600:.3g} h"
    n.take("tests", f"\ntests\n{c['robots'] * c['days']}\n{length}\n", f"cycles\n{len(cycles)}\nof the motion on a day")
    of = f"of {d.comparisons} comparisons, beyond {d.threshold:.2f} sigma"
    n.take("changes", f"changes\n{len(d.changes)}\n{of}\n")
    merged = [(key[0], key[2]) for key, row in d.times.items() if key[1] == "mix" and row["identifiable"] == "yes"]
    n.take("time constants", f"time constants\n{len(set(merged))} of {len(d.robots) * len(d.joints)}\n")
    spreads = [robot.spread(p)[2:] for robot in d.robots for p in range(len(d.parameters))]
    drift, over_days = (max((s[k] for s in reversed(spreads) if s[k] is not None), default=None) for k in (1, 0))
    n.take(
        "inertia",
        f"inertia over a day\n{share(drift)}\nmaximum of the parameters that one cycle identifies within 2 %; their "
        f"maximum standard deviation over days: {share(over_days)}\n",
    )


def take_changes(n, d):
    for robot, joint, day, cycle, found, expected, z in d.changes:
        row = [joint, str(robot.number), str(day + 1), str(cycle + 1), f"{robot.minutes(day, cycle):.1f}"]
        n.take("change", "\n".join([*row, f"{found:+.2f} %", f"{expected:+.2f} %", f"{z:.1f}"]) + "\n")
    if d.changes:
        n.take(
            "a change",
            f"more than {d.threshold:.2f} standard deviations: of campaigns without a change, 1 % report any",
        )


UNKNOWN = {"identifiable": "no"}


def minutes(time):
    if time["identifiable"] == "no":
        return "*"
    return f"{float(time['value_s']) / 60:.3f} ± {float(time['sigma_s']) / 60:.2g}"


def take_times(n, d):
    for robot in d.robots:  # each table as a whole: rows of two robots may be the same
        changed = {change[1] for change in robot.changes}
        tests = [(str(k + 1), f"test {k + 1}" + ", changed" * (k in changed)) for k in range(len(robot.days))]
        rows = [["minutes", *d.joints]]
        for name in ("t1", "t2"):
            for test, called in [*tests, ("mix", "Mix")]:
                found = [d.times.get((str(robot.number), test, joint, name), UNKNOWN) for joint in d.joints]
                rows.append([f"{name}, {called}", *map(minutes, found)])
        n.take("time constants", f"Robot {robot.number}\n" + "\n\n".join("\n".join(row) for row in rows) + "\n")


def take_base(n, d):
    for p, (name, unit) in enumerate(d.parameters):
        row = [name, unit]
        for robot in d.robots:
            mean, sigma, over_days, over_a_day = robot.spread(p)
            true = robot.days[0]["base_of_robot"][p]
            simulated = "0" if abs(true) < 1e-12 else typeset(f"{true:.4g}")
            row += [with_sigma(mean, sigma), simulated, share(over_days), share(over_a_day)]
        n.take("base parameter", "\n".join(row) + "\n")


def take_groups(n, d, model):
    """What the base parameters stand for, and the captions of those that the first day identifies best."""
    rows = dict(re.findall(r"\n(\S+)\n(\1 [+-] .*)\n", n.text))
    groups = [rows.get(name, name) for name, _ in d.parameters]
    bad = base_parameter_groups.wrong(model, groups)
    n.check("number: combinations of parameters are those with which the model moves", not bad, bad)
    n.take("stands for", *(f"{name}\n{group}\n" for name, group in rows.items()))
    precision = [-abs(value) / sigma for value, sigma in d.first["base"]]
    captions = [f"{groups[p]}, of each cycle, with one sigma." for p in np.argsort(precision)[:6]]
    n.take("best identified", *captions)


def hold(page, check, folder, source, model):
    """`source`: the folder of `model`, which the page leaves out."""
    n, d = Numbers(page, check), Days(folder)
    n.take("campaign.yaml", d.campaign_text.replace(source + "/", ""))
    day = day_of(os.path.join(folder, "friction.csv"))
    made = f"page made with tribotwin {version()} · simulated by MuJoCo {engine_of(d.campaign_text)}\n"
    n.take("identity", f"EFORT ER3A-C60 · newest file written {day} · {made}")
    take_head(n, d)
    take_changes(n, d)
    take_times(n, d)
    take_base(n, d)
    n.take("friction over the day", "At 60 % of the maximum speed: ")
    take_groups(n, d, os.path.join(source, model))
    # What is no measured number: the paper, a share that is a setting, column heads.
    if d.changes:  # figures of that joint
        n.take("words", "at speed 0")
    n.take("words", "Hao 2021", "one cycle does not identify it within 2 %")
    whats = ("", ", as simulated", ", over days", ", over a day")
    heads = [f"robot {robot.number}{what}" for robot in d.robots for what in whats]
    n.take("columns", "\n".join(heads) + "\n")
    n.finish("days")
