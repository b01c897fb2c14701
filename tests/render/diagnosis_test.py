"""tribotwin-report diagnosis: the page in a real browser, its numbers against those of tribotwin diagnose, figures that can be read
without colour, wrong input. Arguments: tribotwin, tribotwin-report, source tree."""
import json, os, re, subprocess, sys, tempfile

import numpy as np

sys.dont_write_bytecode = True
from browser import Browser

twin, report, source = sys.argv[1:4]
work = tempfile.mkdtemp(prefix="tribotwin_diagnosis_")
failures = []
random = np.random.default_rng(5)
v = np.array([0.17, 0.87, 1.75, 2.62, 3.49, 5.24, 8.73, 13.96, 17.45, 26.18, 52.36, 78.54, 104.7, 139.6, 174.5])


def check(name, condition, detail=""):
    print("ok  " if condition else "FAIL", name, "" if condition else detail, flush=True)
    if not condition:
        failures.append(name)


def run(program, *arguments):
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=300, cwd=work)


def write(name, conditions):
    rows = []
    for i, (T, wear) in enumerate(conditions):
        Fc, Fs, Vs = (1 + wear) * (6 + 0.0162 * T), (1 + wear) * 9.5, (1 + wear) * (2 + 0.025 * T)
        friction = Fc + (Fs - Fc) * np.exp(-((v / Vs) ** 1.3)) + 3.4 * np.exp(-T / 32) * v ** (0.5 + 0.0025 * T) + random.normal(0, 0.05, v.size)
        rows.append(np.column_stack([np.full(v.size, i + 1), v, np.full(v.size, T), friction, np.full(v.size, 0.05)]))
    np.savetxt(os.path.join(work, name), np.vstack(rows), delimiter=",", header="curve,speed_rad_s,temperature_degC,friction_nm,stderr_nm", comments="", fmt="%.9g")


write("healthy.csv", [(T, 0) for T in np.linspace(25, 58, 20)])
write("checked.csv", [(30, 0), (55, 0), (40, 0.1), (41, 0.15)])
check("learn", run(twin, "diagnose", "learn", "healthy.csv", "-o", "healthy.yaml").returncode == 0)
seen = json.loads(run(twin, "diagnose", "check", "healthy.yaml", "checked.csv", "--json").stdout)["observations"]
r = run(report, "diagnosis", "healthy.yaml", "checked.csv", "-o", "page.html", "--quiet")
check("the page is written", r.returncode == 0 and r.stdout == "page.html\n" and r.stderr == "", (r.returncode, r.stdout, r.stderr))
measured = Browser(work, check).check_page("page", os.path.join(work, "page.html"), images=0, drawings=5)
text = measured["text"] if measured else ""
for i, o in enumerate(seen):
    row = re.search(rf"^{i + 1}\t([^\n]*)$", text, re.M)
    cells = row.group(1).split("\t") if row else []
    expected = [f"{o['region1']['distance']:.3f}", f"{o['region1']['statistic']:.2f}", str(o["region1"]["anomalous"]), f"{o['region2']['distance']:.3f}", f"{o['region2']['statistic']:.2f}", str(o["region2"]["anomalous"])]
    check(f"row {i + 1} is that of diagnose check", cells[1:7] == expected and cells[8] == o["pattern"], (cells, expected))
    check(f"sentence {i + 1} is on the page", (o["sentence"] in text) == o["anomalous"], o["sentence"])
check("verdict counts", f"{sum(o['anomalous'] for o in seen)} of 4 observations are not those of a healthy joint" in text, text[:400])
# Marks differ in shape: the same drawing without any colour still has three kinds of points and two kinds of outlines.
with open(os.path.join(work, "page.html")) as f:
    drawing = re.search(r'<svg[^>]*aria-label="Region 1: Fc and Fs.*?</svg>', f.read(), re.S)
marks = set(re.findall(r'xlink:href="#[^"]*?(gpPt\d+)" transform="translate', drawing.group(0))) if drawing else set()
check("points are told apart by shape", len(marks) >= 3, marks)
check("outlines are told apart by dashes", drawing and "stroke-dasharray" in drawing.group(0))

os.rename(os.path.join(work, "healthy.csv"), os.path.join(work, "gone.csv"))
r = run(report, "diagnosis", "healthy.yaml", "checked.csv", "-o", "alone.html", "--quiet")
check("without the learned curves the page says so", r.returncode == 0 and "are not shown: healthy.csv" in r.stderr, r.stderr)
for name, says, arguments in (("no healthy state", "nothing.yaml", ("nothing.yaml", "checked.csv")), ("no curves", "nothing.csv", ("healthy.yaml", "nothing.csv"))):
    r = run(report, "diagnosis", *arguments, "-o", "wrong.html")
    check(f"{name}: refused", r.returncode == 2 and says in r.stderr and not os.path.exists(os.path.join(work, "wrong.html")), r.stderr)

print(f"{len(failures)} failed: {failures}" if failures else "all passed")
sys.exit(bool(failures))
