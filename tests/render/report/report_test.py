"""tribotwin-report as its user meets it: pages in a real browser, pictures, odd names, missing helpers, damaged runs.
Arguments: tribotwin, tribotwin-report, source tree."""
import glob, hashlib, html, json, os, re, shutil, signal, subprocess, sys, time

import h5py
import numpy as np

from browser import Browser, opening
import harness
from harness import check, check_refused, content, finish, path, work
from numbers_of_page import in_print

twin, report, source = sys.argv[1:4]


def run(program, *arguments, **options):
    # A report is made again and again here; that nothing is replaced unasked is tested in tests/programs.
    again = ["--force"] if program == report and "--help" not in arguments else []
    return harness.run(program, *arguments, *again, errors="replace", **options)


def refused(name, code, *arguments, says=(), **options):
    check_refused(name, run(report, *arguments, **options), says, code, lines=None)


browser = Browser(work, check)
check_page = browser.check_page

# The warm-up, cut to 20 minutes.
r = run(twin, "run", "irb6620_warmup", "-o", "warmup", "--set", "duration_s=1200", "--quiet")
check("the run works", r.returncode == 0, r.stderr)
r = run(report, "warmup", "--png", "--pdf")
check(
    "report of a run",
    r.returncode == 0
    and r.stderr == ""
    and r.stdout.splitlines() == ["warmup/report_figures/ (21 figures)", "warmup/report.html"],
    (r.returncode, r.stdout, r.stderr),
)
page = content("warmup/report.html")
m = check_page("report", path("warmup/report.html"), 3, 9)
summary = json.loads(content("warmup/summary.json"))
warnings = [in_print(w) for w in summary["warnings"]]
hot = max(summary["joints"], key=lambda j: j["temperature_degC"]["max"])
if m:
    for what in (
        f"{hot['temperature_degC']['max']:.1f} °C",
        "joint2",
        "MuJoCo " + summary["engine"]["version"],
        "seed",
        "Stood still: joint1",
        "tribotwin run warmup/scenario.yaml -o warmup_again",
        "tribotwin-report warmup --png --pdf",
        "motion:",
        "Law 'extended'",
        *warnings,
    ):
        check(f"the page says {what[:50]!r}", what in m["text"])
    check(
        "the page begins with the verdict of the health check",
        m["text"].index("The run is what its scenario asked for: none of 14 checks warns.")
        < m["text"].index("Over time"),
    )
    check("each warning is said once", all(m["text"].count(w) == 1 for w in warnings), warnings)
check("nothing is fetched", not re.search(r'(src|href)="(?!data:|#)', page) and "@import" not in page)
figures = sorted(os.listdir(path("warmup/report_figures")))
check(
    "figures are PNG and PDF files",
    all(
        content("warmup/report_figures/" + f, "rb")[:4] == (b"%PDF" if f.endswith("pdf") else b"\x89PNG")
        for f in figures
    )
    and sum(f.endswith("pdf") for f in figures) == 9,
    figures,
)
first = hashlib.sha256(page.encode()).hexdigest()
run(report, "warmup", "--png", "--pdf")
check(
    "two processes make the same page, pixels included",
    hashlib.sha256(content("warmup/report.html").encode()).hexdigest() == first,
)
check("nothing half-written is left", not glob.glob(work + "/**/*.partial", recursive=True))

# A run that is not what its scenario asked for: damping beside a drive, and a drive without torque.
model = content(os.path.join(source, "mjcf", "irb6620.xml")).replace('file="', f'file="{source}/mjcf/')
with open(path("bad.xml"), "w") as f:
    f.write(
        model.replace('<joint name="joint2"', '<joint name="joint2" damping="2000"').replace("-6400 6400", "-6.28 6.28")
    )
brief = ("--set", "duration_s=10", "--set", "multirate.enabled=false", "--quiet")
r = run(twin, "run", "irb6620_warmup", "-o", "bad", "--set", "model=" + path("bad.xml"), *brief)
r = run(report, "bad")
m = check_page("a bad run", path("bad/report.html"), 3, 8)
bad = json.loads(content("bad/summary.json"))
fired = {f["check"] for f in bad["health"] if f["verdict"] == "warning"}
check("the checks fire", fired >= {"ctrlrange", "damping", "saturation", "tracking", "balance"}, fired)
if m:
    check(
        "the page of a bad run begins with what is wrong, its effect and its remedy",
        opening(content("bad/report.html"))["verdict"].startswith("The run is not what its scenario asked for: ")
        and all(f in opening(content("bad/report.html"))["verdict"] for f in fired)
        and opening(content("bad/report.html"))["light"] == "Red"
        and all(
            in_print(w["cause"]) in m["text"].split("Over time")[0] for w in bad["health"] if w["verdict"] == "warning"
        ),
        m["text"][:3000],
    )

# Slides with long names, at the width of a small window: forces are in N, no word is torn.
shutil.copy(os.path.join(source, "tests", "twin", "gears", "gantry.xml"), path("gantry.xml"))
run(twin, "add-drives", "gantry.xml", "-o", "slides.xml")
run(twin, "run", "slides.yaml", "-o", "slides", "--set", "telemetry_rate_hz=250", *brief)
r = run(report, "slides")
m = check_page("slides", path("slides/report.html"), 3, 5, widths=(1100,))
if m:
    check(
        "slides: friction in N",
        "friction RMS [N]" in m["text"]
        and "Nm" not in m["text"].split("How it was made")[0].replace("[Nm s/rad, Nm; slides N s/m, N]", ""),
        re.findall(".*Nm.*", m["text"]),
    )
r = run(report, "slides", "-o", "slides.pdf")
check_refused("a page is no PDF", r, ["slides.pdf", "must end in .html", "--pdf"])
check("a page that is refused is not there", not os.path.exists(path("slides.pdf")))
r = run(report, "pose", "slides.xml", "--pose", "hub=0.9", "--size", "64x64", "-o", "beyond.png")
check("a pose beyond a range is told", r.returncode == 0 and "hub (0.9 m, range -0.6 .. 0.6)" in r.stderr, r.stderr)

# Comparison, with a model whose parameters nobody measured.
guess = '<custom><text name="tribotwin.starting_point.joint2" data="cycloidal_7500"/></custom></mujoco>'
with open(path("guess.xml"), "w") as f:
    f.write(model.replace("</mujoco>", guess))
guess = ("--set", "model=" + path("guess.xml"))
run(
    twin,
    "run",
    "irb6620_warmup",
    "-o",
    "warmup35",
    *guess,
    "--set",
    "duration_s=1200",
    "--set",
    "ambient_degC=35",
    "--quiet",
)
r = run(report, "warmup", "warmup35", "-o", "both.html")
check("report of two runs", r.returncode == 0 and r.stdout == "both.html\n", (r.returncode, r.stdout, r.stderr))
m = check_page("comparison", path("both.html"), 6, 20)
if m:
    check(
        "the comparison names both",
        "result\twarmup\twarmup35\tdifference" in m["text"] and "maximum temperature" in m["text"],
    )
    check(
        "guesses are said beside the verdict, and in red",
        m["text"].count("But friction and heat of its model are guesses.") == 1
        and m["text"].count("of 1 of 6 joints: starting points of a gear class") == 1
        and re.search(r'class="[^"]*bad[^"]*"[^>]*>guessed<', content("both.html")),
        m["text"][:3000],
    )


# Scenarios that vary, of a drive behind a transmission; poses are left out where they are not looked at.
def varied(scenario, folder, runs, duration_s):
    """The shipped scenario with a shorter list of runs."""
    text = (
        content(os.path.join(source, "twin", "scenarios", scenario + ".yaml"))
        .split("vary:")[0]
        .replace("../../mjcf", os.path.join(source, "mjcf"))
    )
    with open(path(scenario + ".yaml"), "w") as f:
        f.write(text + "vary: " + json.dumps(runs) + "\n")
    r = run(twin, "run", scenario + ".yaml", "-o", folder, "--set", f"duration_s={duration_s}", "--quiet")
    check(f"{folder}: the runs work", r.returncode == 0, r.stderr)


def without_poses(folder):
    for file in glob.glob(path(folder) + "/*/scenario.yaml"):
        text = content(file).replace("rh380n_bench.xml", "moved.xml")
        with open(file, "w") as f:
            f.write(text)


def drawn(page, title):
    """The curves of a figure by their label: points [px], y down."""
    svg = next(s for s in re.findall(r"<svg.*?</svg>", page, re.S) if f">{title}<" in s)
    curves = {}
    for part in re.split(r'id="[^"]*gnuplot_plot_\d+"', svg)[1:]:
        label = re.search(r"<text>(.*?)</text>", part).group(1)
        points = re.search(r' d="(.*?)"', part, re.S).group(1).split("M")[2:]  # the first is the key's
        curves[label] = np.array(
            [[float(v) for v in p.split(",")] for p in re.findall(r"[-\d.]+,[-\d.]+", " ".join(points))]
        )
    return curves


def recorded(folder):
    with h5py.File(path(folder + "/telemetry.h5")) as f:
        return {
            "time": f["time_s"][:],
            **{
                name: f["motor"][name][:]
                for name in ("torsion_rad", "transmission_torque_nm", "arm_position_rad", "arm_set_point_rad")
            },
        }


varied(
    "rh380n_tracking",
    "tracking",
    [
        {"temperature_degC": [20], "control.compensation": ["none", "proposed"]},
        {"temperature_degC": [35], "control.compensation": ["none"]},
    ],
    18,
)
r = run(report, "tracking/20_proposed", "-o", "followed.html")
check("report of a drive behind a transmission", r.returncode == 0 and r.stderr == "", (r.returncode, r.stderr))
m = check_page("transmission", path("followed.html"), 3, 6)
entry = json.loads(content("tracking/20_proposed/summary.json"))["tracking"][0]
if m:
    for what in (
        "motor: torque over torsion",
        "motor: arm and set point",
        "motor: tracking error",
        f"proposed\t{entry['l1_mrad']:.4f}",
    ):
        check(f"transmission: the page says {what!r}", what in m["text"])
without_poses("tracking")
r = run(report, "tracking")
check(
    "the folder of a scenario that varied is the comparison of its runs",
    r.returncode == 0 and r.stdout == "tracking/report.html\n",
    (r.returncode, r.stdout, r.stderr),
)
m = check_page("varied", path("tracking/report.html"), 0, 7 + 3 * 5)
summary = json.loads(content("tracking/summary.json"))
if m:
    check(
        "varied: title and settings",
        m["title"] == "rh380n_tracking: 3 runs compared"
        and "temperature_degC=20, control.compensation=proposed" in m["text"],
        m["title"],
    )
    for of, e in zip(summary["runs"], summary["tracking"]):
        row = f"{of['folder']}\t{e['temperature_degC']:.1f}\t{e['compensation']}"
        row += f"\t{e['l1_mrad']:.4f}\t{e['standstill_pp_mrad']:.4f}"
        check("varied: the table has " + row.replace("\t", " "), row in m["text"], m["text"][:3000])
pages = browser.printed(path("tracking/report.html"), path("tracking.pdf"))
check("varied: printed on at most six pages, without the closed sections", 1 <= pages <= 6, pages)
page = content("tracking/report.html")
cold = drawn(page, "Tracking error from 20.0 °C")
check(
    "errors from one temperature are in one figure",
    list(cold) == ["20_none", "20_proposed"] and list(drawn(page, "Tracking error from 35.0 °C")) == ["35_none"],
    list(cold),
)
heights = {name: np.ptp(points[:, 1]) for name, points in cold.items()}
spans = {
    name: np.ptp(recorded("tracking/" + name)["arm_set_point_rad"] - recorded("tracking/" + name)["arm_position_rad"])
    for name in cold
}
check(
    "the errors are drawn with their peaks, to one scale",
    abs(heights["20_none"] / heights["20_proposed"] / (spans["20_none"] / spans["20_proposed"]) - 1) < 0.01,
    (heights, spans),
)

varied("rh380n_hysteresis", "hysteresis", [{"temperature_degC": [20, 50]}], 3)
without_poses("hysteresis")
r = run(report, "hysteresis")
check("report of hysteresis", r.returncode == 0, r.stderr)
page = content("hysteresis/report.html")
loops = drawn(page, "Torque over torsion")
check(
    "a set point at rest has no tracking error",
    list(loops) == ["20", "50"] and "racking error" not in page,
    list(loops),
)
widths = {}
for name, points in loops.items():
    of = recorded("hysteresis/" + name)
    torsion = of["torsion_rad"][of["time"] >= of["time"][-1] - 1 / 0.5 - 1e-9]  # the last period at 0.5 Hz
    widths[name] = np.ptp(points[:, 0]) / np.ptp(torsion)
    expected = points[:, 0].min() + (torsion[[0, -1]] - torsion.min()) * widths[name]
    check(
        f"loop {name}: the last period, from its beginning to its end",
        np.abs(points[[0, -1], 0] - expected).max() < 1,
        (points[[0, -1], 0], expected),
    )
check("loops are drawn to one scale", abs(widths["20"] / widths["50"] - 1) < 0.01, widths)

os.makedirs(path("odd_runs"))
for runs in ([], [{"folder": 3}], "x", [1]):
    with open(path("odd_runs/summary.json"), "w") as f:
        json.dump({"runs": runs}, f)
    refused(f"runs that are none: {runs}", 2, "odd_runs", says=["odd_runs/summary.json: `runs` must be a list of"])
with open(path("odd_runs/summary.json"), "w") as f:
    json.dump({"runs": [{"folder": "away", "set": []}]}, f)
refused("a run that is gone", 2, "odd_runs", says=["odd_runs/away: is no folder of a run"])

# Single pictures; two processes, the same pixels.
model = os.path.join(source, "mjcf", "irb6620.xml")
hashes = set()
for _ in range(2):
    r = run(
        report,
        "pose",
        model,
        "--pose",
        "joint2=0.6",
        "--temperature",
        "joint2=72",
        "--size",
        "320x240",
        "-o",
        "pose.png",
    )
    check("pose of a model", r.returncode == 0 and r.stdout == "pose.png\n", r.stderr)
    hashes.add(hashlib.sha256(content("pose.png", "rb")).hexdigest())
check("two processes draw the same pixels", len(hashes) == 1)
r = run(report, "pose", "warmup", "--time", "600", "--size", "320x240", "--colour-by", "friction", "-o", "run.png")
check("pose of a run", r.returncode == 0 and content("run.png", "rb").startswith(b"\x89PNG"), r.stderr)
for over in ("temperature", "load", "surface"):
    r = run(report, "curve", model, "--joint", "joint2", "--over", over, "-o", over + ".svg")
    check("curve over " + over, r.returncode == 0 and "joint2: law 'extended'" in content(over + ".svg"), r.stderr)
run(
    twin,
    "curve",
    model,
    "--joint",
    "joint2",
    "--experiment",
    "--noise",
    "20",
    "--speeds",
    "10:250:4",
    "--temperature",
    "50",
    "--csv",
    "points.csv",
    "--quiet",
)
r = run(report, "curve", model, "--joint", "joint2", "--points", "points.csv", "-o", "points.pdf")
check("curve with measured points", r.returncode == 0 and content("points.pdf", "rb").startswith(b"%PDF"), r.stderr)
r = run(report, "curve", model, "--joint", "joint2", "--size", "300x200", "-o", "small.png")
check(
    "size of a figure: a PNG has twice the pixels",
    r.returncode == 0 and content("small.png", "rb")[16:24] == bytes([0, 0, 2, 88, 0, 0, 1, 144]),
    r.stderr,
)
r = run(
    report, "pose", model, "--colour-by", "temperature", "--size", "320x240", "--text-scale", "2", "-o", "large.png"
)
check("size of the text", r.returncode == 0 and content("large.png", "rb") != content("pose.png", "rb"), r.stderr)
r = run(report, "sheet", "warmup", "--count", "4", "--size", "160x120", "-o", "sheet.png")
check("contact sheet", r.returncode == 0 and content("sheet.png", "rb").startswith(b"\x89PNG"), r.stderr)
r = run(report, "video", "warmup", "--seconds", "0.4", "--size", "160x121", "-o", "film.mp4")
check("film", r.returncode == 0, r.stderr)
r = subprocess.run(
    [
        "ffprobe",
        "-v",
        "error",
        "-count_frames",
        "-show_entries",
        "stream=width,height,nb_read_frames",
        "-of",
        "csv=p=0",
        path("film.mp4"),
    ],
    capture_output=True,
    text=True,
)
check("the film has its frames", r.stdout.strip() == "160,122,10", (r.stdout, r.stderr))

# Hostile names of joint, folder, file and scenario. A file "pwned" would show that one was executed.
name = "j'1\" `touch pwned` $(touch pwned) <script>document.title='pwned'</script> &amp; ü関\nF_{x}^2\\"
escaped = html.escape(name).replace("\n", "&#10;")
folder = "odd 'name' \"`touch pwned`\" <b>;ü"
os.mkdir(path(folder))
mjcf = (
    content(os.path.join(source, "mjcf", "xl330_pendulum.xml"))
    .replace('"hinge"', '"' + escaped + '"')
    .replace('"scene.xml"', '"' + os.path.join(source, "mjcf", "scene.xml") + '"')
)
with open(path(folder) + "/odd.xml", "w") as f:
    f.write(mjcf)
scenario = {
    "name": "<script>document.title='pwned'<b> `touch pwned` 'x' \"y\"",
    "description": "a\n<script>document.title='pwned'</script> <img src=x onerror=alert(1)> </style></pre> ]]> ü",
    "model": "odd.xml",
    "duration_s": 6,
    "ambient_degC": 25,
    "motion": {"type": "cycle", "waypoints": [{"position_rad": {name: -0.5}}, {"position_rad": {name: 0.9}}]},
    "control": {"type": "servo"},
    "telemetry_rate_hz": 50,
}
with open(path(folder) + "/odd.yaml", "w") as f:
    json.dump(scenario, f)
r = run(twin, "run", folder + "/odd.yaml", "-o", folder + "/run `x`", "--quiet")
check("a run with odd names", r.returncode == 0, r.stderr)
r = run(report, folder + "/run `x`", "-o", folder + "/odd.html", "--png")
check("a report with odd names", r.returncode == 0, (r.stdout, r.stderr))
m = check_page("odd names", path(folder) + "/odd.html", 3, 3)
if m:
    shown = name.replace("\n", " ")
    flat = re.sub(r"\s+", " ", m["text"])
    check("the joint's name is shown as it is", shown in flat, flat[:2000])
    check(
        "the scenario's name is shown as it is",
        m["title"] == scenario["name"] and scenario["name"] in m["text"],
        m["title"],
    )
    command = re.search(r"tribotwin-report .*odd\.html' --png", m["text"])
    check("the command is quoted for the shell", command is not None)
    if command:
        words = subprocess.run(
            ["bash", "-c", "printf '%s\\n' " + command.group(0)], capture_output=True, text=True, cwd=work
        ).stdout.splitlines()
        check(
            "the shell reads it back",
            words == ["tribotwin-report", folder + "/run `x`", "-o", folder + "/odd.html", "--png"],
            words,
        )
r = run(
    report,
    "pose",
    folder + "/odd.xml",
    "--pose",
    name + "=0.4",
    "--temperature",
    name + "=40",
    "--size",
    "160x120",
    "-o",
    "odd.png",
)
check("a pose with odd names", r.returncode == 0, r.stderr)
r = run(report, "curve", folder + "/odd.xml", "--joint", name, "-o", "odd.svg")
check("a curve with odd names", r.returncode == 0 and "<script" not in content("odd.svg"), r.stderr)
check("nothing was executed", not glob.glob(work + "/**/pwned", recursive=True) and not os.path.exists("pwned"))

# Nonsense.
refused("no run", 2, says=["the folder of a run is missing"])
refused("no such folder", 2, "nowhere", says=["nowhere: is no folder of a run"])
os.mkdir(path("empty"))
refused("empty folder", 2, "empty", says=["empty/telemetry.h5: does not exist"])
refused("no folder for the page", 2, "warmup", "-o", "no/where.html", says=["there is no folder no"])
refused("unwritable page", 1, "warmup", "-o", "/proc/report.html", says=["/proc/report.html: cannot be written"])
refused(
    "unwritable picture",
    1,
    "pose",
    model,
    "--size",
    "64x64",
    "-o",
    "/proc/x.png",
    says=["/proc/x.png: cannot be written"],
)
refused("size too large", 2, "pose", model, "--size", "9000x100", says=["each side must be 16 to 8192"])
refused("size nonsense", 2, "pose", model, "--size", "large", says=["WIDTHxHEIGHT"])
refused("size of a figure too small", 2, "curve", model, "--joint", "joint2", "--size", "9x9", says=["200 to 4000"])
refused("no such camera", 2, "pose", model, "--camera", "side", says=["overview"])
refused("no such camera in a film", 2, "video", "warmup", "--camera", "side", says=["overview"])
refused("a film of no frame", 2, "video", "warmup", "--seconds", "0.1", "--fps", "1", says=["1 to 1000000 frames"])
refused("two cameras", 2, "pose", model, "--camera", "overview", "--azimuth", "3", says=["free camera"])
refused("no such joint", 2, "pose", model, "--pose", "joint9=1", says=["joint1, joint2"])
refused("no number", 2, "pose", model, "--pose", "joint2=left", says=["must be JOINT=NUMBER"])
refused("no such keyframe", 2, "pose", model, "--pose", "away", says=["home"])
refused("no such drive", 2, "pose", model, "--temperature", "joint9=4", says=["did you mean"])
refused("not a model", 2, "pose", "nowhere.xml", says=["nowhere.xml"])
refused("time out of the record", 2, "pose", "warmup", "--time", "1e9", says=["the record spans"])
refused("wrong ending", 2, "curve", model, "--joint", "joint2", "-o", "x.gif", says=[".svg, .png or .pdf"])
refused("wrong ending of a pose", 2, "pose", model, "-o", "x.jpg", says=[".png"])
refused("wrong ending of a film", 2, "video", "warmup", "-o", "x.avi", says=[".mp4"])
refused("curve of no joint", 2, "curve", model, "--joint", "joint7", says=["joint7", "joint6"])
refused("points that are none", 2, "curve", model, "--joint", "joint2", "--points", model, says=["irb6620.xml:"])
with open(path("bad.csv"), "w") as f:
    f.write("speed_rad_s,load_norm,temperature_degC,friction_nm\n1,0,50,3\n2,0,50,x\n")
refused(
    "a point that is no number",
    2,
    "curve",
    model,
    "--joint",
    "joint2",
    "--points",
    "bad.csv",
    says=["bad.csv:3: column 'friction_nm' is 'x'"],
)
refused(
    "several loads over temperature", 2, "curve", model, "--joint", "joint2", "--load", "0", "0.5", says=["one load"]
)

# Helpers that are not there.
os.mkdir(path("bin"))
for tool in ("gnuplot", "ffmpeg"):
    os.symlink(shutil.which(tool), path("bin/" + tool))
for tool, package, arguments in (
    ("gnuplot", "gnuplot-nox", ["warmup", "-o", "x.html"]),
    ("gnuplot", "gnuplot-nox", ["curve", model, "--joint", "joint2", "-o", "x.svg"]),
    ("ffmpeg", "ffmpeg", ["video", "warmup", "--seconds", "0.1", "--size", "64x64", "-o", "x.mp4"]),
):
    os.rename(path("bin/" + tool), path("bin/away"))
    refused(
        f"no {tool} for {arguments[0]}",
        1,
        *arguments,
        says=[f"{tool} is not installed; on Debian: apt-get install {package}"],
        env={**os.environ, "PATH": path("bin")},
    )
    os.rename(path("bin/away"), path("bin/" + tool))
with open(path("bin/broken"), "w") as f:
    f.write("#!/bin/sh\necho 'out of ink' >&2\nexit 3\n")
os.chmod(path("bin/broken"), 0o755)
for tool, arguments in (
    ("gnuplot", ["curve", model, "--joint", "joint2", "-o", "x.svg"]),
    ("ffmpeg", ["video", "warmup", "--seconds", "1", "--size", "64x64", "-o", "x.mp4"]),
):
    os.rename(path("bin/" + tool), path("bin/away"))
    os.symlink(path("bin/broken"), path("bin/" + tool))
    refused(
        f"a {tool} that fails",
        1,
        *arguments,
        says=[f"{tool} ended with exit code 3: out of ink"],
        env={**os.environ, "PATH": path("bin") + ":/bin:/usr/bin"},
    )
    os.remove(path("bin/" + tool))
    os.rename(path("bin/away"), path("bin/" + tool))
check("nothing is left of what failed", not glob.glob(work + "/x.*"), glob.glob(work + "/x.*"))


# Incomplete runs.
def partial(name, *, says, code=0):
    r = run(report, name, "-o", name + ".html")
    text = content(name + ".html")
    check(
        name + ": a partial report that says so",
        r.returncode == code and all(s in r.stderr and html.escape(s, quote=False) in text for s in says),
        (r.returncode, r.stderr),
    )


shutil.copytree(path("warmup"), path("model_moved"))
with open(path("model_moved/scenario.yaml"), "w") as f:
    f.write(content("warmup/scenario.yaml").replace("irb6620.xml", "moved.xml"))
partial("model_moved", says=["moved.xml"])
shutil.copytree(path("model_moved"), path("no_summary"))  # without a model no poses are drawn, which takes most time
os.remove(path("no_summary/summary.json"))
partial("no_summary", says=["no_summary/summary.json: does not exist"])
shutil.copytree(path("model_moved"), path("bad_summary"))
with open(path("bad_summary/summary.json"), "w") as f:
    f.write('{"joints": [')
partial("bad_summary", says=["bad_summary/summary.json: is damaged"])
shutil.copytree(path("model_moved"), path("odd_summary"))
with open(path("odd_summary/summary.json"), "w") as f:
    f.write(
        '{"joints": [1, {"name": 3}], "warnings": 7, "engine": [], "simulated_s": "x", "health": [3, {"check": 5}, '
        '{"check": "limits", "joint": [], "value": null, "verdict": "?"}, {"verdict": "warning"}]}'
    )
check("a summary of other things does no harm", run(report, "odd_summary").returncode == 0)
shutil.copytree(path("warmup"), path("no_scenario"))
os.remove(path("no_scenario/scenario.yaml"))
partial("no_scenario", says=["no_scenario/scenario.yaml: does not exist"])
shutil.copytree(path("warmup"), path("damaged"))
with open(path("damaged/telemetry.h5"), "r+b") as f:
    f.truncate(3000)
partial("damaged", says=["damaged/telemetry.h5", "no part of it can be read"], code=1)
shutil.copytree(path("slides"), path("flipped"))  # of several chunks per channel
with open(path("flipped/telemetry.h5"), "r+b") as f:
    f.seek(os.path.getsize(path("flipped/telemetry.h5")) * 3 // 4)
    f.write(b"\xff" * 64)
partial("flipped", says=["flipped/telemetry.h5", "the part that is whole", "tribotwin recover flipped"], code=1)
page = content("flipped.html")
check(
    "a damaged record is told in red",
    (opening(page)["verdict"], opening(page)["light"]) == ("The record of this run is damaged.", "Red"),
)
check("what is left is shown, and is not green", 'class="verdict good"' not in page and page.count("<svg") > 3)
check("the damaged record stays as it was", not os.path.exists(path("flipped/telemetry.h5.original")))
os.remove(path("damaged/summary.json"))
refused("damaged and nothing else", 2, "damaged", says=["damaged/telemetry.h5"])
shutil.copytree(path("warmup"), path("gone"))
os.remove(path("gone/telemetry.h5"))
partial("gone", says=["gone/telemetry.h5: does not exist"])

# A run that is still being written, and one that was killed.
process = subprocess.Popen([twin, "run", "irb6620_hold", "-o", "growing", "--realtime", "--quiet"], cwd=work)
deadline = time.time() + 30
while time.time() < deadline and not (
    os.path.exists(path("growing/telemetry.h5"))
    and run(report, "pose", "growing", "--size", "64x64", "-o", "now.png").returncode == 0
):
    time.sleep(0.5)
partial("growing", says=["This run has not finished"])
process.send_signal(signal.SIGKILL)
process.wait()
partial("growing", says=["This run has not finished"])
said, day = opening(content("growing.html")), time.strftime("%Y-%m-%d", time.gmtime())
check(
    "a killed run: the first sentence says so, the rule what that means, and when it wrote last",
    said["verdict"].startswith("This run has not finished; so far: ")
    and said["light"] == "Amber"
    and "ended early" in said["rule"]
    and f"last written {day}" in said["identity"],
    said,
)

# A record that its model does not fit.
shutil.copytree(path("warmup"), path("other_model"))
with open(path("other_model/scenario.yaml"), "w") as f:
    f.write(
        "name: other\nmodel: %s\nduration_s: 1\ncontrol: {type: torque}\n"
        % os.path.join(source, "mjcf", "xl330_pendulum.xml")
    )
r = run(report, "other_model")
check("a model that is not the record's does no harm", r.returncode == 0, r.stderr)

# Killed halfway: the old page stays.
before = content("warmup/report.html")
process = subprocess.Popen([report, "warmup"], cwd=work, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
time.sleep(0.6)
process.send_signal(signal.SIGKILL)
process.wait()
check("a killed report leaves the old page whole", content("warmup/report.html") == before)

# The examples of --help work as pasted, from the source tree's top.
os.makedirs(path("runs"))
os.symlink(path("warmup"), path("runs/irb6620_warmup"))
os.symlink(os.path.join(source, "mjcf"), path("mjcf"))
for command in ([], ["pose"], ["curve"], ["sheet"], ["video"]):
    text = run(report, *command, "--help").stdout
    example = text[text.index("Example:") :].replace("\\\n", "").splitlines()[1].split()
    small = ["--size", "160x120"] if command in (["pose"], ["sheet"], ["video"]) else []  # quickly drawn
    small += ["--fps", "4"] if command == ["video"] else []
    r = run(report, *example[1:], *small)
    check(
        "example of --help: " + " ".join(example),
        example[0] == "tribotwin-report" and r.returncode == 0,
        (r.stdout, r.stderr),
    )

# No display libraries; OSMesa only where a robot is drawn.
mapped = lambda *command: set(
    re.findall(
        r"calling init: \S*/(\S+)", run(report, *command, env={**os.environ, "LD_DEBUG": "libs"}, timeout=60).stderr
    )
)
drawing = mapped("pose", "runs/irb6620_warmup", "--size", "160x120", "-o", "loaded.png")
check("a pose is drawn by OSMesa", "libOSMesa.so.8" in drawing and os.path.exists(path("loaded.png")), drawing)
display = [name for name in drawing if re.match(r"lib(GL|EGL|GLX|OpenGL)\.so", name)]
check("neither by libGL nor libEGL", not display, display)
check("nothing else loads it", "libOSMesa.so.8" not in mapped("--version"))

finish()
