"""First sentences that once misled: of a run whose motors do no work, of runs whose friction differs in power alone, of
joints that cost little and changed much. Arguments: tribotwin, tribotwin-report."""
import html, json, re, shutil, sys

import h5py
import numpy as np

from browser import opening
from harness import check, content, finish, path, run, work
from numbers_of_page import difference, energy, text_of
from pendulum import PENDULUM, several

twin, report = sys.argv[1:3]


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


write("pendulum.xml", PENDULUM)
write("off.yaml", "model: pendulum.xml\nduration_s: 0.2\ncontrol: {type: torque}\n")
write(
    "on.yaml",
    "model: pendulum.xml\nduration_s: 0.5\n"
    "motion: {type: cycle, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}], speed_rad_s: 2}\n",
)
run(twin, "run", "off.yaml", "-o", "off", "--quiet")
summary = json.loads(content("off/summary.json"))
check("the motors do no work", summary["motor_work_J"] == 0, summary)
run(report, "off", "-o", "off.html", "--quiet")
page = content("off.html")
read = re.sub(r"<(svg|style|script).*?</\1>", "", page, flags=re.S)
check("no share of nothing", not re.search(r"\b(inf|nan)\b", read))
check("a run without heat has no warm-up to predict", not re.search("What if:|Not predicted", read))
check("it is said", "without work of the motors" in opening(page)["verdict"], opening(page))

# Friction that is less power and as large in root mean square: from 5 % on that comes first, and in amber.
run(twin, "run", "on.yaml", "-o", "on", "--quiet")
shutil.copytree(path("on"), path("less"))
summary = json.loads(content("less/summary.json"))
work_J = summary["friction_work_J"]
summary["friction_work_J"] = 0.96 * work_J
write("less/summary.json", json.dumps(summary))
run(report, "on", "less", "-o", "both.html", "--quiet")
said = opening(content("both.html"))
check(
    "a change of friction work is in the first sentence",
    said["verdict"].endswith(", but friction work falls by 4.0 % in less.") and said["light"] == "Green",
    said,
)
shutil.copytree(path("on"), path("least"))
summary["friction_work_J"] = 0.874 * work_J
summary["joints"][0]["friction_nm"]["rms"] *= 0.983
write("least/summary.json", json.dumps(summary))
run(report, "on", "less", "least", "-o", "least.html", "--quiet")
said, page = opening(content("least.html")), text_of(content("least.html"))
check(
    "what matters most comes first",
    said["verdict"].startswith(f"Friction takes 12.6 % less work in least than in on: {energy(work_J)} → ")
    and said["verdict"].endswith("; friction (RMS) of hinge differs by -1.7 % in least.")
    and said["light"] == "Amber"
    and said["rule"].endswith(" Amber, because of friction work in least (-12.6 %)."),
    said,
)
check("tiles say of which runs they are", page.count(", on → least\n") == 4, page[:1500])


# Two joints, of which one does nearly all the work: the other is not overlooked where its friction changes.
write("two.xml", several(["hinge", "wrist"]))
write(
    "two.yaml",
    "model: two.xml\nduration_s: 15\nmotion: {type: cycle, waypoints: [{position_rad: {hinge: -0.5, wrist: -0.1}}, "
    "{position_rad: {hinge: 0.6, wrist: 0.1}}], speed_rad_s: 2}\n",
)
r = run(twin, "run", "two.yaml", "-o", "two", "--quiet")
check("two joints run", r.returncode == 0, r.stderr)


def changed(name, factors, power, rests=None):
    """A copy of the run with other friction (RMS) and other power in the work cycles."""
    shutil.copytree(path("two"), path(name))
    s = json.loads(content(name + "/summary.json"))
    for joint in s["joints"]:
        joint["friction_nm"]["rms"] *= factors.get(joint["name"], 1)
    write(name + "/summary.json", json.dumps(s))
    with h5py.File(path(name, "telemetry.h5"), "r+") as f:
        for joint, factor in power.items():
            f[joint + "/cycle_friction_power_W"][:] *= factor
        if rests:
            f[rests + "/velocity_rad_s"][:] = 0


def compared(*names):
    r = run(report, *names, "-o", "compared.html", "--quiet", "--force")
    check(f"{names} are compared", r.returncode == 0, r.stderr)
    return opening(content("compared.html"))


with h5py.File(path("two/telemetry.h5")) as f:
    check("the run has work cycles", f["cycle_time_s"].size > 1, f["cycle_time_s"].size)
    mean_W = {joint: f[joint + "/cycle_friction_power_W"][:].mean() for joint in ("hinge", "wrist")}
check("the wrist does little of the work", mean_W["wrist"] < 0.25 * mean_W["hinge"], mean_W)
changed("little", {"wrist": 1.2, "hinge": 1.004}, {"hinge": 1.1})
said = compared("two", "little")
check(
    "a joint that costs little and changed much is named, in amber",
    said["verdict"].startswith("wrist has more friction in little than in two: ") and said["light"] == "Amber",
    said,
)
changed("both_changed", {"wrist": 1.2, "hinge": 1.1}, {"hinge": 1.1, "wrist": 1.05})
said = compared("two", "both_changed")
check(
    "beside one that costs more it is named, too",
    said["verdict"].startswith("hinge has more friction in both_changed than in two: ")
    and said["verdict"].endswith("; wrist +20.0 % with a smaller change of power."),
    said,
)
changed("third", {"wrist": 0.9, "hinge": 1.02}, {"hinge": 1.02, "wrist": 0.99})
said = compared("two", "third")
check(
    "amber for a joint that is not the first named",
    said["light"] == "Amber" and said["verdict"].endswith("; wrist -10.0 % with a smaller change of power."),
    said,
)
changed("cycles", {"wrist": 1.06, "hinge": 1.06}, {"wrist": 30})
said = compared("two", "cycles")
check(
    "power is that of the work cycles, whichever have samples",
    said["verdict"].startswith("wrist has more friction in cycles than in two: "),
    said,
)
# A joint that rests in either run has no friction to compare.
changed("resting", {}, {}, rests="wrist")
for names in (("resting", "little"), ("little", "resting")):
    said = compared(*names)
    check(f"a joint that rests in one is not named: {names}", "wrist" not in said["verdict"], said)

# Numbers from 1000 on have no power of ten.
shutil.copytree(path("two"), path("strong"))
s = json.loads(content("strong/summary.json"))
s["joints"][0]["temperature_degC"].update(start=25, end=40, max=40)
s["joints"][0]["friction_nm"]["rms"] = 12345.6
s["friction_work_J"], s["motor_work_J"] = 1.2344e9, 1e8
write("strong/summary.json", json.dumps(s))
with h5py.File(path("strong/telemetry.h5"), "r+") as f:
    power = f["hinge/cycle_friction_power_W"]
    check("enough cycles", power.size > 2, power.size)
    power[:] = np.linspace(1234.4, 999.7, power.size)
run(report, "strong", "-o", "strong.html", "--quiet")
read = text_of(content("strong.html"))
check(
    "powers of a strong joint are written out",
    "falls from 1234 to 1000 W (-19 %)" in read and "1234 → 1000 W" in read and "-235 W, -19.0 %" in read,
    read[:1200],
)
check("so are its works", "1234 MJ" in read and "1234 % of 100 MJ motor work" in read, read[:1200])
check("so is its friction", "\n12346\n" in read, read[:4000])
compared("two", "strong")
read = text_of(content("compared.html"))
check("works of a comparison are in the unit of the largest", "\n1234.4\n" in read and "\n100\n" in read, read[:4000])
check("and its friction", "\n12346\n" in read, read[:4000])

# Differences of mean friction power have what single work cycles scatter by, where that is known.
run(twin, "run", "two.yaml", "-o", "long", "--quiet", "--set", "duration_s=40")
random, powers = np.random.default_rng(7), {}
for folder, level_W in (("calm", 20), ("loud", 23)):
    shutil.copytree(path("long"), path(folder))
    with h5py.File(path(folder, "telemetry.h5"), "r+") as f:
        power = f["hinge/cycle_friction_power_W"]
        power[0] = level_W + 9  # from rest: no scatter
        power[1:] = level_W + np.linspace(0, -4, power.size - 1) + random.normal(0, 0.3, power.size - 1)
        powers[folder] = power[:]
check("enough cycles scatter", powers["calm"].size >= 8, powers["calm"].size)
off = [(p[1:-2] + p[3:]) / 2 - p[2:-1] for p in powers.values()]
scatter = np.sqrt(sum(np.mean(x**2) / 1.5 for x in off))
a, b = (np.mean(p) for p in powers.values())
compared("calm", "loud")
read = text_of(content("compared.html"))
wanted = f"hinge: friction power [W]\n{a:.4g}\n{b:.4g}\n{b - a:+.3g} ± {scatter:.2g} W, {100 * (b / a - 1):+.1f} %\n"
check(
    "a difference of powers has its scatter", wanted in read and "± is the standard deviation" in read, (wanted, read)
)
shutil.copytree(path("calm"), path("hush"))
run(report, "calm", "loud", "hush", "-o", "three.html", "--quiet")
read = text_of(content("three.html"))
wanted = difference(a, b, "W", scatter)
check(
    "of three runs each has its difference from the first, with its scatter",
    "difference from calm\nloud\nhush\n" in read
    and f"hinge: friction power\n{wanted}\nnone\n" in read
    and "± is the standard deviation" in read,
    (wanted, read),
)
compared("on", "less")
read = text_of(content("compared.html"))
check("without work cycles there is none, and it is said", "No ±: too few" in read and "power [W]" not in read, read)
with h5py.File(path("on/telemetry.h5")) as f:
    time, friction = f["time_s"][:], f["hinge/friction_nm"][:]
window = np.minimum(9 * (time - time[0]) // np.ptp(time), 8)  # nine windows of five samples or more
rms = [np.sqrt(np.mean(friction[window == k] ** 2)) for k in range(9)]
data = [json.loads(html.unescape(d)) for d in re.findall(r'data-figure="([^"]*)"', content("compared.html"))]
drawn = next(d["series"][0]["y"] for d in data if d["y"]["quantity"] == "friction, RMS")
check("a short run has windows with samples", len(drawn) == 9 and np.allclose(drawn, rms, rtol=1e-3), (drawn, rms))
check("and says how long they are", "root mean square over 0.05 s." in read and "over 0.00 s" not in read, read)

# Motors that brake more than they drive do no work that friction could have a share of, nor one with a ratio.
for folder, motor_J in (("braked", -12.3), ("driven", 40)):
    shutil.copytree(path("on"), path(folder))
    s = json.loads(content(folder + "/summary.json"))
    s["friction_work_J"], s["motor_work_J"] = 5, motor_J
    write(folder + "/summary.json", json.dumps(s))
run(report, "braked", "-o", "braked.html", "--quiet")
read = text_of(content("braked.html"))
said = "friction takes 5 J, while the motors brake more than they drive, by 12.3 J."
check("motors that brake are said to", said in read and "% of -12.3 J" not in read, read[:1200])
compared("braked", "driven")
read = text_of(content("compared.html"))
check("no ratio of works with two signs", "\n-12.3 J → 40 J\n+52.3 J\n" in read, read[:3000])
check("nor in the table", "motor work [J]\n-12.3\n40\n+52.3 J\n" in read, read[:3000])

# Small differences have the digits, the sign and the typeset power of ten of all numbers.
shutil.copytree(path("on"), path("nearly"))
s = json.loads(content("nearly/summary.json"))
s["friction_work_J"] += 2.88e-7
s["joints"][0]["friction_nm"]["rms"] += 1.734e-5
write("nearly/summary.json", json.dumps(s))
run(report, "on", "nearly", "less", "-o", "nearly.html", "--quiet")
read = text_of(content("nearly.html"))
for wanted in ("friction work\n+2.88·10⁻⁷ J, ", "hinge: friction, RMS\n+0.0000173 Nm, "):
    check(f"a small difference: {wanted[-20:]!r}", wanted in read, read[:4000])

# Friction may take more than the motors do, where gravity drives; and an overloaded joint's load is a number of times.
s["friction_work_J"], s["motor_work_J"] = 5, 4
s["joints"][0]["load_norm"]["max"] = 53385.79
write("nearly/summary.json", json.dumps(s))
run(report, "nearly", "-o", "overloaded.html", "--quiet")
read = text_of(content("overloaded.html"))
check(
    "where it comes from is said", "\n125 % of 4 J motor work, as gravity or stored energy drives, too\n" in read, read
)
check("an overload", "maximum load\n53386 times\nthe maximum torque, hinge\n" in read and "\n53386\n" in read, read)

# What matters of a run that repeats a recording is how near it comes.
shutil.copytree(path("on"), path("repeated"))
s = json.loads(content("repeated/summary.json"))
s["comparison"] = {"mae_mrad": 19.06, "baseline_mae_mrad": 28.94}
write("repeated/summary.json", json.dumps(s))
run(report, "repeated", "-o", "repeated.html", "--quiet")
said = opening(content("repeated.html"))["verdict"]
shutil.copytree(path("repeated"), path("named"))
repeats = "motion: {type: recording, file: data/swing_3.json}\n"
write("named/scenario.yaml", re.sub(r"(?ms)^motion:.*?^(?=\w)", repeats, content("named/scenario.yaml") + "name: n\n"))
run(report, "named", "-o", "named.html", "--quiet")
check("the recording is named", "recording: swing_3.json" in opening(content("named.html"))["identity"])
wanted = "The twin is 19.1 mrad from the recording (mean absolute error; with native friction 28.9 mrad);"
check("a repeated recording: its error is the verdict", said.startswith(wanted), said)

# A drive that has just begun has done no work worth digits.
s["friction_work_J"], s["motor_work_J"] = 2.4e-41, 2e-25
del s["comparison"]
write("repeated/summary.json", json.dumps(s))
run(report, "repeated", "-o", "begun.html", "--quiet", "--force")
said = opening(content("begun.html"))["verdict"]
check("no work: said without digits", said.endswith("; friction takes 0 J, without work of the motors."), said)

# A summary of an early version has no checks: nothing is known, which is not green.
shutil.copytree(path("on"), path("early"))
s = json.loads(content("early/summary.json"))
del s["health"]
write("early/summary.json", json.dumps(s))
run(report, "early", "-o", "early.html", "--quiet")
said = opening(content("early.html"))
check(
    "a run without checks is amber, and the page says why",
    said["light"] == "Amber" and "its summary has no checks" in said["rule"] and "again" in said["action"],
    said,
)
said = compared("on", "early")
check(
    "so is a comparison with it, which names it",
    said["light"] == "Amber"
    and "the health of early is not known" in said["rule"]
    and said["action"].startswith("run early again"),
    said,
)
said = compared("on", "less")
check("one of runs with checks is green", said["light"] == "Green", said)

# A slide beside a hinge: the figure of one joint has that joint's unit.
write("mixed.xml", several(["hinge", "wrist"]).replace('name="wrist"', 'name="wrist" type="slide"'))
write("mixed.yaml", re.sub(r"two\.xml\nduration_s: 15", "mixed.xml\nduration_s: 0.3", content("two.yaml")))
r = run(twin, "run", "mixed.yaml", "-o", "mixed", "--quiet")
check("a hinge and a slide run", r.returncode == 0, r.stderr)
for joint, unit in (("hinge", "Nm"), ("wrist", "N")):
    shutil.copytree(path("mixed"), path("mixed_" + joint))
    s = json.loads(content(f"mixed_{joint}/summary.json"))
    next(j for j in s["joints"] if j["name"] == joint)["friction_nm"]["rms"] *= 1.3
    write(f"mixed_{joint}/summary.json", json.dumps(s))
    said = compared("mixed", "mixed_" + joint)
    check(f"{joint} is the one that differs", said["verdict"].startswith(joint + " has more friction"), said)
    data = [json.loads(html.unescape(d)) for d in re.findall(r'data-figure="([^"]*)"', content("compared.html"))]
    units = {d["y"]["unit"] for d in data[:2] if "friction" in d["y"]["quantity"]}
    check(f"friction of {joint} in {unit}", units == {unit}, [d["y"] for d in data])

# Runs of one name in folders of one name: the shortest end of the path tells them apart, not all of it.
for cell in ("cell_a", "cell_b"):
    shutil.copytree(path("on"), path(cell, "today"))
said = compared(path("cell_a/today"), path("cell_b/today"))
page = content("compared.html")
check("the first is named by two folders", "% from that in cell_a/today" in said["verdict"], said)
check("so is the other", "result\ncell_a/today\ncell_b/today\n" in text_of(page), text_of(page)[:2000])
check("nothing is said of this machine", work not in page)

# A record of one sample.
write("one.yaml", content("off.yaml").replace("0.2", "0.02") + "telemetry_rate_hz: 10\n")
run(twin, "run", "one.yaml", "-o", "one", "--quiet")
run(report, "one", "-o", "one.html", "--quiet")
page = content("one.html")
check("one pose is the only one", "The only pose of the run, at 0.00 s." in page and "1 poses" not in page)
check("so is its moment in 3-D", "The only moment of the run" in page and "1 moments" not in page)
compared("one", "one")
check(
    "one sample has no root mean square",
    "hinge: friction, magnitude of the only sample." in content("compared.html")
    and "over 0.00 s" not in content("compared.html"),
    re.findall("<figcaption>(.*?)</figcaption>", content("compared.html")),
)
finish()
