"""tribotwin-report thermal: the page in a real browser, its numbers against those of tribotwin thermal, recordings that
the models have not seen or do not explain, a short one, a chain, wrong input. Arguments: tribotwin, its report."""
import html, json, math, os, re, sys

import numpy as np

from browser import Browser, opening
import harness
from harness import check, check_refused, content, finish, path, work
from numbers_of_page import text_of
import thermal_numbers

twin, report = sys.argv[1:3]
page_of = Browser(work, check).check_page
STEP_S = 20.0


def run(program, *arguments):
    return harness.run(program, *arguments, *(["--force"] if program == report else []))


def recording(name, seed, watts, hours=12.0, faulty_from_s=np.inf):
    """Two joints, one body each: 0.8 K/W and 1,500 s, 0.5 K/W and 2,500 s; work in waves and rest, 20 mK of noise. From
    faulty_from_s on the second has four times the recorded heat."""
    fine_s = 2.0
    time_s = np.arange(0, hours * 3600, fine_s)
    noise, every = np.random.default_rng(seed), int(STEP_S / fine_s)
    power = watts * np.where(time_s % 9000 < 6000, np.sin(np.pi * (time_s % 9000) / 6000) ** 2, 0)
    columns, head = [time_s[::every]], ["time_s"]
    for joint, (r_th, kappa_s) in {"shoulder": (0.8, 1500.0), "elbow": (0.5, 2500.0)}.items():
        heat = power * np.where((time_s >= faulty_from_s) & (joint == "elbow"), 4.0, 1.0)
        rise, decay = np.zeros(time_s.size), np.exp(-fine_s / kappa_s)
        for k in range(1, time_s.size):
            rise[k] = rise[k - 1] * decay + (heat[k] + heat[k - 1]) / 2 * r_th * (1 - decay)
        columns += [power[::every], 21 + rise[::every] + noise.normal(0, 0.02, columns[0].size)]
        head += [f"power_{joint}_w", f"temperature_{joint}_degC"]
    np.savetxt(path(name), np.column_stack(columns), delimiter=",", header=",".join(head), comments="")


def linked(name, seed, watts, bodies=None):
    """12 hours of a chain of three joints, which exchange heat at 4e-4 1/s; with `bodies`, gain [K/J] and time constant
    [s] of each, of one joint with these. Work in waves that come later in later joints, 20 mK of noise."""
    fine_s, every, noise = 2.0, int(STEP_S / 2), np.random.default_rng(seed)
    time_s = np.arange(0, 12 * 3600, fine_s)
    waves = [np.where((time_s + 1500 * k) % 9000 < 6000, np.sin(np.pi * ((time_s + 1500 * k) % 9000) / 6000) ** 2, 0)
             for k in range(len(watts))]  # fmt: skip
    power = np.array(watts)[:, None] * waves
    chain = {"shoulder": (6e-4, 1500.0), "elbow": (4e-4, 2500.0), "wrist": (9e-4, 900.0)}
    gain, t_s = np.array(bodies or list(chain.values())).T
    rise = np.zeros((len(t_s), time_s.size))
    for i in range(1, time_s.size):
        last = rise[:, i - 1]
        flow = np.zeros(0) if bodies else 4e-4 * np.diff(last)
        exchanged = 0 if bodies else np.append(flow, 0) - np.append(0, flow)
        rise[:, i] = last + fine_s * (gain * (power[:, i] + power[:, i - 1]) / 2 - last / t_s + exchanged)
    columns, head = [time_s[::every]], ["time_s"]
    for joint, watt, own in zip(["elbow"] if bodies else chain, power, [rise.sum(axis=0)] if bodies else rise):
        columns += [watt[::every], 21 + own[::every] + noise.normal(0, 0.02, columns[0].size)]
        head += [f"power_{joint}_w", f"temperature_{joint}_degC"]
    np.savetxt(path(name), np.column_stack(columns), delimiter=",", header=",".join(head), comments="")


def digits(v, count):
    """As the page rounds: so many digits, and all before the point."""
    return round(v, max(0, count - 1 - math.floor(math.log10(abs(v)))))


def errors(*data):
    """joint, file -> rms, largest [K]."""
    r = run(twin, "thermal", *data, "--evaluate", "thermal.yaml", "--json")
    return {
        (j, e["file"]): (e["rms_K"], e["largest_K"]) for j, all in json.loads(r.stdout)["joints"].items() for e in all
    }


def bands(file):
    r = run(twin, "thermal", file, "--evaluate", "thermal.yaml", "--json")
    return {j: all[0] for j, all in json.loads(r.stdout)["joints"].items()}


def rows(text, first):
    """Cells of the table rows that begin with `first`, as they stand in the page's source."""
    cells = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.S) for row in re.findall(r"<tr>(.*?)</tr>", text, re.S)]
    return [c for c in cells if c and c[0] == first]


def hold_numbers(name, parameters, given, *files):
    """Of a page of these recordings. `given`: those that the command names."""
    command = " ".join(["tribotwin-report thermal", parameters, *given, "-o", name, "--force"])
    thermal_numbers.hold(content(name), check, report, command, path(parameters), [path(f) for f in files])


recording("monday.csv", 1, 30)
recording("tuesday.csv", 2, 20)
recording("faulty.csv", 3, 20, faulty_from_s=3000)
r = run(twin, "thermal", "monday.csv", "-o", "thermal.yaml", "--json", "--rested")
found = json.loads(r.stdout)["joints"]
check("identified", r.returncode == 0 and not found["elbow"]["unidentifiable"], r.stdout)

# Of the recordings that the models are from, which the file names.
r = run(report, "thermal", "thermal.yaml", "-o", "own.html", "--png", "--robot", "arm 3")
check("own data: the page is written", r.returncode == 0 and r.stdout.endswith("own.html\n"), r)
page_of("thermal", path("own.html"), 0, 4)
own = content("own.html")
said, e = opening(own), errors("monday.csv")
worst = max(rms for rms, _ in e.values())
check(
    "own data: green, with its rule",
    said["light"] == "Green" and "25 %" in said["rule"] and "5 %" in said["rule"],
    said,
)
check(
    "own data: the verdict has the largest errors",
    f"within {worst:.2g} K" in said["verdict"]
    and f"largest error {max(l for _, l in e.values()):.2g} K" in text_of(own)
    and "the recordings that the models are from" in said["verdict"],
    (said, e),
)
check("own data: what to do, and whose", "another day" in said["action"] and said["identity"].startswith("arm 3"), said)
for joint in ("shoulder", "elbow"):
    shown = rows(own, joint)
    check(
        f"own data: errors of {joint} are those of --evaluate",
        [f"{x:.3f}" for x in e[joint, "monday.csv"]] == [shown[0][4], shown[0][6]],
        (shown, e),
    )
    check(
        f"own data: the band of {joint} is that of --evaluate and holds",
        float(shown[0][7]) == digits(bands("monday.csv")[joint]["half_width_K"], 3)
        and bands("monday.csv")[joint]["inside"] > 0.9,
        (shown, bands("monday.csv")),
    )
    for row in shown[1:]:
        p = found[joint]["parameters"][row[1]]
        check(
            f"own data: {joint}, {row[1]}",
            [float(x) for x in row[2:4]] == [digits(p["value"], 4), digits(p["sigma"], 2)],
            (row, p),
        )
check("own data: figures have their band", own.count("95 % band") >= 4 and "with the band of 95 %" in own)
check("own data: every figure is a file", len(os.listdir(path("own_figures"))) == 4, os.listdir(path("own_figures")))

# Of another day.
r = run(report, "thermal", "thermal.yaml", "tuesday.csv", "-o", "tuesday.html")
said, e = opening(content("tuesday.html")), errors("tuesday.csv")
check(
    "another day: said, and green",
    said["light"] == "Green"
    and "have not seen" in said["verdict"]
    and f"within {max(rms for rms, _ in e.values()):.2g} K" in said["verdict"],
    (said, e),
)

b = bands("tuesday.csv")
check(
    "another day: the band is wider, by surroundings that one day does not show, and says so",
    all(b[j]["half_width_K"] > 3 * bands("monday.csv")[j]["half_width_K"] and b[j]["half_width_K"] < 8 for j in b)
    and "one day shows none" in content("tuesday.html")
    and "100 % lie within their 95 % band" in text_of(content("tuesday.html")),
    (b, said),
)
text = content("thermal.yaml")
with open(path("known.yaml"), "w") as f:
    f.write(text.replace("deviation_K: 2", "deviation_K: 0.1"))
run(report, "thermal", "known.yaml", "tuesday.csv", "-o", "known.html")
check("another day: surroundings that are known make it narrow", "vary by 0.1 K" in content("known.html"))
with open(path("vague.yaml"), "w") as f:
    f.write(text.replace("deviation_K: 2", "deviation_K: 40"))
run(report, "thermal", "vague.yaml", "tuesday.csv", "-o", "vague.html")
wide = [f for f in re.findall(r"<figure.*?</figure>", content("vague.html"), re.S) if "leaves the figure" in f]
check("a band that would flatten the curves leaves both figures", len(wide) == 2, len(wide))
for figure in wide:
    data = json.loads(html.unescape(re.search(r'data-figure="([^"]*)"', figure)[1]))
    curves = [v for s in data["series"] if s["label"] in ("recorded", "predicted") for v in s["y"]]
    height = data["y"]["to"] - data["y"]["from"]
    check("its axis follows the curves", height < 3.01 * (max(curves) - min(curves)), (height, data["y"]))
with open(path("earlier.yaml"), "w") as f:
    f.write(re.sub(r"    uncertainty:\n(      .*\n)+", "", text))
run(report, "thermal", "earlier.yaml", "tuesday.csv", "-o", "earlier.html")
check(
    "a file of an earlier version: no band, and why",
    "uncertainty" not in content("earlier.yaml")
    and "There is no band" in content("earlier.html")
    and "lie within" not in text_of(content("earlier.html")),
    opening(content("earlier.html")),
)

# The models' own recording by another path, alone and beside an unseen one.
for name, data, says in (
    ("own", ["./monday.csv"], "of the recordings that the models are from are"),
    ("mixed", ["./monday.csv", "tuesday.csv"], "of recordings, 1 of which the models are from, are"),
):
    run(report, "thermal", "thermal.yaml", *data, "-o", name + ".html")
    said = opening(content(name + ".html"))
    check(
        name + ": what the models have seen is not called unseen",
        says in said["verdict"] and "another day" in said["action"],
        said,
    )

hold_numbers("own.html", "thermal.yaml", ["./monday.csv"], "monday.csv")

# A joint that something else heats.
r = run(report, "thermal", "thermal.yaml", "tuesday.csv", "faulty.csv", "-o", "faulty.html")
hold_numbers("faulty.html", "thermal.yaml", ["tuesday.csv", "faulty.csv"], "tuesday.csv", "faulty.csv")
said = opening(content("faulty.html"))
check(
    "a fault: red, and the joint is named",
    said["light"] == "Red"
    and "elbow is worst" in said["verdict"]
    and "do not use the model of elbow" in said["action"],
    said,
)

# Seven minutes identify nothing: amber, no numbers that are none.
recording("short.csv", 4, 30, hours=0.12)
r = run(twin, "thermal", "short.csv", "-o", "short.yaml", "--json")
lacking = {j: [n for n in x["unidentifiable"] if n != "T_amb"] for j, x in json.loads(r.stdout)["joints"].items()}
check("a short record lacks parameters", all(lacking.values()), lacking)
run(report, "thermal", "short.yaml", "-o", "short.html")
hold_numbers("short.html", "short.yaml", [], "short.csv")
short = content("short.html")
said = opening(short)
check("a short record: amber, and what to record", said["light"] == "Amber" and "record longer" in said["action"], said)
count = sum(map(len, lacking.values()))
check(
    "a short record: the verdict says first how much is identified, and no number in the head is green",
    said["verdict"].startswith(
        "None of the 4 parameters is identified." if count == 4 else f"{4 - count} of 4 parameters"
    )
    and opening(own)["verdict"].startswith("All 4 parameters are identified.")
    and 'value good">' not in short,
    (said, count),
)
check(
    "a short record: its identity is the recording, not the file of the models",
    "recording: short.csv" in said["identity"],
)
check(
    "a short record: its parameters are no numbers",
    all(row[2] == "–" and row[3] == "–" for j in lacking for row in rows(short, j)[1:] if row[1] in lacking[j])
    and sum(row[2] == "–" for j in lacking for row in rows(short, j)[1:]) == sum(map(len, lacking.values())),
    (lacking, [rows(short, j) for j in lacking]),
)

# Power that never changes: what it heats and the surroundings are one.
time_s = np.arange(0, 900, STEP_S)
steady = 24 + 2 * (1 - np.exp(-time_s / 1000)) + np.random.default_rng(5).normal(0, 0.03, time_s.size)
np.savetxt(
    path("steady.csv"),
    np.column_stack([time_s, np.full(time_s.size, 30), steady]),
    delimiter=",",
    header="time_s,power_elbow_w,temperature_elbow_degC",
    comments="",
)
r = run(twin, "thermal", "steady.csv", "-o", "steady.yaml")
run(report, "thermal", "steady.yaml", "-o", "steady.html")
check(
    "steady power: no band, and no numbers that no joint has",
    "power that never changes" in content("steady.html")
    and "e+" not in r.stdout + opening(content("steady.html"))["verdict"],
    r.stdout,
)

# A chain.
r = run(twin, "thermal", "monday.csv", "--chain", "-o", "chain.yaml", "--quiet")
r = run(report, "thermal", "chain.yaml", "-o", "chain.html")
check(
    "a chain: its exchange is in the table",
    r.returncode == 0 and rows(content("chain.html"), "all")[0][1] == "exchange",
    r,
)

hold_numbers("chain.html", "chain.yaml", [], "monday.csv")
linked("linked.csv", 6, (30, 20, 10))
linked("next.csv", 7, (20, 30, 15))
r = run(twin, "thermal", "linked.csv", "--chain", "-o", "linked.yaml", "--quiet")
noise_K = float(re.search(r"white_K: ([\d.]+)", content("linked.yaml"))[1])
check("a chain: its band has the noise of the samples, 20 mK, and no warming", abs(noise_K / 0.02 - 1) < 0.1, noise_K)
for name, given in (("linked", []), ("next", ["next.csv"]), ("both", ["linked.csv", "next.csv"])):
    run(report, "thermal", "linked.yaml", *given, "-o", name + ".html")
    hold_numbers(name + ".html", "linked.yaml", given, *(given or ["linked.csv"]))

# Models of several days, which show how surroundings vary: one by one, and in a chain.
for name, chain, days in (
    ("several", [], ["monday.csv", "tuesday.csv"]),
    ("chains", ["--chain"], ["linked.csv", "next.csv"]),
):
    run(twin, "thermal", *days, *chain, "-o", name + ".yaml", "--quiet")
    check(name + ": of two days", "days: 2" in content(name + ".yaml"), content(name + ".yaml"))
    run(report, "thermal", name + ".yaml", "-o", name + ".html")
    hold_numbers(name + ".html", name + ".yaml", [], *days)
linked("third.csv", 10, (25, 10, 20))
run(report, "thermal", "chains.yaml", "third.csv", "-o", "third.html")
hold_numbers("third.html", "chains.yaml", ["third.csv"], "third.csv")

# Two bodies in one joint.
bodies = [(1.2e-3, 400.0), (3e-4, 3500.0)]
linked("two.csv", 8, (20,), bodies)
linked("hotter.csv", 9, (30,), bodies)
run(twin, "thermal", "two.csv", "--order", "2", "--rested", "-o", "two.yaml", "--quiet")
for name, given in (("two", []), ("hotter", ["hotter.csv"])):
    run(report, "thermal", "two.yaml", *given, "-o", name + ".html")
    hold_numbers(name + ".html", "two.yaml", given, *(given or ["two.csv"]))

# Wrong input.
refused = lambda name, *arguments, says: check_refused(name, run(report, "thermal", *arguments, "-o", "x.html"), says)
os.rename(path("short.csv"), path("away.csv"))
refused("data that are gone", "short.yaml", says=["short.yaml: data: short.csv is neither in the working directory"])
with open(path("other.csv"), "w") as f:
    f.write(content("monday.csv").replace("elbow", "wrist"))
refused("another robot's data", "thermal.yaml", "other.csv", says=["thermal.yaml: joints: has no 'wrist'", "other.csv"])
with open(path("law.yaml"), "w") as f:
    f.write("law: stribeck\nparameters: {}\n")
refused(
    "a file of another kind", "law.yaml", "monday.csv", says=["law.yaml", "tribotwin identify", "tribotwin thermal"]
)
with open(path("broken.yaml"), "w") as f:
    f.write(text.replace("covariance: [[", "covariance: [[1, "))
refused("a broken covariance", "broken.yaml", "monday.csv", says=["broken.yaml:", "covariance", "3 list(s) of 3"])
check("nothing is left of what failed", not os.path.exists(path("x.html")))
finish()
