"""tribotwin-report dynamics: the page in a real browser, its numbers against those of tribotwin predict, a law that
does not explain a joint, files that are gone, wrong input. Arguments: tribotwin, tribotwin-report."""
import json, os, re, sys

import numpy as np

from browser import Browser, opening
import harness
from harness import check, check_refused, content, finish, path, work
from pendulum import PENDULUM

twin, report = sys.argv[1:3]
page_of = Browser(work, check).check_page
with open(path("robot.xml"), "w") as f:
    f.write(PENDULUM)


def run(program, *arguments):
    return harness.run(program, *arguments, "--force")


def recording(name, seed, speed, by_position=0.0):
    """The pendulum at up to `speed`, 60 s: inertia, gravity, Coulomb and viscous friction, 0.05 Nm of noise, and a
    torque that depends on the position, which no law has."""
    time_s = np.arange(0, 60, 0.005)
    phase = 2 * np.pi * np.array([0.21, 0.37])[:, None] * time_s
    q = np.array([0.9, 0.35]) @ np.sin(phase) * speed
    qd, qdd = np.gradient(q, time_s), np.gradient(np.gradient(q, time_s), time_s)
    torque = 1.5 * qdd + 6 * np.sin(q) + 1.2 * np.sign(qd) + 0.4 * qd + by_position * np.sin(9 * q)
    torque += np.random.default_rng(seed).normal(0, 0.05, time_s.size)
    np.savetxt(
        path(name),
        np.column_stack([time_s, q, torque]),
        delimiter=",",
        header="time_s,position_hinge_rad,torque_hinge_nm",
        comments="",
    )


def predicted(data):
    r = run(twin, "predict", "robot.xml", "robot.yaml", data, "-o", "predicted.csv", "--json", "--quiet")
    with open(path("predicted.json"), "w") as f:
        f.write(r.stdout)
    return json.loads(r.stdout)


def rows(text, first):
    cells = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.S) for row in re.findall(r"<tr>(.*?)</tr>", text, re.S)]
    return [c for c in cells if c and c[0] == first]


def percent(share):
    return f"{100 * share:.{1 if share < 0.1 else 0}f} %"


recording("monday.csv", 1, 1.0)
recording("tuesday.csv", 2, 0.9)
recording("ripple.csv", 3, 0.9, by_position=6)
r = run(twin, "dynamics", "robot.xml", "monday.csv", "--friction", "coulomb_viscous", "-o", "robot.yaml", "--quiet")
check("identified", r.returncode == 0, r.stderr)

p = predicted("tuesday.csv")["joints"]["hinge"]
r = run(report, "dynamics", "predicted.json", "--png")
check("the page is written", r.returncode == 0 and r.stdout.endswith("dynamics.html\n"), r)
shown = page_of("dynamics", path("dynamics.html"), 0, len(os.listdir(path("dynamics_figures"))))
page = content("dynamics.html")
said = opening(page)
check("another day: green, with its rule", said["light"] == "Green" and "30 %" in said["rule"], said)
check(
    "the verdict has the errors of predict",
    f"within {percent(p['relative_to_range'])} of their range" in said["verdict"]
    and f"at most {percent(p['verdict']['of_variation'])}" in said["verdict"],
    (said["verdict"], p["relative_to_range"], p["verdict"]["of_variation"]),
)
row = rows(page, "hinge")[0]
check(
    "the table has the numbers of predict",
    row[1:8]
    == [
        f"{p['rms']:.4g}",
        percent(p["relative_to_range"]),
        f"{p['range']:.4g}",
        f"{p['largest']:.4g}",
        "Nm",
        percent(p["verdict"]["of_variation"]),
        "–",
    ],
    (row, p),
)
friction = {row[2]: row for row in rows(page, "hinge")[1:] if row[1] == "coulomb_viscous"}
check(
    "friction with standard deviations and units, near the truth",
    abs(float(friction["Fc"][3]) - 1.2) < 0.05
    and abs(float(friction["Fv"][3]) - 0.4) < 0.05
    and all(float(friction[k][4]) > 0 and friction[k][5].startswith("Nm") for k in ("Fc", "Fv")),
    friction,
)
with open(path("predicted.csv")) as f:
    head, *lines = f.read().splitlines()
moving = [line.rsplit(",", 1)[1] for line in lines]
check("the table says where the joint moves", head.endswith(",moving_hinge") and set(moving) <= {"0", "1"}, head)
check("as often as predict counts", moving.count("1") == p["samples"], (moving.count("1"), p["samples"]))

# A torque by position that the law does not have.
result = predicted("ripple.csv")
p = result["joints"]["hinge"]
r = run(report, "dynamics", "predicted.json", "-o", "ripple.html")
page = content("ripple.html")
said = opening(page)
check(
    "a joint that is badly explained: red, named, and what would help",
    p["verdict"]["badly_explained"]
    and said["light"] == "Red"
    and "hinge is badly explained" in said["verdict"]
    and result["badly_explained"][0] in re.sub(r"&#?\w+;", "", page),
    (said, result["badly_explained"]),
)
share = p["verdict"]["dependence"]["position"]["share"]
check(
    "what to do names what it depends on most",
    f"hinge below, {percent(share)} of which goes with position" in said["action"],
    said,
)
check(
    "its residual is shown over the position",
    share > 0.3 and f"{percent(share)} of the residual goes with position" in page,
    share,
)

# Without its table and its parameters it says so.
for name in ("predicted.csv", "robot.yaml"):
    os.rename(path(name), path("away_" + name))
r = run(report, "dynamics", "predicted.json", "-o", "alone.html")
check(
    "files that are gone are said",
    r.returncode == 0
    and all(s in content("alone.html") for s in ("No torques are drawn: predicted.csv", "No parameters")),
    r,
)
with open(path("predicted.csv"), "w") as f:
    f.write("time_s,torque_other_nm\n0,1\n")
refused = lambda name, says: check_refused(name, run(report, "dynamics", "predicted.json", "-o", "x.html"), says)
refused("another robot's table", ["predicted.csv", "moving_hinge"])
for name, text in (("no JSON", "{"), ("another JSON", '{"joints": {}}')):
    with open(path("predicted.json"), "w") as f:
        f.write(text)
    refused(name, ["predicted.json: is no JSON of tribotwin predict"])
check("nothing is left of what failed", not os.path.exists(path("x.html")))
finish()
