"""tribotwin-report of a healthy and a worn robot, and of the flagship warm-up: what its reader must find in the first
lines, and pictures that show the moment that they say. Arguments: tribotwin, tribotwin-report, source tree."""
import json, os, re, subprocess, sys

import h5py
import numpy as np

from browser import Browser, opening
import harness
from harness import check, content, finish, path, work

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
check("three to five figures", 3 <= len(first["tiles"]) <= 5, first["tiles"])
m = browser.check_page("comparison", path("both.html"), 6, None)
if m:
    check("columns are told apart", "result\thealthy\tworn\tdifference" in m["text"], m["text"][:3000])
    check("the keys that differ are shown with both values", "events[1].factors.Fc0\t–\t1.2" in m["text"], m["text"])
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
difference = drawn(page, "Difference of friction")
check("their difference is drawn beside", list(difference) == ["worn − healthy"], list(difference))

same = run(report, "healthy", "healthy", "-o", "same.html")
check("a run beside itself does not differ", "No joint's friction differs by more than" in content("same.html"))

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
