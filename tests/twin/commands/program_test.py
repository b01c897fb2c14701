"""The program as its user meets it: exit codes, messages, kill -9, full disk. Arguments: program, source tree."""
import json, os, re, resource, signal, subprocess, sys, time

import h5py
import numpy as np

import harness
from harness import check, finish, work
from reference_law import M_STAR, law

program, source = sys.argv[1], sys.argv[2]


def run(*arguments, **options):
    return harness.run(program, *arguments, timeout=120, **options)


def refused(name, code, *arguments, says=()):
    r = run(*arguments)
    lines = r.stderr.strip().splitlines()
    check(
        name,
        r.returncode == code and all(s in r.stderr for s in says) and len(lines) >= 1,
        (r.returncode, r.stdout, r.stderr),
    )


model = os.path.join(source, "mjcf", "irb6620.xml")

# A run, read by somebody else's library.
r = run("run", "irb6620_warmup", "-o", "run", "--set", "duration_s=600")
check("run exits 0", r.returncode == 0, r.stderr)
check("stderr is no terminal: no progress", "\r" not in r.stderr)
summary = json.load(open(work + "/run/summary.json"))
for key in (
    "simulated_s",
    "wall_s",
    "steps",
    "realtime_factor",
    "seed",
    "engine",
    "friction_work_J",
    "heat_J",
    "joints",
    "warnings",
):
    check("summary has " + key, key in summary)
for key in ("name", "temperature_degC", "friction_nm", "load_norm", "clamped_samples", "outside_s", "stuck_s"):
    check("joint summary has " + key, key in summary["joints"][0])
with h5py.File(work + "/run/telemetry.h5") as f:
    joints = [k for k in f if isinstance(f[k], h5py.Group)]
    check("one group per joint", joints == ["joint%d" % i for i in range(1, 7)], joints)
    for channel in ("position_rad", "velocity_rad_s", "motor_torque_nm", "friction_nm", "load_nm", "temperature_degC"):
        d = f["joint2"][channel]
        check(
            "dataset " + channel,
            d.shape == f["time_s"].shape and d.chunks and "unit" in d.attrs and "description" in d.attrs,
        )
    check("complete", f["complete"][()] == 1)
    check("it warms up", f["joint2/temperature_degC"][-1] > 25.5)

# The resolved scenario gives the same values.
check("rerun", run("run", "run/scenario.yaml", "-o", "again", "--quiet").returncode == 0)
with h5py.File(work + "/run/telemetry.h5") as a, h5py.File(work + "/again/telemetry.h5") as b:
    check("rerun has the same bytes", all(np.array_equal(a[j][c][:], b[j][c][:]) for j in joints for c in a[j]))

# kill -9 in the middle; a second program reads meanwhile.
p = subprocess.Popen(
    [
        program,
        "run",
        "irb6620_warmup",
        "-o",
        "killed",
        "--quiet",
        "--set",
        "multirate.enabled=false",
        "--set",
        "telemetry_rate_hz=1000",
    ],
    cwd=work,
)
time.sleep(4)
with h5py.File(work + "/killed/telemetry.h5", "r", libver="latest", swmr=True) as f:
    seen = f["time_s"].shape[0]
    check("readable while it runs", seen > 1000 and f["complete"][()] == 0, seen)
refused("a second run into the same folder", 1, "run", "irb6620_hold", "-o", "killed", says=["another run is writing"])
p.send_signal(signal.SIGKILL)
p.wait()
check("no summary of a killed run", not os.path.exists(work + "/killed/summary.json"))
r = run("recover", "killed")
check("recover exits 0", r.returncode == 0, r.stderr)
with h5py.File(work + "/killed/telemetry.h5") as f:
    n = f["time_s"].shape[0]
    check(
        "recovered what was seen",
        n >= seen and f["joint2/position_rad"].shape[0] == n and f["complete"][()] == 0,
        (n, seen),
    )
    check("recovered time is whole", np.all(np.diff(f["time_s"][:]) > 0))
r = run("recover", "run")
check("nothing to recover", r.returncode == 0 and "complete" in r.stdout)

check(
    "the folder of a killed run can be used again",
    run("run", "irb6620_hold", "-o", "killed", "--quiet", "--force", "--set", "duration_s=1").returncode == 0,
)
check("no lock stays behind", not os.path.exists(work + "/killed/run.lock"))

# A viscous damper that nobody accounts for takes energy: said, and an exit code for who asks for it.
text = open(model).read()
damped, found = re.subn(r'(<joint name="joint2")', r'\1 damping="2000"', text)
assert found == 1
open(os.path.join(work, "damped.xml"), "w").write(damped.replace('file="', 'file="' + os.path.dirname(model) + "/"))
short = ("--set", "duration_s=20", "--set", "multirate.enabled=false")
r = run("run", "irb6620_warmup", "-o", "damped", "--set", "model=" + os.path.join(work, "damped.xml"), *short)
check(
    "an energy balance that does not hold is said",
    r.returncode == 0 and "energy balance is off" in r.stderr,
    (r.returncode, r.stderr),
)
warnings = json.load(open(work + "/damped/summary.json"))["warnings"]
check(
    "... in the summary, too", any("energy balance" in w and "% of the friction work" in w for w in warnings), warnings
)
r = run(
    "run", "irb6620_warmup", "-o", "strict", "--strict", "--set", "model=" + os.path.join(work, "damped.xml"), *short
)
check(
    "... and exit code 3 under --strict",
    r.returncode == 3 and os.path.exists(work + "/strict/summary.json"),
    (r.returncode, r.stderr),
)
check(
    "the damper is said before the run, what it does to the run after it, and once each",
    [line.split(": ")[:2] for line in r.stderr.splitlines() if line.startswith("warning")][0] == ["warning", "joint2"]
    and r.stderr.count('damping="2000"') == 1
    and "the run is not what its scenario asked for (damping, balance)" in r.stderr,
    r.stderr,
)
found = {f["check"]: f for f in json.load(open(work + "/strict/summary.json"))["health"] if f["verdict"] == "warning"}
check(
    "... and in the summary with cause, effect and remedy",
    set(found) == {"damping", "balance"}
    and found["damping"]["joint"] == "joint2"
    and found["damping"]["value"] == 2000
    and found["damping"]["unit"] == "Nm s/rad"
    and found["damping"]["threshold"] == 0
    and all(found["damping"][key] for key in ("cause", "effect", "remedy")),
    found,
)
r = run(
    "run",
    "irb6620_warmup",
    "-o",
    "asked",
    "--strict",
    "--set",
    "expects=[damping, balance]",
    "--set",
    "model=" + os.path.join(work, "damped.xml"),
    *short
)
check("what the scenario expects passes --strict", r.returncode == 0 and "warning" not in r.stderr, r.stderr)
r = run("run", "irb6620_warmup", "-o", "balanced", "--strict", *short)
check("a balance that holds passes --strict", r.returncode == 0, (r.returncode, r.stderr))

# CSV against the record.
check("export", run("export", "run", "--csv").returncode == 0)
table = np.genfromtxt(work + "/run/telemetry.csv", delimiter=",", names=True, deletechars="")
with h5py.File(work + "/run/telemetry.h5") as f:
    check("csv equals the record", np.array_equal(table["joint2.friction_nm"], f["joint2/friction_nm"][:]))


# Full disk.
def small_files():
    resource.setrlimit(resource.RLIMIT_FSIZE, (300000, 300000))


r = run("run", "irb6620_warmup", "-o", "full", "--quiet", "--set", "telemetry_rate_hz=1000", preexec_fn=small_files)
check(
    "full disk",
    r.returncode == 1
    and "telemetry.h5" in r.stderr
    and "File too large" in r.stderr
    and not os.path.exists(work + "/full/summary.json"),
    (r.returncode, r.stderr),
)

# Curves.
r = run("curve", model, "--joint", "joint2", "--temperature", "50", "--load", "0.3", "--speeds", "1:280:5")
check(
    "curve columns",
    r.stdout.splitlines()[0] == "speed_rad_s,load_norm,temperature_degC,friction_norm,friction_nm,stderr_nm"
    and len(r.stdout.splitlines()) == 6,
)
expected = law(M_STAR, 280, 0.3, 50)
check("curve equals Bittencourt 2012", abs(float(r.stdout.splitlines()[-1].split(",")[3]) / expected - 1) < 1e-12)

# A model named without a folder.
r = subprocess.run(
    [program, "curve", "irb6620.xml", "--joint", "joint2", "--speeds", "1:280:3"],
    capture_output=True,
    text=True,
    cwd=source + "/mjcf",
)
check("model in the current folder", r.returncode == 0, r.stderr)

# Wrong input.
refused("nan load", 2, "curve", model, "--joint", "joint2", "--load", "nan", says=["finite"])
refused(
    "too slow to measure",
    1,
    "curve",
    model,
    "--joint",
    "joint2",
    "--speeds",
    "0.001:0.001:1",
    "--experiment",
    says=["stick"],
)
refused("no command", 2)
refused("unknown option", 2, "run", "irb6620_hold", "--fast")
refused("unknown scenario", 2, "run", "irb6621_warmup", says=["irb6621_warmup"])
refused("unknown key by --set", 2, "run", "irb6620_hold", "--set", "duratoin_s=3", says=["did you mean 'duration_s'"])
refused("--set without =", 2, "run", "irb6620_hold", "--set", "duration_s", says=["key=value"])
refused("wrong type", 2, "run", "irb6620_hold", "--set", "duration_s=[1]", says=["must be a number"])
refused("unwritable folder", 1, "run", "irb6620_hold", "-o", "/proc/none", says=["/proc/none"])
refused("unknown joint", 2, "curve", model, "--joint", "joint7", says=["did you mean", "joint6"])
refused("bad speeds", 2, "curve", model, "--joint", "joint2", "--speeds", "1:x:3", says=["FROM:TO:COUNT"])
refused("missing model", 2, "curve", "none.xml", "--joint", "joint2", says=["none.xml"])
refused(
    "impossible pose",
    2,
    "curve",
    model,
    "--joint",
    "joint2",
    "--load",
    "0.9",
    "--experiment",
    "--load-by",
    "pose",
    says=[".."],
)
refused("recover nothing", 2, "recover", "none", says=["does not exist"])
refused("export nothing", 2, "export", "none", "--csv", says=["does not exist"])
open(work + "/run2.h5", "w").write("x")
os.makedirs(work + "/broken")
open(work + "/broken/telemetry.h5", "w").write("no HDF5")
refused("broken record", 1, "recover", "broken", says=["no readable HDF5"])
for command in ([], ["run"], ["curve"], ["recover"], ["export"]):
    r = run(*command, "--help")
    check("help " + " ".join(command), r.returncode == 0 and ("Example" in r.stdout or not command), r.stdout)
r = run("run", "--list")
check(
    "list",
    r.returncode == 0
    and all(
        s in r.stdout for s in ("irb6620_warmup", "irb6620_hold", "br609_test_cycle", "er3a_c60_day", "xl330_replay")
    ),
    r.stdout,
)

finish()
