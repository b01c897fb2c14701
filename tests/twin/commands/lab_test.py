"""tribotwin lab as its user meets it: results, resumption, refusals. Arguments: program, source tree."""
import os, resource, signal, subprocess, sys, time

import numpy as np

import harness
from harness import check, check_refused, finish, work
from reference_law import M_STAR, law

program, source = sys.argv[1], sys.argv[2]


def run(*arguments, **options):
    return harness.run(program, "lab", *arguments, **options)


def refused(name, code, *arguments, says=(), **options):
    check_refused(name, run(*arguments, **options), says, code, lines=None)


def bytes_of(folder):
    return open(os.path.join(work, folder, "curves.csv"), "rb").read()


open(work + "/small.yaml", "w").write(
    """
model: %s/mjcf/irb6620.xml
joint: joint2
procedure: plus_minus
speeds_rad_s: {from: 5, to: 250, count: 4, spacing: logarithmic}
sensors: {encoder_increments_per_turn: 729088, torque_noise_nm: 20, sampling_hz: 250, lag_s: 0.004}
level_noise_nm: 7.5
series:
  - name: grid
    load: {by: torque, norm: [0, 0.5]}
    temperature: {prescribed_degC: [40, 60, 80]}
  - name: drawn
    load: {by: pose, norm: {from: -0.5, to: 0.4}}
    temperature: {prescribed_degC: {from: 40, to: 80}}
    combine: random
    count: 8
"""
    % source
)

# Half of these levels need more than the 12000 Nm of the robot's drive.
small = open(work + "/small.yaml").read()
with open(work + "/heavy.yaml", "w") as f:
    f.write(small[: small.index("speeds_rad_s")] + "drive: {torque_max_nm: 15000}\nspeeds_rad_s: [20, 100]\n")
    f.write("series: [{name: one, load: {by: torque, norm: [0, 0.9]}, temperature: {prescribed_degC: 60}}]\n")
r = run("heavy.yaml", "-o", "heavy")
check("a drive that is too weak", "warning: 2 of 4 levels need more torque" in r.stderr, r.stderr)

# A whole run.
r = run("small.yaml", "-o", "one", "--threads", "1")
check("exits 0", r.returncode == 0, r.stderr)
check("says what it did", "14 curves, 0 of them from earlier runs, 56 levels" in r.stdout, r.stdout)
check("its drive is strong enough", "more torque" not in r.stderr, r.stderr)
check("no terminal, no progress", "\r" not in r.stderr)
check(
    "header",
    bytes_of("one").startswith(
        b"series,curve,speed_rad_s,load_norm,temperature_degC,friction_norm,stderr_norm,friction_forward_norm,"
        b"friction_backward_norm,friction_nm,stderr_nm,lag_s,ripple_nm,lost_motion_rad\n"
    ),
)
d = np.genfromtxt(work + "/one/curves.csv", delimiter=",", names=True, dtype=None, encoding=None)
check(
    "rows in the order of the campaign",
    list(d["curve"]) == [c for c in range(1, 15) for _ in range(4)]
    and list(d["series"][:24]) == ["grid"] * 24
    and d["series"][24] == "drawn",
)
v, l, T = d["speed_rad_s"], np.abs(d["load_norm"]), d["temperature_degC"]
z = (d["friction_norm"] - law(M_STAR, v, l, T)) / d["stderr_norm"]
check(
    "Bittencourt 2012's law within the standard errors",
    np.max(np.abs(z)) < 4 and 0.7 < np.std(z) < 1.3,
    (np.max(np.abs(z)), np.std(z)),
)
check(
    "the same in Nm",
    np.allclose(d["friction_nm"], 7500 * d["friction_norm"], rtol=1e-12)
    and np.allclose(d["stderr_nm"], 7500 * d["stderr_norm"], rtol=1e-12),
)
check(
    "both directions",
    np.all(np.abs(0.5 * (d["friction_forward_norm"] + d["friction_backward_norm"]) - d["friction_norm"]) < 1e-3),
)
check("lag within a sample", np.all(np.abs(d["lag_s"] - 0.004) < 0.004))
check(
    "loads as asked for",
    np.all(np.abs(d["load_norm"][:12]) < 1e-3) and np.all(np.abs(d["load_norm"][12:24] - 0.5) < 1e-3),
)

# Threads, repetition, seeds.
check(
    "two threads",
    run("small.yaml", "-o", "two", "--threads", "2", "--quiet").returncode == 0 and bytes_of("two") == bytes_of("one"),
)
r = run("small.yaml", "-o", "one")
check("nothing left to do", r.returncode == 0 and "14 of them from earlier runs" in r.stdout, (r.stdout, r.stderr))
check(
    "the resolved campaign repeats it",
    run("one/campaign.yaml", "-o", "again", "--quiet").returncode == 0 and bytes_of("again") == bytes_of("one"),
)
r = run("small.yaml", "-o", "seed", "--set", "seed=2", "--quiet")
check("another seed", r.returncode == 0 and r.stdout == "" and bytes_of("seed") != bytes_of("one"))

# However it ends, the next run goes on.
for name, how in (("kill", signal.SIGKILL), ("interrupt", signal.SIGINT), ("terminate", signal.SIGTERM)):
    p = subprocess.Popen([program, "lab", "small.yaml", "-o", name, "--threads", "1", "--quiet"], cwd=work)
    curves = os.path.join(work, name, "curves")
    end = time.time() + 60
    while time.time() < end and not (os.path.isdir(curves) and len(os.listdir(curves)) >= 3):
        time.sleep(0.005)
    if how == signal.SIGKILL:
        refused("a second process in the folder", 1, "small.yaml", "-o", name, says=["another run is writing"])
    p.send_signal(how)
    p.wait()
    check(
        name + ": not finished",
        p.returncode != 0 and not os.path.exists(os.path.join(work, name, "curves.csv")),
        p.returncode,
    )
    r = run("small.yaml", "-o", name, "--threads", "2")
    present = int(r.stdout.split("curves, ")[1].split()[0]) if "curves, " in r.stdout else -1
    check(name + ": goes on", r.returncode == 0 and 2 <= present < 14, (r.stdout, r.stderr))
    check(name + ": the same bytes", bytes_of(name) == bytes_of("one"))
    check(name + ": no lock stays", not os.path.exists(os.path.join(work, name, "run.lock")))
os.remove(work + "/kill/curves/003.csv")
open(work + "/kill/curves/005.csv", "w").write("series,curve\nhalf a")
r = run("small.yaml", "-o", "kill")
check(
    "curves that are lost or cut are measured again",
    r.returncode == 0 and "12 of them from earlier runs" in r.stdout and bytes_of("kill") == bytes_of("one"),
    (r.stdout, r.stderr),
)

# Folders that belong to something else.
refused(
    "another campaign", 2, "small.yaml", "-o", "one", "--set", "level_noise_nm=8", says=["one: holds another campaign"]
)
check("and it is untouched", bytes_of("one") == bytes_of("two"))
os.makedirs(work + "/foreign")
open(work + "/foreign/telemetry.h5", "w").write("x")
refused(
    "a folder of something else", 2, "small.yaml", "-o", "foreign", says=["foreign: holds telemetry.h5 and no campaign"]
)
check("and it is untouched", os.listdir(work + "/foreign") == ["telemetry.h5"])
refused("a file", 2, "small.yaml", "-o", "small.yaml", says=["is a file"])
refused("unwritable folder", 1, "small.yaml", "-o", "/proc/none", says=["/proc/none"])
model = open(source + "/mjcf/irb6620.xml").read()
os.makedirs(work + "/robot")
open(work + "/robot/scene.xml", "w").write(open(source + "/mjcf/scene.xml").read())
open(work + "/robot/robot.xml", "w").write(model)
setting = ["--set", "model=robot/robot.xml", "--set", "speeds_rad_s=[100]", "--set", "series.1.count=1", "--quiet"]
check("a copy of the robot", run("small.yaml", "-o", "robot/out", *setting).returncode == 0)
open(work + "/robot/robot.xml", "w").write(model.replace('mass="120"', 'mass="121"'))
refused("the robot has changed since", 2, "small.yaml", "-o", "robot/out", *setting, says=["another engine or model"])


# Wrong input.
def wrong(name, text, says, code=2):
    open(work + "/wrong.yaml", "w").write(text)
    refused(name, code, "wrong.yaml", "-o", "never", says=says)
    check(name + ": no folder", not os.path.exists(work + "/never"))


small = open(work + "/small.yaml").read()
wrong(
    "mistyped key",
    small.replace("level_noise_nm", "level_noise"),
    ["wrong.yaml:7: level_noise: is not known; did you mean 'level_noise_nm'"],
)
wrong(
    "impossible pose",
    small.replace("from: -0.5, to: 0.4", "from: 0.8, to: 0.9"),
    ["wrong.yaml:", "load: no pose", ".."],
)
wrong("no YAML", "a: [", ["wrong.yaml:"])
wrong("no such model", small.replace("irb6620.xml", "irb6621.xml"), ["irb6621.xml"])
wrong("no such joint", small.replace("joint: joint2", "joint: joint9"), ["wrong.yaml:3: joint:", "did you mean"])
wrong("too slow", small.replace("from: 5,", "from: 0.001,"), ["wrong.yaml:", "stick and slip"])
refused("no such campaign", 2, "nothing", "-o", "never", says=["nothing"])
refused("no folder given", 2, "small.yaml")
refused("--set without =", 2, "small.yaml", "-o", "never", "--set", "seed", says=["key=value"])
refused("no threads", 2, "small.yaml", "-o", "never", "--threads", "0")


# A full disk loses nothing.
def small_files():
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))


refused("full disk", 1, "small.yaml", "-o", "full", "--quiet", says=["full/", "File too large"], preexec_fn=small_files)
check(
    "after a full disk",
    run("small.yaml", "-o", "full", "--quiet").returncode == 0 and bytes_of("full") == bytes_of("one"),
)

# Zhou 2024's cycle, shipped, found by name: one observation of it.
r = run(
    "br609_campaign",
    "-o",
    "br609",
    "--set",
    "series.0.temperature.heating.steps=[{duration_s: 0}]",
    "--set",
    "series.1.temperature.heating.steps=[{speed_rad_s: 100, duration_s: 3600}]",
)
check(
    "br609", r.returncode == 0 and "3 curves, 0 of them from earlier runs, 45 levels" in r.stdout, (r.stdout, r.stderr)
)
d = np.genfromtxt(work + "/br609/curves.csv", delimiter=",", names=True, dtype=None, encoding=None)
check(
    "15 levels",
    np.allclose(
        d["speed_rad_s"][:15], np.radians([0.1, 0.5, 1, 1.5, 2, 3, 5, 8, 10, 15, 30, 45, 60, 80, 100]) * 100, rtol=2e-3
    ),
    d["speed_rad_s"][:15],
)
check("cold at first, then warm", d["temperature_degC"][0] < 25.1 and d["temperature_degC"][15] > 30)
check("viscous friction falls", d["friction_nm"][29] < 0.9 * d["friction_nm"][14])

r = run("--help")
check("help", r.returncode == 0 and "Example" in r.stdout and "irb6620_load_campaign" in r.stdout)

finish()
