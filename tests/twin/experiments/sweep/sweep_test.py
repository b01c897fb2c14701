"""tribotwin sweep as its user meets it: results, resumption, refusals. Arguments: program, source tree."""
import csv, json, os, re, signal, subprocess, sys, time

import h5py
import numpy as np

import harness
from harness import check, check_refused, content, finish, path, work
from pendulum import PENDULUM

program, source = sys.argv[1], sys.argv[2]


def run(*arguments, **options):
    return harness.run(program, "sweep", *arguments, **options)


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


RESULTS = ("results.csv", "results.h5", "statistics.json", "bands.csv")


def bytes_of(folder):
    return [open(path(folder, name), "rb").read() for name in RESULTS]


def statistics(folder):
    return json.loads(content(folder + "/statistics.json"))


write("pendulum.xml", PENDULUM)
write(
    "scenario.yaml",
    "model: pendulum.xml\nduration_s: 2\n"
    "motion: {type: cycle, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}], speed_rad_s: 2}\n",
)
SMALL = """scenario: scenario.yaml
set: {duration_s: 1}
factors:
  temperature_degC: {uniform: [20, 40]}
  drives.hinge.Fc0: {normal: [0.03, 0.002]}
  seed: [1, 2, 3]
design: {type: sobol, runs: 40, seed: 3}
outputs:
  - heat_J
  - joints.hinge.temperature_degC.end
  - time_above(hinge.velocity_rad_s, 0.5)
  - max_abs(hinge.friction_nm)
bands: {telemetry: [hinge.friction_nm], times: 11}
"""
write("small.yaml", SMALL)

# ---- A whole sweep.
r = run("small.yaml", "-o", "one", "--threads", "1")
check("exits 0", r.returncode == 0, r.stderr)
check("says what it did", "40 runs, 0 of them from earlier calls, 0 failed" in r.stdout, r.stdout)
rows = list(csv.DictReader(open(path("one", "results.csv"))))
above = statistics("one")["outputs"]["time_above(hinge.velocity_rad_s, 0.5)"]["mean"]["confidence_95"]
check("the interval of a time lies in the run", 0 <= above[0] < above[1] <= 1, above)
columns = "run temperature_degC drives.hinge.Fc0 seed heat_J joints.hinge.temperature_degC.end".split()
columns += ["time_above(hinge.velocity_rad_s, 0.5)", "max_abs(hinge.friction_nm)", "status", "message"]
check("results.csv: its columns", list(rows[0]) == columns and len(rows) == 40, list(rows[0]))
check("results.csv: all runs are as asked", {row["status"] for row in rows} == {"ok"}, rows[0])
heat = np.array([float(row["heat_J"]) for row in rows])
found = statistics("one")["outputs"]["heat_J"]
check("statistics: the mean", abs(found["mean"]["value"] - heat.mean()) < 1e-12 * heat.mean(), found)
check("statistics: the deviation", abs(found["deviation"]["value"] - heat.std(ddof=1)) < 1e-9 * heat.std(), found)
check(
    "statistics: friction makes the heat, the temperature does not",
    found["rank_correlations"]["drives.hinge.Fc0"]["confidence_95"][0] > 0.9
    and abs(found["rank_correlations"]["temperature_degC"]["value"]) < 0.5,
    found["rank_correlations"],
)
with h5py.File(path("one", "results.h5")) as file:
    same = np.array_equal(file["outputs/heat_J"], heat) and file["status"].asstr()[0] == "ok"
    same &= np.array_equal(file["factors/seed"], [float(row["seed"]) for row in rows])
    check("results.h5: the same numbers", same, list(file))
    middle = file["bands/hinge.friction_nm/q0.5"][:]
bands = list(csv.DictReader(open(path("one", "bands.csv"))))
check("bands.csv: the same numbers", [float(b["hinge.friction_nm.q0.5"]) for b in bands] == list(middle), bands[0])

# ---- A run of the sweep is that of tribotwin run.
r = run("small.yaml", "-o", "seven", "--run", "7")
summary = json.loads(content("seven/summary.json"))
check("--run: the summary's heat", r.returncode == 0 and summary["heat_J"] == heat[7], (r.stderr, summary["heat_J"]))
with h5py.File(path("seven", "telemetry.h5")) as file:
    t, v, f = file["time_s"][:], file["hinge/velocity_rad_s"][:], file["hinge/friction_nm"][:]
check("figures: the largest magnitude", float(rows[7]["max_abs(hinge.friction_nm)"]) == np.abs(f).max())
above = float(rows[7]["time_above(hinge.velocity_rad_s, 0.5)"])
check("figures: the time above", abs(above - 0.01 * np.sum(v > 0.5)) < 1e-9, above)
line = json.loads(content("one/runs/0000007.json"))
times = [float(b["time_s"]) for b in bands]
exact = [f[np.argmin(np.abs(t - x))] for x in times]
check("bands: the exact samples", line["bands"][0] == exact and max(np.abs(t[:, None] - times).min(0)) < 1e-9, times)
r = harness.run(program, "run", "seven/scenario.yaml", "-o", "eight", "--quiet")
check("its scenario.yaml repeats it", json.loads(content("eight/summary.json"))["heat_J"] == heat[7], r.stderr)

# ---- Threads, resumption.
r = run("small.yaml", "-o", "threads", "--threads", "8", "--quiet")
check("eight threads: the same bytes", r.returncode == 0 and bytes_of("threads") == bytes_of("one"), r.stderr)
r = run("small.yaml", "-o", "one")
check("nothing left to do", r.returncode == 0 and "40 of them from earlier calls" in r.stdout, (r.stdout, r.stderr))
write("longer.yaml", SMALL.replace("duration_s: 1", "duration_s: 20"))
run("longer.yaml", "-o", "whole", "--quiet")
for name, how in (("kill", signal.SIGKILL), ("interrupt", signal.SIGINT)):
    p = subprocess.Popen(
        [program, "sweep", "longer.yaml", "-o", name, "--threads", "2"], cwd=work, stderr=subprocess.PIPE
    )
    end = time.time() + 60
    while time.time() < end and not (os.path.isdir(path(name, "runs")) and len(os.listdir(path(name, "runs"))) >= 5):
        time.sleep(0.005)
    status = json.loads(run("-o", name, "--status", "--json").stdout)
    check(name + ": --status while it works", status["planned"] == 40 and 4 <= status["present"] < 40, status)
    p.send_signal(how)
    said = p.communicate()[1].decode()
    check(name + ": not finished", p.returncode != 0 and not os.path.exists(path(name, "results.csv")), p.returncode)
    if how == signal.SIGINT:
        check("interrupt: says how it goes on", p.returncode == 1 and "the same command goes on" in said, said)
        check("interrupt: no litter", not [n for n in os.listdir(path(name, "runs")) if "partial" in n])
    r = run("longer.yaml", "-o", name)
    present = int(r.stdout.split("runs, ")[1].split()[0]) if "runs, " in r.stdout else -1
    check(name + ": goes on", r.returncode == 0 and 4 <= present < 40, (r.stdout, r.stderr))
    check(name + ": the same bytes", bytes_of(name) == bytes_of("whole"))
# A process of runs that is killed: its run is made again, and nothing else is lost.
p = subprocess.Popen(
    [program, "sweep", "longer.yaml", "-o", "crash", "--threads", "2"],
    cwd=work,
    stdout=subprocess.PIPE,
    stderr=subprocess.PIPE,
)
killed, made = 0, 0
while p.poll() is None and killed < 3:
    runs = len(os.listdir(path("crash", "runs"))) if os.path.isdir(path("crash", "runs")) else 0
    processes = open(f"/proc/{p.pid}/task/{p.pid}/children").read().split()
    if runs >= made and len(processes) == 2:
        os.kill(int(processes[killed % 2]), signal.SIGKILL)
        killed, made = killed + 1, runs + 5
    time.sleep(0.002)
said = [text.decode() for text in p.communicate()]
check("killed processes: three of them", killed == 3, killed)
check("killed processes: the sweep is whole", p.returncode == 0 and "0 failed" in said[0], (p.returncode, said))
check("killed processes: the same bytes", bytes_of("crash") == bytes_of("whole"))
# A run that failed is made by the next call, and the results follow.
p = subprocess.Popen(
    [program, "sweep", "longer.yaml", "-o", "again", "--threads", "1", "--retries", "0", "--quiet"], cwd=work
)
while p.poll() is None and not os.path.exists(path("again", "runs", "0000001.json")):
    time.sleep(0.002)
os.kill(int(open(f"/proc/{p.pid}/task/{p.pid}/children").read().split()[0]), signal.SIGKILL)
check("a killed run: the sweep is complete, and exits 1", p.wait() == 1 and "signal 9" in content("again/results.csv"))
r = run("longer.yaml", "-o", "again")
check(
    "a killed run: made by the next call",
    r.returncode == 0 and "39 of them from earlier" in r.stdout,
    (r.stdout, r.stderr),
)
check("a killed run: then the same bytes", bytes_of("again") == bytes_of("whole"))
with open(path("again", "results.csv"), "a") as file:
    file.write("a note\n")
r = run("longer.yaml", "-o", "again")
check("results that the user changed stay", r.returncode == 2 and "was changed since it was made" in r.stderr, r.stderr)
status = json.loads(run("-o", "kill", "--status", "--json").stdout)
check("--status after it", status["finished"] and status["present"] == 40 and status["failed"] == 0, status)

# ---- Records of all runs on request.
write("records.yaml", SMALL + "telemetry: true\n")
r = run("records.yaml", "--dry-run", "--json")
foretold_MB = json.loads(r.stdout)["telemetry_MB"]
r = run("records.yaml", "-o", "records", "--quiet")
# results.h5 names its plan.
same = [a == b for a, b in zip(bytes_of("records"), bytes_of("one"))]
check("telemetry: the same results", r.returncode == 0 and same == [True, False, True, True], (same, r.stderr))
folders = sorted(os.listdir(path("records", "telemetry")))
check("telemetry: a folder per run", folders == ["%07d" % i for i in range(40)], folders)
with h5py.File(path("records/telemetry/0000007/telemetry.h5")) as file:
    check("telemetry: that of --run", np.array_equal(file["hinge/friction_nm"], f))
MB = (
    sum(
        os.path.getsize(path("records/telemetry", n, k))
        for n in folders
        for k in os.listdir(path("records/telemetry", n))
    )
    / 1e6
)
check("telemetry: --dry-run foretells its size", abs(foretold_MB / MB - 1) < 0.1, (foretold_MB, MB))
os.remove(path("records/telemetry/0000007/telemetry.h5"))
r = run("records.yaml", "-o", "records")
check("telemetry: a lost record is made again", "39 of them from earlier calls" in r.stdout, r.stdout)
check("telemetry: and is there", os.path.exists(path("records/telemetry/0000007/telemetry.h5")))

# ---- Failed runs: the rest is complete, and the exit code says it.
write("wide.yaml", SMALL.replace("{normal: [0.03, 0.002]}", "{normal: [0.03, 0.03]}"))
r = run("wide.yaml", "-o", "wide")
rows = list(csv.DictReader(open(path("wide", "results.csv"))))
failed = [row for row in rows if row["status"] == "failed"]
check(
    "failed runs: exit code 1 and the first one",
    r.returncode == 1 and f"the first is run {failed[0]['run']}" in r.stderr,
    r.stderr,
)
check(
    "failed runs: those with negative friction, and why",
    {row["run"] for row in failed} == {row["run"] for row in rows if float(row["drives.hinge.Fc0"]) < 0}
    and all("Fc0" in row["message"] and row["heat_J"] == "" for row in failed),
    failed,
)
check(
    "failed runs: statistics say it", any("runs failed" in n for n in statistics("wide")["notes"]), statistics("wide")
)
write("stopped.yaml", open(path("wide.yaml")).read() + "stop: {failures: 1}\n")
r = run("stopped.yaml", "-o", "stopped")
check("stop: after failures", r.returncode == 1 and "stopped after 32 of 40" in r.stderr, r.stderr)

# ---- Runs that fail while they work: tried again, then recorded as the others.
write(
    "strict.xml",
    PENDULUM.replace('<config key="load_max"', '<config key="validity" value="error"/><config key="load_max"'),
)
write("strict_scenario.yaml", content("scenario.yaml").replace("pendulum.xml", "strict.xml"))
write(
    "strict.yaml",
    "scenario: strict_scenario.yaml\nset: {duration_s: 1}\noutputs: [heat_J]\ndesign: {type: grid}\n"
    "factors: {drives.hinge.load_max: [0.4, 1.2], temperature_degC: [20, 30]}\n",
)
for name, arguments in {"strict": ("--retries", "0"), "stricter": ("--retries", "3", "--threads", "4")}.items():
    r = run("strict.yaml", "-o", name, *arguments)
    rows = list(csv.DictReader(open(path(name, "results.csv"))))
    check(f"{name}: the sweep is complete", [x["status"] for x in rows] == ["failed"] * 2 + ["ok"] * 2, rows)
    check(f"{name}: says why", r.returncode == 1 and "left the range" in r.stderr and "left" in rows[0]["message"], r)
check("failures: the same bytes", content("strict/results.h5", "rb") == content("stricter/results.h5", "rb"))
r = run("strict.yaml", "-o", "strict")
check("failures: tried again by the next call", r.returncode == 1 and "2 of them from earlier calls" in r.stdout, r)

# ---- Stop rules and indices.
enough = SMALL.replace("runs: 40", "runs: 400").replace("seed: [1, 2, 3]", "telemetry_rate_hz: [100, 200]")
write("enough.yaml", enough + "stop: {narrower_than: {heat_J: %g}}\n" % (heat.std() / 2))
r = run("enough.yaml", "-o", "enough", "--json")
j = json.loads(r.stdout)
interval = j["outputs"]["heat_J"]["mean"]["confidence_95"]
check("stop: the mean is known", j["runs"]["made"] in (64, 96, 128) and "narrower" in j["stopped"], j["runs"])
check("stop: its interval is as narrow", interval[1] - interval[0] < heat.std() / 2, interval)
write("indices.yaml", SMALL.replace("seed: 3}", "seed: 3, indices: true}").replace("runs: 40", "runs: 81"))
r = run("indices.yaml", "-o", "indices", "--json")
j = json.loads(r.stdout)
share = j["outputs"]["heat_J"]["sobol_indices"]
check(
    "indices: whole base points, and it is said",
    j["runs"]["made"] == 80 and "80 of 81 runs" in j["notes"][0],
    j["notes"],
)
low, high = share["drives.hinge.Fc0"]["total"]["confidence_95"]
check("indices: of the friction, which has all the effect", 0.3 < low < 1 < high, share)
check("indices: of what has no effect", share["temperature_degC"]["total"]["value"] == 0, share)
write(
    "grid.yaml",
    "scenario: scenario.yaml\nset: {duration_s: 1}\nfactors: {drives.hinge.Fc0: {from: 0.02, to: 0.04, count: 3},"
    " integrator: [Euler, implicit]}\ndesign: {type: grid}\noutputs: {heat: heat_J}\n",
)
r = run("grid.yaml", "-o", "grid", "--json")
j = json.loads(r.stdout)
rows = list(csv.DictReader(open(path("grid", "results.csv"))))
check(
    "grid: all combinations",
    [(x["drives.hinge.Fc0"], x["integrator"]) for x in rows][:3]
    == [("0.02", "Euler"), ("0.02", "implicit"), ("0.03", "Euler")]
    and len(rows) == 6,
    rows,
)
check(
    "grid: indices without intervals",
    j["outputs"]["heat"]["sobol_indices"]["drives.hinge.Fc0"]["first"]["confidence_95"] is None,
    j,
)
check("grid: a column by name", "heat" in rows[0] and not os.path.exists(path("grid", "bands.csv")), rows[0])

# ---- --dry-run.
before = sorted(os.listdir(work))
r = run("small.yaml", "--dry-run", "--json")
j = json.loads(r.stdout)
check("--dry-run: foretells", j["runs"] == 40 and j["status"] == "ok" and j["seconds"] >= j["seconds_of_one"] > 0, j)
r = run("small.yaml", "--dry-run")
table = [line.split() for line in r.stdout.splitlines()[-5:]]
check(
    "--dry-run: a table of its outputs, with digits that matter",
    table[0] == ["output", "run", "0"]
    and all(re.fullmatch(r"-|-?[\d.]{1,10}(e[+-]\d+)?", row[-1]) for row in table[1:])
    and len({len(line.rstrip()) for line in r.stdout.splitlines()[-5:]}) == 1,
    r.stdout,
)
check("--dry-run: writes nothing", sorted(os.listdir(work)) == before)

# ---- Plans that make no sense: place, what would be right, nothing written.
parameters = "law: load\nparameters: {Fc0: 0.03, Fcl: 0.3, Fs0: 0, Fsl: 0.1, vs: 100, alpha: 1.4, Fv: 3e-5}\n"
write("exact.yaml", parameters)
for name, old, new, says in (
    ("an unknown key", "set:", "sett:", ["plan.yaml:2: sett", "did you mean 'set'"]),
    ("no scenario", "scenario: scenario.yaml", "scenario: nowhere.yaml", ["plan.yaml:1: scenario", "does not exist"]),
    ("a key that the scenario has not", "{duration_s: 1}", "{duration: 1}", ["duration", "did you mean 'duration_s'"]),
    ("vary", "{duration_s: 1}", "{vary: []}", ["plan.yaml:2: set", "use factors"]),
    ("a key twice", "{duration_s: 1}", "{temperature_degC: 5}", ["temperature_degC", "give each key"]),
    ("a part of a key", "{duration_s: 1}", "{drives: {hinge: {Fc0: 1}}}", ["drives.hinge.Fc0", "give each key"]),
    ("an empty list", "[1, 2, 3]", "[]", ["plan.yaml:6: factors.seed", "at least one value"]),
    ("a value twice", "[1, 2, 3]", "[1, 2, 1]", ["factors.seed", "1 twice"]),
    ("a factor that is a number", "[1, 2, 3]", "4", ["plan.yaml:6: factors.seed", "{from: A, to: B, count: N}"]),
    ("steps that stand still", "[1, 2, 3]", "{from: 1, to: 1, count: 2}", ["factors.seed.to", "would not vary"]),
    ("one step", "[1, 2, 3]", "{from: 1, to: 2, count: 1}", ["factors.seed.count", "within 2"]),
    ("an unknown distribution", "uniform: [20, 40]", "uniforn: [20, 40]", ["plan.yaml:4", "{uniform: [A, B]}"]),
    ("uniform backwards", "uniform: [20, 40]", "uniform: [40, 20]", ["factors.temperature_degC.uniform", "below HIGH"]),
    ("normal without spread", "[0.03, 0.002]", "[0.03, 0]", ["factors.drives.hinge.Fc0.normal", "above 0"]),
    (
        "an end that the scenario refuses",
        "uniform: [20, 40]",
        "uniform: [20, 4000]",
        ["plan.yaml:4: factors.temperature_degC: 4000", "-100 .. 300"],
    ),
    ("a joint that is not there", "drives.hinge.Fc0", "drives.knee.Fc0", ["knee", "hinge"]),
    ("a parameter that the law has not", "drives.hinge.Fc0", "drives.hinge.Fc9", ["Fc9"]),
    ("no design", "design:", "desing:", ["did you mean 'design'"]),
    ("an unknown design", "type: sobol", "type: sobel", ["plan.yaml:7: design.type", "did you mean 'sobol'"]),
    (
        "a grid over distributions",
        "{type: sobol, runs: 40, seed: 3}",
        "{type: grid}",
        ["design.type", "temperature_degC"],
    ),
    ("no number of runs", "runs: 40, ", "", ["design.runs"]),
    ("too few runs", "runs: 40", "runs: 1", ["design.runs", "within 2"]),
    ("an output that is not there", "- heat_J", "- heat_W", ["plan.yaml:8: outputs", "heat_W", "heat_J"]),
    ("an output that is no number", "- heat_J", "- joints.hinge", ["outputs", "no number", "temperature_degC"]),
    ("an output of the computer", "- heat_J", "- wall_s", ["outputs", "property of the computer"]),
    ("an output twice", "- heat_J", "- heat_J\n  - heat_J", ["outputs", "given twice"]),
    ("an unknown figure", "max_abs(", "maxabs(", ["outputs", "did you mean 'max_abs'"]),
    ("a channel that is not there", "hinge.friction_nm)", "hinge.friction)", ["outputs", "no channel", "friction_nm"]),
    ("a figure without its threshold", ", 0.5)", ")", ["outputs", "time_above(JOINT.CHANNEL, THRESHOLD)"]),
    ("a threshold that is no number", ", 0.5)", ", fast)", ["outputs", "'fast'"]),
    ("an open parenthesis", "friction_nm)", "friction_nm", ["outputs", "must end with ')'"]),
    ("a band that is not there", "[hinge.friction_nm]", "[hinge]", ["plan.yaml:13: bands.telemetry", "JOINT.CHANNEL"]),
    ("one time", "times: 11", "times: 1", ["bands.times", "within 2"]),
    ("times backwards", "times: 11", "times_s: [1, 0]", ["bands.times_s", "ascending"]),
    ("times beyond the run", "times: 11", "times_s: [0, 3]", ["bands.times_s", "lasts 1 s"]),
    (
        "skipped cycles",
        "set: {duration_s: 1}",
        "set: {multirate: {tolerance_K: 2}}",
        ["outputs", "cycle_temperature_degC"],
    ),
    ("quantiles backwards", "bands:", "quantiles: [0.9, 0.1]\nbands:", ["plan.yaml:13: quantiles", "ascending"]),
    ("an empty stop", "bands:", "stop: {}\nbands:", ["plan.yaml:13: stop", "narrower_than"]),
    (
        "a stop at what is no output",
        "bands:",
        "stop: {narrower_than: {heat: 1}}\nbands:",
        ["stop.narrower_than.heat", "did you mean 'heat_J'"],
    ),
    (
        "parameters that are not there",
        "bands:",
        "parameters: {hinge: no.yaml}\nbands:",
        ["plan.yaml:13: parameters.hinge", "does not exist"],
    ),
    ("no parameters", "bands:", "parameters: {}\nbands:", ["plan.yaml:13: parameters", "is empty", "PARAMS.yaml"]),
    (
        "parameters without a sigma",
        "bands:",
        "parameters: {hinge: exact.yaml}\nbands:",
        ["parameters.hinge", "nothing can be drawn"],
    ),
    (
        "parameters that are a scenario",
        "bands:",
        "parameters: scenario.yaml\nbands:",
        ["parameters", "tribotwin identify"],
    ),
):
    assert old in SMALL, old
    write("plan.yaml", SMALL.replace(old, new, 1))
    check_refused(f"nonsense: {name}", run("plan.yaml", "-o", "nonsense"), says, lines=None)
write("plan.yaml", SMALL.replace("seed: 3}", "seed: 3, indices: true}").replace("runs: 40", "runs: 39"))
check_refused("nonsense: too few runs for indices", run("plan.yaml", "-o", "nonsense"), ["design.runs", "at least 40"])
write("plan.yaml", SMALL.replace("sobol", "latin_hypercube") + "stop: {narrower_than: {heat_J: 1}}\n")
check_refused(
    "nonsense: a stop of an uneven beginning", run("plan.yaml", "-o", "nonsense"), ["stop", "sobol or random"]
)
check("nonsense: nothing was written", not os.path.exists(path("nonsense")))
write("plan.yaml", SMALL.replace("[0.03, 0.002]", "[0.03, 0.001]"))
check_refused("another plan in the folder", run("plan.yaml", "-o", "one"), "one: holds another campaign")
for wrong, says in (("many", "must be a finite number"), ("99999999999999", "must be within 1 .. 1e+07")):
    os.makedirs(path("edited"), exist_ok=True)
    write("edited/campaign.yaml", content("one/campaign.yaml").replace("\nruns: 40", f"\nruns: {wrong}"))
    r = run("-o", "edited", "--status", timeout=60)
    check_refused(f"--status of {wrong} runs", r, ["edited/campaign.yaml:", "runs", says])
check_refused("a folder of nothing", run("-o", "seven", "--status"), "holds no sweep")
check_refused("a run beyond the plan", run("small.yaml", "-o", "x", "--run", "40"), "the plan has the runs 0 .. 39")
check_refused("a run into the sweep's folder", run("small.yaml", "-o", "one", "--run", "3"), "one: holds a sweep")
check_refused("no folder", run("small.yaml"), "-o")

# ---- Parameters with their covariance.
write(
    "params.yaml",
    parameters.replace("0.03,", "0.031,")
    + "sigma: {Fc0: 0.001, Fcl: 0.02}\ncorrelation: {Fc0: [1, -0.9], Fcl: [-0.9, 1]}\n"
    "status: {Fc0: estimated, Fcl: estimated, Fs0: fixed, Fsl: fixed, vs: fixed, alpha: fixed, Fv: fixed}\n",
)
drawn = SMALL.replace("  drives.hinge.Fc0: {normal: [0.03, 0.002]}\n", "").replace(
    "bands:", "parameters: params.yaml\nbands:"
)
write("drawn.yaml", drawn.replace("runs: 40", "runs: 128"))
r = run("drawn.yaml", "-o", "drawn", "--quiet")
rows = list(csv.DictReader(open(path("drawn", "results.csv"))))
x = np.array([[float(row[f"drives.hinge.{p}"]) for p in ("Fc0", "Fcl")] for row in rows])
check(
    "parameters: the mean and the spread",
    np.allclose(x.mean(0), [0.031, 0.3], rtol=2e-3) and np.allclose(x.std(0), [0.001, 0.02], rtol=0.05),
    (x.mean(0), x.std(0)),
)
check("parameters: their correlation", abs(np.corrcoef(x.T)[0, 1] + 0.9) < 0.03, np.corrcoef(x.T))
write("params.yaml", content("params.yaml").replace("0.02}", "0.01}"))
check_refused("parameters that were changed", run("drawn.yaml", "-o", "drawn"), "drawn: holds another campaign")
finish()
