"""tribotwin lab for robots over working days, short ones, and its page. A day takes half a minute, so campaigns that
differ from the first in other days or robots go on from its days. Arguments: tribotwin, source tree[,
tribotwin-report]."""
import csv, os, re, shutil, sys
from statistics import NormalDist

import numpy as np

import harness
from harness import check, check_refused, finish, work

program, source = sys.argv[1:3]
report = sys.argv[3] if len(sys.argv) > 3 else None


def run(*arguments, which=program):
    return harness.run(which, *arguments, timeout=500)


def refused(name, says, *arguments, which=program, code=2):
    check_refused(name, run(*arguments, which=which), says, code)


def table(name):
    return list(csv.DictReader(open(f"{work}/days/{name}.csv")))


def go_on_from_days(folder, *changes, without=()):
    """The campaign of days/ with other settings: a folder that holds its tests, but for those that come out otherwise.
    A day depends on its robot, on its number and on the faults of its robot up to then, not on how many there are."""
    shutil.copytree(f"{work}/days/tests", f"{work}/{folder}/tests")
    for name in ("campaign.yaml", "checksums", "motion.csv"):
        shutil.copy(f"{work}/days/{name}", f"{work}/{folder}/{name}")
    for name in without:
        os.remove(f"{work}/{folder}/tests/{name}.json")
    campaign = open(f"{work}/{folder}/campaign.yaml").read()
    for old, new in changes:
        check(f"{folder}: its campaign has '{old}'", campaign.count(old) == 1, campaign)
        campaign = campaign.replace(old, new)
    with open(f"{work}/{folder}/campaign.yaml", "w") as f:
        f.write(campaign)


CAMPAIGN = f"""
description: Two days, on the second of which joint3 breaks
procedure: working_days
model: {source}/mjcf/er3a_c60.xml
robots: 1
days: 2
duration_s: 530
ambient: {{mean_degC: 20, std_K: 1}}
scatter: {{friction: 0.08, inertia: 0.02}}
sensors: {{encoder_increments_per_turn: 6.5e6, torque_noise_share: 0.01}}
excitation: {{evaluations: 60, heating_s: 10}}
faults:
  - {{robot: 1, day: 2, time_s: 262, joint: joint3, factors: {{f1: 1.4}}}}
"""
open(f"{work}/days.yaml", "w").write(CAMPAIGN)

r = run("lab", "days.yaml", "-o", "days")
check("exits 0", r.returncode == 0, r.stderr)
check(
    "says what it did",
    "2 tests, 0 of them from earlier runs" in r.stdout
    and "change: robot 1, test 2, cycle 2" in r.stdout
    and "joint3" in r.stdout,
    r.stdout,
)
check("a day too short for time constants says so", "*: not identifiable from this record" in r.stdout, r.stdout)
first = {
    name: open(f"{work}/days/{name}.csv", "rb").read() for name in ("time_constants", "inertial", "friction", "changes")
}

changes = table("changes")
check(
    "the broken joint is the change, from the cycle in which it broke",
    {(c["test"], c["joint"], c["cycle"]) for c in changes} == {("2", "joint3", "2")},
    changes,
)
f1 = {(f["test"], f["cycle"], f["joint"]): float(f["f1"]) for f in table("friction") if f["f1"]}
check(
    "it shows as a jump of f1",
    f1["2", "2", "joint3"] > 1.2 * f1["2", "1", "joint3"] and f1["1", "2", "joint3"] < 1.1 * f1["1", "1", "joint3"],
    f1,
)
times = table("time_constants")
check(
    "each test and all merged, per joint",
    {t["test"] for t in times} == {"1", "2", "mix"} and len({t["joint"] for t in times}) == 6,
)
identifiable = [t for t in times if t["identifiable"] == "yes" and t["test"] == "mix"]
check(
    "merged time constants that are identifiable are as far off as their sigmas say, or 10 %",
    all(
        abs(float(t["value_s"]) - float(t["of_robot_s"])) < max(4 * float(t["sigma_s"]), 0.1 * float(t["of_robot_s"]))
        for t in identifiable
    ),
    identifiable,
)
inertial = [i for i in table("inertial") if i["test"] == "1" and i["sigma"]]
z = np.array([(float(i["value"]) - float(i["of_robot"])) / float(i["sigma"]) for i in inertial])
check(
    "inertial parameters of each cycle and of the day are as far off as their sigmas say",
    len(z) == 3 * 40 and np.abs(z).max() < 4.5 and 0.6 < np.sqrt(np.mean(z**2)) < 1.4,
    (np.abs(z).max(), np.sqrt(np.mean(z**2))),
)
names = {i["of_robot"] for i in inertial if i["parameter"] == "joint6.Ia"}
check("the robot is no other robot's copy", len(names) == 1 and abs(float(names.pop()) / 0.02 - 1) > 1e-4)

# ---- What is there is kept, what is broken off is done again.
open(f"{work}/days/tests/robot1_day2.json", "w").write('{"ambient_degC": 20, "cyc')
os.remove(f"{work}/days/changes.csv")
r = run("lab", "days.yaml", "-o", "days", "--threads", 2)
check("goes on", r.returncode == 0 and "2 tests, 1 of them from earlier runs" in r.stdout, (r.stdout, r.stderr))
check("the same bytes", all(open(f"{work}/days/{name}.csv", "rb").read() == text for name, text in first.items()))

refused("another campaign in the folder", "another campaign", "lab", "days.yaml", "-o", "days", "--set", "seed=2")
for name, setting, says in (
    ("no such joint", "faults.0.joint=joint7", "did you mean"),
    ("no such parameter", "faults.0.factors={f9: 2}", "no parameter of law 'polynomial'"),
    ("a day that is not", "faults.0.day=3", "faults[0].day"),
    ("an unknown key", "roboters=3", "robots"),
    ("half a robot", "robots=1.5", "whole number"),
    ("a model with another law", f"model={source}/mjcf/irb6620.xml", "polynomial"),
    ("kelvins", "ambient.mean_degC=293", "mean_degC"),
):
    refused(name, says, "lab", "days.yaml", "-o", "other", "--set", setting)
refused(
    "shorter than a cycle",
    "one cycle of the motion",
    "lab",
    "days.yaml",
    "-o",
    "other",
    "--set",
    "duration_s=90",
    "--set",
    "faults=[]",
)
check("nothing half-written", not os.path.exists(f"{work}/other"))

# ---- A joint that breaks after the last friction of its day: nothing is found, and nobody is told that all is well.
go_on_from_days("late", ("time_s: 262", "time_s: 420"), without=["robot1_day2"])
r = run("lab", "days.yaml", "-o", "late", "--set", "faults.0.time_s=420")
late = re.search(r"A change of ([\d.]+) % from one cycle to the next is seen in 95 % of cases \((joint\d);", r.stdout)
check(
    "a late break: no change, and which one would have been seen until when",
    r.returncode == 0
    and "2 tests, 1 of them from earlier runs" in r.stdout
    and "0 of 6 comparisons" in r.stdout
    and late
    and "after 4.2 of a day's 8.8 min" in r.stdout,
    r.stdout,
)
level = list(csv.DictReader(open(f"{work}/late/friction.csv")))
sigma = {}
for joint in {f["joint"] for f in level}:
    cycles = [f for f in level if f["joint"] == joint and f["cycle"] != "all"]
    relative = [float(f["level_sigma_nm"]) / float(f["level_nm"]) for f in cycles]
    sigma[joint] = np.sqrt(np.sum(np.square(relative)))  # two steps, each of two cycles
least = max(sigma, key=sigma.get)
smallest = 100 * np.expm1((NormalDist().inv_cdf(1 - 0.005 / 6) + NormalDist().inv_cdf(0.95)) * sigma[least])
check(
    "a late break: that change is the sigma of the least certain comparison",
    late and late[2] == least and abs(float(late[1]) / smallest - 1) < 0.01,
    (late and late.groups(), sigma, smallest),
)

if report:
    sys.path.insert(0, os.path.join(source, "tests", "render", "report"))
    from browser import Browser, opening
    import days_numbers

    r = run("days", "late", "--quiet", which=report)
    said = opening(open(f"{work}/late/report.html").read())
    check(
        "page of a late break: amber, with the smallest change that is seen, and what to do",
        said["light"] == "Amber"
        and late
        and f"A change of {late[1]} %" in said["verdict"]
        and "after 4.2 of a day's 8.8 min" in said["verdict"]
        and "longer days" in said["action"],
        said,
    )
    days_numbers.hold(open(f"{work}/late/report.html").read(), check, f"{work}/late", source, "mjcf/er3a_c60.xml")
    r = run("days", "days", which=report)
    check("page", r.returncode == 0 and r.stdout.strip() == "days/report.html", (r.stdout, r.stderr))
    page = open(f"{work}/days/report.html").read()
    said = opening(page)
    check(
        "page: verdict before all sentences, of the robot that the model names",
        page.index('id="verdict"') < page.index("Two days") and said["identity"].startswith("EFORT ER3A-C60 ·"),
        said,
    )
    days_numbers.hold(page, check, f"{work}/days", source, "mjcf/er3a_c60.xml")
    # Two robots over three days: a day after a change is compared with those before it, of this robot alone.
    go_on_from_days("plant", ("robots: 1", "robots: 2"), ("days: 2", "days: 3"))
    r = run("lab", "days.yaml", "-o", "plant", "--set", "robots=2", "--set", "days=3")
    check(
        "two robots over three days",
        r.returncode == 0 and "6 tests, 2 of them from earlier runs" in r.stdout,
        (r.stdout, r.stderr),
    )
    r = run("days", "plant", "--quiet", which=report)
    check("their page", r.returncode == 0, r.stderr)
    days_numbers.hold(open(f"{work}/plant/report.html").read(), check, f"{work}/plant", source, "mjcf/er3a_c60.xml")
    campaign = open(f"{work}/days/campaign.yaml").read()
    with open(f"{work}/days/campaign.yaml", "w") as f:
        f.write(re.sub(r"^# MuJoCo [^,]*,", "# MuJoCo 1.9.9,", campaign))
    run("days", "days", "-o", "older.html", which=report)
    older = open(f"{work}/older.html").read()
    made = opening(older)["identity"]
    check(
        "page: the engine is the one that simulated the days",
        "page made with tribotwin " in made
        and made.endswith(" · simulated by MuJoCo 1.9.9")
        and "# MuJoCo 1.9.9, model" in older,
        made,
    )
    with open(f"{work}/days/campaign.yaml", "w") as f:
        f.write(campaign)
    Browser(work, check).check_page("days", f"{work}/days/report.html", 0, 6 + 6 + 2 + 6)
    for what in (
        "friction of joint3 changed",
        "Time constants",
        "not identifiable from this record",
        "Friction over the day",
        "Torque, cold and hot",
        "Inertial parameters over the tests",
        "Base parameters",
    ):
        check("page: " + what, what in page)
    check("page: figures", page.count("<svg") == 6 + 6 + 2 + 6, page.count("<svg"))
    os.remove(f"{work}/days/tests/robot1_day1.json")
    refused(
        "page of an unfinished campaign", "robot1_day1.json: is missing", "days", "days", "-o", "x.html", which=report
    )
    refused("page of no campaign", "campaign.yaml", "days", ".", "-o", "x.html", which=report)
    check("nothing half-written by the page", not os.path.exists(f"{work}/x.html"))

finish()
