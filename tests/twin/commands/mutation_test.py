"""Every YAML and JSON file that the programs read, with one thing in it changed: null keys, other shapes, numbers that
are none, missing and doubled keys. Never a signal; exit code 0, 1, 2 or 3; a refusal is one line that names the file;
what is done holds no number that is none. Fixed seed. Arguments: tribotwin, source tree, tribotwin-hil[,
tribotwin-report]."""
import json, os, random, resource, shutil, subprocess, sys, tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import yaml

import harness
from harness import check, content, failures, finish, path, work

program, source, hil, *report = map(os.path.abspath, sys.argv[1:])
each = int(os.environ.get("TRIBOTWIN_MUTATIONS", "7" if harness.nightly else "2"))  # of a file
counts = {}
NULL = object()  # a key, written as ~


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
    resource.setrlimit(resource.RLIMIT_FSIZE, (64 << 20, 64 << 20))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def run(arguments, cwd):
    try:
        return harness.run(*arguments, errors="replace", cwd=cwd, timeout=60, preexec_fn=limited)
    except subprocess.TimeoutExpired:
        return None


# ---- Documents are mappings as lists of pairs: keys may come twice.
def pairs(value):
    if isinstance(value, dict):
        return ("map", [(k, pairs(v)) for k, v in value.items()])
    if isinstance(value, list):
        return ("list", [pairs(v) for v in value])
    return ("raw", value if isinstance(value, Literal) else json.dumps(value))


class Literal(str):
    """Text that goes into the file as it is."""


def text(node):
    kind, value = node
    if kind == "map":
        return "{" + ", ".join(("~" if k is NULL else json.dumps(str(k))) + ": " + text(v) for k, v in value) + "}"
    if kind == "list":
        return "[" + ", ".join(text(v) for v in value) + "]"
    return value


def places(node, path=()):
    kind, value = node
    for i, entry in enumerate(value if kind in ("map", "list") else ()):
        yield path + (i,)
        yield from places(entry[1] if kind == "map" else entry, path + (i,))


LITERALS = (
    "null",
    "1e308",
    "-1e308",
    "-1",
    "0",
    "1e999",
    '""',
    '"' + "x" * 5000 + '"',
    '"../../x"',
    "[]",
    "{}",
    "[[1]]",
    '{"a": 1}',
    "true",
    '"\\u0007"',
    "[null]",
)
YAML_ONLY = (".nan", ".inf", "~", "&a [*a]", "!!binary x", "0x10", "2026-01-01")


def mutated(node, random, is_yaml):
    path = random.choice(list(places(node)))

    def change(node, path):
        kind, value = node
        value = list(value)
        if len(path) > 1:
            inner = value[path[0]]
            value[path[0]] = (inner[0], change(inner[1], path[1:])) if kind == "map" else change(inner, path[1:])
            return (kind, value)
        i, how = path[0], random.random()
        if how < 0.6:
            new = ("raw", random.choice(LITERALS + (YAML_ONLY if is_yaml else ())))
            value[i] = (value[i][0], new) if kind == "map" else new
        elif how < 0.75:
            del value[i]
        elif how < 0.85:
            value.append(value[i])
        elif kind == "map":
            value[i] = (
                random.choice((NULL, "", "unknown", "x/../y") if is_yaml else ("", "unknown", "x/../y")),
                value[i][1],
            )
        else:
            value[i] = ("map", [("of", value[i])])
        return (kind, value)

    return change(node, path)


def finite_only(text):
    """No NaN and no infinity: json.loads takes them, the programs write null."""
    return json.loads(text, parse_constant=lambda name: failures.append("prints " + name))


def attack(name, file, document, command, seed):
    """`command(folder)` reads `file` of a folder of its own, which begins as a copy of `whole`."""
    chance = random.Random(seed)
    is_yaml = file.endswith(".yaml")
    folder = tempfile.mkdtemp(prefix="case_", dir=work)
    shutil.copytree(f"{work}/whole", folder, dirs_exist_ok=True)
    changed = text(mutated(pairs(document), chance, is_yaml))
    open(f"{folder}/{file}", "w").write(changed)
    r = run(command, folder)
    outcome = "hangs" if r is None else r.returncode
    wrong = None
    if r is None or r.returncode not in (0, 1, 2, 3):
        wrong = "crash or hang"
    elif "'none://'" in r.stderr or "holds another campaign" in r.stderr:
        outcome = 0  # read; what comes next has no bus, or works in another folder
    elif r.returncode in (1, 2) and (not r.stderr.strip() or os.path.basename(file) not in r.stderr):
        wrong = "the message does not name the file"
    elif r.returncode in (1, 2) and len(r.stderr.strip().splitlines()) > 1 + r.stderr.count("note: "):
        wrong = "more than a line"
    elif r.returncode == 0 and "--json" in command:
        before = len(failures)
        finite_only(r.stdout)
        wrong = "a number that is none" if len(failures) > before else None
    shutil.rmtree(folder)
    return outcome, wrong and (
        name,
        seed,
        wrong,
        outcome,
        r and r.stderr[-400:],
        changed[:1500] if len(changed) < 20000 else text(pairs("long")),
    )


# ---- One whole example of everything.
def make(*command):
    r = run(command, f"{work}/whole")
    assert r and r.returncode == 0, (command, r and r.stderr)


def put(name, content):
    os.makedirs(os.path.dirname(f"{work}/whole/{name}"), exist_ok=True)
    open(f"{work}/whole/{name}", "w").write(content)


def read(name):
    return yaml.safe_load(open(f"{work}/whole/{name}"))


os.makedirs(f"{work}/whole")
speeds = np.geomspace(1, 280, 12)
put(
    "curve.csv",
    "curve,speed_rad_s,friction_norm,friction_nm,load_norm,temperature_degC\n"
    + "".join(
        f"{c + 1},{v},{f},{10 * f},0.01,{20 + c}\n"
        for c in range(10)
        for v in speeds
        for f in [
            0.05 + 0.02 * np.exp(-v / (8 + 0.3 * c)) + (3 - 0.1 * c) * 1e-4 * v**0.9 + 1e-4 * np.sin(37 * c + v)
        ]
    ),
)
make(
    program,
    "identify",
    "--law",
    "stribeck",
    "curve.csv",
    "-o",
    "params.yaml",
    "--tau-max",
    "10",
    "--gear-ratio",
    "100",
    "--quiet",
)
make(program, "diagnose", "learn", "curve.csv", "-o", "healthy.yaml", "--quiet")
time = np.arange(0, 7200, 20.0)
put(
    "heat.csv",
    "time_s,power_w_arm,temperature_arm_degC,power_w_hand,temperature_hand_degC\n"
    + "".join(
        f"{t},{1 + np.sin(t / 300)},{20 + 5 * (1 - np.exp(-t / 900)) + 0.3 * np.cos(t / 300)},"
        f"{1 + np.cos(t / 400)},{21 + 3 * (1 - np.exp(-t / 700))}\n"
        for t in time
    ),
)
make(program, "thermal", "heat.csv", "-o", "thermal.yaml", "--quiet")
make(program, "thermal", "heat.csv", "--chain", "-o", "chain.yaml", "--quiet")
shutil.copy(f"{source}/mjcf/scene.xml", f"{work}/whole/scene.xml")
for model in ("xl330_pendulum", "irb6620", "br609", "er3a_c60"):
    shutil.copy(f"{source}/mjcf/{model}.xml", f"{work}/whole/{model}.xml")
put(
    "goals.json",
    json.dumps(
        {
            "kp": 400,
            "entries": [
                {"timestamp": 0.02 * i, "goal_position": 0.5, "position": 0.02 * i, "temp": 30, "torque_enable": True}
                for i in range(20)
            ],
        }
    ),
)
scenario = {
    "name": "a",
    "model": "irb6620.xml",
    "duration_s": 0.05,
    "seed": 1,
    "keyframe": "home",
    "temperature_degC": {"joint2": 40},
    "ambient_degC": 22,
    "telemetry_rate_hz": 50,
    "motion": {
        "type": "cycle",
        "speed_share": 0.5,
        "ramp_s": 0.4,
        "waypoints": [{"position_rad": {"joint1": 0.1}}, {"position_rad": {"joint1": -0.1}}],
    },
    "control": {"type": "servo", "speed_bandwidth_rad_s": 40},
    "multirate": {"enabled": True, "tolerance_K": 2},
    "events": [
        {"time_s": 0.01, "type": "payload", "mass_kg": 3, "com_m": [0, 0, 0.1]},
        {"time_s": 0.02, "type": "ambient", "temperature_degC": 30},
        {"time_s": 0.03, "type": "wear", "joint": "joint2", "factors": {"Fc0": 1.2}},
    ],
}
replay = {
    "model": "xl330_pendulum.xml",
    "motion": {"type": "recording", "file": "goals.json", "delay_s": 0.01},
    "control": {"type": "dc_position", "error_gain": 0.002, "supply_V": 7.4, "resistance_ohm": 3, "kt_nm_A": 0.4},
}
varied = {
    "model": "xl330_pendulum.xml",
    "duration_s": 0.02,
    "motion": {"type": "hold"},
    "vary": [{"temperature_degC": [20, 30], "seed": [1]}],
}
campaign = {
    "model": "irb6620.xml",
    "joint": "joint2",
    "procedure": "plus_minus",
    "speeds_rad_s": [10, 30],
    "seed": 3,
    "start_rad": {"joint2": 0.1},
    "sensors": {"torque_noise_nm": 20, "sampling_hz": 250},
    "drive": {"temperature_min_degC": 30},
    "series": [{"name": "s", "load": {"by": "torque", "norm": [0.1]}, "temperature": {"prescribed_degC": [40]}}],
}
study = {
    "model": "br609.xml",
    "procedure": "test_cycle",
    "joints": {"joint3": {}},
    "diagnosis": {"learn": ["l"], "check": [{"series": "l", "state": "cold"}], "false_alarm": 0.01, "draws": 0},
    "series": [
        {
            "name": "l",
            "load": {"by": "payload", "mass_kg": 0},
            "temperature": {"prescribed_degC": [20, 22, 24, 26, 28, 30, 32, 34]},
        }
    ],
}
days = {
    "procedure": "working_days",
    "model": f"{work}/whole/er3a_c60.xml",
    "robots": 1,
    "days": 1,
    "duration_s": 510,
    "scatter": {"friction": 0.08},
    "excitation": {"evaluations": 60, "heating_s": 10},
}
fit = {
    "recordings": {"files": f"{work}/whole/goals.json"},
    "search": {"starts": 1, "evaluations": 20},
    "variants": [
        {
            "label": "v",
            "model": f"{work}/whole/xl330_pendulum.xml",
            "law": "load",
            "drive": {"Fc0": {"start": 0.014, "low": 0.01, "high": 0.02}},
            "control": {"error_gain": 0.002, "supply_V": 7.4, "resistance_ohm": 3, "kt_nm_A": 0.4},
        }
    ],
}
faults = {
    "faults": [
        {"kind": "drop", "time_s": 0, "duration_s": 1, "probability": 0.5},
        {"kind": "over_temperature", "time_s": 0, "duration_s": 1, "node": 1, "temperature_degC": 120},
    ]
}
plan = {
    "scenario": "scenario.yaml",
    "set": {"duration_s": 0.2, "multirate.enabled": False},
    "factors": {
        "temperature_degC": {"uniform": [20, 40]},
        "seed": [1, 2],
        "telemetry_rate_hz": {"from": 50, "to": 100, "count": 2},
        "ambient_degC": {"normal": [25, 1]},
    },
    "design": {"type": "sobol", "runs": 64, "seed": 1, "indices": True},
    "outputs": ["heat_J", "max(joint2.friction_nm)", "time_above(joint2.friction_nm, 0.1)"],
    "quantiles": [0.1, 0.9],
    "bands": {"telemetry": ["joint2.friction_nm"], "times": 3},
    "stop": {"narrower_than": {"heat_J": 1}, "failures": 3},
}
for name, document in (
    ("plan", plan),
    ("scenario", scenario),
    ("replay", replay),
    ("varied", varied),
    ("campaign", campaign),
    ("days", days),
    ("fit", fit),
    ("faults", faults),
    ("study", study),
):
    put(f"{name}.yaml", json.dumps(document))
make(program, "run", "scenario.yaml", "-o", "ran", "--quiet")
make(program, "lab", "days.yaml", "-o", "lab", "--quiet")
make(program, "calibrate", "fit.yaml", "-o", "found", "--quiet")
part = read("lab/tests/robot1_day1.json")
for stretch in ("cold", "hot"):  # the shape without its thousands of numbers
    part[stretch] = {
        "time_s": part[stretch]["time_s"][::50],
        **{k: [x[::50] for x in part[stretch][k]] for k in ("measured_nm", "predicted_nm", "moving")},
    }
put("lab/tests/robot1_day1.json", json.dumps(part))

targets = [
    ("scenario", "scenario.yaml", [program, "run", "scenario.yaml", "-o", "out", "--json", "--quiet"]),
    ("replay", "replay.yaml", [program, "run", "replay.yaml", "-o", "out", "--json", "--quiet"]),
    ("varied scenario", "varied.yaml", [program, "run", "varied.yaml", "-o", "out", "--json", "--quiet"]),
    ("recording", "goals.json", [program, "run", "replay.yaml", "-o", "out", "--json", "--quiet"]),
    ("campaign", "campaign.yaml", [program, "lab", "campaign.yaml", "-o", "out", "--quiet"]),
    ("plan", "plan.yaml", [program, "sweep", "plan.yaml", "--dry-run", "--json"]),
    ("campaign of days", "days.yaml", [program, "lab", "days.yaml", "-o", "lab", "--quiet"]),
    ("calibration", "fit.yaml", [program, "calibrate", "fit.yaml", "-o", "out", "--json", "--quiet"]),
    (
        "calibration, kept",
        "found/calibration.json",
        [program, "calibrate", "fit.yaml", "-o", "found", "--json", "--quiet"],
    ),
    ("parameters", "params.yaml", [program, "curve", "params.yaml", "--quiet"]),
    (
        "parameters, evaluated",
        "params.yaml",
        [program, "identify", "curve.csv", "--evaluate", "params.yaml", "--json", "--quiet"],
    ),
    ("parameters, exported", "params.yaml", [program, "export", "params.yaml", "--mjcf"]),
    ("healthy state", "healthy.yaml", [program, "diagnose", "check", "healthy.yaml", "curve.csv", "--json", "--quiet"]),
    (
        "thermal models",
        "thermal.yaml",
        [program, "thermal", "heat.csv", "--evaluate", "thermal.yaml", "--json", "--quiet"],
    ),
    ("thermal chain", "chain.yaml", [program, "thermal", "heat.csv", "--evaluate", "chain.yaml", "--json", "--quiet"]),
    ("faults", "faults.yaml", [hil, "drive", "varied.yaml", "--can", "none://", "--faults", "faults.yaml"]),
    ("study", "study.yaml", [program, "lab", "study.yaml", "-o", "out", "--quiet"]),
]
refused_as_it_is = ("faults",)  # a bus that is none: what matters is read before
if report:
    targets += [
        ("day of a robot", "lab/tests/robot1_day1.json", [report[0], "days", "lab", "-o", "page.html", "--quiet"]),
        ("summary", "ran/summary.json", [report[0], "ran", "-o", "page.html", "--quiet"]),
    ]

for name, file, document_command in targets:  # what is changed is right before
    folder = tempfile.mkdtemp(prefix="case_", dir=work)
    shutil.copytree(f"{work}/whole", folder, dirs_exist_ok=True)
    r = run(document_command, folder)
    if name not in refused_as_it_is and (r is None or r.returncode not in (0, 3)):
        failures.append(f"{name}: is refused as it is: {r and r.stderr}")
        print("FAIL", failures[-1], flush=True)
    shutil.rmtree(folder)

with ThreadPoolExecutor(os.cpu_count()) as pool:
    jobs = [
        pool.submit(attack, name, file, read(file), command, seed)
        for name, file, command in targets
        for seed in range(each)
    ]
    for job, (name, seed) in zip(jobs, ((t[0], s) for t in targets for s in range(each))):
        outcome, wrong = job.result()
        counts.setdefault(name, {}).setdefault(outcome, 0)
        counts[name][outcome] += 1
        if wrong:
            failures.append(wrong)
            print("FAIL", *wrong, sep="\n   ", flush=True)
for name, outcomes in counts.items():
    print(f"{name}: {outcomes}")
    if not outcomes.get(2) and name != "summary":  # of which a page shows what there is
        check(f"{name}: something is refused", False)

finish()
