"""tribotwin-report dynamics: the page in a real browser, its numbers against those of tribotwin predict, a law that
does not explain a joint, files that are gone, wrong input. Arguments: tribotwin, tribotwin-report."""
import html, json, os, re, sys

import numpy as np

from browser import Browser, opening
import dynamics_numbers
import harness
from harness import check, check_refused, content, finish, path, work
from numbers_of_page import percent
from pendulum import PENDULUM

twin, report = sys.argv[1:3]
browser = Browser(work, check)
page_of = browser.check_page
with open(path("robot.xml"), "w") as f:
    f.write(PENDULUM)


def run(program, *arguments):
    return harness.run(program, *arguments, "--force")


def recording(name, seed, speed, by_position=0.0, coulomb=1.2):
    """The pendulum at up to `speed`, 60 s: inertia, gravity, Coulomb and viscous friction, 0.05 Nm of noise, and a
    torque that depends on the position, which no law has."""
    time_s = np.arange(0, 60, 0.005)
    phase = 2 * np.pi * np.array([0.21, 0.37])[:, None] * time_s
    q = np.array([0.9, 0.35]) @ np.sin(phase) * speed
    qd, qdd = np.gradient(q, time_s), np.gradient(np.gradient(q, time_s), time_s)
    torque = 1.5 * qdd + 6 * np.sin(q) + coulomb * np.sign(qd) + 0.4 * qd + by_position * np.sin(9 * q)
    torque += np.random.default_rng(seed).normal(0, 0.05, time_s.size)
    np.savetxt(
        path(name),
        np.column_stack([time_s, q, torque]),
        delimiter=",",
        header="time_s,position_hinge_rad,torque_hinge_nm",
        comments="",
    )


def predicted(data, parameters="robot.yaml", *options):
    r = run(twin, "predict", "robot.xml", parameters, data, "-o", "predicted.csv", "--json", "--quiet", *options)
    with open(path("predicted.json"), "w") as f:
        f.write(r.stdout)
    return json.loads(r.stdout)


def rows(text, first):
    cells = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.S) for row in re.findall(r"<tr>(.*?)</tr>", text, re.S)]
    return [c for c in cells if c and c[0] == first]


def drawn_bands(text):
    """The outlines of the 95 % band and the curve that it is about, of the figure of the torque."""
    data = [json.loads(html.unescape(d)) for d in re.findall(r'data-figure="([^"]*)"', text)]
    series = next(d["series"] for d in data if any(s["label"] == "predicted" for s in d["series"]))
    return [s for s in series if s["mark"] == "band"], next(s for s in series if s["label"] == "predicted")


def hold_numbers(name, *options):
    """Of a page of the last prediction."""
    command = " ".join(["tribotwin-report dynamics predicted.json", *options, "--force"])
    files = [path(f) for f in ("predicted.json", "predicted.csv", "robot.yaml")]
    dynamics_numbers.hold(content(name), check, report, command, files)


recording("monday.csv", 1, 1.0)
recording("tuesday.csv", 2, 0.9)
recording("ripple.csv", 3, 0.9, by_position=6)
recording("worn.csv", 4, 0.9, coulomb=1.25)
r = run(twin, "dynamics", "robot.xml", "monday.csv", "--friction", "coulomb_viscous", "-o", "robot.yaml", "--quiet")
check("identified", r.returncode == 0, r.stderr)

p = predicted("tuesday.csv")["joints"]["hinge"]
r = run(report, "dynamics", "predicted.json", "--png")
check("the page is written", r.returncode == 0 and r.stdout.endswith("dynamics.html\n"), r)
shown = page_of("dynamics", path("dynamics.html"), 0, len(os.listdir(path("dynamics_figures"))))
page = content("dynamics.html")
said = opening(page)
check(
    "another day: green, with its rule",
    said["light"] == "Green" and {"30 %", "90 %"} <= set(re.findall(r"\d+ %", said["rule"])),
    said,
)
check(
    "the verdict has the errors of predict",
    f"to {percent(p['relative_to_range'])} of their range" in said["verdict"]
    and f"{percent(p['verdict']['of_variation'])} of a joint's variation is unexplained" in said["verdict"],
    (said["verdict"], p["relative_to_range"], p["verdict"]["of_variation"]),
)
row = rows(page, "hinge")[0]
check(
    "the table has the numbers of predict",
    row[1:10]
    == [
        f"{p['rms']:.4g}",
        percent(p["relative_to_range"]),
        f"{p['range']:.4g}",
        f"{p['largest']:.4g}",
        f"{p['band']['half_width']:.4g}",
        "Nm",
        percent(p["band"]["share_inside"]),
        percent(p["verdict"]["of_variation"]),
        "–",
    ],
    (row, p),
)
hold_numbers("dynamics.html", "--png")
check(
    "columns of numbers are set right, those of units are not",
    page.count('<th class="number" scope="col">value</th>') == 1 and page.count('<th scope="col">unit</th>') == 2,
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

# The 95 % band.
band = p["band"]
table = np.genfromtxt(path("predicted.csv"), delimiter=",", names=True)
inside = ~np.isnan(table["band_hinge_nm"])
error = np.abs(table["torque_hinge_nm"] - table["predicted_hinge_nm"])[inside]
check(
    "the table has the band where the joint moves in the training",
    set(table["band_hinge_nm"][inside]) == {float(f"{band['half_width']:.9g}")}
    and inside.sum() == band["samples"] > 0.9 * p["samples"]
    and not inside[table["moving_hinge"] == 0].any(),
    (inside.sum(), p),
)
within = {factor: np.mean(error <= factor * band["half_width"]) for factor in (0.5, 1, 2)}
check("the share inside is that of the table", abs(within[1] - band["share_inside"]) < 2 / inside.sum(), within)
check(
    "the band has 95 % of another day's torques; half or twice as wide it would not",
    0.93 < within[1] < 0.97 and within[0.5] < 0.93 and within[2] > 0.97,
    within,
)
bands, middle = drawn_bands(page)
at = dict(zip(middle["x"], middle["y"]))
check(
    "it is drawn about the predicted torque, and said",
    bands[0]["label"] == "95 % band"
    and all(abs(abs(y - at[x]) - band["half_width"]) < 1e-3 for s in bands for x, y in zip(s["x"], s["y"]))
    and sum(len(s["x"]) for s in bands) > len(middle["x"])
    and f"Band: ± {band['half_width']:.4g} Nm about it" in page,
    (bands[0], band),
)
TIP = """(share) => { const svg = document.querySelector('svg.live:not(.sample)'), box = svg.getBoundingClientRect();
  svg.dispatchEvent(new PointerEvent('pointermove', {bubbles: true, pointerType: 'mouse',
    clientX: box.x + share * box.width, clientY: box.y + 0.4 * box.height}));
  return svg.parentElement.querySelector('.tip').innerText; }"""
browser.open(path("dynamics.html"))
browser.tab.until(f"({TIP})(0.5) !== ''")  # the figure's script has begun
tips = [browser.tab.value(f"({TIP})({share})") for share in np.linspace(0.1, 0.9, 17)]
found = [float(half) for tip in tips for half in re.findall(r"predicted \S+ ± (\S+) Nm \(95 %\)", tip)]
check(
    "the pointer says half its width, and no edge of it as a value",
    len(found) > 3
    and all(abs(half / band["half_width"] - 1) < 0.06 for half in found)
    and not any("95 % band" in tip for tip in tips),
    (tips, band),
)
result = predicted("worn.csv")
worn = result["joints"]["hinge"]
r = run(report, "dynamics", "predicted.json", "-o", "worn.html")
said = opening(content("worn.html"))
check(
    "friction that grew: seen by the band, amber",
    worn["band"]["share_inside"] < 0.9
    and not worn["verdict"]["badly_explained"]
    and any("joint hinge: only" in w and "95 % band" in w for w in result["warnings"])
    and said["light"] == "Amber",
    (result["warnings"], worn["band"], said),
)
other = predicted("tuesday.csv", "robot.yaml", "--cutoff", "8")
check("torques with another cut-off have no band", other["joints"]["hinge"]["band"] is None, other["joints"])
with open(path("robot.yaml")) as f, open(path("old.yaml"), "w") as g:
    g.write(re.sub(r"^band:\n(  .*\n)+", "", f.read(), flags=re.M))
other = predicted("tuesday.csv", "old.yaml")
r = run(report, "dynamics", "predicted.json", "-o", "old.html")
check("a page all the same", r.returncode == 0, r)
page = content("old.html")
check(
    "nor have those of a file of an earlier version, and both say so",
    other["joints"]["hinge"]["band"] is None
    and "old.yaml: of an earlier version" in other["bands_lacking"]
    and "have no 95 % band" in page
    and "Band: ±" not in page
    and drawn_bands(page)[0] == [],
    other,
)
for joint in [other["joints"]["hinge"]]:
    del joint["band"], other["bands_lacking"]
with open(path("predicted.json"), "w") as f:
    json.dump(other, f)
with open(path("predicted.csv")) as f:
    columns = [line.rstrip("\n").split(",") for line in f]
with open(path("predicted.csv"), "w") as f:
    f.write("".join(",".join(c[:3] + c[4:]) + "\n" for c in columns))
check("the case is one", columns[0][3] == "band_hinge_nm")
r = run(report, "dynamics", "predicted.json", "-o", "older.html")
check(
    "a prediction of an earlier version has a page without bands",
    r.returncode == 0 and "No 95 % bands are known" in content("older.html"),
    r,
)


# A joint that rests in the middle of the record, or in all of it.
def at_rest(rests, name):
    """The page where the joint rests in samples `rests` of the table."""
    predicted("tuesday.csv")
    with open(path("predicted.csv")) as f:
        head, *lines = f.read().splitlines()
    for i in range(len(lines))[rests]:
        lines[i] = lines[i].rsplit(",", 1)[0] + ",0"
    with open(path("predicted.csv"), "w") as f:
        f.write("\n".join([head, *lines]) + "\n")
    r = run(report, "dynamics", "predicted.json", "-o", name)
    check(f"{name}: a page all the same", r.returncode == 0, r.stderr)
    return content(name) if r.returncode == 0 else ""


check("moving is the last column", head.endswith(",moving_hinge"), head)
page = at_rest(slice(1500, 4500), "rest.html")  # from 15 to 45 s
spans = re.findall(r"hinge: torque, recorded and, while the joint moves, predicted, from ([\d.]+) to ([\d.]+) s", page)
check("it shows where there is a prediction", spans and (float(spans[0][0]) < 15 or float(spans[0][1]) > 45), spans)
page = at_rest(slice(None), "resting.html")
check("or says that there is none", "No torques of hinge are drawn: no sample of the table has a prediction" in page)

# Joints in the order of the robot, not of the alphabet.
result = predicted("tuesday.csv")
result["joints"]["arm"] = {"lacking": "torque not recorded", "unit": "Nm"}
with open(path("predicted.json"), "w") as f:
    json.dump(result, f)
run(report, "dynamics", "predicted.json", "-o", "order.html")
page = content("order.html")
check("joints are in the order of the parameters", 0 < page.index(">hinge<") < page.index(">arm<"))

# A torque by position that the law does not have.
result = predicted("ripple.csv")
p = result["joints"]["hinge"]
r = run(report, "dynamics", "predicted.json", "-o", "ripple.html")
hold_numbers("ripple.html", "-o", "ripple.html")
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
refused("another robot's table", ["predicted.csv", "has no torque_hinge_nm; give the table of the same"])
for name, text in (("no JSON", "{"), ("another JSON", '{"joints": {}}')):
    with open(path("predicted.json"), "w") as f:
        f.write(text)
    refused(name, ["predicted.json: is no JSON of tribotwin predict"])
check("nothing is left of what failed", not os.path.exists(path("x.html")))
finish()
