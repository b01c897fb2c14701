"""From a campaign in MuJoCo with noise to parameters: Bittencourt 2012 and Zhou 2024, whole. The exponent that curves
share is that of the 210 curves of the other campaigns by day, of 488 of its own by night.

Arguments: tribotwin, source tree."""
import json, sys

import numpy as np

import harness
from harness import check, finish, nightly

program, source = sys.argv[1:3]
# Bittencourt 2012, Tables 2 and 3: value, one standard deviation.
PAPER = {
    "Fc0": (3.11e-2, 0.028e-2),
    "Fcl": (2.34e-2, 0.071e-2),
    "Fs0": (-2.50e-2, 0.12e-2),
    "FsT": (1.60e-3, 0.022e-3),
    "Fsl": (1.26e-1, 0.025e-1),
    "vs0": (-24.81, 0.87),
    "vsT": (0.98, 0.018),
    "vsl": (9.22, 0.12),
    "Fv0": (1.30e-4, 0.056e-4),
    "FvT": (1.32e-3, 0.076e-3),
    "TV0": (20.71, 0.91),
}


def run(*arguments):
    r = harness.run(program, *arguments, timeout=None)
    if r.returncode:
        sys.exit(f"{arguments}: {r.stderr}")
    return r.stdout


def measure(name):
    run("lab", f"{source}/twin/scenarios/{name}.yaml", "-o", name, "--quiet")
    return name + "/curves.csv"


def identify(*arguments):
    return json.loads(run("identify", "--json", "--quiet", *arguments))


# ---- Bittencourt 2012: load campaign, temperature campaign, stages, validation.
load, temperature, validation = map(
    measure, ("irb6620_load_campaign", "irb6620_temperature_campaign", "irb6620_validation_campaign")
)
staged = identify("--law", "extended", "--fix", "alpha=1.36", "--staged", load, temperature, "-o", "staged.yaml")[
    "parameters"
]
for name, (truth, paper_sigma) in PAPER.items():
    value, sigma = staged[name]["value"], staged[name]["sigma"]
    print(
        f"    {name:4} {value:11.5g} +- {sigma:8.2g}   truth {truth:9.4g}: "
        f"{(value - truth) / sigma:5.2f} sigma; sigma / paper's {sigma / paper_sigma:.2f}"
    )
    check(f"{name} within 3 of its sigmas", abs(value - truth) < 3 * sigma, (value, sigma))
    check(f"{name}: sigma at most twice the paper's", sigma < 2 * paper_sigma, sigma / paper_sigma)
best = identify("--evaluate", "staged.yaml", validation)["residual"]
identify("--law", "stribeck", load, temperature, "-o", "single.yaml")
single = identify("--evaluate", "single.yaml", validation)["residual"]
strongest = identify("--law", "stribeck", "--unweighted", validation)["residual"]
print(f"    validation: M* {best}, one M0 {single}, M0 fitted on the validation data themselves {strongest}")
for rival in (single, strongest):
    check(
        "M* beats a single M0 as in the paper: std 3.17, max 4.03",
        rival["std"] > 3.17 * best["std"] and rival["max_abs"] > 4.03 * best["max_abs"],
        (rival, best),
    )

# ---- Zhou 2024: the six-parameter law, cold -> hot -> cold, then loaded.
br609 = measure("br609_campaign")
fits = identify("--law", "steady_state", "--fix", "alpha=1.3", "--each", br609)["curves"]
p = {n: np.array([f["parameters"][n]["value"] for f in fits]) for n in ("Fc", "Fs", "Vs", "Fv", "beta")}
sigma = {n: np.array([f["parameters"][n]["sigma"] for f in fits]) for n in p}
T, l = (np.array([f[k] for f in fits]) for k in ("temperature_degC", "load_norm"))
check("12 observations and three with load", len(fits) == 15, len(fits))
check(
    "cold to hot and back",
    T[0] < 30 and T[5] > 50 and abs(T[11] - T[0]) < 1 and np.all(np.diff(T[:6]) > 0) and np.all(np.diff(T[5:12]) < 0),
    T,
)
unloaded = slice(0, 12)
rank = lambda x: np.argsort(np.argsort(x))
along = lambda n: np.corrcoef(rank(T[unloaded]), rank(p[n][unloaded]))[0, 1]
check("Fv falls with temperature", along("Fv") < -0.95, along("Fv"))
check("beta rises with temperature", along("beta") > 0.9, along("beta"))
check("Vs and Fc rise with temperature", along("Vs") > 0.8 and along("Fc") > 0.5, (along("Vs"), along("Fc")))
hot, kg5 = 5, 14
differs = lambda n, a, b: (p[n][b] - p[n][a]) / np.hypot(sigma[n][a], sigma[n][b])
check(
    "Fc and Fs move with load",
    differs("Fc", hot, kg5) > 5 and differs("Fs", hot, kg5) > 8,
    (differs("Fc", hot, kg5), differs("Fs", hot, kg5)),
)
check("Fs scarcely moves with temperature", abs(p["Fs"][hot] / p["Fs"][0] - 1) < 0.03, p["Fs"])

# ---- Bittencourt 2012, Fig. 5: one exponent for at least 488 curves (by day 210), all else free at each.
everything = [measure("irb6620_all_campaign")] if nightly else [load, temperature, validation]
curves = 488 if nightly else 210
law = identify("--law", "extended", *everything)["parameters"]["alpha"]
shared = identify("--law", "stribeck", "--shared", "alpha", *everything)
print(
    f"    alpha from {shared['curves']} curves: of M* {law['value']:.3f} +- {law['sigma']:.3f}; "
    f"of one M0 per curve {shared['value']:.3f} +- {shared['sigma']:.3f}"
)
check(
    f"alpha* = 1.36 +- 0.02 from at least {curves} curves",
    shared["curves"] >= curves
    and shared["samples"] > 11.8 * curves
    and abs(law["value"] - 1.36) < 0.02
    and law["sigma"] < 0.02,
    law,
)

finish()
