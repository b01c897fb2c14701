"""tribotwin-report fit and curve of identified laws: the page in a real browser, its numbers against those of
PARAMS.yaml, other laws, data that are elsewhere, changed or gone, wrong input. Arguments: tribotwin, tribotwin-report,
source tree."""
import glob, hashlib, html, json, os, re, shutil, sys

import numpy as np

from browser import Browser, opening
import fit_numbers
import harness
from harness import check, check_refused, content, finish, path, work
from numbers_of_page import number
from reference_law import M_STAR, law

twin, report, source = sys.argv[1:4]
HEADER = "speed_rad_s,load_norm,temperature_degC,friction_norm"
random = np.random.default_rng(11)


def run(program, *arguments, **options):
    # A report is made again and again here; that nothing is replaced unasked is tested in tests/programs.
    again = ["--force"] if program == report and "--help" not in arguments else []
    return harness.run(program, *arguments, *again, **options)


def refused(name, *arguments, says, code=2):
    before = sorted(os.listdir(work))
    check_refused(name, run(report, *arguments), says, code)
    check(name + ": nothing is written", sorted(os.listdir(work)) == before, sorted(os.listdir(work)))


def put(name, text):
    with open(path(name), "w") as f:
        f.write(text)


def curves(name, count, loads=None, noise=4.23e-3):
    v, T = np.tile(1.5 * (280 / 1.5) ** (np.arange(12) / 11), count), random.uniform(38, 81.2, count).repeat(12)
    l = (random.uniform(0, 0.73, count) if loads is None else random.choice(loads, count)).repeat(12)
    np.savetxt(
        path(name),
        np.column_stack([v, l, T, law(M_STAR, v, l, T) + random.normal(0, noise, v.size)]),
        delimiter=",",
        header=HEADER,
        comments="",
        fmt="%.7g",
    )


def identify(data, output, *arguments):
    r = run(twin, "identify", data, "-o", output, "--quiet", *arguments)
    check("identify " + output, r.returncode == 0, r.stderr)


def block(name, key):
    """The mapping `key` of a PARAMS.yaml."""
    found = re.search(rf"^{key}:.*\n((?:  .*\n)*)", content(name), re.M)
    return {k: v for k, v in re.findall(r"^  (\w+): ([^#\n]*?)\s*(?:#.*)?$", found.group(1), re.M)}


def drawing(page, label):
    """The texts of the drawing whose description begins so."""
    found = re.search(r'<svg[^>]*aria-label="' + label + r'.*?</svg>', page, re.S)
    return (
        [html.unescape(re.sub("<[^>]*>", "", t)) for t in re.findall(r"<text[^>]*>(.*?)</text>", found.group(0), re.S)]
        if found
        else []
    )


def marks(name):
    """How many points the figures over speed show."""
    return sum(
        len(re.findall(r"<use[^>]* transform=.translate", svg))
        for svg in re.findall(r'<svg[^>]*aria-label="Friction.*?</svg>', content(name), re.S)
    )


def hold_numbers(name, command, parameters, *data):
    """Of a page that `command` makes of these files."""
    command = f"tribotwin-report fit {command} --force"
    fit_numbers.hold(content(name), check, report, command, path(parameters), *map(path, data))


check_page = Browser(work, check).check_page

# ---- The page of Bittencourt 2012's law.
curves("curves.csv", 484)
identify("curves.csv", "params.yaml", "--law", "extended")
r = run(report, "fit", "params.yaml", "--png", "--pdf")
check(
    "page of a fit",
    r.returncode == 0 and r.stderr == "" and r.stdout.splitlines() == ["fit_figures/ (24 figures)", "fit.html"],
    (r.returncode, r.stdout, r.stderr),
)
page = content("fit.html")
m = check_page("fit", path("fit.html"), 0, 12)
values, sigmas, intervals, correlation = (
    block("params.yaml", key) for key in ("parameters", "sigma", "confidence_95", "correlation")
)
names = list(sigmas)
if m:
    flat = re.sub(r"\s+", " ", m["text"])
    for what in (
        "All 12 parameters of law 'extended' were identified from 5808 samples of curves.csv",
        "% of the variance of friction",
        "12 of 12",
        "standstill friction at 0 °C, excess over Coulomb",
        "tribotwin-report fit params.yaml --png --pdf",
        "law: extended",
        "measurement: curves.csv · newest file written",
        "2000 of the 5808 samples are drawn",
        "all 5808 samples",
    ):
        check(f"the page says {what[:50]!r}", what in flat, flat[:600])
    residual = float(re.search(r"std: ([^,]*)", content("params.yaml")).group(1))
    said = re.search(r"standard deviation of (\S+) of the maximum torque; the law explains ([\d.]+) %", flat)
    check(
        "the verdict's numbers are the file's",
        said
        and abs(number(said.group(1)) / residual - 1) < 0.01
        and abs(float(said.group(2)) / 100 - float(re.search(r"r_squared: (.*)", content("params.yaml")).group(1)))
        < 6e-4,
        said,
    )
hold_numbers("fit.html", "params.yaml --png --pdf", "params.yaml", "curves.csv")
check("nothing is fetched", not re.search(r'(src|href)="(?!data:|#)', page) and "@import" not in page)
rows = re.findall(
    r"<tr><th scope=\"row\">(\w+)</th><td[^>]*>([^<]*)</td><td[^>]*>([^<]*)</td><td[^>]*>([^<]*)</td>"
    r"<td[^>]*>([^<]*)</td><td[^>]*>estimated</td>",
    page,
)
check("the table has every parameter", [row[0] for row in rows] == list(values), rows)
for name, value, sigma, interval, _ in rows:
    v, s, (low, high) = float(values[name]), float(sigmas[name]), map(float, intervals[name].strip("[]").split(","))
    shown = [number(e) for e in interval.split(" … ")]
    check(
        f"table: {name}",
        abs(number(value) - v) <= 0.06 * s
        and abs(number(sigma) / s - 1) <= 0.06
        and abs(shown[0] - low) <= 0.06 * s
        and abs(shown[1] - high) <= 0.06 * s,
        (value, sigma, interval),
    )
texts = drawing(page, "Correlation of the estimates")
matrix = {a: [float(x) for x in correlation[a].strip("[]").split(",")] for a in names}
cells = [("1" if i == k else "%.2f" % matrix[a][k]) for i, a in enumerate(names) for k in range(i + 1)]
shown = [t.strip() for t in texts]
start = next((s for s in range(len(shown)) if shown[s : s + 3] == ["1", cells[1], "1"]), 0)
equal = [
    abs(float(a) - float(b)) <= (0.0100001 if len(a) < 6 else 0.005)
    for a, b in zip(shown[start : start + len(cells)], cells)
]
check("the correlation figure's numbers are the file's", len(equal) == 78 and all(equal), shown)
check("it names every parameter on both sides", all(shown.count(n) == 2 for n in names), shown)
pairs = sorted(((abs(matrix[a][k]), a, names[k]) for i, a in enumerate(names) for k in range(i)), reverse=True)[:2]
check(
    "ellipses of the two most correlated pairs",
    all(drawing(page, f"{b} and {a}: correlation") for _, a, b in pairs),
    pairs,
)
check("histogram over all", any(t.endswith("n = 5808") for t in drawing(page, "Residuals")), drawing(page, "Residuals"))
for label in (
    "Friction at a load of",
    r"Friction at \S+ ± \S+ °C",
    "Residuals against speed",
    "Residuals against temperature",
    "Residuals against load",
):
    check("figure: " + label, len(drawing(page, label)) > 5)
check(
    "axes have units",
    {"motor speed v [rad/s]", "friction torque τf / τmax [-]", "temperature T [°C]"}
    <= set(drawing(page, "Friction at a load of")),
    drawing(page, "Friction at a load of"),
)
figures = sorted(os.listdir(path("fit_figures")))
check(
    "12 figures as PNG and as PDF",
    len(figures) == 24
    and all(content("fit_figures/" + f, "rb")[:4] == (b"%PDF" if f.endswith("pdf") else b"\x89PNG") for f in figures),
    figures,
)
first = hashlib.sha256(page.encode()).hexdigest()
run(report, "fit", "params.yaml", "--png", "--pdf")
check("two processes make the same page", hashlib.sha256(content("fit.html").encode()).hexdigest() == first)


# ---- Bands: 95 % of the curve, by the file's covariance of all parameters.
def shown_values(page, label):
    """What the figure whose drawing's description begins so carries for the page's script."""
    found = re.search(r'<figure[^>]* data-figure="([^"]*)"><svg[^>]*aria-label="' + label, page)
    return json.loads(html.unescape(found.group(1))) if found else {"series": []}


def half_width(v, l, T):
    """By finite differences, with the sigmas and correlations of PARAMS.yaml."""
    p, s = np.array([float(values[n]) for n in names]), np.array([float(sigmas[n]) for n in names])
    slopes = np.array([(law(p + d, v, l, T) - law(p - d, v, l, T)) / 0.02 for d in np.diag(0.01 * s)])  # per sigma
    low, high = map(float, intervals[names[0]].strip("[]").split(","))
    C = np.array([matrix[n] for n in names])
    return (high - low) / 2 / s[0] * np.sqrt(np.maximum(0, np.einsum("iv,ik,kv->v", slopes, C, slopes)))


data = shown_values(page, "Friction at a load of")
load = float(re.search(r"load of ([\d.]+)", data["title"]).group(1)) if data["series"] else 0
bands = [s for s in data["series"] if s["mark"] == "band"]
lines = [s for s in data["series"] if s["mark"] == "line"]
check("each of seven curves has a band", len(bands) == len(lines) == 7, [s["mark"] for s in data["series"]])
worst = 0
for band, line in zip(bands, lines):
    n, v, T = len(line["x"]), np.array(line["x"]), band["shade"][0]
    upper, lower = np.array(band["y"][:n]), np.array(band["y"][n:])[::-1]
    expected = half_width(v, load, T)
    check(f"the band at {T:.0f} degC is around its curve", np.allclose((upper + lower) / 2, line["y"], atol=1e-7))
    worst = max(worst, np.max(np.abs((upper - lower) / 2 - expected) / expected))
check("its width is that of the covariance", 0 < worst < 0.05, worst)  # the title rounds the load
check("the page says what bands are", "Bands: where the law is with 95 % confidence" in html.unescape(page))

# ---- Where the data are.
os.makedirs(path("elsewhere"))
named = ["--robot", "arm 7", "--serial-number", "12"]
r = run(report, "fit", os.path.join("..", "params.yaml"), "-o", "here.html", *named, cwd=path("elsewhere"))
check(
    "the robot that the user names", "arm 7 · serial number 12 · newest file written" in content("elsewhere/here.html")
)
check(
    "data beside the parameter file",
    r.returncode == 0 and r.stderr == "" and "Residuals against speed" in content("elsewhere/here.html"),
    r.stderr,
)
shutil.copy(path("params.yaml"), path("elsewhere/alone.yaml"))
r = run(report, "fit", "alone.yaml", "-o", "alone.html", cwd=path("elsewhere"))
check(
    "without data: a page that says so",
    r.returncode == 0
    and "The data of this identification are missing: curves.csv" in r.stderr
    and "are missing: curves.csv" in content("elsewhere/alone.html"),
    r.stderr,
)
m = check_page("without data", path("elsewhere/alone.html"), 0, 8)
check(
    "it has curves, correlation and ellipses, no residuals",
    bool(drawing(content("elsewhere/alone.html"), "Correlation"))
    and not drawing(content("elsewhere/alone.html"), "Residuals"),
)
check("and no points", marks("fit.html") > 0 and marks("elsewhere/alone.html") == 0, marks("elsewhere/alone.html"))
r = run(report, "fit", "alone.yaml", "../curves.csv", "-o", "alone.html", cwd=path("elsewhere"))
check(
    "with data named",
    r.returncode == 0 and r.stderr == "" and "Residuals against speed" in content("elsewhere/alone.html"),
    r.stderr,
)
curves("other.csv", 40, noise=9e-3)
r = run(report, "fit", "params.yaml", "other.csv", "-o", "other.html")
check(
    "other data: the page says so",
    r.returncode == 0
    and "not those of the identification: 480 samples" in r.stderr
    and "not those of the identification" in content("other.html"),
    r.stderr,
)
hold_numbers("other.html", "params.yaml other.csv -o other.html", "params.yaml", "curves.csv", "other.csv")
first = opening(content("other.html"))
off = re.search(
    r"is off by (\S+) of the maximum torque \(RMS\) on data .* not identified from, (\S+) times", first["verdict"]
)
if check("its first sentence is about these data", off, first):
    noise = 9e-3
    check("how far they are off", abs(number(off.group(1)) / noise - 1) < 0.1, first)
    check("and beside the law's own", abs(float(off.group(2)) / (noise / residual) - 1) < 0.1, (first, residual))
check(
    "twice as far is amber, and what to do follows",
    first["light"] == "Amber" and "see the residuals" in first["action"],
    first,
)
curves("alike.csv", 40)
run(report, "fit", "params.yaml", "alike.csv", "-o", "alike.html")
first = opening(content("alike.html"))
check("other data that fit are green", first["light"] == "Green" and "is off by" in first["verdict"], first)
check("three to five figures", 3 <= len(first["tiles"]) <= 5, first["tiles"])
put("changed.csv", content("curves.csv") + "10,0.1,50,0.06\n")
put("changed.yaml", content("params.yaml").replace("curves.csv", "changed.csv"))
r = run(report, "fit", "changed.yaml", "-o", "changed.html")
check("data that have changed since", r.returncode == 0 and "5809 samples" in r.stderr, r.stderr)

# ---- Parameters that are not identifiable, fixed parameters, other laws, many samples.
curves("one_load.csv", 40, loads=[0.3])
identify("one_load.csv", "one_load.yaml")
r = run(report, "fit", "one_load.yaml", "-o", "one_load.html")
hold_numbers("one_load.html", "one_load.yaml -o one_load.html", "one_load.yaml", "one_load.csv")
text = html.unescape(re.sub("<[^>]*>", " ", content("one_load.html")))
check(
    "what is not identifiable is listed",
    re.search(r"[1-9] of the 12 parameters", text)  # under this load the law without its load terms may not follow
    and re.search(r"Not identifiable from these data: .*Fcl.*Fsl.*vsl", text)
    and "fixed: not identifiable" in text
    and "all samples are at load 0.3" in text,
    text[:3000],
)
check(
    "and not drawn",
    not drawing(content("one_load.html"), r"Friction at \S+ ± \S+ °C")
    and not any("Fcl" == t for t in drawing(content("one_load.html"), "Correlation")),
)
check_page("one load", path("one_load.html"), 0, 8)
what_if = html.unescape(re.search(r'data-what-if="([^"]*)"', content("one_load.html")).group(1))
inputs = json.loads(what_if)["sliders"]
check(
    "what if: the load that was not varied cannot be chosen",
    inputs[1]["name"] == "load" and inputs[1]["from"] == inputs[1]["to"] and inputs[0]["from"] < inputs[0]["to"],
    inputs,
)
check(
    "where a parameter has no sigma there is no band",
    "Without bands" in text and "&quot;band&quot;" not in content("one_load.html"),
)
curves("lab.csv", 60, loads=[0, 0.2, 0.4, 0.7])
identify("lab.csv", "lab.yaml", "--fix", "alpha=1.36", "--tau-max", 7500, "--gear-ratio", 178)
r = run(report, "fit", "lab.yaml", "-o", "lab.html")
text = html.unescape(re.sub("<[^>]*>", " ", content("lab.html")))
check(
    "what was given is listed",
    "11 of the 12 parameters" in text and "Given, not estimated: alpha" in text and "torque_max_nm: 7500" in text,
    text[:3000],
)
identify("curves.csv", "stribeck.yaml", "--law", "stribeck")
r = run(report, "fit", "stribeck.yaml", "-o", "stribeck.html")
check(
    "a law that does not depend on temperature",
    r.returncode == 0 and "the law does not follow these data" in content("stribeck.html"),
    r.stderr,
)
check_page("stribeck", path("stribeck.html"), 0, 7)
v = np.tile([0.17, 0.9, 1.7, 2.6, 3.5, 5.2, 8.7, 14, 17, 26, 52, 79, 105, 140, 175], 4)
np.savetxt(
    path("nm.csv"),
    np.column_stack([v, 5.4 + 2.4 * np.exp(-((v / 3) ** 1.3)) + 0.97 * v**0.6 + random.normal(0, 0.1, v.size)]),
    delimiter=",",
    header="speed_rad_s,friction_nm",
    comments="",
)
identify("nm.csv", "nm.yaml", "--law", "steady_state")
r = run(report, "fit", "nm.yaml", "-o", "nm.html")
check(
    "a law in Nm, without load and temperature",
    r.returncode == 0 and "friction torque τf [Nm]" in drawing(content("nm.html"), "Friction"),
    (r.stderr, drawing(content("nm.html"), "Friction")),
)
m = check_page("steady_state", path("nm.html"), 0, 5)
v, T = np.tile(np.linspace(20, 400, 12), 8), np.repeat(np.linspace(22, 60, 8), 12)
q = v / 100
np.savetxt(
    path("joint.csv"),
    np.column_stack(
        [v, T, (20 + 6 * q - q**2 + 0.1 * q**3) * (1 - 0.006 * (T - 20)) + random.normal(0, 0.5, v.size)]
    ),
    delimiter=",",
    header="speed_rad_s,temperature_degC,friction_nm",
    comments="",
)
identify("joint.csv", "joint.yaml", "--law", "polynomial", "--gear-ratio", 100)
r = run(report, "fit", "joint.yaml", "-o", "joint.html")
check(
    "a law of the joint's side",
    r.returncode == 0 and "joint speed v [rad/s]" in drawing(content("joint.html"), "Friction"),
    r.stderr,
)
curves("many.csv", 20000)
identify("many.csv", "many.yaml")
r = run(report, "fit", "many.yaml", "-o", "many.html")
check(
    "240000 samples are thinned, and counted",
    r.returncode == 0
    and "2000 of the 240000 samples are drawn" in content("many.html")
    and any("n = 240000" in t for t in drawing(content("many.html"), "Residuals")),
    r.stderr,
)
check("and the page stays light", os.path.getsize(path("many.html")) < 3e6, os.path.getsize(path("many.html")))
put("bare.yaml", "law: stribeck\nparameters: {Fc: 0.034, Fs: 0.046, Fv: 3.68e-4, vs: 10.68, alpha: 1.93}\n")
r = run(report, "fit", "bare.yaml", "-o", "bare.html")
check(
    "parameters that somebody wrote",
    r.returncode == 0
    and "does not say how they were found" in content("bare.html")
    and "does not say which data" in r.stderr,
    r.stderr,
)
check_page("bare", path("bare.html"), 0, 1)
hold_numbers("bare.html", "bare.yaml -o bare.html", "bare.yaml")
put(
    "calibrated.yaml",
    """law: stribeck
torque_max_nm: 0.52
gear_ratio: 288.35
parameters: {Fc: 0.034, Fs: 0.046, Fv: 3.68e-4, vs: 10.68, alpha: 1.93}
status: {Fc: estimated, Fs: fixed, Fv: estimated, vs: held, alpha: at_bound}
sigma: {Fc: 0.002, Fv: 3e-5}
confidence_95: {Fc: [0.030, 0.038], Fv: [3.1e-4, 4.3e-4]}
correlation: {Fc: [1, -0.8], Fv: [-0.8, 1]}
residual: {mean: 0, std: 0, max_abs: 0}
samples: 4488
data: [made/sine.json, made/chirp.json]
unidentifiable: [vs]
notes: [found by simulation]
""",
)
r = run(report, "fit", "calibrated.yaml", "-o", "calibrated.html")
text = html.unescape(re.sub("<[^>]*>", " ", content("calibrated.html")))
check(
    "what tribotwin calibrate writes: no friction was measured",
    r.returncode == 0
    and "not found from measured friction" in r.stderr
    and "2 of the 5 parameters" in text
    and "4488 samples of 2 files" in text
    and "found by simulation" in text,
    (r.stderr, text[:1500]),
)
check(
    "nothing is said of residuals",
    "explains" not in text and "residual, std" not in text and "condition number" not in text,
    text[:1500],
)
check_page("calibrated", path("calibrated.html"), 0, 3)

# ---- Names as bad as they get.
name = "odd 'x' \"`touch pwned`\" $(touch pwned) <script>document.title=1<b>;ü"
shutil.copy(path("one_load.csv"), path(name + ".csv"))
identify(name + ".csv", name + ".yaml")
put(
    name + ".yaml",
    content(name + ".yaml").replace("notes: [", "notes: ['<img src=x onerror=alert(1)> </style></pre> ]]> ü', "),
)
r = run(report, "fit", name + ".yaml", "-o", name + ".html", "--png")
check("a page with odd names", r.returncode == 0, r.stderr)
m = check_page("odd names", path(name + ".html"), 0, 8)
if m:
    check(
        "names and notes are shown as they are",
        m["title"] == name + ": friction law 'extended'"
        and "<img src=x onerror=alert(1)> </style></pre> ]]> ü" in m["text"]
        and name + ".csv" in m["text"],
        (m["title"], m["text"][:1500]),
    )
check("nothing was executed", not glob.glob(work + "/**/pwned", recursive=True) and not os.path.exists("pwned"))

# ---- Single figures.
for over in ("temperature", "load", "surface"):
    r = run(report, "curve", "params.yaml", "--over", over, "-o", over + ".svg")
    check(
        "curve over " + over,
        r.returncode == 0 and "params: law 'extended'" in content(over + ".svg") and "[-]" in content(over + ".svg"),
        r.stderr,
    )
r = run(
    report,
    "curve",
    "params.yaml",
    "--points",
    "one_load.csv",
    "--points",
    "other.csv",
    "--load",
    "0.3",
    "-o",
    "points.svg",
)
both = np.concatenate([np.loadtxt(path(name), delimiter=",", skiprows=1) for name in ("one_load.csv", "other.csv")])
away = int((np.abs(both[:, 1] - 0.3) > 0.05).sum())
check(
    "points of two files: those of the curves' load, and it is said how many are of another",
    r.returncode == 0
    and 0 < away < len(both)
    and f"note: {away} of the {len(both)} points are not drawn" in r.stderr
    and 0 <= content("points.svg").count("<use") - (len(both) - away) <= 10,  # and the marks of the key
    (r.stderr, content("points.svg").count("<use"), len(both), away),
)
r = run(report, "curve", "nm.yaml", "--points", "nm.csv", "-o", "nm.pdf")
check("curve of a law in Nm", r.returncode == 0 and content("nm.pdf", "rb").startswith(b"%PDF"), r.stderr)
check(
    "curve of a joint-side law",
    run(report, "curve", "joint.yaml", "--points", "joint.csv", "-o", "joint.png").returncode == 0,
)
r = run(report, "curve", "stribeck.yaml", "--points", "many.csv", "-o", "many.svg")
check(
    "very many points are thinned, and it is said",
    r.returncode == 0 and "5000 of the 240000 points" in r.stderr,
    r.stderr,
)
put("nm7500.csv", "speed_rad_s,load_norm,temperature_degC,friction_nm,stderr_nm\n10,0,50,600,30\n100,0,50,450,30\n")
r = run(report, "curve", "lab.yaml", "--points", "nm7500.csv", "-o", "lab.svg")
check("points in Nm with error bars, where the maximum torque is known", r.returncode == 0, r.stderr)
check(
    "or given",
    run(report, "curve", "params.yaml", "--tau-max", "7500", "--points", "nm7500.csv", "-o", "given.svg").returncode
    == 0,
)

# ---- Nonsense: one line, nothing written.
refused("no such file", "fit", "nowhere.yaml", says="nowhere.yaml")
refused("a folder", "fit", "elsewhere", says="is a folder")
refused("a table instead of parameters", "fit", "curves.csv", says="curves.csv: ")
refused(
    "a scenario instead of parameters",
    "fit",
    source + "/twin/scenarios/irb6620_warmup.yaml",
    says="irb6620_warmup.yaml:",
)
put("empty.yaml", "")
refused("an empty file", "fit", "empty.yaml", says="empty.yaml")
put("half.yaml", "law: extended\nparameters: {Fc0: 1}\n")
refused("half the parameters", "fit", "half.yaml", says="half.yaml")
put("nested.yaml", re.sub(r"data: .*", "data: [[1, 2]]", content("params.yaml")))
refused("data that are no names", "fit", "nested.yaml", says="nested.yaml")
put("binary.yaml", "\x01[[")
refused("no YAML", "fit", "binary.yaml", says="binary.yaml")
refused("data that are named and missing", "fit", "params.yaml", "gone.csv", says="gone.csv")
refused("data that do not fit the law", "fit", "params.yaml", "nm.csv", says="load_norm is needed")
refused("data that are no table", "fit", "params.yaml", source + "/mjcf/irb6620.xml", says="irb6620.xml")
refused("Nm without the maximum torque", "fit", "stribeck.yaml", "nm.csv", says="--tau-max")
refused("no folder for the page", "fit", "params.yaml", "-o", "no/where.html", says="there is no folder no")
refused(
    "unwritable page", "fit", "params.yaml", "-o", "/proc/fit.html", says="/proc/fit.html: cannot be written", code=1
)
refused("curve: no such file", "curve", "nowhere.yaml", says="nowhere.yaml")
refused("curve: a joint of an identified law", "curve", "params.yaml", "--joint", "joint2", says="has no joint")
refused("curve: a model without a joint", "curve", source + "/mjcf/irb6620.xml", says="--joint is needed")
refused(
    "curve: points in Nm without the maximum torque",
    "curve",
    "stribeck.yaml",
    "--points",
    "nm.csv",
    says="--tau-max (largest manipulation torque [Nm]) is needed",
)
refused(
    "curve: the maximum torque of a model",
    "curve",
    source + "/mjcf/irb6620.xml",
    "--joint",
    "joint2",
    "--tau-max",
    "1",
    says="a model has its own",
)
# Foreign names and units by --columns: the same picture and the same page.
plain = np.loadtxt(path("nm.csv"), delimiter=",", skiprows=1)
np.savetxt(path("foreign.csv"), plain * [1e3, 1], delimiter=";", header="Drehzahl;M", comments="", fmt="%.17g")
put("map.yaml", "speed_rad_s: {from: Drehzahl, unit: mrad_s}\nfriction_nm: M\n")
refused("fit: foreign names", "fit", "nm.yaml", "foreign.csv", says="foreign.csv:1: neither a friction curve")
put("wrong_map.yaml", "speed_rad_s: Drehzal\n")
refused(
    "fit: a map of other names",
    *("fit", "nm.yaml", "foreign.csv", "--columns", "wrong_map.yaml"),
    says="foreign.csv has no column 'Drehzal'",
)
for points in (["nm.csv"], ["foreign.csv", "--columns", "map.yaml"]):
    r = run(report, "curve", "nm.yaml", "--points", *points, "-o", points[0] + ".svg")
    check("curve: points of " + points[0], r.returncode == 0, r.stderr)
check("curve: the same picture by --columns", content("nm.csv.svg") == content("foreign.csv.svg"))
r = run(report, "fit", "nm.yaml", "foreign.csv", "--columns", "map.yaml", "-o", "foreign.html")
check("fit: --columns", r.returncode == 0 and f"{len(plain)} samples" in content("foreign.html"), r.stderr)
said = run(report, "fit", "--help").stdout.split("Example:")[0]
check(
    "help says which data", all(c in said for c in ("friction_norm", "time_s, position_rad", "temperature_degC")), said
)
refused("fit: a page is no PDF", "fit", "params.yaml", "-o", "x.pdf", says="must end in .html")
refused("curve: wrong ending", "curve", "params.yaml", "-o", "x.gif", says=".svg, .png or .pdf")
environment = {**os.environ, "PATH": "/nonexistent"}
r = run(report, "fit", "params.yaml", "-o", "x.html", env=environment)
check(
    "no gnuplot",
    r.returncode == 1 and "apt-get install gnuplot-nox" in r.stderr and not os.path.exists(path("x.html")),
    (r.returncode, r.stderr),
)
check("nothing half-written is left", not glob.glob(work + "/**/*.partial", recursive=True))

text = run(report, "fit", "--help").stdout
example = text[text.index("Example:") :].splitlines()[1].split()
r = run(report, *example[1:])
check(
    "example of --help: " + " ".join(example),
    example[0] == "tribotwin-report" and r.returncode == 0,
    (r.stdout, r.stderr),
)

finish()
