"""Every number outside the figures of a page of predicted torques of one joint, against the table and the JSON of
tribotwin predict and the parameters that it was given. What the table says, JSON or not, is computed from the table."""
import json, re

import numpy as np
import yaml

from numbers_of_page import Numbers, percent, take_identity

EXCERPT = 800  # samples of the figure of the torque


class Joint:
    """What the table says of it, and of JSON what the table cannot say: the residual by quantity, the training."""

    def __init__(self, name, table, result):
        table = np.genfromtxt(table, delimiter=",", names=True)
        column = lambda key, unit="_nm": table[f"{key}_{name}{unit}"]
        self.name, self.time_s = name, table["time_s"]
        self.moves = column("moving", "") == 1
        torque, error, half = (x[self.moves] for x in (column("torque"), self.error(column), column("band")))
        self.rms, self.largest, self.range = np.sqrt(np.mean(error**2)), np.max(np.abs(error)), np.ptp(torque)
        self.of_range, self.of_variation = self.rms / self.range, self.rms / np.std(torque)
        banded = np.isfinite(half)
        self.inside = np.mean(np.abs(error[banded]) <= half[banded])
        shares = {on: d["share"] for on, d in result["verdict"]["dependence"].items() if d["chance"] < 1e-3}
        self.dependence = sorted(((s, on) for on, s in shares.items() if s >= 0.1), reverse=True)[:3]
        self.of_speed = result["verdict"]["dependence"]["speed"]["share"]
        self.outside = max(r["share_outside"] for r in result["training"].values())

    @staticmethod
    def error(column):
        return column("torque") - column("predicted")

    def drawn(self):
        """From when to when the figure of the torque is, around the middle of the samples in motion."""
        known, n = np.flatnonzero(self.moves), len(self.time_s)
        count, middle = min(n, EXCERPT), known[len(known) // 2]
        begin = min(max(middle - count // 2, 0), n - count)
        return self.time_s[begin], self.time_s[begin + count - 1]


def take_head(n, j, bad):
    """Verdict, tiles and what to do."""
    n.take(
        "verdict",
        f"Torques are predicted to {percent(j.of_range)} of their range (root mean square; worst: {j.name}); "
        + (
            f"{j.name} is badly explained."
            if bad
            else f"{percent(j.of_variation)} of a joint's variation is unexplained (worst: {j.name})."
        ),
    )
    n.take(
        "tiles",
        f"largest error\n{percent(j.of_range)}\nof the range of {j.name}, RMS\n",
        f"unexplained\n{percent(j.of_variation)}\nof the variation of {j.name}\n",
        f"within the 95 % band\n{percent(j.inside)}\nof the torques of {j.name}\n",
        f"outside the training\n{percent(j.outside)}\nof the samples\n",
        "recordings\n1\n",
    )
    if bad:
        share, on = j.dependence[0]
        n.take("what to do", f"the residual of {j.name} below, {percent(share)} of which goes with {on};")


def take_notes(n, j, half, bad, band):
    if bad:
        share, on = j.dependence[0]
        n.take(
            "badly explained",
            f"joint {j.name}: {100 * j.of_variation:.0f} % of its torque's variation is unexplained",
            f"the residual repeats with {on} ({100 * share:.0f} % of it)",
        )
    if j.inside < 0.9:
        n.take(
            "few in the band",
            f"only {100 * j.inside:.0f} % of the recorded torques are within the 95 % band of ± {half:.3g} Nm",
        )
    if band["changed"]:
        trained = band["as_trained"]
        n.take(
            "few in the band where joints are as in the training",
            f"and {100 * trained['share_inside']:.0f} % where it and the joints that load it are within the training's "
            f"ranges ({trained['samples']} samples, {trained['independent']:.0f} independent ones)",
        )


def take_captions(n, j, half):
    begin, end = j.drawn()
    n.take(
        "figure of the torque",
        f"from {begin:.6g} to {end:.6g} s. Band: ± {half:.4g} Nm about it, in which 95 % of recorded torques lie if",
    )
    over = "mean residual with its 95 % interval; {} of the residual goes with "
    for share, on in j.dependence:
        n.take("residual over " + on, over.format(percent(share)) + on + ".")
    if not j.dependence:
        n.take("residual over speed", over.format(percent(j.of_speed)) + "speed, as much as")


def hold(page, check, program, command, files):
    """`files`: JSON of tribotwin predict, its table, the parameters."""
    with open(files[0]) as result, open(files[2]) as parameters:
        n, of, given = Numbers(page, check), json.load(result), yaml.safe_load(parameters)
    ((name, joint),) = of["joints"].items()
    j, half, bad = Joint(name, files[1], joint), given["band"][name], bool(of["badly_explained"])
    check("dynamics: red is from 30 % on", bad == (j.of_variation >= 0.3), (bad, j.of_variation))
    n.take("the command", command)
    take_identity(n, program, *files)
    take_head(n, j, bad)
    take_notes(n, j, half, bad, of['joints'][name]['band'])
    row = [f"{j.rms:.4g}", percent(j.of_range), f"{j.range:.4g}", f"{j.largest:.4g}", f"{half:.4g}", "Nm"]
    row += [percent(j.inside), percent(j.of_variation)]
    n.take("errors", "\n".join(["", name, *row, ""]))
    take_captions(n, j, half)
    for key, p in given["friction"][name].items():
        cells = [name, given["friction_law"], key, f"{p['value']:.4g}", f"{p['sigma']:.2g}", p["unit"]]
        n.take("friction: " + key, "\n".join(["", *cells, ""]))
    n.take("rules", "red when 30 % or more", "more than 1 % of its samples", "less than 90 % of a joint's torques")
    n.take("95 % bands", "within their 95 % band,", "95 % band, ±", "95 % band: 95 % of the torques of the training")
    n.finish("dynamics")
