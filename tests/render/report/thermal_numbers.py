"""Every number outside the figures of a page of thermal models, of one or two bodies or in a chain, without gaps in the
recordings, against these and the file of the models: temperatures and bands are predicted here."""
import os

import numpy as np
from scipy import linalg
import yaml

from numbers_of_page import Numbers, digits, percent, take_identity, typeset

LIGHTS = ("green", "amber", "red")


def warm(t_s, gain_K_J, ambient_degC, time_s, power_w, first_degC, shares=None):
    """Of bodies side by side that share the first rise, without `shares` as in steady state: T [degC]."""
    t_s, gain_K_J = np.array(t_s), np.array(gain_K_J)
    steady = t_s * gain_K_J
    if shares is None:
        shares = steady / steady.sum() if steady.sum() > 0 else np.eye(len(t_s))[0]
    rise, out = shares * (first_degC - ambient_degC), [first_degC]
    for dt_s, p in zip(np.diff(time_s), (power_w[1:] + power_w[:-1]) / 2):
        rise = rise + (1 - np.exp(-dt_s / t_s)) * (steady * p - rise)
        out.append(ambient_degC + rise.sum())
    return np.array(out)


def derivatives(f, at):
    """Of a vector, by each number: [number, ...]."""
    return np.array([(f(at + d) - f(at - d)) / (2 * d.sum()) for d in np.diag(1e-4 * at)])


def other_day(u, seen):
    """Variance of the surroundings [K^2]."""
    return u["surroundings"]["deviation_K"] ** 2 * (1 + (-1 if seen else 1) / u["surroundings"]["days"])


class Session:
    """A joint in a recording: what is predicted of it, and how well."""

    def __init__(self, joint, file):
        table = np.genfromtxt(file, delimiter=",", names=True)
        self.joint, self.file, self.time_s = joint, os.path.basename(file), table["time_s"]
        self.recorded, self.power_w = table[f"temperature_{joint}_degC"], table[f"power_{joint}_w"]
        self.first = self.recorded[0]
        self.low, self.high = min(self.recorded), max(self.recorded)
        self.minutes = self.time_s[[0, -1]] / 60

    def judge(self, predicted, half):
        self.error, self.half = predicted - self.recorded, half
        self.rms, self.largest = np.sqrt(np.mean(self.error**2)), np.max(np.abs(self.error))
        self.inside = np.mean((np.abs(self.error) <= self.half)[1:])

    def row(self):
        range_K = self.high - self.low
        cells = [self.joint, self.file, "{:.1f} … {:.1f}".format(*self.minutes), f"{self.low:.1f} … {self.high:.1f}"]
        cells += [f"{self.rms:.3f}", percent(self.rms / range_K), f"{self.largest:.3f}", digits(max(self.half), 3)]
        return cells + [percent(self.inside), str(len(self.time_s))]


class Separate:
    """A model of a joint that its neighbours do not warm, in a session."""

    def __init__(self, model, session):
        self.s, self.two = session, "c1" in model
        names = ("c1", "c2", "t1", "t2") if self.two else ("R_th", "kappa")
        self.at = np.array([model[name] for name in (*names, "T_amb")])

    def warmed(self, at, more_K=0.0, shares=None):
        *own, T_amb = at
        t_s, gain = (own[2:], own[:2]) if self.two else (own[1:], [own[0] / own[1]])
        return warm(t_s, gain, T_amb, self.s.time_s, self.s.power_w, self.s.first + more_K, shares)

    def band(self, u, seen):
        """Half its width [K]."""
        own, g = self.warmed(self.at), derivatives(self.warmed, self.at)
        kept, noise, s = self.warmed(self.at, 1.0) - own, u["noise"], self.s
        slow = noise["slow_K"] ** 2
        common = slow * np.exp(-(s.time_s - s.time_s[0]) / noise["correlation_s"]) if slow else 0
        variance = np.einsum("it,ik,kt->t", g, np.array(u["covariance"]), g)
        variance += (1 + kept**2) * (noise["white_K"] ** 2 + slow) - 2 * kept * common
        variance += g[-1] ** 2 * other_day(u, seen)
        if self.two:  # the first temperature is that of either body, or between
            either = [self.warmed(self.at, shares=np.eye(2)[k]) for k in (0, 1)]
            variance += (either[0] - either[1]) ** 2 / 12
        others = [(b["t_s"], b["gain_K_J"], b["T_amb"], s.time_s, s.power_w, s.first) for b in u.get("slower", [])]
        slower = np.max([np.abs(warm(*other) - own) for other in others], axis=0) if others else 0
        return np.append(0, np.sqrt(u["sigmas"] ** 2 * variance + slower**2)[1:])


class Chain:
    """Of joints that warm their neighbours, in the sessions of one recording."""

    def __init__(self, given, sessions):
        self.sessions, self.time_s = sessions, sessions[0].time_s
        self.power_w = np.array([(s.power_w[1:] + s.power_w[:-1]) / 2 for s in sessions])
        numbers = [given["exchange"], *(j[name] for j in given["chain"].values() for name in ("gain", "t", "T_amb"))]
        self.at, self.first = np.array([n["value"] for n in numbers]), np.array([s.first for s in sessions])

    def warmed(self, at, first=None):
        """Joints x samples, by the matrix exponential of each step."""
        exchange, (gain, t_s, T_amb) = at[0], at[1:].reshape(-1, 3).T
        n, T = len(t_s), [self.first if first is None else first]
        A = np.diag(-1 / t_s) + exchange * (np.eye(n, k=1) + np.eye(n, k=-1))
        A -= exchange * np.diag([(j > 0) + (j < n - 1) for j in range(n)])
        step_s = np.diff(self.time_s)
        assert np.ptp(step_s) < 1e-9
        kept = linalg.expm(A * step_s[0])
        for power in self.power_w.T:
            steady = np.linalg.solve(-A, gain * power + T_amb / t_s)
            T.append(steady + kept @ (T[-1] - steady))
        return np.array(T).T

    def band(self, u, seen):
        own, g = self.warmed(self.at), derivatives(self.warmed, self.at)
        assert u["noise"]["slow_K"] == 0
        kept = [self.warmed(self.at, self.first + row) - own for row in np.eye(len(own))]
        variance = np.einsum("ijt,ik,kjt->jt", g, np.array(u["covariance"]), g)
        variance += u["noise"]["white_K"] ** 2 * (1 + np.sum(np.square(kept), axis=0))
        variance += np.sum(g[3::3], axis=0) ** 2 * other_day(u, seen)
        half = u["sigmas"] * np.sqrt(variance)
        half[:, 0] = 0
        return half


def sessions_of(given, file, seen):
    """Of each joint, in their order."""
    sessions = [Session(joint, file) for joint in given.get("joints", given.get("chain"))]
    if "chain" in given:
        chain, u = Chain(given, sessions), given["uncertainty"]
        for s, predicted, half in zip(sessions, chain.warmed(chain.at), chain.band(u, seen)):
            s.judge(predicted, half)
        return sessions
    for s, model in zip(sessions, given["joints"].values()):
        one = Separate(model, s)
        s.judge(one.warmed(one.at), one.band(model["uncertainty"], seen))
    return sessions


class Joint:
    """In all its sessions."""

    def __init__(self, name, sessions):
        self.name = name
        counts = [len(s.time_s) for s in sessions]
        self.rms = np.sqrt(np.average([s.rms**2 for s in sessions], weights=counts))
        self.inside = np.average([s.inside for s in sessions], weights=[n - 1 for n in counts])
        self.largest, self.half = max(s.largest for s in sessions), max(max(s.half) for s in sessions)
        self.high = max(s.high for s in sessions)
        self.range = self.high - min(s.low for s in sessions)
        self.recorded_s = sum(s.time_s[-1] - s.time_s[0] for s in sessions)
        self.share = self.rms / self.range

    def light(self):
        if self.rms <= 1 or (self.share <= 0.05 and self.inside >= 0.5):
            return "green"
        return "amber" if self.share <= 0.25 else "red"


def kelvins(K):
    return digits(max(K, 1e-3), 2) + " K"


def hours(seconds):
    return f"{seconds / 3600:.3g} h" if seconds >= 5400 else f"{seconds / 60:.3g} min"


def take_verdict(n, joints, worst, known, of):
    """`known` of the parameters are identified. `of`: which recordings these are."""
    if 0 < known[0] < known[1]:
        identified = f"{known[0]} of {known[1]} parameters are identified."
    else:
        identified = ("All {} parameters are" if known[0] else "None of the {} parameters is").format(known[1])
        identified += " identified."
    fewest, own = min(joints, key=lambda j: j.inside), percent(worst.inside)
    least = percent(fewest.inside)
    n.take(
        "verdict",
        f"{identified} Temperatures of {of} are predicted within {kelvins(max(j.rms for j in joints))} (root mean "
        f"square); {worst.name} is worst, {percent(worst.share)} of its range.",
        f"largest error {kelvins(max(j.largest for j in joints))}. {worst.name} has a range of {kelvins(worst.range)} "
        f"over {hours(worst.recorded_s)}. Of its temperatures {own} lie within their 95 % band, at most "
        f"±{kelvins(worst.half)}" + ("" if least == own else f"; of those of {fewest.name}, the fewest, {least}"),
    )


def take_tiles(n, joints, worst, lacking, files):
    """`lacking`: parameters that are not identifiable, and all."""
    hottest, longest = max(joints, key=lambda j: j.high), max(joints, key=lambda j: j.recorded_s)
    several = f"{len(files)} files" if len(files) > 1 else "1 file"
    n.take(
        "tiles",
        f"worst joint\n{kelvins(worst.rms)}\nroot mean square of {worst.name}, {percent(worst.share)} of its range\n",
        f"hottest joint\n{hottest.high:.1f} °C\n{hottest.name}\n",
        f"recorded\n{hours(longest.recorded_s)}\n{len(joints)} joint{'s' if len(joints) > 1 else ''}, {several}\n",
        "not identifiable\n{} of {}\nparameters\n".format(*lacking),
    )


UNITS = {"R_th": "K/W", "kappa": "s", "c1": "K/J", "c2": "K/J", "t1": "s", "t2": "s"}


def parameters_of(given):
    """Rows of the table: joint, name, value, sigma, unit, whether it is identifiable."""
    if "chain" not in given:
        for joint, m in given["joints"].items():
            for name in (name for name in UNITS if name in m):
                yield joint, name, m[name], m["sigma"].get(name), UNITS[name], name not in m["unidentifiable"]
        return
    lacking, own = given["unidentifiable"], lambda e: (e["value"], e["sigma"], e["unit"].replace("degC", "°C"))
    yield "all", "exchange", *own(given["exchange"]), "exchange" not in lacking
    for joint, m in given["chain"].items():
        for name, e in m.items():
            yield joint, name, *own(e), f"{joint}.{name}" not in lacking


def take_parameters(n, parameters):
    for joint, name, value, sigma, unit, known in parameters:
        cells, remark = ["–", "–"], f"not identifiable; {typeset(digits(value, 2))} fits, as do others"
        if known:
            cells, remark = [typeset(digits(value, 4)), typeset(digits(sigma, 2))], "–"
        n.take(f"{joint}, {name}", "\n".join(["", joint, name, *cells, unit, remark, ""]))


def take_words(n, surroundings):
    """Rules, what a band is, names of parameters."""
    n.take(
        "rule",
        "red when a joint's error is above 1 K and 25 % of its temperature range, amber above 1 K and 5 %, above 1 K "
        "with less than 50 % of the temperatures within their band",
    )
    days = surroundings["days"]
    source = "no measurement" if days == 1 else f"the {days} days of the models and 5 supposed ones with 2 K"
    n.take(
        "surroundings",
        f"surroundings that vary by {surroundings['deviation_K']:.2g} K (standard deviation, from {source}",
    )
    n.take("95 % bands", "95 % band ± [K]", "holds 95 % of the recorded", "with the band of 95 %")
    n.take("parameters of two bodies", "heat gains c1, c2 and time constants t1, t2")


def hold(page, check, program, command, parameters, files):
    """`parameters`: of the models; `files`: recordings with the same joints."""
    with open(parameters) as f:
        text = f.read()
    given, n = yaml.safe_load(text), Numbers(page, check)
    seen = [os.path.basename(f) in given["data"] for f in files]
    sessions = list(zip(*(sessions_of(given, f, s) for f, s in zip(files, seen))))
    joints = [Joint(one[0].joint, one) for one in sessions]
    worst = max(joints, key=lambda j: (LIGHTS.index(j.light()), j.rms))
    parameters_shown = list(parameters_of(given))
    count, lacking = len(parameters_shown), sum(not known for *_, known in parameters_shown)
    light = "amber" if lacking and worst.light() == "green" else worst.light()
    check("thermal: the light is that of the worst joint", f"\n{light.capitalize()}: red when" in n.text, light)
    of = f"recordings, {sum(seen)} of which the models are from,"
    if all(seen) or not any(seen):
        of = "the recordings that the models are from" if all(seen) else "recordings that the models have not seen"
    n.take("the file", text)
    n.take("the command", command)
    take_identity(n, program, parameters, *files)
    take_verdict(n, joints, worst, (count - lacking, count), of)
    take_tiles(n, joints, worst, (lacking, count), files)
    for s in (s for one in sessions for s in one):
        n.take(f"{s.joint} in {s.file}", "\n".join(["", *s.row(), ""]))
    take_parameters(n, parameters_shown)
    own = given if "chain" in given else given["joints"][worst.name]
    take_words(n, own["uncertainty"]["surroundings"])
    n.finish("thermal")
