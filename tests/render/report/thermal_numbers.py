"""Every number outside the figures of a page of first-order thermal models without gaps in their recordings, against
these and the file of the models: temperatures and bands are predicted here."""
import os

import numpy as np
import yaml

from numbers_of_page import Numbers, digits, percent, take_identity

LIGHTS = ("green", "amber", "red")


def warm(t_s, gain_K_J, ambient_degC, time_s, power_w, first_degC):
    """Of bodies side by side that share the first rise as in steady state: T [degC]."""
    t_s, gain_K_J = np.array(t_s), np.array(gain_K_J)
    steady = t_s * gain_K_J
    shares = steady / steady.sum() if steady.sum() > 0 else np.eye(len(t_s))[0]
    rise, out = shares * (first_degC - ambient_degC), [first_degC]
    for dt_s, p in zip(np.diff(time_s), (power_w[1:] + power_w[:-1]) / 2):
        rise = rise + (1 - np.exp(-dt_s / t_s)) * (steady * p - rise)
        out.append(ambient_degC + rise.sum())
    return np.array(out)


class Session:
    """A joint in a recording: what is predicted of it, and how well."""

    def __init__(self, joint, model, file, seen):
        table = np.genfromtxt(file, delimiter=",", names=True)
        self.joint, self.file, self.time_s = joint, os.path.basename(file), table["time_s"]
        self.recorded, self.power_w = table[f"temperature_{joint}_degC"], table[f"power_{joint}_w"]
        self.first = self.recorded[0]
        at = np.array([model["R_th"], model["kappa"], model["T_amb"]])
        self.error = self.warmed(at) - self.recorded
        self.rms, self.largest = np.sqrt(np.mean(self.error**2)), np.max(np.abs(self.error))
        self.half = self.band(at, model["uncertainty"], seen)
        self.inside = np.mean((np.abs(self.error) <= self.half)[1:])
        self.low, self.high = min(self.recorded), max(self.recorded)
        self.minutes = self.time_s[[0, -1]] / 60

    def warmed(self, at, more_K=0.0):
        R_th, kappa, T_amb = at
        return warm([kappa], [R_th / kappa], T_amb, self.time_s, self.power_w, self.first + more_K)

    def band(self, at, u, seen):
        """Half its width [K]."""
        own, steps = self.warmed(at), np.diag(1e-4 * at)
        g = np.array([(self.warmed(at + d) - self.warmed(at - d)) / (2 * d.sum()) for d in steps])
        kept, noise, days = self.warmed(at, 1.0) - own, u["noise"], u["surroundings"]["days"]
        slow = noise["slow_K"] ** 2
        common = slow * np.exp(-(self.time_s - self.time_s[0]) / noise["correlation_s"]) if slow else 0
        variance = np.einsum("it,ik,kt->t", g, np.array(u["covariance"]), g)
        variance += (1 + kept**2) * (noise["white_K"] ** 2 + slow) - 2 * kept * common
        variance += g[2] ** 2 * u["surroundings"]["deviation_K"] ** 2 * (1 + (-1 if seen else 1) / days)
        others = [(b["t_s"], b["gain_K_J"], b["T_amb"], self.time_s, self.power_w, self.first) for b in u["slower"]]
        slower = np.max([np.abs(warm(*other) - own) for other in others], axis=0)
        return np.append(0, np.sqrt(u["sigmas"] ** 2 * variance + slower**2)[1:])

    def row(self):
        range_K = self.high - self.low
        cells = [self.joint, self.file, "{:.1f} … {:.1f}".format(*self.minutes), f"{self.low:.1f} … {self.high:.1f}"]
        cells += [f"{self.rms:.3f}", percent(self.rms / range_K), f"{self.largest:.3f}", digits(max(self.half), 3)]
        return cells + [percent(self.inside), str(len(self.time_s))]


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
        f"{identified} Temperatures are predicted from the first one of each recording within "
        f"{kelvins(max(j.rms for j in joints))} (root mean square; largest error "
        f"{kelvins(max(j.largest for j in joints))}); {worst.name} is worst, {percent(worst.share)} of its range of "
        f"{kelvins(worst.range)}, over {hours(worst.recorded_s)} of {of}. Of its temperatures {own} lie within their "
        f"95 % band, at most ±{kelvins(worst.half)}"
        + ("" if least == own else f"; of those of {fewest.name}, the fewest, {least}"),
    )


def take_tiles(n, joints, worst, lacking, files):
    """`lacking`: parameters that are not identifiable, and all."""
    hottest, longest = max(joints, key=lambda j: j.high), max(joints, key=lambda j: j.recorded_s)
    several = f"{len(files)} files" if len(files) > 1 else "1 file"
    n.take(
        "tiles",
        f"worst joint\n{kelvins(worst.rms)}\nroot mean square of {worst.name}, {percent(worst.share)} of its range\n",
        f"hottest joint\n{hottest.high:.1f} °C\n{hottest.name}\n",
        f"recorded\n{hours(longest.recorded_s)}\n{len(joints)} joints, {several}\n",
        "not identifiable\n{} of {}\nparameters\n".format(*lacking),
    )


def take_parameters(n, models):
    for joint, m in models.items():
        for name, unit in (("R_th", "K/W"), ("kappa", "s")):
            if name in m["unidentifiable"]:
                value, remark = ["–", "–"], f"not identifiable; {digits(m[name], 2)} fits, as do others"
            else:
                value, remark = [digits(m[name], 4), digits(m["sigma"][name], 2)], "–"
            n.take(f"{joint}, {name}", "\n".join(["", joint, name, *value, unit, remark, ""]))


def take_words(n, surroundings):
    """Rules, what a band is, names of parameters."""
    n.take(
        "rule",
        "red when a joint's error is above 1 K and 25 % of its temperature range, amber above 1 K and 5 %, above 1 K "
        "with less than 50 % of the temperatures within their band",
    )
    assert surroundings["days"] == 1
    n.take(
        "surroundings", f"surroundings that vary by {surroundings['deviation_K']:.2g} K (standard deviation, from no"
    )
    n.take("95 % bands", "95 % band ± [K]", "holds 95 % of the recorded", "with the band of 95 %")
    n.take("parameters of two bodies", "heat gains c1, c2 and time constants t1, t2")


def hold(page, check, program, command, parameters, files):
    """`parameters`: of the models; `files`: recordings with the same joints."""
    with open(parameters) as f:
        text = f.read()
    given, n = yaml.safe_load(text), Numbers(page, check)
    models = given["joints"]
    seen = [os.path.basename(f) in given["data"] for f in files]
    sessions = {j: [Session(j, m, f, s) for f, s in zip(files, seen)] for j, m in models.items()}
    joints = [Joint(*one) for one in sessions.items()]
    worst = max(joints, key=lambda j: (LIGHTS.index(j.light()), j.rms))
    lacking = sum(len({"R_th", "kappa"} & set(m["unidentifiable"])) for m in models.values())
    light = "amber" if lacking and worst.light() == "green" else worst.light()
    check("thermal: the light is that of the worst joint", f"\n{light.capitalize()}: red when" in n.text, light)
    of = "the recordings that the models are from" if all(seen) else "recordings that the models have not seen"
    n.take("the file", text)
    n.take("the command", command)
    take_identity(n, program, parameters, *files)
    take_verdict(n, joints, worst, (2 * len(models) - lacking, 2 * len(models)), of)
    take_tiles(n, joints, worst, (lacking, 2 * len(models)), files)
    for s in (s for one in sessions.values() for s in one):
        n.take(f"{s.joint} in {s.file}", "\n".join(["", *s.row(), ""]))
    take_parameters(n, models)
    take_words(n, models[worst.name]["uncertainty"]["surroundings"])
    n.finish("thermal")
