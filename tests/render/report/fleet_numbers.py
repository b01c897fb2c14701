"""Every number outside the figures of a fleet's page, against the store, read by sqlite3, and what tribotwin fleet
check and watch say of the listed joints. Their friction is also computed from the curves of the store, within the
deviation of one of them."""
import datetime, math, re, sqlite3

import numpy as np

from numbers_of_page import Numbers, version

DAY_S, WINDOW_DAYS = 86400, 10
EXCESS = 2.3  # healthy joints on a list over what its rate says, at most, in tests of the twin


class Plant:
    def __init__(self, store):
        db = sqlite3.connect(store)
        rows = lambda query, *values: db.execute(query, values).fetchall()
        self.end = rows("SELECT MAX(time_s) FROM observations")[0][0]
        self.start = self.end - WINDOW_DAYS * DAY_S + 1
        self.robots = rows("SELECT COUNT(*) FROM robots")[0][0]
        self.joints = rows("SELECT COUNT(*) FROM joints")[0][0]
        window = "FROM observations WHERE learned = 0 AND time_s BETWEEN ? AND ?"
        self.curves, self.judged = rows("SELECT COUNT(*), COUNT(DISTINCT joint) " + window, self.start, self.end)[0]
        self.checks = rows("SELECT time_s, kind, judged, rate FROM checks")
        self.listed = rows("SELECT kind, joint FROM verdicts")
        self.curve_of = rows(
            "SELECT robots.name, joints.name, learned, time_s, Fc_nm, temperature_degC "
            "FROM observations JOIN joints ON joints.id = joint JOIN robots ON robots.id = joints.robot"
        )
        self.files = rows(
            "SELECT files.name, COUNT(*), COUNT(DISTINCT joints.robot), SUM(weak != '') FROM observations "
            "JOIN files ON files.id = file JOIN joints ON joints.id = joint "
            "WHERE learned = 0 AND time_s BETWEEN ? AND ? GROUP BY file",
            self.start,
            self.end,
        )
        db.close()

    def of_joint(self, name, learned):
        """By robot: logarithm of Fc, and temperature, of a joint's curves."""
        robots = {}
        for robot, joint, was_learned, time_s, Fc, T in self.curve_of:
            if joint == name and was_learned == learned and (learned or time_s >= self.start):
                robots.setdefault(robot, []).append((math.log(Fc), T))
        return {robot: np.array(rows).T for robot, rows in robots.items()}

    def friction(self, robot, joint):
        """Mean change of Fc in the window and standard deviation of one healthy curve in %, and the healthy curves:
        against the robot's healthy mean, with slopes over T and T^2 that all robots share."""
        healthy = self.of_joint(joint, 1)
        terms = lambda T: np.column_stack([T, T**2])
        inner = lambda x: x - np.mean(x, axis=0)
        x = np.vstack([inner(terms(T)) for _, T in healthy.values()])
        y = np.concatenate([inner(Fc) for Fc, _ in healthy.values()])
        slopes, squares = np.linalg.lstsq(x, y, rcond=None)[:2]
        within = squares[0] / (len(y) - len(healthy) - 2)
        Fc, T = healthy[robot]
        mean = np.mean(Fc - terms(T) @ slopes)
        now, now_T = self.of_joint(joint, 0)[robot]
        change = np.mean(now - terms(now_T) @ slopes) - mean
        return 100 * math.expm1(change), 100 * math.sqrt(within * (1 + 1 / len(Fc))), len(Fc)


def day(time_s):
    return datetime.datetime.fromtimestamp(time_s, datetime.timezone.utc).date().isoformat()


def joints_text(count):
    return f"{count} joint" + "s" * (count != 1)


def confidence(p):
    return "> 99 %" if p > 0.99 else f"{100 * p:.0f} %"


def q_text(q):
    return "<0.0001" if q < 1e-4 else f"{q:.2g}"


def name_of(found):
    return f"{found['robot']} {found['joint']}"


def cause_of(found):
    change = 100 * found["friction_change"]
    return f"friction {change:+.1f} %, looks like {found['pattern']} (confidence {confidence(found['confidence'])})"


def take_head(n, p, all_found):
    """`all_found`: the joints that are listed, by check and by watch, first the worst."""
    silent, listed = p.joints - p.judged, [sum(kind == k for kind, _ in p.listed) for k in ("check", "watch")]
    found, several = all_found[0], len(all_found) > 1
    n.take(
        "verdict",
        f"{len(all_found)} of {joints_text(p.judged)} {'need' if several else 'needs'} a look: "
        f"{'first ' if several else ''}{name_of(found)}, {cause_of(found)}, since {found['since']}. "
        f"{joints_text(silent)} has no verdict.",
    )
    n.take(
        "identity",
        f"the {WINDOW_DAYS} days to {day(p.end)} · {p.joints} joints of {p.robots} robots · tribotwin {version()}\n",
    )
    rate = p.checks[0][3]
    healthy = rate * sum(listed)
    n.take(
        "rule",
        f"False-discovery rate {100 * rate:g} % of each list (check {listed[0]}, watch {listed[1]}): of "
        f"them {healthy:.2g} joints or fewer are healthy on average as far as the model holds; up to "
        f"{EXCESS * healthy:.2g} in tests.",
    )
    n.take("judged", f"judged\n{p.judged}\nof {joints_text(p.joints)}\n")
    n.take("listed", "listed\n{}\n{} by check, {} by watch\n".format(len({joint for _, joint in p.listed}), *listed))
    n.take("without verdict", f"without verdict\n{silent}\n")
    n.take("curves", f"curves\n{p.curves}\nof these {WINDOW_DAYS} days\n")
    n.take("silent", f"{joints_text(silent)} without verdict: no curve in these {WINDOW_DAYS} days.")
    n.take("what to do", f"What to do: {name_of(found)}: {found['advice']}.")
    both = f"{len(all_found)} on both lists, 0 on that of check alone, 0 on that of watch alone."
    n.take("which list", both)
    n.take("list by itself", f"made at the false-discovery rate of {100 * rate:g} %; q is")


def take_row(n, rank, found):
    margin = "{value:.3f} ({low:.3f} … {high:.3f})".format(**found["margin"])
    row = [str(rank), found["robot"], found["joint"], f"{100 * found['friction_change']:+.1f} %", found["pattern"]]
    row += [f"{100 * found['severity']:.0f} %", margin, q_text(found["q"]), found["since"], "both", found["advice"]]
    n.take("row", "\n".join(row) + "\n")


def take_part(check, part, p, rank, found):
    """What is said of one of them below."""
    n, cause = Numbers(f"<main>{part}</main>", check), cause_of(found)
    computed, deviation, curves = p.friction(found["robot"], found["joint"])
    change = 100 * found["friction_change"]  # of a joint's healthy state, which weighs curves otherwise
    check("number: friction is that of the store's curves", abs(change - computed) < deviation, (change, computed))
    n.take("its own part", f"{rank}. {name_of(found)}\n", cause[0].upper() + cause[1:] + ". ")
    n.take(
        "friction",
        f"against the mean of this joint's {curves} healthy curves at its temperature. The strip: ± 2 standard "
        f"deviations of one healthy curve ({deviation:.1f} %).",
    )
    n.take("since", f"Listed by the chart since {found['since']}.")
    n.take("the strip", "the strip is ± 2.")
    n.finish("fleet, " + name_of(found))


def hold(page, check, store, all_found):
    """`all_found`: the listed joints as fleet check --json has them, with `since` of watch; each is on both lists."""
    p = Plant(store)
    first, *parts = re.split(r"(?=<h3[^>]*>\d+\. )", page[page.index("<main>") : page.index("</main>")])
    parts[-1], rest = re.split("(?=<h2)", parts[-1], maxsplit=1)
    check("fleet: a part of each listed joint", len(parts) == len(all_found), len(parts))
    for rank, (part, found) in enumerate(zip(parts, all_found), 1):
        take_part(check, part, p, rank, found)
    n = Numbers(first + rest + "</main>", check)
    take_head(n, p, all_found)
    for rank, found in enumerate(all_found, 1):
        take_row(n, rank, found)
    n.take(
        "lists", f"check judges the mean of the last {WINDOW_DAYS} days", f"Mean over the {WINDOW_DAYS} days against"
    )
    n.take("heading", f"Curves of these {WINDOW_DAYS} days")
    for name, *numbers in p.files:
        n.take("file", "\n".join(map(str, [name, *numbers])) + "\n")
    for time_s, kind, judged, rate in p.checks:
        listed = sum(k == kind for k, _ in p.listed)
        n.take("earlier check", "\n".join([day(time_s), kind, str(judged), str(listed), f"{100 * rate:g} %"]) + "\n")
    # What is no measured number: the share of an interval, the width of a strip, the level of a threshold.
    n.take("words", "margin (95 %)", "below 0 it is exceeded")
    n.finish("fleet")
