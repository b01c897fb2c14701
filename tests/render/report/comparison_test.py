"""tribotwin-report of a healthy and a worn robot, and of the flagship warm-up: what its reader must find in the first
lines, and pictures that show the moment that they say. Arguments: tribotwin, tribotwin-report, source tree."""
import html, json, os, re, shutil, subprocess, sys

import h5py
import numpy as np

from browser import Browser, opening
import harness
from harness import check, content, finish, path, work
from pendulum import PENDULUM
from numbers_of_page import Numbers, difference, duration, energy, energy_unit, in_print, number, of_motor_work
from numbers_of_page import text_of, version
from robot_checks import unpacked

twin, report, source = sys.argv[1:4]
browser = Browser(work, check)


def run(program, *arguments, **options):
    again = ["--force"] if program == report else []
    return harness.run(program, *arguments, *again, errors="replace", **options)


def drawn(page, title):
    """The curves of a figure by their label: points [px], y down."""
    svg = next((s for s in re.findall(r"<svg.*?</svg>", page, re.S) if f">{title}<" in s), "")
    curves = {}
    for part in re.split(r'id="[^"]*gnuplot_plot_\d+"', svg)[1:]:
        label = re.search(r"<text>(.*?)</text>", part)
        points = re.search(r' d="(.*?)"', part, re.S).group(1).split("M")[1:]
        if label:
            curves[label.group(1)] = np.array(
                [[float(v) for v in p.split(",")] for p in re.findall(r"[-\d.]+,[-\d.]+", " ".join(points[1:]))]
            )
    return curves


wear = "events=[{time_s: 0, type: wear, joint: joint2, factors: {Fc0: 1.2, Fcl: 1.2, Fs0: 1.2, FsT: 1.2, Fv0: 1.2}}]"
named = ("--set", "robot=Cell 4, left", "--set", "serial_number=6620-104417")
for folder, more in (("healthy", ()), ("worn", ("--set", wear))):
    r = run(twin, "run", "irb6620_warmup", "-o", folder, "--quiet", *named, *more)
    check(f"{folder}: the run works", r.returncode == 0, r.stderr)
summaries = {f: json.loads(content(f + "/summary.json")) for f in ("healthy", "worn")}
rms = {f: s["joints"][1]["friction_nm"]["rms"] for f, s in summaries.items()}

# ---- A joint that hardly moves may have three times the friction and cost nothing: it is not what differs most.
for folder, share in (("slow", 0.3), ("fast", 0.8)):
    speed = ("--set", f"motion.speed_share={share}", "--set", "duration_s=600")
    r = run(twin, "run", "irb6620_warmup", "-o", folder, "--quiet", *speed)
    check(f"{folder}: the run works", r.returncode == 0, r.stderr)
run(report, path("slow"), path("fast"), "-o", "speeds.html")
rms_of = [
    [j["friction_nm"]["rms"] for j in json.loads(content(f + "/summary.json"))["joints"]] for f in ("slow", "fast")
]
gain = [other / first if first > 1 else 1 for first, other in zip(*rms_of)]
check("joint 3 changes more in percent than joint 2", gain[2] > 1.2 * gain[1] > 1.2, gain)
check(
    "the sentence names the joint that works",
    opening(content("speeds.html"))["verdict"].startswith("joint2 has more friction in fast than in slow: "),
    opening(content("speeds.html"))["verdict"],
)

# ---- A scenario of 10^12 values by aliases is not unfolded.
shutil.copytree(path("slow"), path("vast"))
with open(path("vast/scenario.yaml"), "w") as f:
    f.write("a0: &a0 [0]\n" + "".join(f"a{i}: &a{i} [{10 * f'*a{i - 1},'}]\n" for i in range(1, 13)))
r = run(report, path("slow"), path("vast"), "-o", "vast.html", timeout=60)
check("a scenario with too many values is not read", r.returncode == 0 and "holds more than" in r.stderr, r.stderr)

# ---- Healthy against worn.
r = run(report, path("healthy"), path("worn"), "-o", "both.html")
check("the comparison is made", r.returncode == 0 and r.stderr == "", (r.returncode, r.stderr))
page = content("both.html")
first = opening(page)
check(
    "the first sentence names the worn joint and the change of its friction, absolute and in percent",
    first["verdict"].startswith("joint2 has more friction in worn than in healthy: ")
    and f"{rms['healthy']:.4g} → {rms['worn']:.4g} Nm" in first["verdict"]
    and f"{100 * (rms['worn'] / rms['healthy'] - 1):+.1f} %" in first["verdict"],
    (first, rms),
)
check("the light is amber, and its rule is told", first["light"] == "Amber" and "amber beyond" in first["rule"], first)
more_MJ = (summaries["worn"]["friction_work_J"] - summaries["healthy"]["friction_work_J"]) / 1e6
changed = "wear of joint2 at 0 s: Fc0 1.2, Fcl 1.2, Fs0 1.2, FsT 1.2, Fv0 1.2"
check("three to five figures", 3 <= len(first["tiles"]) <= 5, first["tiles"])
m = browser.check_page("comparison", path("both.html"), 6, None)
if m:
    check("columns are told apart", "result\thealthy\tworn\tdifference" in m["text"], m["text"][:3000])
    top = m["text"].split("Simulations have no noise")[0]
    check("the keys that differ are shown with both values", f"events[1]\t–\t{changed}\n" in top, top)
    check("what to do names what was changed", f"what was changed explains it: events[1] (– → {changed})." in top, top)
    check("work and its change have one unit", f"{more_MJ:+.3g} MJ" in top, (more_MJ, top))
    check("no exponent where none is needed", not re.findall(r".*\de[+-]0.*", top), top)
    check("what does not differ is left out", "\nduration_s\t" not in m["text"] and "\nmodel\t" not in m["text"])
    rows = dict(re.findall(r"^(joint\d: friction, RMS \[Nm\])\t(.*)$", m["text"], re.M))
    check(
        "results are given with their difference",
        rows.get("joint2: friction, RMS [Nm]", "").endswith(f", {100 * (rms['worn'] / rms['healthy'] - 1):+.1f} %"),
        rows,
    )
    check("the page says nothing about this machine", work not in m["text"] and source not in m["text"])
curves = drawn(page, "Friction")
check("both are overlaid", list(curves) == ["healthy", "worn"], list(curves))
for label, points in curves.items():
    # A warm-up is smooth: no point is further from the middle of its neighbours than a part of the whole change.
    zigzag = np.abs(points[1:-1, 1] - (points[:-2, 1] + points[2:, 1]) / 2).max() / np.ptp(points[:, 1])
    check(f"{label}: friction does not zigzag", zigzag < 0.03, zigzag)
beside = drawn(page, "Difference of friction")
check("their difference is drawn beside", list(beside) == ["worn − healthy"], list(beside))

same = run(report, "healthy", "healthy", "-o", "same.html")
check("a run beside itself does not differ", "No joint's friction (RMS) differs by more than" in content("same.html"))

# ---- More than six runs: each beside the first, in a small figure of its own; their sections are closed.
degrees = [20, 25, 30, 35, 40, 45, 50, 55]
folders = [f"room{degC}" for degC in degrees]
with open(path("pendulum.xml"), "w") as f:
    f.write(PENDULUM)
with open(path("pendulum.yaml"), "w") as f:
    f.write("model: pendulum.xml\nduration_s: 5\nmotion: {type: cycle, speed_rad_s: 3, waypoints: ")
    f.write("[{position_rad: -0.5}, {position_rad: 0.6}]}\n")
for folder, degC in zip(folders, degrees):
    run(twin, "run", "pendulum.yaml", "-o", folder, "--quiet", "--set", f"temperature_degC={degC}")
r = run(report, *map(path, folders), "-o", "many.html")
check("eight runs are compared", r.returncode == 0 and r.stderr == "", (r.returncode, r.stderr))
page = content("many.html")
grids = re.findall(r'<div class="figures many">(.*?)</div>', page, re.S)
captions = [re.findall("<figcaption>(.*?)</figcaption>", grid) for grid in grids]
wanted = [f"temperature_degC {degC}" for degC in degrees[1:]]
check("each has a small figure of friction and one of temperature", captions == [wanted] * 2, captions)
for grid in grids:
    data = [json.loads(html.unescape(d)) for d in re.findall(r'data-figure="([^"]*)"', grid)]
    labels = [[s["label"] for s in d["series"]] for d in data]
    check("it shows the run and the first", labels == [["", f] for f in folders[1:]], labels)
    axes = {json.dumps([d["x"], d["y"]]) for d in data}
    values = [v for d in data for s in d["series"] for v in s["y"]]
    y = data[0]["y"]
    check(
        "all have the same axes, around all values", len(axes) == 1 and y["from"] < min(values) <= max(values) < y["to"]
    )
    check("the first is the same in all", len({json.dumps(d["series"][0]) for d in data}) == 1)
closed = re.findall(r"<details><summary>(room\d+)</summary>", page)
check("sections are closed", closed == folders and "<details open" not in page, closed)
browser.check_page("many runs", path("many.html"), 8 * 3, None)
pages = browser.printed(path("many.html"), path("many.pdf"))
check("eight runs are printed on at most four pages", 1 <= pages <= 4, pages)

# ---- The flagship.
r = run(report, path("healthy"), "-o", "one.html")
page = content("one.html")
first = opening(page)
with h5py.File(path("healthy/telemetry.h5")) as f:
    group = f["joint2"]
    power = np.array(group["cycle_friction_power_W"]) if "cycle_friction_power_W" in group else None
    cycles = f["cycle_time_s"][:] if "cycle_time_s" in f else None
    time, temperature = f["time_s"][:], group["temperature_degC"][:]
    if power is None:
        power = np.array(f["cycles/joint2/friction_power_W"])
ends = f"from {power[0]:.3g} to {power[-1]:.3g} W ({100 * (power[-1] / power[0] - 1):+.0f} %)"
check(
    "the first sentence is the warm-up",
    first["verdict"].startswith("joint2 warms from 25.0 to ") and ends in first["verdict"],
    (first["verdict"], ends),
)
for what in (
    "Cell 4, left",
    "serial number 6620-104417",
    "tribotwin ",
    "MuJoCo ",
    summaries["healthy"]["finished_at"][:10],
):
    check(f"the identity has {what!r}", what in first["identity"], first["identity"])
check("no path of this machine", work not in page and source not in page and os.path.dirname(source) not in page)
text = re.sub(r"<[^>]*>", " ", page)
check("numbers have digits that matter", not re.search(r"\d\.\d+e-0\d", text.split("How it was made")[0]), "")
by_joint = {}
for svg in re.findall(r"<svg.*?</svg>", page, re.S):
    for part in re.split(r'id="[^"]*gnuplot_plot_\d+"', svg)[1:]:
        label = re.search(r"<text>(joint\d)</text>", part)
        colour = re.search(r"stroke='rgb\(([^)]*)\)'|stroke=\"rgb\(([^)]*)\)\"", part[label.end() :] if label else "")
        if label and colour:
            by_joint.setdefault(label.group(1), set()).add(colour.group(1) or colour.group(2))
check(
    "a joint has one colour in all figures",
    "joint2" in by_joint and all(len(c) == 1 for c in by_joint.values()),
    by_joint,
)

browser.check_page("warm-up", path("one.html"), 3, 9)
opens_s = browser.opens_in_s(path("one.html"))  # wanted: 1 s, which other work on the machine may take away
check(
    "the warm-up's page opens in a second, or in 5 s beside other work", 0 < opens_s < 5, opens_s, f"({opens_s:.2f} s)"
)
pages = browser.printed(path("one.html"), path("one.pdf"))
check("the warm-up is printed on at most six pages", 1 <= pages <= 6, pages)
check("the warm-up's page is below 3 MB", os.path.getsize(path("one.html")) < 3e6, os.path.getsize(path("one.html")))

# ---- What if: the ambient temperature of a whole run (what other robots do: warm_up_test.py).
r = run(twin, "run", "irb6620_warmup", "-o", "hot", "--quiet", "--set", "ambient_degC=45")
hot = json.loads(content("hot/summary.json"))["joints"][1]["temperature_degC"]["end"]
browser.open(path("one.html"))
browser.tab.until("document.querySelectorAll('[data-kernel] .sliders input').length == 2")
said = "document.querySelector('figure[data-kernel] p[role=status]').innerText.replaceAll('\\u00a0', ' ')"
warm = summaries["healthy"]["joints"][1]["temperature_degC"]["end"]
told = browser.tab.value(said)
expected = f"joint2 {warm:.1f} °C ({warm:.1f} °C). Where nobody measured the law: joint2 below 38 °C."
check("what if: at first the run itself", told.endswith(expected), (told, expected))
browser.tab.value("document.querySelectorAll('.sliders input')[0].focus()")
browser.tab.key("End", 35)
told = browser.tab.value(said)
there = re.search(r"joint2 ([\d.]+) °C \(([\d.]+) °C\)\. Where nobody measured the law: joint2 above 81.2 °C\.", told)
if check("what if: the hottest room leaves the range of the law", there, told):
    predicted = float(there.group(1))
    check("what if: it is that of a whole run", abs(predicted - hot) < 0.1 and hot > warm + 15, (told, hot))


# ---- A multi-rate run that an older version recorded: its shares of time were counted in the steps computed alone.
shutil.copytree(path("healthy"), path("older"))
older = json.loads(content("older/summary.json"))
check("the run is multi-rate", older["steps_computed"] < 0.1 * older["steps"], older["steps_computed"])
for j, outside, stuck in zip(older["joints"], (0.25, 0.5, 1, 0, 0.125, 0.75), (0.5, 0.004, 0.6, 1, 0, 0.25)):
    del j["outside_s"]
    j["clamped_samples"] = round(outside * older["steps_computed"])
    j["stuck_s"] = stuck * older["simulated_s"] * older["steps_computed"] / older["steps"]
with open(path("older/summary.json"), "w") as f:
    json.dump(older, f)
r = run(report, "older")
check("its page is made", r.returncode == 0, r.stderr)
rows = re.findall(r"^joint\d\n" + r"([\d.]+)\n" * 8, text_of(content("older/report.html")), re.M)
shares = [tuple(map(float, row[-2:])) for row in rows]
expected = [(25, 50), (50, 0.4), (100, 60), (0, 100), (12.5, 0), (75, 25)]
check("it shows what the older version counted", shares == expected, shares)


# ---- Every number outside the figures is that of telemetry.h5 or summary.json.
def take_joints(n, folder, s):
    for j in s["joints"]:
        cells = [f"{j['temperature_degC'][k]:.1f}" for k in ("start", "end", "max")]
        cells += [f"{j['friction_nm'][k]:.4g}" if j["friction_nm"][k] > 1e-5 else "0" for k in ("rms", "max")]
        cells += [f"{j['load_norm']['max']:.3f}", f"{100 * j['outside_s'] / s['simulated_s']:.3g}"]
        cells += [f"{100 * j['stuck_s'] / s['simulated_s']:.3g}"]
        n.take(f"{folder}: row of {j['name']}", "\n".join([j["name"], *cells]) + "\n")


def take_health(n, folder, s):
    for h in s["health"]:
        row = rf"\n{h['check']}\n(?:{h['joint'] or '–'})\n(\S+)(?: [^\n]*)?\n(\S+)(?: [^\n]*)?\n{h['verdict']}\n"
        if re.search(row, n.text):  # each check shows its worst joint
            equal = lambda shown, true: abs(number(shown) - true) <= 0.006 * abs(true)
            n.match(f"{folder}: {h['check']}", row, lambda v, l: equal(v, h["value"]) and equal(l, h["threshold"]))
    n.take(folder + ": what checks measure", "follow (1) or not (0)", "a gear class (1)", "its own (0)")


def take_run(n, folder):
    """What the section of a run says."""
    s = summaries[folder]
    with h5py.File(path(folder + "/telemetry.h5")) as f:
        time, samples = f["time_s"][:], len(f["time_s"])
        cycle_s, warm = f["cycle_time_s"][:], f["joint2/cycle_temperature_degC"][:]
        power = f["joint2/cycle_friction_power_W"][:]
        visited = {}
        for j in ("joint2", "joint3"):
            speed = np.abs(f[j + "/velocity_rad_s"][:])
            slid = speed > 0.02 * speed.max()
            visited[j] = (np.abs(f[j + "/load_nm"][:]) / f[j].attrs["torque_max_nm"])[slid], f[j + "/temperature_degC"][
                :
            ][slid]
    joint, ends = s["joints"][1], (power[0], power[-1])
    t = joint["temperature_degC"]
    share = 100 * (ends[1] / ends[0] - 1)
    n.take(
        folder + ": verdict",
        f"joint2 warms from {t['start']:.1f} to {t['end']:.1f} °C, and its friction power falls from {ends[0]:.3g} to "
        f"{ends[1]:.3g} W ({share:+.0f} %).",
        f"none of {len({h['check'] for h in s['health']})} checks warns",
    )
    n.take(
        folder + ": tiles",
        f"{ends[0]:.3g} → {ends[1]:.3g} W\n{difference(*ends, 'W')}",
        f"{t['start']:.1f} → {t['end']:.1f} °C\n{t['end'] - t['start']:+.1f} K, at most {t['max']:.1f} °C",
        f"{energy(s['friction_work_J'])}\n{of_motor_work(s['friction_work_J'], s['motor_work_J'])}\n",
        f"{100 * joint['load_norm']['max']:.0f} %\nof the maximum torque, joint2",
        f"{s['simulated_s'] / 3600:.3g} h\n{s['realtime_factor']:.0f} × real time",
    )
    take_joints(n, folder, s)
    take_health(n, folder, s)
    n.take(folder + ": the legend of health", "telemetry.h5")
    n.take(folder + ": remarks", *map(in_print, s["warnings"]))
    crossing = np.interp(38, warm, cycle_s)
    n.match(
        folder + ": where the law is clamped",
        r"below (\d+) °C the law of joint2 was not measured; until (\d+) min (\d+) s its friction is that at 38 °C",
        lambda c, m, sec: c == "38" and abs(int(m) * 60 + int(sec) - crossing) < 5,
    )
    n.take(
        folder + ": moments",
        f"6 poses over the run, evenly in time from 0.00 s to {duration(time[-1])}",
        f"The end, at {duration(time[-1])}",
        "The beginning, at 0.00 s",
    )
    for load, degrees in visited.values():
        n.take(
            folder + ": where curves are drawn",
            f"Law 'extended' at a load of {np.median(load):.3f} of the maximum torque. Points: samples of the run with "
            f"a load within {max(0.1 * load.max(), 0.005):.3f} of that.",
            f"Law 'extended' at {np.median(degrees):.1f} °C. Points: samples of the run within "
            f"{max(0.05 * np.ptp(degrees), 0.25):.2g} K of that.",
        )
    n.take(
        folder + ": the surface",
        f"Law 'extended' at a load of {np.median(visited['joint2'][0]):.3f} of the maximum torque.",
    )
    n.take(
        folder + ": how it was made",
        f"MuJoCo {s['engine']['version']}\n",
        f"seed\n{s['seed']}\n",
        "time step\n0.001 s\n",
        f"{s['steps_computed']} computed of {s['steps']}",
        f"samples\n{samples}\n",
    )


n = Numbers(page, check)
n.take("the scenario", re.sub(r"(?m)^model: .*/mjcf/", "model: mjcf/", content("healthy/scenario.yaml")))
n.take(
    "identity",
    "Cell 4, left",
    "serial number 6620-104417",
    summaries["healthy"]["finished_at"][:16].replace("T", " ") + " UTC",
    f"simulated by MuJoCo {summaries['healthy']['engine']['version']}",
)
n.take("version", f"tribotwin {version()} ")
take_run(n, "healthy")
robot = json.loads(unpacked(page, "robot"))
n.take("moments of the robot in 3-D", f"{len(robot['moments'])} moments from the beginning to the end")
n.take(
    "what the scenario is",
    "irb6620_warmup",
    "IRB 6620 joint 2 working from a cold 25 °C room for two decay constants (6.08 h)",
)
n.take(
    "what if",
    "that changed by 1 K or more",
    "they differ by less than 0.01 K (rms)",  # warm_up_test.py holds this figure and the next
    "robots that ship agree within 0.5 K",
)
n.finish("warm-up")


# ---- And so is every number of the comparison.
def why_amber(runs):
    """Of a comparison, of [name, {joint: RMS friction}, friction work] of each run; empty where it is not amber."""
    (_, first_rms, first_J), *others = runs
    shares = [(f"{joint} in {name}", v / first_rms[joint] - 1) for name, rms, _ in others for joint, v in rms.items()]
    works = [("friction work in " + name, joule / first_J - 1) for name, _, joule in others]
    shares.append(max(works, key=lambda w: abs(w[1])))
    beyond = sorted((s for s in shares if abs(s[1]) > 0.05), key=lambda s: -abs(s[1]))
    said = ", ".join(f"{what} ({100 * share:+.1f} %)" for what, share in beyond[:3])
    return f" Amber, because of {said}{f' and {len(beyond) - 3} more' if len(beyond) > 3 else ''}." if beyond else ""


RULE = "green up to 5 % of a joint's friction (root mean square over the run) and of friction work, amber beyond; "
RULE += "red when a run is not what its scenario asked for."


def pair(value):
    """Of the healthy and of the worn run."""
    return [value(summaries[folder]) for folder in ("healthy", "worn")]


def cycle_power_W(folder, joint):
    with h5py.File(path(folder + "/telemetry.h5")) as f:
        return np.mean(f[joint + "/cycle_friction_power_W"][:])


def rms_of_moving(folder):
    return {f"joint{j + 1}": summaries[folder]["joints"][j]["friction_nm"]["rms"] for j in (1, 2)}


whole = content("both.html")
main = whole[whole.index("<main>") : whole.index("</main>")]
compared, *sections = re.split(r"(?=<h2>(?:healthy|worn)</h2>)", main)
check("the page has a section of each run", len(sections) == 2, len(sections))
n = Numbers(compared + "</main>", check)
n.take("what differs", f"events[1]\n–\n{changed}\n", f"what was changed explains it: events[1] (– → {changed}).")
n.take(
    "identity of both",
    "Cell 4, left",
    "serial number 6620-104417",
    summaries["healthy"]["finished_at"][:16].replace("T", " ") + " UTC",
    f"simulated by MuJoCo {summaries['healthy']['engine']['version']}",
    "irb6620_warmup: 2 runs compared",
)
n.take("version", f"tribotwin {version()} ")
frictions = pair(lambda s: s["joints"][1]["friction_nm"]["rms"])
degrees = pair(lambda s: s["joints"][1]["temperature_degC"]["max"])
works = [pair(lambda s: s[key]) for key in ("friction_work_J", "motor_work_J")]
said = "{:.4g} → {:.4g} Nm".format(*frictions)
n.take(
    "verdict and rule of both",
    f"joint2 has more friction in worn than in healthy: {said} ({difference(*frictions, 'Nm')}).",
    RULE + why_amber([(f, rms_of_moving(f), summaries[f]["friction_work_J"]) for f in ("healthy", "worn")]),
    "Simulations have no noise: what is above 1 %",
)
n.take(
    "tiles of both",
    f"{said}\n{difference(*frictions, 'Nm')}\n",
    f"{degrees[0]:.1f} → {degrees[1]:.1f} °C\n{degrees[1] - degrees[0]:+.1f} K\n",
    *(f"{energy(a)} → {energy(b)}\n{difference(a / 1e6, b / 1e6, 'MJ')}\n" for a, b in works),
)


def row(name, digits, values, unit=""):
    head = f"{name} [{unit}]" if unit else name
    n.take("row " + head, "\n".join([head, *(f"{v:{digits}}" for v in values), difference(*values, unit)]) + "\n")


row("simulated", ".1f", pair(lambda s: s["simulated_s"]), "s")
for j in (1, 2):
    row(f"joint{j + 1}: friction, RMS", ".4g", pair(lambda s: s["joints"][j]["friction_nm"]["rms"]), "Nm")
    row(f"joint{j + 1}: friction power", ".4g", [cycle_power_W(f, f"joint{j + 1}") for f in ("healthy", "worn")], "W")
    row(f"joint{j + 1}: maximum temperature", ".2f", pair(lambda s: s["joints"][j]["temperature_degC"]["max"]), "°C")
for name in ("friction work", "motor work"):
    joule = pair(lambda s: s[name.replace(" ", "_") + "_J"])
    unit, size = energy_unit(max(map(abs, joule)))
    row(name, ".5g", [J / size for J in joule], unit)
row("maximum load", ".3f", pair(lambda s: max(j["load_norm"]["max"] for j in s["joints"])))
n.finish("comparison")
for folder, section in zip(("healthy", "worn"), sections):
    n = Numbers(f"<main>{section}</main>", check)
    n.take(f"scenario of {folder}", re.sub(r"(?m)^model: .*/mjcf/", "model: mjcf/", content(folder + "/scenario.yaml")))
    take_run(n, folder)
    n.take(f"what {folder} is", "IRB 6620 joint 2 working from a cold 25 °C room for two decay constants (6.08 h)")
    n.finish("comparison: " + folder)


# ---- So is every number of comparisons of three runs, of as many as are overlaid, and of one more.
# Friction Fc0 [Nm] and temperature [degC] of each run.
CASES = {"base": (0.03, 20), "more": (0.036, 25), "less": (0.0285, 30), "much": (0.042, 35)}
CASES |= {"same": (0.0301, 40), "weak": (0.025, 45), "near": (0.0305, 50)}
KEYS = ("drives.hinge.Fc0", "temperature_degC")
for folder, values in CASES.items():
    settings = [word for key, value in zip(KEYS, values) for word in ("--set", f"{key}={value}")]
    run(twin, "run", "pendulum.yaml", "-o", folder, "--quiet", *settings)


class Case:
    def __init__(self, folder):
        self.folder, self.summary = folder, json.loads(content(folder + "/summary.json"))
        (self.joint,) = self.summary["joints"]
        self.rms, self.max_degC = self.joint["friction_nm"]["rms"], self.joint["temperature_degC"]["max"]
        self.works_J = [self.summary[key] for key in ("friction_work_J", "motor_work_J")]
        self.power_W = cycle_power_W(folder, "hinge")
        with h5py.File(path(folder, "telemetry.h5")) as f:
            self.end_s, self.samples = f["time_s"][-1], len(f["time_s"])


def take_several(n, cases):
    """What is said of all of them together."""
    first, *others = cases
    differ = [c for c in others if abs(c.rms / first.rms - 1) > 0.01]
    most = max(differ, key=lambda c: abs(c.power_W - first.power_W))
    said = f"{first.rms:.4g} → {most.rms:.4g} Nm"
    more = "more" if most.rms > first.rms else "less"
    n.take("title", f"pendulum: {len(cases)} runs compared")
    n.take(
        "verdict",
        f"hinge has {more} friction in {most.folder} than in base: {said} ({difference(first.rms, most.rms, 'Nm')}).",
        RULE + why_amber([(c.folder, {"hinge": c.rms}, c.works_J[0]) for c in cases]),
        "Simulations have no noise: what is above 1 %",
    )
    n.take(
        "tiles",
        f"{said}\n{difference(first.rms, most.rms, 'Nm')}\n",
        f"{first.max_degC:.1f} → {most.max_degC:.1f} °C\n{most.max_degC - first.max_degC:+.1f} K\n",
        *(f"{energy(a)} → {energy(b)}\n{difference(a, b, 'J')}\n" for a, b in zip(first.works_J, most.works_J)),
    )
    values = list(zip(*(CASES[c.folder] for c in cases)))
    keys = [f"{key} ({' → '.join(map(str, all))})" for key, all in zip(KEYS, values)]
    n.take("what to do", f"explains it: {', '.join(keys)}.")
    for key, all in zip(KEYS, values):
        n.take("what was asked for: " + key, "\n".join([key, *map(str, all)]) + "\n")
    table = lambda what, digits, value: n.take(what, "\n".join([what, *(f"{value(c):{digits}}" for c in cases)]) + "\n")
    table("simulated [s]", ".1f", lambda c: c.summary["simulated_s"])
    table("hinge: friction, RMS [Nm]", ".4g", lambda c: c.rms)
    table("hinge: friction power [W]", ".4g", lambda c: c.power_W)
    table("hinge: maximum temperature [°C]", ".2f", lambda c: c.max_degC)
    units = [energy_unit(max(abs(c.works_J[k]) for c in cases)) for k in (0, 1)]
    for k, what in enumerate(("friction work", "motor work")):
        table(f"{what} [{units[k][0]}]", ".5g", lambda c: c.works_J[k] / units[k][1])
    table("maximum load", ".3f", lambda c: c.joint["load_norm"]["max"])
    if len(cases) < 7:
        take_differences(n, cases, units)


def take_differences(n, cases, units):
    """The table of what each run differs by from the first, without what differs in none. `units`: of both works."""
    first, *others = cases

    def row(what, unit, value):
        cells = [difference(value(first), value(c), unit) for c in others]
        if set(cells) != {"none"}:
            n.take("differences: " + what, "\n".join([what, *cells]) + "\n")

    row("hinge: friction, RMS", "Nm", lambda c: c.rms)
    row("hinge: friction power", "W", lambda c: c.power_W)
    row("hinge: maximum temperature", "°C", lambda c: c.max_degC)
    for k, what in enumerate(("friction work", "motor work")):
        row(what, units[k][0], lambda c: c.works_J[k] / units[k][1])
    row("maximum load", "", lambda c: c.joint["load_norm"]["max"])


def take_case(n, c):
    """What the section of a run says that does not warm up."""
    s, (friction_J, motor_J), t = c.summary, c.works_J, c.joint["temperature_degC"]
    share = of_motor_work(friction_J, motor_J)
    n.take(
        c.folder + ": head",
        f"No joint warms by more than 1 K; friction takes {energy(friction_J)}, {share}.",
        f"none of {len({h['check'] for h in s['health']})} checks warns",
        f"{t['start']:.1f} → {t['end']:.1f} °C\n{t['end'] - t['start']:+.1f} K, at most {t['max']:.1f} °C\n",
        f"{energy(friction_J)}\n{share}\n",
        f"{100 * c.joint['load_norm']['max']:.0f} %\nof the maximum torque, hinge\n",
        f"{duration(s['simulated_s'])}\n{s['realtime_factor']:.0f} × real time\n",
    )
    take_joints(n, c.folder, s)
    take_health(n, c.folder, s)
    n.take(
        c.folder + ": moments",
        f"6 poses over the run, evenly in time from 0.00 s to {duration(c.end_s)}",
        f"The end, at {duration(c.end_s)}",
        "The beginning, at 0.00 s",
    )
    n.take(
        c.folder + ": how it was made",
        f"MuJoCo {s['engine']['version']}\n",
        f"seed\n{s['seed']}\n",
        "time step\n0.002 s\n",
        f"{s['steps_computed']} computed of {s['steps']}\n",
        f"samples\n{c.samples}\n",
        re.sub(r"(?m)^model: .*/", "model: ", content(c.folder + "/scenario.yaml")),
        "telemetry.h5",
    )
    n.finish("several: " + c.folder)


def hold_several(count):
    cases = [Case(folder) for folder in list(CASES)[:count]]
    name = f"several_{count}.html"
    r = run(report, *(c.folder for c in cases), "-o", name)
    check(f"{count} runs are compared", r.returncode == 0 and r.stderr == "", r.stderr)
    page = content(name)
    main = page[page.index("<main>") : page.index("</main>")].replace(name, "")
    pages = browser.printed(path(name), path("several.pdf"))
    check(f"{count} runs are printed on at most six pages", 1 <= pages <= 6, pages)
    check(f"{count} runs: the page's size", os.path.getsize(path(name)) < 2.5e6, os.path.getsize(path(name)))
    folders = "|".join(c.folder for c in cases)
    compared, *sections = re.split(rf"(?=<h2>(?:{folders})</h2>|<details><summary>(?:{folders})</summary>)", main)
    check(f"{count} runs: a section of each", len(sections) == count, len(sections))
    n, first = Numbers(compared + "</main>", check), cases[0].summary
    ended = first["finished_at"][:16].replace("T", " ") + " UTC"
    engine = first["engine"]["version"]
    n.take("identity", f"pendulum · {ended} · tribotwin {version()} · simulated by MuJoCo {engine}\n")
    take_several(n, cases)
    if count > 6:
        each = ("; ".join(f"{k} {v}" for k, v in zip(KEYS, CASES[c.folder])) for c in cases[1:])
        n.take("small figures", *(caption + "\n" for caption in each))
    n.finish(f"comparison of {count} runs")
    for c, section in zip(cases, sections):
        take_case(Numbers(f"<main>{section}</main>", check), c)


for count in (3, 6, 7):
    hold_several(count)

# ---- Pictures show the moment that they say, of a run of which most cycles were not computed.
captions = re.findall(r"<figcaption>(.*?)</figcaption>", page)
check(
    "where the law is clamped both figures say so",
    sum("its friction is that at 38 °C" in c for c in captions) == 2,
    captions,
)
check(
    "poses are evenly in time",
    "6 poses over the run, evenly in time from 0.00 s to 6 h 04 min 48 s." in captions,
    captions,
)
gap = int(np.argmax(np.diff(time)))
middle = (time[gap] + time[gap + 1]) / 2
r = run(report, "pose", "healthy", "--time", f"{middle}", "--size", "320x240", "-o", "gap.png")
check("a pose between computed cycles is drawn without a warning", r.returncode == 0 and r.stderr == "", r.stderr)
for name, at in (("before", time[gap]), ("after", time[gap + 1])):
    run(report, "pose", "healthy", "--time", f"{at}", "--size", "320x240", "-o", name + ".png")
pictures = {n: content(n + ".png", "rb") for n in ("before", "gap", "after")}
check("it is neither the sample before nor the one after", len(set(pictures.values())) == 3)

r = run(report, "video", "healthy", "--seconds", "4", "--fps", "10", "--size", "160x120", "-o", "film.mp4")
check("the film is made", r.returncode == 0, r.stderr)
frames = subprocess.run(
    ["ffmpeg", "-v", "error", "-i", path("film.mp4"), "-f", "rawvideo", "-pix_fmt", "gray", "-"], capture_output=True
).stdout
frames = np.frombuffer(frames, np.uint8).reshape(-1, 120, 160).astype(float)
robot = frames[:, :, 60:130]  # beside the panel, whose numbers change anyhow
moving = np.abs(np.diff(robot, axis=0)).max(axis=(1, 2)) > 40
check("the film shows motion", len(frames) == 40 and moving.mean() > 0.6, (len(frames), moving.mean()))

# ---- A model without light, sky and visible geometry.
with open(path("dark.xml"), "w") as f:
    f.write(
        '<mujoco model="dark"><visual><headlight active="0"/></visual><worldbody><body name="arm"><joint name="hinge" '
        'axis="0 1 0"/><geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" group="3" rgba="0.8 0.5 0.2 1"/></body>'
        "</worldbody></mujoco>"
    )
r = run(report, "pose", "dark.xml", "--size", "320x240", "-o", "dark.png")
pixels = subprocess.run(
    ["ffmpeg", "-v", "error", "-i", path("dark.png"), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True
).stdout
pixels = np.frombuffer(pixels, np.uint8).reshape(240, 320, 3).astype(int)
check("its picture is not black", r.returncode == 0 and (pixels.max(axis=2) < 30).mean() < 0.01, pixels.mean())
check("its collision geometry is seen", ((pixels[..., 0] - pixels[..., 2]) > 60).mean() > 0.02, "")

finish()
