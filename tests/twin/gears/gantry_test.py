"""A gantry of three slides with long names from add-drives to dynamics: units of slides, tables that stay tables.
Arguments: program, source tree."""
import json, os, re, shutil, sys, unicodedata

import h5py

import harness
from harness import check, check_refused, content, finish, path

program, source = sys.argv[1], sys.argv[2]
JOINTS = ["längsachse_des_portals", "quer", "hub"]


def run(*arguments):
    return harness.run(program, *map(str, arguments))


def wide(text):
    """Columns on a terminal."""
    return sum(not unicodedata.combining(c) for c in text)


def check_table(name, text, heads):
    """Below the line that begins with `heads`, cells of each row begin or end where those of the heads do."""
    lines = text.splitlines()
    at = next((i for i, line in enumerate(lines) if re.split("  +", line.strip())[: len(heads)] == heads), None)
    if not check(name + ": its heads", at is not None, text):
        return []
    spans = lambda line: [(wide(line[: m.start()]), wide(line[: m.end()])) for m in re.finditer(r"\S+(?: \S+)*", line)]
    head, rows = spans(lines[at])[: len(heads)], lines[at + 1 : at + 1 + len(JOINTS)]
    for row in rows:
        cells = spans(row)
        check(
            f"{name}: {row.split()[0]} stands under its heads",
            all(any(begin == b or end == e for b, e in cells) for begin, end in head),
            (lines[at], row),
        )
    return [re.split("  +", row.strip()) for row in rows]


shutil.copy(os.path.join(source, "tests", "twin", "gears", "gantry.xml"), path("gantry.xml"))
r = run("add-drives", "gantry.xml", "-o", "g.xml")
check("add-drives: forces and gears of slides", "600 N (" in r.stderr and "628.3 rad/m" in r.stderr, r.stderr)
check("add-drives: no torque", "Nm" not in r.stderr, r.stderr)

r = run(
    "run",
    "g.yaml",
    "-o",
    "w",
    "--set",
    "multirate.enabled=false",
    "--set",
    "duration_s=20",
    "--set",
    "telemetry_rate_hz=250",
)
rows = check_table("run", r.stdout, ["joint", "start [degC]", "end [degC]", "max [degC]", "friction rms", "max"])
check("run: newtons", [row[0] for row in rows] == JOINTS and all("N" in row for row in rows), r.stdout)
check("run: no torque", "Nm" not in r.stdout + r.stderr, (r.stdout, r.stderr))
summary = json.loads(content("w/summary.json"))
check("summary.json", {j["friction_unit"] for j in summary["joints"]} == {"N"}, summary["joints"])
with h5py.File(path("w/telemetry.h5")) as f:
    units = {name: f["hub"][name].attrs["unit"] for name in f["hub"]}
units = {name: u if isinstance(u, str) else u.decode() for name, u in units.items()}
expected = {"position_rad": "m", "velocity_rad_s": "m/s", "torque_nm": "N", "friction_nm": "N", "load_nm": "N"}
expected["motor_torque_nm"] = "Nm"
check("telemetry.h5", {k: units.get(k) for k in expected} == expected, units)

# Its own tables, and what reads them.
r = run("export", "w", "--csv", "-o", "all.csv")
check("export --csv -o", r.returncode == 0 and r.stdout.split() == ["all.csv", "all_cycles.csv"], (r.stdout, r.stderr))
heads = content("all.csv").split("\n")[0].split(",")
check(
    "columns of slides",
    [h[4:] for h in heads if h.startswith("hub.")]
    == ["position_m", "velocity_m_s", "motor_torque_nm", "torque_n", "friction_n", "load_n", "temperature_degC"],
    heads,
)
check_refused("export --csv is no PDF", run("export", "w", "--csv", "-o", "all.pdf"), ["all.pdf", "must end in .csv"])
r = run("export", "w", "--recording", "-o", "rec.csv")
check("export --recording", "position_hub_m,torque_hub_n,temperature_hub_degC" in content("rec.csv"), r.stderr)
errors = {}
for data in ("w", "all.csv", "rec.csv"):
    r = run("dynamics", "--friction", "coulomb_viscous", "g.xml", data, "-o", data + ".yaml", "--quiet")
    check(
        "dynamics of " + data, r.returncode == 0 and "N s/m" in r.stdout and "Nm" not in r.stdout, r.stdout + r.stderr
    )
    rows = check_table("dynamics of " + data, r.stdout, ["joint", "relative error", "residual std"])
    errors[data] = [row[1] for row in rows]
check("all three are one record", len({tuple(e) for e in errors.values()}) == 1, errors)
r = run("predict", "g.xml", "w.yaml", "rec.csv")
rows = check_table("predict", r.stdout, ["joint", "error rms", "of its range", "range", "largest"])
check("predict: newtons", [row[0] for row in rows] == JOINTS and all("N" in row for row in rows), r.stdout)
r = run("thermal", "w", "--order", 1, "--quiet")
check_table("thermal", r.stdout, ["joint"])
check("thermal: the record's power", all(j in r.stdout for j in JOINTS), r.stderr)
telemetry, table = (
    run("identify", "--law", "stribeck", "--joint", "hub", *d, "--json", "--quiet")
    for d in (["w/telemetry.h5"], ["all.csv", "--tau-max", "600", "--gear-ratio", "628.3"])
)
check(
    "identify of a slide reads both alike, at its one speed",
    telemetry.stderr == table.stderr and "3 samples cannot determine" in table.stderr,
    (telemetry.stderr, table.stderr),
)

gears = json.loads(run("list", "gears", "--json").stdout)
unit = {g["name"]: (g["torque_max_unit"], g["gear_ratio_unit"]) for g in gears}
check("list gears", unit["ball_screw_1000"] == ("N", "rad/m") and unit["cycloidal_7500"] == ("Nm", ""), unit)

# What is not what was asked for.
for given in ("gantry.xml", "irb6620"):
    check_refused("run of a model: " + given, run("run", given), [given + ": is a model", "add-drives", "scenario"])
for what, arguments in {
    "add-drives --params": ("add-drives", "gantry.xml", "--params", "w.yaml", "-o", "x.xml"),
    "thermal --evaluate": ("thermal", "w", "--evaluate", "w.yaml", "--quiet"),
}.items():
    check_refused(what + " of dynamics", run(*arguments), ["w.yaml: is a file of tribotwin dynamics", "needed here"])
check_refused(
    "predict of a scenario", run("predict", "g.xml", "g.yaml", "rec.csv"), "g.yaml: is a scenario of tribotwin run"
)
laws = json.loads(run("list", "laws", "--json").stdout)
check("list laws", {"bouc_wen", "lugre", "extended"} <= {law["name"] for law in laws if law["use"]}, laws)
script = run("completion", "bash").stdout
check("completion", re.search(r"add-drives:--gear'\) words='[^']*ball_screw_1000", script) and "lugre" in script)
for command, says in {"thermal": "temperature_JOINT_degC", "add-drives": "friction_nm"}.items():
    check("help says which data: " + command, says in run(command, "--help").stdout.split("Example:")[0])

finish()
