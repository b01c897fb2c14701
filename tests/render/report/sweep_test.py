"""tribotwin-report sweep and fleet: the pages in a real browser, their numbers against those of tribotwin sweep and
fleet, unfinished and failing sweeps, stores without a verdict, wrong input. Arguments: tribotwin, tribotwin-report."""
import csv, glob, json, os, re, shlex, shutil, sqlite3, sys

from browser import Browser, opening
import fleet_numbers
import harness
from fleet_plant import HEADER, Plant
from harness import check, check_refused, content, finish, path, work
from numbers_of_page import day_of, in_print, text_of
from pendulum import PENDULUM
import sweep_numbers

twin, report = sys.argv[1:3]

check_page = Browser(work, check).check_page


def run(program, *arguments):
    # A report is made again and again here; that nothing is replaced unasked is tested in tests/programs.
    return harness.run(program, *arguments, *(["--force"] if program == report else []))


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


def verdict(page):
    return opening(content(page))["verdict"]


# ---- Sweeps.
write("pendulum.xml", PENDULUM)
write(
    "scenario.yaml",
    "model: pendulum.xml\nduration_s: 2\n"
    "motion: {type: cycle, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}], speed_rad_s: 2}\n",
)
PLAN = """scenario: scenario.yaml
description: a pendulum & <its> friction
set: {duration_s: 1}
factors:
  temperature_degC: {uniform: [20, 40]}
  drives.hinge.Fc0: {normal: [0.03, 0.002]}
design: {type: sobol, runs: 40, seed: 3}
outputs: [heat_J, joints.hinge.temperature_degC.end, max_abs(hinge.friction_nm)]
bands: {telemetry: [hinge.friction_nm], times: 11}
"""
write("small.yaml", PLAN)
run(twin, "sweep", "small.yaml", "-o", "runs/small", "--quiet")
r = run(report, "sweep", "runs/small", "--png")
check("sweep: the page is written", r.returncode == 0 and r.stdout.endswith("runs/small/report.html\n"), r)
m = check_page("sweep", path("runs/small/report.html"), 0, len(os.listdir(path("runs/small/report_figures"))))
text = m["text"] if m else ""
days = set()
for zone in ("UTC-14", "UTC+12"):  # at any time one of them has another day than UTC
    r = harness.run(report, "sweep", "runs/small", "-o", "zone.html", "--force", env={**os.environ, "TZ": zone})
    days.add(opening(content("zone.html"))["identity"].split(" · ")[0])
check("sweep: its day is that of UTC, as on other pages", days == {day_of(path("runs/small/results.csv"))}, days)
statistics = json.loads(content("runs/small/statistics.json"))
heat = statistics["outputs"]["heat_J"]
said = verdict("runs/small/report.html")
numbers = [float(x) for x in re.findall(r"-?\d+\.\d+", said)]
check(
    "sweep: the verdict has mean and interval of the first output",
    all(
        abs(shown - true) <= 0.05 * (heat["mean"]["confidence_95"][1] - heat["mean"]["confidence_95"][0])
        for shown, true in zip(numbers, [heat["mean"]["value"], *heat["mean"]["confidence_95"]])
    )
    and "over 40 runs" in said,
    (said, heat["mean"]),
)
largest = max(heat["rank_correlations"].items(), key=lambda x: abs(x[1]["value"]))
check(
    "sweep: the verdict names what matters most",
    f"of the factors, {largest[0]} matters most (rank correlation {largest[1]['value']:.2f}, 95 %" in said,
    (said, largest),
)
first = opening(content("runs/small/report.html"))
check(
    "sweep: a light with its rule, and what to do",
    first["light"] == "Green" and first["rule"].startswith("red when runs failed") and largest[0] in first["action"],
    first,
)
check(
    "sweep: its figures have names in words",
    said.startswith("The mean of friction heat is") and "mean of heat_J" not in text,
    said,
)
headings = re.findall(r"<h3>(.*?)</h3>|<text[^>]*>(.*?)</text>", content("runs/small/report.html"), re.S)
raw = [h for both in headings for h in both if "heat_J" in h or "max_abs" in h or "temperature_degC.end" in h]
check("sweep: no heading and no figure has an output's expression", headings and not raw, raw[:3])
check("sweep: no folder of this machine", harness.work not in content("runs/small/report.html"))
sweep_numbers.hold(
    content("runs/small/report.html"),
    check,
    path("runs/small"),
    "runs/small",
    {
        "heat_J": ("friction heat", "J"),
        "joints.hinge.temperature_degC.end": ("temperature of hinge at the end", "°C"),
        "max_abs(hinge.friction_nm)": ("largest friction of hinge", "Nm"),
    },
)
for what in (
    "Sweep small",
    "a pendulum & <its> friction",
    "Sobol' sequence, seed 3",
    "MuJoCo",
    "temperature of hinge at the end [°C]",
    "largest friction of hinge [Nm]",
    "largest friction of hinge is max_abs(hinge.friction_nm).",
    "Over time",
    *statistics["notes"],
):
    check(f"sweep: the page says {what[:40]!r}", what in text)

rows = list(csv.DictReader(open(path("runs", "small", "results.csv"))))
worst = max(rows, key=lambda row: float(row["heat_J"]))
line = re.search(r"largest friction heat\t(\d+)\t([\d.]+) J", text)
check(
    "sweep: the worst run is that of the table",
    line and line[1] == worst["run"] and abs(float(line[2]) / float(worst["heat_J"]) - 1) < 0.05,
    (line, worst),
)
command = next((c for c in text.splitlines() if f"--run {worst['run']} " in c), "")
r = harness.run(*([twin] + shlex.split(command)[1:] + ["--quiet"])) if command else None
folder = shlex.split(command)[-1] if command else ""
check(
    "sweep: the page's command repeats the worst run, to the bit",
    r and r.returncode == 0 and json.loads(content(folder + "/summary.json"))["heat_J"] == float(worst["heat_J"]),
    (command, r),
)

# A run is repeated only while its scenario is what it was.
before = content("scenario.yaml")
write("scenario.yaml", before.replace("speed_rad_s: 2", "speed_rad_s: 1.9"))
r = run(twin, "sweep", "runs/small/campaign.yaml", "--run", "1", "-o", "runs/changed")
check_refused("a changed scenario", r, ["resolved_scenario", "scenario.yaml", "has changed since"], 2, lines=None)
r = run(report, "sweep", "runs/small")
check("a finished sweep needs its folder alone", r.returncode == 0, r.stderr)
write("scenario.yaml", before)
write("top.yaml", PLAN + "runs: 7\n")
r = run(twin, "sweep", "top.yaml", "-o", "runs/top")
check_refused("a plan does not take what only campaign.yaml has", r, ["runs"], 2, lines=None)

# A campaign.yaml that somebody has edited.
shutil.copytree(path("runs/small"), path("runs/edited"))
for old, new, says in (
    (r"\nruns: \d+", "\nruns: many", "runs"),
    (r"\nscenario: .*", "\nscenario: [1]", "scenario"),
    (r"seed: \d+}", "seed: {a: 1}}", "seed"),
):
    edited, count = re.subn(old, new, content("runs/small/campaign.yaml"), count=1)
    write("runs/edited/campaign.yaml", edited)
    r = run(report, "sweep", "runs/edited")
    check_refused(f"campaign.yaml with a wrong {says}", r, ["runs/edited/campaign.yaml:", says], 2, lines=None)
    check(f"and {says} was one", count == 1)

# Unfinished: as a kill leaves it, with a hole.
shutil.copytree(path("runs/small"), path("runs/part"))
for name in ("results.csv", "results.h5", "statistics.json", "bands.csv"):
    os.remove(path("runs/part", name))
for n in (3, *range(30, 40)):
    os.remove(path("runs/part/runs", f"{n:07}.json"))
r = run(report, "sweep", "runs/part")
check("unfinished: exit 0 and a note", r.returncode == 0 and "29 of 40 runs are there" in r.stderr, r)
said = verdict("runs/part/report.html")
check("unfinished: the verdict says so", said.startswith("Unfinished: 29 of 40 runs are there"), said)
there = [float(row["heat_J"]) for row in rows if int(row["run"]) < 30 and row["run"] != "3"]
numbers = [float(x) for x in re.findall(r"-?\d+\.\d+", said)]
check(
    "unfinished: the mean is of what is there", abs(numbers[0] / (sum(there) / 29) - 1) < 2e-3, (said, sum(there) / 29)
)
m = check_page("unfinished", path("runs/part/report.html"), 0, 19, widths=(1100,))
r = run(twin, "sweep", "runs/part/campaign.yaml", "-o", "runs/part", "--quiet")
check(
    "unfinished: the page's command ends it with the same results",
    r.returncode == 0 and content("runs/part/results.csv") == content("runs/small/results.csv"),
    r.stderr,
)
for name in glob.glob(path("runs/part/runs/*")) + [
    path("runs/part", n) for n in ("results.csv", "statistics.json", "report.html")
]:
    os.remove(name)
check_refused("no run yet", run(report, "sweep", "runs/part"), ["has none of its 40 runs yet"], 2, lines=None)
check_refused("no sweep", run(report, "sweep", "."), ["holds no sweep"], 2, lines=None)
check_refused(
    "no folder", run(report, "sweep", "nowhere", "-o", "x.html"), ["nowhere", "holds no sweep"], 2, lines=None
)
shutil.copytree(path("runs/small"), path("runs/torn"))
write("runs/torn/results.csv", content("runs/small/results.csv")[:-40])
check_refused("a torn table", run(report, "sweep", "runs/torn"), ["results.csv:41", "cells"], 2, lines=None)
write("runs/torn/results.csv", content("runs/small/results.csv"))
write("runs/torn/statistics.json", "{}")
check_refused("torn statistics", run(report, "sweep", "runs/torn"), ["statistics.json"], 2, lines=None)
for keys, value, says in (
    (("stopped",), 1, "stopped: must be a text"),
    (("notes",), {}, "notes: must be a list"),
    (("outputs", "heat_J", "count"), "many", "count: must be a number"),
    (("outputs", "heat_J", "mean"), {}, "mean: has no 'value'"),
    (("outputs", "heat_J", "mean", "confidence_95"), [1], "confidence_95: has 1 entries but must have 2"),
    (("outputs", "heat_J", "quantiles"), [1], "quantiles 1: has no 'probability'"),
    (("outputs", "heat_J", "rank_correlations"), {"a": 1}, "rank_correlations: a: has no 'value'"),
):
    changed = json.loads(content("runs/small/statistics.json"))
    place = changed
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    write("runs/torn/statistics.json", json.dumps(changed))
    r = run(report, "sweep", "runs/torn")
    check_refused(f"statistics.json: {says}", r, ["runs/torn/statistics.json: ", says], 2, lines=None)

# A grid with words, runs that fail, indices.
write("other.xml", PENDULUM.replace('"0.03"', '"0.04"'))
write(
    "grid.yaml",
    "scenario: scenario.yaml\nset: {duration_s: 0.5}\n"
    "factors: {temperature_degC: [20, 30, 40], model: [pendulum.xml, other.xml]}\n"
    "design: {type: grid}\noutputs: {heat: heat_J}\n",
)
r = run(twin, "sweep", "grid.yaml", "-o", "runs/grid", "--quiet")
r = run(report, "sweep", "runs/grid")
m = check_page("grid", path("runs/grid/report.html"), 0, 4, widths=(1100,))
check(
    "grid: total Sobol' index, no interval",
    m and "total Sobol' index" in m["text"] and "Each cell is one run" in m["text"],
)
sweep_numbers.hold_grid(
    content("runs/grid/report.html"), check, path("runs/grid"), "runs/grid", {"heat": ("heat", "J")}
)
write(
    "plane.yaml",
    "scenario: scenario.yaml\nset: {duration_s: 1}\nfactors:\n  drives.hinge.Fc0: [0.02, 0.03, 0.04, 0.05]\n"
    "  motion.speed_rad_s: [1, 1.5, 2]\ndesign: {type: grid}\noutputs: [heat_J, max_abs(hinge.friction_nm)]\n"
    "bands: {telemetry: [hinge.friction_nm], times: 11}\n",
)
run(twin, "sweep", "plane.yaml", "-o", "runs/plane", "--quiet")
run(report, "sweep", "runs/plane")
sweep_numbers.hold_grid(
    content("runs/plane/report.html"),
    check,
    path("runs/plane"),
    "runs/plane",
    {"heat_J": ("friction heat", "J"), "max_abs(hinge.friction_nm)": ("largest friction of hinge", "Nm")},
)
write("wide.yaml", PLAN.replace("[0.03, 0.002]", "[0.01, 0.02]").replace("type: sobol", "type: random"))
run(twin, "sweep", "wide.yaml", "-o", "runs/wide", "--quiet")
failed = [row for row in csv.DictReader(open(path("runs", "wide", "results.csv"))) if row["status"] == "failed"]
r = run(report, "sweep", "runs/wide")
m = check_page("failed runs", path("runs/wide/report.html"), 0, 19, widths=(1100,))
check(
    "failed runs: how many, why, and the first one again",
    m
    and f"{len(failed)} runs failed." in verdict("runs/wide/report.html")
    and in_print(failed[0]["message"].split(": ", 1)[1]) in m["text"]
    and f"{len(failed)} of 40\t" in m["text"]
    and f"--run {failed[0]['run']} " in m["text"],
    (len(failed), m and m["text"][-3000:]),
)
write("indices.yaml", PLAN.replace("runs: 40, seed: 3", "runs: 64, indices: true"))
run(twin, "sweep", "indices.yaml", "-o", "runs/indices", "--quiet")
r = run(report, "sweep", "runs/indices")
m = check_page("indices", path("runs/indices/report.html"), 0, 19, widths=(1100,))
check("indices: of the independent runs", "the 32 runs that are independent" in verdict("runs/indices/report.html"))

# A time that is 0 in most runs: its quadratic explains 92 % of the variance and is 9 % of its span below 0.
write(
    "corner.yaml",
    """scenario: scenario.yaml
set: {duration_s: 1}
factors:
  temperature_degC: {uniform: [20, 60]}
  drives.hinge.Fc0: {uniform: [0.02, 0.1]}
design: {type: sobol, runs: 64, seed: 3}
outputs: ["time_above(hinge.friction_nm, 0.12)", "time_above(hinge.friction_nm, 0.136)"]
""",
)
run(twin, "sweep", "corner.yaml", "-o", "runs/corner", "--quiet")
run(report, "sweep", "runs/corner", "-o", "corner.html")
drawn = set(re.findall(r"friction[^<]*?(0\.1\d+)[^<]*, quadratic<", content("corner.html")))
check("sweep: no surface of a time that goes below zero, but of one that hardly does", drawn == {"0.12"}, drawn)

# One run is said as one.
write(
    "single.yaml",
    "scenario: scenario.yaml\nset: {duration_s: 1}\nfactors: {temperature_degC: [20]}\n"
    "design: {type: grid}\noutputs: [heat_J]\n",
)
run(twin, "sweep", "single.yaml", "-o", "runs/single", "--quiet")
run(report, "sweep", "runs/single", "-o", "single.html")
check(
    "sweep of one run", verdict("single.html").startswith("In the only run friction heat is "), verdict("single.html")
)
tiles = opening(content("single.html"))["tiles"]
check("sweep of one output: three tiles", len(tiles) == 3 and "factors\n1\n" in text_of(content("single.html")), tiles)
run(report, "sweep", "runs/single", "-o", "named.html", "--robot", "arm 3", "--serial-number", "77-2")
made = opening(content("named.html"))["identity"]
check("sweep of a robot that the user names", made.startswith("arm 3 · serial number 77-2 · "), made)

# ---- Fleets.
plant = Plant(20)
plant.write(path("healthy.csv"), 14)
week = plant.rows(7, {("R0003", "joint2"): 0.2})
write("week.csv", "\n".join([HEADER] + [row for row in week if not row.startswith("R0005,joint3")]) + "\n")
run(twin, "fleet", "learn", "healthy.csv", "-o", "plant.db", "--quiet")
told = json.loads(run(twin, "fleet", "check", "week.csv", "-o", "plant.db", "--json").stdout)
since = json.loads(run(twin, "fleet", "watch", "-o", "plant.db", "--json").stdout)["joints"][0]["since"]
stored = content("plant.db", "rb")
r = run(report, "fleet", "plant.db")
check("fleet: the page is beside the store", r.returncode == 0 and r.stdout == "plant.html\n", r)
check("fleet: the store is as it was", content("plant.db", "rb") == stored)
m = check_page("fleet", path("plant.html"), 0, 4)
text, said, first = m["text"] if m else "", verdict("plant.html"), told["joints"][0]
for what in (
    f"1 of {told['judged']} joints needs a look",
    f"{first['robot']} {first['joint']}",
    f"friction {100 * first['friction_change']:+.1f} %",
    "looks like wear (confidence > 99 %)",
    f"since {since}",
    "1 joint has no verdict",
):
    check(f"fleet: the verdict says {what!r}", what in said, said)
beginning = opening(content("plant.html"))
check(
    "fleet: red, with the rate of false discoveries and what to do with the first joint",
    beginning["light"] == "Red"
    and "False-discovery rate 5 %" in beginning["rule"]
    and beginning["action"] == f"{first['robot']} {first['joint']}: {first['advice']}.",
    beginning,
)
check(
    "fleet: the plant and the list say the same of a listed joint",
    f"{100 * first['friction_change']:.1f}" in re.findall(r">(-?\d+\.\d)</tspan>", content("plant.html")),
    re.findall(r">(-?\d+\.\d)</tspan>", content("plant.html"))[:10],
)
check(
    "fleet: margin and advice are those of fleet check",
    "{value:.3f} ({low:.3f} … {high:.3f})".format(**first["margin"]) in text and first["advice"] in text,
    (first, text[:2000]),
)
fleet_numbers.hold(content("plant.html"), check, path("plant.db"), [{**first, "since": since}])
check("fleet: what was imported", re.search(r"week.csv\t273\t20\t0", text), text[-1500:])
check("fleet: earlier checks", re.search(rf"{told['date']}\tcheck\t39\t1\t5 %", text), text[-1500:])

r = run(report, "fleet", "plant.db", "-o", "before.html", "--date", "2026-03-15", "--days", "1", "--first", "0")
m = check_page("fleet, first day", path("before.html"), 0, 1, widths=(1100,))
check("fleet: the day that is judged", m and "the day to 2026-03-15" in m["text"], m and m["text"][:800])
write("good.csv", "\n".join([HEADER] + [row for row in week if not row.startswith("R0003")]) + "\n")
run(twin, "fleet", "learn", "healthy.csv", "-o", "good.db", "--quiet")
check_refused(
    "nothing to judge", run(report, "fleet", "good.db"), ["good.db", "no observation to judge"], 2, lines=None
)
run(twin, "fleet", "check", "good.csv", "-o", "good.db", "--quiet")
r = run(report, "fleet", "good.db")
m = check_page("fleet without a listed joint", path("good.html"), 0, 1, widths=(1100,))
check(
    "nothing listed is said", verdict("good.html").startswith("None of 38 joints needs a look."), verdict("good.html")
)

# Listed joints of several robots.
worn = Plant(20)
worn.write(path("healthy_too.csv"), 14)
week = worn.rows(7, {("R0003", "joint2"): 0.2, ("R0007", "joint3"): 0.15, ("R0011", "joint2"): 0.3})
write("worn.csv", "\n".join([HEADER] + [row for row in week if not row.startswith("R0005,joint3")]) + "\n")
run(twin, "fleet", "learn", "healthy_too.csv", "-o", "worn.db", "--quiet")
told = json.loads(run(twin, "fleet", "check", "worn.csv", "-o", "worn.db", "--json").stdout)["joints"]
watched = json.loads(run(twin, "fleet", "watch", "-o", "worn.db", "--json").stdout)["joints"]
since = {(j["robot"], j["joint"]): j["since"] for j in watched}
check("fleet: three are listed, by check and by watch", len(told) == 3 and len(since) == 3, (told, watched))
run(report, "fleet", "worn.db")
found = [{**j, "since": since.get((j["robot"], j["joint"]))} for j in told]
fleet_numbers.hold(content("worn.html"), check, path("worn.db"), found)

# A joint that was worn for six days and mended: of the last day alone check lists it not, but its chart remembers.
mended = Plant(12, seed=4)
mended.write(path("healthy_before.csv"), 14)
week = mended.rows(6, {("R0002", "joint2"): 0.12, ("R0005", "joint3"): 0.2})
week += mended.rows(1, {("R0005", "joint3"): 0.2, ("R0008", "joint2"): 0.09})
write("mended.csv", "\n".join([HEADER] + week) + "\n")
run(twin, "fleet", "learn", "healthy_before.csv", "-o", "mended.db", "--quiet")
names = lambda r: {(j["robot"], j["joint"]) for j in json.loads(r.stdout)["joints"]}
by_check = names(run(twin, "fleet", "check", "mended.csv", "-o", "mended.db", "--days", "1", "--json"))
by_watch = names(run(twin, "fleet", "watch", "-o", "mended.db", "--json"))
check("fleet: one joint is listed by watch alone", by_watch - by_check == {("R0002", "joint2")}, (by_check, by_watch))
run(report, "fleet", "mended.db", "--days", "1")
read = text_of(content("mended.html"))
check(
    "fleet: how many are on which list is said",
    f"{len(by_check & by_watch)} on both lists, {len(by_check - by_watch)} on that of check alone, 1 on that of watch "
    "alone." in read,
    read[:3000],
)
of_joint = {name: read.split(f". {' '.join(name)}\n")[1].split("\n")[0] for name in by_check | by_watch}
check(
    "fleet: a joint of one list says which",
    {name for name, said in of_joint.items() if "Listed by watch alone: its mean over the last day does not" in said}
    == by_watch - by_check
    and not any("check alone" in said for name, said in of_joint.items() if name in by_watch),
    of_joint,
)

# More joints than have room: the one that is listed is not among those left out.
many = Plant(8, [f"joint{k}" for k in range(1, 15)])  # joint9 is the last by name
many.write(path("many.csv"), 14)
many.write(path("many_week.csv"), 7, {("R0003", "joint9"): 0.2})
run(twin, "fleet", "learn", "many.csv", "-o", "many.db", "--quiet")
run(twin, "fleet", "check", "many_week.csv", "-o", "many.db", "--quiet")
r = run(report, "fleet", "many.db")
check("fleet of many joints: its page", r.returncode == 0 and verdict("many.html").startswith("1 of 112 "), r.stderr)
plan = next(svg for svg in re.findall("<svg.*?</svg>", content("many.html"), re.S) if "change of Fc" in svg)
columns = {name for name in re.findall(r">(joint\d+)<", plan)}
check("fleet of many joints: the listed one is shown", len(columns) == 12 and "joint9" in columns, columns)
check(
    "fleet of many joints: what is left out is said",
    "12 of 14 joints, 2 left out: those that are listed on a robot first." in content("many.html"),
)

db = sqlite3.connect(path("good.db"))
db.execute("DELETE FROM models WHERE joint = 'joint3'")
db.commit()
r = run(report, "fleet", "good.db", "-o", "half.html")
check("joints without a model: said", "no healthy curves of their type were learned" in content("half.html"), r)
db.execute("DELETE FROM models")
db.commit()
db.close()
check_refused(
    "no model at all", run(report, "fleet", "good.db"), ["holds no healthy state", "fleet learn"], 2, lines=None
)
write("empty.db", "")
check_refused("an empty file", run(report, "fleet", "empty.db"), ["empty.db", "is empty"], 2, lines=None)
check_refused("no file", run(report, "fleet", "no.db"), ["no.db", "there is no such file"], 2, lines=None)
check_refused("a fleet is no robot", run(report, "fleet", "plant.db", "--robot", "arm 3"), ["--robot"], 2, lines=None)
check("no file is made", not os.path.exists(path("no.db")))
check_refused("another file", run(report, "fleet", "week.csv"), ["week.csv", "is no store"], 2, lines=None)
check_refused("a wrong day", run(report, "fleet", "plant.db", "--date", "May"), ["--date May"], 2, lines=None)
finish()
