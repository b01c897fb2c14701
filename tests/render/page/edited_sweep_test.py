"""tribotwin-report sweep on a folder that somebody else has edited: a page, or one message with the file. Arguments:
tribotwin, tribotwin-report."""
import json, os, re, shutil, sys, time

import harness
from harness import check, check_refused, content, finish, path
from pendulum import PENDULUM

twin, report = sys.argv[1:3]


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


write("pendulum.xml", PENDULUM)
write(
    "scenario.yaml",
    "model: pendulum.xml\nduration_s: 0.5\n"
    "motion: {type: cycle, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}], speed_rad_s: 2}\n",
)
write(
    "plan.yaml",
    "scenario: scenario.yaml\nfactors:\n  temperature_degC: {uniform: [20, 40]}\n"
    "  drives.hinge.Fc0: {normal: [0.03, 0.002]}\n"
    "design: {type: sobol, runs: 32, seed: 3, indices: true}\noutputs: [heat_J, max_abs(hinge.friction_nm)]\n"
    "bands: {telemetry: [hinge.friction_nm, hinge.velocity_rad_s], times: 5}\n",
)
r = harness.run(twin, "sweep", "plan.yaml", "-o", "good", "--quiet")
check("the sweep is made", r.returncode == 0, r)


def edited(change):
    """What the report says of a copy that was changed."""
    shutil.rmtree(path("sweep"), ignore_errors=True)
    shutil.copytree(path("good"), path("sweep"))
    change()
    return harness.run(report, "sweep", "sweep", timeout=60)


def replaced(file, old, new):
    text, count = re.subn(old, lambda _: new, content(f"sweep/{file}"), count=1)
    check(f"{file} has {old!r}", count == 1)
    write(f"sweep/{file}", text)


def statistics(change):
    def act():
        all = json.loads(content("sweep/statistics.json"))
        change(all["outputs"])
        write("sweep/statistics.json", json.dumps(all))

    return act


# ---- Texts of any length: patterns of pages take no stack for each character.
digits, letters = "1" * 300_000, "a" * 300_000
for name, file, old, new in (
    ("a power of many digits", "origin.yaml", r"(?s).*", f"plan: p\ndescription: 'a {digits}e-05 b'\n"),
    ("a name of many digits", "campaign.yaml", r"\[heat_J", f"[{digits}"),
    ("a long value of the summary", "campaign.yaml", r"\[heat_J", f"[joints.{letters}.temperature_degC.end"),
    ("a long value of the record", "campaign.yaml", r"\[heat_J", f"[max({letters}.friction_nm)"),
):
    r = edited(lambda: replaced(file, old, new))
    check(f"{name}: the page is written", r.returncode == 0 and r.stdout == "sweep/report.html\n", r.returncode)


# ---- statistics.json
def no_mean(outputs):
    del outputs["heat_J"]["mean"]
    outputs["heat_J"]["sobol_indices"] = {"temperature_degC": {}, "drives.hinge.Fc0": 5}


for name, change, says in (
    ("indices of an output without a mean", no_mean, "heat_J: sobol_indices: drives.hinge.Fc0: has no 'first'"),
    (
        "an output without quantiles",
        lambda outputs: outputs["max_abs(hinge.friction_nm)"].update(quantiles=[]),
        "max_abs(hinge.friction_nm): quantiles: must have the probabilities of the other outputs",
    ),
):
    r = edited(statistics(change))
    check_refused(name, r, ["sweep/statistics.json: outputs: ", says, "--force"], 2, lines=None)


# ---- bands.csv
def cut_bands(columns):
    lines = content("sweep/bands.csv").splitlines()
    write("sweep/bands.csv", "".join(",".join(line.split(",")[:columns]) + "\n" for line in lines))


other = "the quantiles of hinge.velocity_rad_s are not those of the first signal"
check_refused("a signal without quantiles", edited(lambda: cut_bands(8)), ["sweep/bands.csv:1: ", other], 2, lines=None)
r = edited(lambda: replaced("bands.csv", r"rad_s\.q0\.5", "rad_s.q0.6"))
check_refused("a signal of other quantiles", r, ["sweep/bands.csv:1: ", other], 2, lines=None)
r = edited(lambda: replaced("bands.csv", r"friction_nm\.q0\.5", "friction_nm.qmany"))
check_refused("a quantile that is no number", r, ["sweep/bands.csv:1: ", "hinge.friction_nm"], 2, lines=None)

# ---- Runs that a campaign.yaml asks for and nobody has made: time is that of those that are there.
for name, change in (
    ("a finished sweep", lambda: None),
    ("an unfinished sweep", lambda: os.remove(path("sweep/statistics.json"))),
):
    began = time.monotonic()
    r = edited(lambda: (replaced("campaign.yaml", r"\nruns: 32", "\nruns: 10000000"), change()))
    took = time.monotonic() - began
    check(f"{name} of 10^7 runs is answered at once", took < 20, took)
    check(f"{name} of 10^7 runs: a page or a message", r.returncode in (0, 2), r)
finish()
