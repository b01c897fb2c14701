"""tribotwin-report diagnosis and study: the pages in a real browser, its numbers against those of tribotwin diagnose,
figures that can be read without colour, wrong input. Arguments: tribotwin, tribotwin-report, source tree."""
import json, os, re, sys, time

import numpy as np

from browser import Browser, opening
import diagnosis_numbers
import harness
import numbers_of_page
import study_numbers
from harness import check, finish, path, work

twin, report, source = sys.argv[1:4]
random = np.random.default_rng(5)
v = np.array([0.17, 0.87, 1.75, 2.62, 3.49, 5.24, 8.73, 13.96, 17.45, 26.18, 52.36, 78.54, 104.7, 139.6, 174.5])


def run(program, *arguments):
    # A report is made again and again here; that nothing is replaced unasked is tested in tests/programs.
    again = ["--force"] if program == report and "--help" not in arguments else []
    return harness.run(program, *arguments, *again)


def write(name, conditions, noise=random):
    rows = []
    for i, (T, wear) in enumerate(conditions):
        Fc, Fs, Vs = (1 + wear) * (6 + 0.0162 * T), (1 + wear) * 9.5, (1 + wear) * (2 + 0.025 * T)
        friction = (
            Fc
            + (Fs - Fc) * np.exp(-((v / Vs) ** 1.3))
            + 3.4 * np.exp(-T / 32) * v ** (0.5 + 0.0025 * T)
            + noise.normal(0, 0.05, v.size)
        )
        rows.append(np.column_stack([np.full(v.size, i + 1), v, np.full(v.size, T), friction, np.full(v.size, 0.05)]))
    np.savetxt(
        os.path.join(work, name),
        np.vstack(rows),
        delimiter=",",
        header="curve,speed_rad_s,temperature_degC,friction_nm,stderr_nm",
        comments="",
        fmt="%.9g",
    )


write("healthy.csv", [(T, 0) for T in np.linspace(25, 58, 20)])
write("checked.csv", [(30, 0), (55, 0), (40, 0.1), (41, 0.15)])
check("learn", run(twin, "diagnose", "learn", "healthy.csv", "-o", "healthy.yaml").returncode == 0)
seen = json.loads(run(twin, "diagnose", "check", "healthy.yaml", "checked.csv", "--json").stdout)["observations"]
r = run(report, "diagnosis", "healthy.yaml", "checked.csv", "-o", "page.html", "--quiet")
check(
    "the page is written",
    r.returncode == 0 and r.stdout == "page.html\n" and r.stderr == "",
    (r.returncode, r.stdout, r.stderr),
)
browser = Browser(work, check)
measured = browser.check_page("page", os.path.join(work, "page.html"), images=0, drawings=6)
text = measured["text"] if measured else ""
for i, o in enumerate(seen):
    rows = [row.split("\t") for row in re.findall(rf"^{i + 1}\t([^\n]*)$", text, re.M)]
    words = rows[0] if rows else []
    check(
        f"row {i + 1} says in words what diagnose check says",
        words[1:4]
        == [("healthy", "anomalous")[o[region]["anomalous"]] for region in ("region1", "region2")]
        + [diagnosis_numbers.cause(o)],
        (words, o),
    )
    cells = rows[-1] if rows else []  # of the appendix
    expected = [
        f"{o['region1']['distance']:.3f}",
        f"{o['region1']['statistic']:.2f}",
        ("no", "yes")[o["region1"]["anomalous"]],
        f"{o['region2']['distance']:.3f}",
        f"{o['region2']['statistic']:.2f}",
        ("no", "yes")[o["region2"]["anomalous"]],
    ]
    check(
        f"row {i + 1} is that of diagnose check", cells[1:7] == expected and cells[8] == o["pattern"], (cells, expected)
    )
check(
    "verdict counts",
    f"{sum(o['anomalous'] and not o['perhaps_healthy'] for o in seen)} of 4 curves are not those of a healthy joint"
    in text,
    text[:400],
)
tile, last = numbers_of_page.text_of(harness.content("page.html")), seen[-1]
check("without dates the margin is that of the latest curve", diagnosis_numbers.margin_of(last) in tile, tile[:1500])
check(
    "a column of intervals is set right, one of words left",
    '<th class="number" scope="col">healthy curves, 95 %' in harness.content("page.html")
    and '<th scope="col">contact surfaces</th>' in harness.content("page.html"),
)
day = time.strftime("%Y-%m-%d", time.gmtime(os.path.getmtime(path("checked.csv"))))
check("without dates it is said what the day is that of", f"newest file written {day} ·" in text, text[:200])


def check_words(name):
    """What a maintenance engineer reads, and what paper shows, needs no paper on statistics."""
    body = numbers_of_page.text_of(re.sub("<details>.*?</details>", "", harness.content(name), flags=re.S))
    foreign = r"T\^2|T²|[Rr]egion|CUSUM|degC|torque_max|[Ss]everity|\de[+-]\d|distance|observation|cause: healthy"
    check(f"{name}: no word that needs a paper", not re.search(foreign, body), re.findall(f".*(?:{foreign}).*", body))
    bad = r"[Bb]y a straight line through the equivalent loads \d|then after what|\be\.g\.|_loss|_bearing|_constant"
    check(f"{name}: sentences that can be read", not re.search(bad, body), re.findall(f".*(?:{bad}).*", body))


check_words("page.html")
# Marks differ in shape: the same drawing without any colour still has three kinds of points and two kinds of outlines.
with open(os.path.join(work, "page.html")) as f:
    drawing = re.search(r'<svg[^>]*aria-label="Region 1: Fc and Fs.*?</svg>', f.read(), re.S)
marks = set(re.findall(r'xlink:href="#[^"]*?(gpPt\d+)" transform="translate', drawing.group(0))) if drawing else set()
check("points differ in shape", len(marks) >= 3, marks)
check("outlines differ in dashes", drawing and "stroke-dasharray" in drawing.group(0))

# ---- Curves with dates in their files' names: a trend over dates; what speaks for the cause, and what to test next.
dates = ("2026-01-10", "2026-02-14", "2026-04-01", "2026-05-20", "2026-07-01")
files = [f"joint3_{date}.csv" for date in dates]
for file, wear in zip(files, (0.01, 0.03, 0.06, 0.09, 0.12)):
    write(file, [(40, wear)])
r = run(report, "diagnosis", "healthy.yaml", *files, "-o", "dated.html", "--quiet")
check("dated: the page is written", r.returncode == 0 and r.stderr == "", r.stderr)
measured = browser.check_page("dated", path("dated.html"), images=0, drawings=7)
text = measured["text"]
seen = [
    json.loads(run(twin, "diagnose", "check", "healthy.yaml", f, "--json").stdout)["observations"][0] for f in files
]
last = seen[-1]
check(
    "dated: each row has its date", all(re.search(rf"^{i + 1}\t{d}\t", text, re.M) for i, d in enumerate(dates)), text
)
days = np.array([np.datetime64(d) - np.datetime64(dates[0]) for d in dates]).astype(float)


def reached(observations):
    """When a straight line through the equivalent loads is at the threshold."""
    rise, start = np.polyfit(days, [o["equivalent_load"] for o in observations], 1)
    left = (observations[0]["equivalent_load_threshold"] - start) / rise
    return np.datetime64(dates[0]) + np.timedelta64(round(left), "D")


said = re.search(r"threshold has been exceeded since about (\S+), by a straight line", text)
check(
    "dated: since when a straight line through the equivalent loads is beyond the threshold",
    said and abs((np.datetime64(said[1]) - reached(seen)).astype(int)) <= 1,
    (said and said.groups(), reached(seen)),
)
slow = [f"slow_{date}.csv" for date in dates]
for file, wear in zip(slow, (0.003, 0.006, 0.009, 0.012, 0.015)):
    write(file, [(40, wear)])
run(report, "diagnosis", "healthy.yaml", *slow, "-o", "slow.html", "--quiet")
found = [
    json.loads(run(twin, "diagnose", "check", "healthy.yaml", f, "--json").stdout)["observations"][0] for f in slow
]
said = re.search(r"wear threshold is reached about (\S+) \(95 %: (\S+) … (\S+?)[,)]", harness.content("slow.html"))
check(
    "dated: when it will be, within its interval",
    said
    and abs((np.datetime64(said[1]) - reached(found)).astype(int)) <= 1
    and dates[-1] <= said[2] < said[1]
    and (said[3] == "never" or said[3] > said[1]),
    (said and said.groups(), reached(found)),
)
check("dated: the latest is worn", last["pattern"] == "wear", last)
first = opening(harness.content("dated.html"))
check("dated: the day is that of the newest curve", f"data of {dates[-1]} ·" in first["identity"], first)
check_words("dated.html")
check(
    "dated: the first sentence says in words what it is and how much",
    f"looks like worn contact surfaces, {100 * last['severity']:.2g} %" in first["verdict"] and first["light"] == "Red",
    first,
)
evidence = dict(re.findall(r"^([A-Z][^\t\n]*F[cs]|speed Vs[^\t\n]*)\t([^\t]*)", text, re.M))
check(
    "dated: what speaks for it is measured",
    re.search(r"For it: .*Coulomb friction Fc.*Against it: ", text)
    and all(abs(float(evidence[f"{k} friction {n}"].split()[0]) / 12 - 1) < 0.3 for k, n in (("Coulomb", "Fc"),)),
    (evidence, text[:3000]),
)
check("dated: the next test is named", "Next test: measure the friction curve again" in text)


def hold_numbers(name, files):
    """Of a page of files with a date in their names, which may hold several curves each."""
    told = json.loads(run(twin, "diagnose", "check", "healthy.yaml", *files, "--json").stdout)["observations"]
    rows = np.loadtxt(path(files[-1]), delimiter=",", skiprows=1)
    latest = rows[rows[:, 0] == rows[-1, 0]]
    of_curves = [re.search(r"\d{4}-\d\d-\d\d", o["file"])[0] for o in told]
    diagnosis_numbers.hold(
        harness.content(name),
        check,
        command=f"tribotwin-report diagnosis healthy.yaml {' '.join(files)} -o {name} --quiet --force",
        healthy=harness.content("healthy.yaml"),
        seen=told,
        watched=json.loads(run(twin, "diagnose", "watch", "healthy.yaml", *files, "--json").stdout),
        levels=(latest[:, 1], latest[:, 3]),
        dates=of_curves,
        days=np.array([np.datetime64(d) - np.datetime64(of_curves[0]) for d in of_curves]).astype(float),
    )


hold_numbers("dated.html", files)
hold_numbers("slow.html", slow)  # the threshold is ahead
pairs = [f"pair_{date}.csv" for date in dates[:4]]
for file, wear in zip(pairs, (0.01, 0.03, 0.06, 0.09)):
    write(file, [(40, wear), (45, wear + 0.005)], np.random.default_rng(int(1000 * wear)))
run(report, "diagnosis", "healthy.yaml", *pairs, "-o", "pairs.html", "--quiet")
hold_numbers("pairs.html", pairs)
run(report, "diagnosis", "healthy.yaml", *reversed(files), "-o", "back.html", "--quiet")
check(
    "dated: files that go back in time have no trend, and it is said",
    "not in the order of the dates" in harness.content("back.html")
    and "is reached about" not in harness.content("back.html"),
)
back = opening(harness.content("back.html"))
check("dated: files that go back in time have a day", f"data of {dates[-1]} ·" in back["identity"], back)

# ---- A change at once is no straight line: no date is said, and the margin is that of the latest curve.
sudden = [f"sudden_{date}.csv" for date in dates]
for file, wear in zip(sudden, (0, 0, 0, 0, 0.12)):
    write(file, [(40, wear)])
run(report, "diagnosis", "healthy.yaml", *sudden, "-o", "sudden.html", "--quiet")
latest = json.loads(run(twin, "diagnose", "check", "healthy.yaml", sudden[-1], "--json").stdout)["observations"][0]
tile = numbers_of_page.text_of(harness.content("sudden.html"))
check("sudden: the margin is that of the latest curve", diagnosis_numbers.margin_of(latest) in tile, tile[:1500])
check(
    "sudden: no date is said",
    "threshold is exceeded. The equivalent loads do not follow a straight line" in tile and "since about" not in tile,
    tile[:3000],
)
hold_numbers("sudden.html", sudden)
told = json.loads(run(twin, "diagnose", "check", "healthy.yaml", *sudden, "--json").stdout)["observations"]
healthy = next(file for file, o in zip(sudden, told) if not o["anomalous"])
run(report, "diagnosis", "healthy.yaml", healthy, sudden[-1], "-o", "two.html", "--quiet")
verdict = opening(harness.content("two.html"))["verdict"]
check("one curve of two", verdict.startswith("1 of 2 curves is not that of a healthy joint; "), verdict)
run(report, "diagnosis", "healthy.yaml", sudden[-1], "-o", "only.html", "--quiet")
verdict = opening(harness.content("only.html"))["verdict"]
check("one curve alone", verdict.startswith("The curve is not that of a healthy joint; it looks like "), verdict)

# ---- Small wear: each curve beyond a limit is likelier so by chance than by any cause; few may be that, many not.
for name, wear, says, light in (
    ("few", 0.004, "2 of 5 curves are beyond the limits of a healthy joint, which may be chance.", ("Green", "Amber")),
    ("many", 0.008, "3 of 5 curves are beyond the limits of a healthy joint, too many for chance", ("Red",)),
):
    noise = np.random.default_rng(0)
    files = [f"{name}_{date}.csv" for date in dates]
    write(name + ".csv", [(40, wear)] * 5, noise)
    rows = np.loadtxt(path(name + ".csv"), delimiter=",", skiprows=1)
    for k, file in enumerate(files):
        with open(path(file), "w") as f:
            f.write("curve,speed_rad_s,temperature_degC,friction_nm,stderr_nm\n")
            np.savetxt(f, rows[rows[:, 0] == k + 1], delimiter=",", fmt="%.9g")
    told = json.loads(run(twin, "diagnose", "check", "healthy.yaml", *files, "--json").stdout)["observations"]
    check(f"{name}: no curve has a cause", all(o["perhaps_healthy"] for o in told if o["anomalous"]), told)
    run(report, "diagnosis", "healthy.yaml", *files, "-o", name + ".html", "--quiet")
    said, page = opening(harness.content(name + ".html")), numbers_of_page.text_of(harness.content(name + ".html"))
    check(
        f"{name}: the verdict is that of all curves", said["verdict"].startswith(says) and said["light"] in light, said
    )
    check(f"{name}: the title names the joint", page.startswith("Diagnosis of " + name), page[:80])
    check(
        f"{name}: a sentence of a curve is of it alone", "Of this curve alone, chance is likelier" in page, page[:3000]
    )

os.rename(os.path.join(work, "healthy.csv"), os.path.join(work, "gone.csv"))
r = run(report, "diagnosis", "healthy.yaml", "checked.csv", "-o", "alone.html", "--quiet")
check(
    "without the learned curves the page says so",
    r.returncode == 0 and "are not shown: healthy.csv" in r.stderr,
    r.stderr,
)
for name, says, arguments in (
    ("no healthy state", "nothing.yaml", ("nothing.yaml", "checked.csv")),
    ("no curves", "nothing.csv", ("healthy.yaml", "nothing.csv")),
):
    r = run(report, "diagnosis", *arguments, "-o", "wrong.html")
    check(
        f"{name}: refused",
        r.returncode == 2 and says in r.stderr and not os.path.exists(os.path.join(work, "wrong.html")),
        r.stderr,
    )


# A study folder of numbers that are all different: two joints, loads, one simulated fault, one that was drawn.
def curve_rows(number, series, T, load):
    friction = (6 + 0.016 * T) * (1 + 0.1 * load) + 3.4 * np.exp(-T / 32) * v**0.6
    return "".join(f"{series},{number},{speed:.6g},{x:.9g}\n" for speed, x in zip(v, friction))


def observation(number, T):
    features = dict(
        zip(
            ("Fc", "Fs", "Vs", "Fv", "beta"),
            np.array([6 + 0.016 * T, 9.5, 2 + 0.025 * T, 3.4 * np.exp(-T / 32), 0.5 + 0.0025 * T])
            + random.normal(0, 0.02, 5),
        )
    )
    return {"curve": number, "temperature_degC": T, "features": features}


# Fault, detection limit, share of the curves that get its name.
FAULTS = (
    ("wear", 0.05, 0.875),
    ("thickening", 0.043, 1),
    ("lubricant_loss", 0.029, 1),
    ("preload_loss", 0.056, 1),
    ("backlash", 8.4e-05, 1),
    ("pitted_bearing", 0.012, 1),
    ("torque_constant", 0.039, 1),
)


def study():
    whole = {}
    for j, joint in enumerate(("joint3", "joint5")):
        os.makedirs(os.path.join(work, "study", joint), exist_ok=True)
        rows, learned, checked = "series,curve,speed_rad_s,friction_nm\n", [], []
        for number, T in enumerate(np.linspace(25, 58, 10), 1):
            rows += curve_rows(number, "evolution", T, 0)
            learned.append(observation(number, T))
        for number, (load, state, T, bad, pattern) in enumerate(
            (
                (0, "cold", 26.0, False, "healthy"),
                (2, "cold", 27.0, j == 0, "load"),
                (5, "thermal", 57.0, True, "load"),
                (0, ("worn", "wear")[j], 40.0, True, ("wear", "unknown")[j]),
            ),
            11,
        ):
            rows += curve_rows(number, "new", T, load)
            region = lambda x, limit, anomalous: {
                "distance": x,
                "statistic": 2 * x,
                "limit": limit,
                "anomalous": anomalous,
            }
            checked.append(
                {
                    **observation(number, T),
                    "load_kg": load,
                    "state": state,
                    "series": "new",
                    "region1": region(100 + number + j / 8, 26.25, bad),
                    "region2": region(number / 16, 19.39, False),
                    "anomalous": bad,
                    "pattern": pattern,
                }
            )
            if j == 0:  # older versions had the state alone
                checked[-1]["faults"] = ["wear"] * (state == "worn")
        roc = [
            {"severity": s, "false_alarm": a, "detected": min(1, a + 10 * s)}
            for s in (0, 0.05, 0.1)
            for a in (0.01, 0.1, 0.2)
        ]
        power = [
            {
                "fault": fault,
                "unit": "rad" if fault == "backlash" else "1",
                "detection_limit": limit,
                "named_at_twice_the_limit": {fault: share, "unknown": 1 - share},
                "roc": roc,
            }
            for fault, limit, share in FAULTS[: 7 if j == 0 else 1]
        ]
        whole[joint] = {"observations": checked, "learned": learned, "power": power}
        with open(os.path.join(work, "study", joint, "curves.csv"), "w") as f:
            f.write(rows)
    return whole


def keep(whole):
    with open(os.path.join(work, "study", "diagnosis.json"), "w") as f:
        f.write(whole if isinstance(whole, str) else json.dumps(whole))


whole = study()
keep(whole)
with open(os.path.join(work, "study", "campaign.yaml"), "w") as f:
    f.write("# MuJoCo 1.9.9, model 0\nprocedure: diagnosis\n")
page = os.path.join(work, "study", "report.html")
r = run(report, "study", "study", "--quiet")
check(
    "study: the page is written",
    r.returncode == 0 and r.stdout == "study/report.html\n" and r.stderr == "",
    (r.returncode, r.stdout, r.stderr),
)
made = opening(harness.content("study/report.html"))["identity"]
check(
    "study: the engine is the one that simulated the curves",
    "page made with tribotwin " in made and made.endswith(" · simulated by MuJoCo 1.9.9"),
    made,
)
measured = browser.check_page("study", page, images=0, drawings=2 * (4 + 6 + 4) + 7 + 1)
text = measured["text"] if measured else ""
browser.open(page)
keys = browser.tab.value("[...document.querySelectorAll('.key .sample path')].map(p => p.getAttribute('d'))")
marks = [any(outline in d for d in keys) for outline in ("m-3.5 0a", "m-3.5 -3.5l", "h0")]
check("study: the key shows circles, crosses and dots as they are drawn", all(marks), marks)
for joint in whole:
    for i, o in enumerate(whole[joint]["observations"][:3]):
        cells = [str(i + 1), f"{o['load_kg']} kg", o["state"], f"{o['temperature_degC']:.1f}"]
        for region in (o["region1"], o["region2"]):
            cells += [f"{region['distance']:.3f}", f"{region['statistic']:.2f}", ("no", "yes")[region["anomalous"]]]
        check(f"study: row {i + 1} of {joint}", "\t".join(cells + [o["pattern"]]) in text, cells)
check(
    "study: what each joint flags",
    "joint3: Region 1 (contact surfaces) flags 2 kg, cold; 5 kg, thermal. Region 2 (lubricant) flags nothing." in text
    and "joint5: Region 1 (contact surfaces) flags 5 kg, thermal." in text,
    text[:600],
)
check(
    "study: a curve with a fault is no false alarm, whatever its author calls it",
    "3 of 4 curves with a payload are noticed, 0 of 2 new healthy ones without a payload are false alarms, 1 of 2 "
    "curves with a fault are named by it." in text,
    text[:600],
)
check("study: a detection limit has its unit", "detection limit 8.4·10⁻⁵ rad." in text, re.findall("limit .*", text))
check("study: faults named", re.search(r"faults named\s+1 of 2", text), text[:600])
check(
    "study: confusion",
    len(re.findall(r"^wear, 0\.1\t87\.5 %\t.*\t12\.5 %$", text, re.M)) == 2,
    re.findall("^wear.*", text, re.M),
)
faults = json.loads(run(twin, "list", "faults", "--json").stdout)
footprints = {fault["name"]: fault["description"] for fault in faults}
day = numbers_of_page.day_of(os.path.join(work, "study", "diagnosis.json"))
study_numbers.hold(harness.content("study/report.html"), check, whole, footprints, day, "1.9.9")
with open(page) as f:
    drawing = re.search(r'<svg[^>]*aria-label="joint3: ROC of wear.*?</svg>', f.read(), re.S)
dashes = (
    set(re.findall(r"stroke-dasharray='[^']*'|stroke-dasharray=\"[^\"]*\"", drawing.group(0))) if drawing else set()
)
check(
    "study: severities differ in dashes",
    len(dashes) >= 2 and all(s in drawing.group(0) for s in ("no fault", "0.05", "0.1")),
    dashes,
)

os.remove(page)
for name, path, value, says in (
    ("no joints", (), {}, "must be a mapping that is not empty"),
    ("no JSON", (), "{", "is no JSON"),
    (
        "a key is missing",
        ("joint3", "observations", 1),
        {"curve": 12, "temperature_degC": 27},
        "joint3: observations 2: has no 'features'",
    ),
    (
        "a number is none",
        ("joint5", "learned", 0, "features", "Vs"),
        "fast",
        "joint5: learned 1: features: Vs: must be a number",
    ),
    ("no such curve", ("joint3", "learned", 2, "curve"), 99, "joint3/curves.csv has no curve 99"),
    ("too few learned", ("joint5", "learned"), [], "joint5: learned: must be a list of at least 8"),
    ("no such fault", ("joint3", "power", 0, "fault"), "waer", "joint3: power 1: fault: is no fault of the twin"),
    ("no share", ("joint3", "power", 0, "roc", 1, "detected"), 1.5, "roc 2: detected: is 1.5 but must be 0 to 1"),
):
    wrong = {"all": json.loads(json.dumps(whole))}
    at = wrong
    for step in ("all", *path)[:-1]:
        at = at[step]
    at[("all", *path)[-1]] = value
    keep(wrong["all"])
    r = run(report, "study", "study", "--quiet")
    check(
        f"study, {name}: refused",
        r.returncode == 2
        and "study/diagnosis.json" in r.stderr
        and says in r.stderr
        and r.stderr.count("\n") == 1
        and not os.path.exists(page),
        (r.returncode, r.stderr),
    )
keep({"joint5": {key: value for key, value in whole["joint5"].items() if key != "power"}})
r = run(report, "study", "study", "-o", "undrawn.html", "--png", "--quiet")
figures = os.listdir(os.path.join(work, "undrawn_figures")) if r.returncode == 0 else []
check(
    "study without drawn curves: no ROC, the rest as files",
    len(figures) == 14 and not any("roc" in name for name in figures),
    (r.stderr, figures),
)
few = {"learned": whole["joint5"]["learned"], "observations": whole["joint5"]["observations"][:1]}
keep({"joint5": few})
r = run(report, "study", "study", "-o", "few.html", "--quiet")
said = opening(harness.content("few.html")) if r.returncode == 0 else {"tiles": []}
check("study of one checked curve: three to five tiles", 3 <= len(said["tiles"]) <= 5, (r.stderr, said))
keep(whole)
os.remove(os.path.join(work, "study", "joint5", "curves.csv"))
for name, folder, says in (
    ("no curves", "study", "study/joint5/curves.csv"),
    ("no folder", "nowhere", "nowhere/diagnosis.json"),
):
    r = run(report, "study", folder, "--quiet")
    check(
        f"study, {name}: refused",
        r.returncode == 2 and says in r.stderr and r.stderr.count("\n") == 1,
        (r.returncode, r.stderr),
    )

finish()
