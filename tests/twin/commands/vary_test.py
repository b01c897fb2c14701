"""`tribotwin run` of a scenario that varies, interrupted and killed: the same command makes what is missing, and
nothing else. Argument: program."""
import os, re, shutil, signal, subprocess, sys, time

import h5py

import harness
from harness import OF_THE_CLOCK, check, check_refused, content, finish, path, work
from pendulum import PENDULUM

program = sys.argv[1]
RUNS = ("20", "30", "40", "50", "60")
SCENARIO = f"""model: pendulum.xml
duration_s: 60
telemetry_rate_hz: 100
vary: [{{temperature_degC: [{", ".join(RUNS)}]}}]
motion: {{type: cycle, speed_rad_s: 1, waypoints: [{{position_rad: 0}}, {{position_rad: 0.5}}]}}
"""


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


def run(*arguments, **options):
    return harness.run(program, "run", "vary.yaml", "--threads", "1", *arguments, **options)


def values(folder):
    """What the runs say, but for wall times."""
    found = {"summary": re.sub(OF_THE_CLOCK, "", content(folder + "/summary.json"))}
    for name in RUNS:
        with h5py.File(path(folder, name, "telemetry.h5")) as f:
            f.visititems(lambda k, x: found.update({name + k: x[()].tolist()}) if isinstance(x, h5py.Dataset) else None)
    return found


def complete(folder):
    """Runs that are over, and when their summaries were written."""
    unfinished = path(folder, ".unfinished", "checksums")
    names = RUNS if os.path.exists(path(folder, "summary.json")) else ()
    if os.path.exists(unfinished):
        names = [line.split(" ")[-1] for line in content(unfinished).splitlines() if line.split(" ")[-1] in RUNS]
    return {name: os.stat(path(folder, name, "summary.json")).st_mtime_ns for name in names}


write("pendulum.xml", PENDULUM)
write("vary.yaml", SCENARIO)
r = run("-o", "whole")
check("undisturbed", r.returncode == 0 and "earlier" not in r.stderr, r.stderr)
check("leaves nothing behind", not os.path.exists(path("whole/.unfinished")), os.listdir(path("whole")))
truth, said = values("whole"), r.stdout
plain = lambda text, folder: re.sub(r"[0-9.]+ s\b", "", text.replace(folder, "whole"))

# A run that is killed again while it replaces what the first kill has left.
command = [program, "run", "vary.yaml", "--threads", "1", "-o", "twice"]
for waits_for in ("telemetry.h5", "replaced"):
    p = subprocess.Popen(command, cwd=work, stdout=-3, stderr=-3)
    end = time.time() + 60
    while time.time() < end and p.poll() is None and not os.path.exists(path("twice", RUNS[0], waits_for)):
        time.sleep(0.0005)
    p.kill()
    p.wait()
check("killed twice in one run", os.path.exists(path("twice", RUNS[0], "replaced")))
r = run("-o", "twice", "--quiet")
check("killed twice: goes on", r.returncode == 0 and values("twice") == truth, r.stderr)
left = {name: sorted(os.listdir(path("twice", name))) for name in RUNS}
check("killed twice: nothing is left behind", left == {n: sorted(os.listdir(path("whole", n))) for n in RUNS}, left)

for name, how in (("interrupted", signal.SIGINT), ("killed", signal.SIGKILL)):
    made = {}
    for wanted in (1, 3):
        p = subprocess.Popen(
            [program, "run", "vary.yaml", "--threads", "1", "-o", name], cwd=work, stdout=-3, stderr=subprocess.PIPE
        )
        end = time.time() + 60
        while time.time() < end and p.poll() is None and len(complete(name)) < wanted:
            time.sleep(0.002)
        p.send_signal(how)
        error = p.communicate()[1].decode()
        check(f"{name}: not complete", p.returncode != 0 and not os.path.exists(path(name, "summary.json")), error)
        there = complete(name)
        again = [k for k, when in made.items() if there.get(k) != when]
        check(f"{name}: complete runs stay", not again and len(there) >= wanted, (made, there))
        made = there
        if how == signal.SIGINT:
            check("interrupted: says how it goes on", "the same command goes on" in error, error)
    write("vary.yaml", SCENARIO.replace("60]", "61]"))
    check_refused(f"{name}: another scenario", run("-o", name), ["holds a run already", "not of this scenario"])
    write("vary.yaml", SCENARIO)
    r = run("-o", name)
    check(f"{name}: goes on", r.returncode == 0 and "of 5 runs are those of an earlier call" in r.stderr, r.stderr)
    there = complete(name)
    check(f"{name}: complete runs stayed", all(there[k] == when for k, when in made.items()), (made, there))
    check(f"{name}: the values of an undisturbed run", values(name) == truth)
    check(f"{name}: says the same", plain(r.stdout, name) == plain(said, "whole"), r.stdout)
    check(f"{name}: leaves nothing behind", not os.path.exists(path(name, ".unfinished")), os.listdir(path(name)))
    check_refused(f"{name}: then it is a run that stays", run("-o", name), "holds a run already")

# --force in place of complete runs, interrupted: the same command goes on.
shutil.copytree(path("whole"), path("forced"))
p = subprocess.Popen([program, "run", "vary.yaml", "--threads", "1", "-o", "forced", "--force", "--quiet"], cwd=work)
report = path("forced", ".unfinished", "checksums")
while p.poll() is None and not (os.path.exists(report) and content("forced/.unfinished/checksums").count("\n") > 1):
    time.sleep(0.002)
p.send_signal(signal.SIGINT)
check("forced: interrupted", p.wait() == 1, p.returncode)
r = run("-o", "forced", "--force")
check("forced: goes on", r.returncode == 0 and "of 5 runs are those of an earlier call" in r.stderr, r.stderr)
check("forced: the values of an undisturbed run", values("forced") == truth)


# A process of a run is killed: the run is made again, and nothing else is lost.
def processes_of(pid):
    return [int(x) for x in open(f"/proc/{pid}/task/{pid}/children").read().split()]


def kill_second_run(folder, *arguments):
    """The process of the second run, once the first is complete, is killed."""
    command = [program, "run", "vary.yaml", "--threads", "1", "-o", folder, *arguments]
    p = subprocess.Popen(command, cwd=work, stdout=-3, stderr=subprocess.PIPE)
    while p.poll() is None and not complete(folder):
        time.sleep(0.002)
    os.kill(processes_of(p.pid)[0], signal.SIGKILL)
    return p.communicate()[1].decode(), p.returncode


said, code = kill_second_run("crashed", "--quiet")
check("a run's process is killed: tried again", code == 0 and values("crashed") == truth, said)
check("and the attempt leaves nothing behind", sorted(os.listdir(path("crashed"))) == sorted(os.listdir(path("whole"))))
check(
    "nor in its folder", os.listdir(path("crashed/30")) == os.listdir(path("whole/30")), os.listdir(path("crashed/30"))
)
said, code = kill_second_run("failed", "--quiet", "--retries", "0")
there = complete("failed")
check("not tried again: the others are complete", code == 1 and len(there) == 4, (code, said, there))
check("not tried again: it is named", "30: its process was ended by signal 9" in said and "4 of 5 runs" in said, said)
recorded = content("failed/failures.csv")
check("and recorded", '30,1,"its process' in recorded and '"temperature_degC=30"' in recorded, recorded)
r = run("-o", "failed")
check("the next call makes it", r.returncode == 0 and "4 of 5 runs are those" in r.stderr, r.stderr)
check("with the values of an undisturbed run", values("failed") == truth)
check("and made no other again", all(complete("failed")[k] == when for k, when in there.items()))
check("nothing failed now", not os.path.exists(path("failed/failures.csv")))

# Killed between the end of a run and its being counted: it is whole, and counted by the next call.
for name, changed in (("uncounted", False), ("uncounted_changed", True)):
    p = subprocess.Popen([program, "run", "vary.yaml", "--threads", "1", "-o", name, "--quiet"], cwd=work, stderr=-3)
    while p.poll() is None and len(complete(name)) < 2:
        time.sleep(0.002)
    p.kill()
    p.wait()
    made = complete(name)
    lines = content(name + "/.unfinished/checksums").splitlines(True)
    write(name + "/.unfinished/checksums", "".join(line for line in lines if not line.endswith(" 20\n")))
    os.remove(path(name, ".unfinished", "reports", "20"))
    write(name + "/20/run.lock", "")  # nobody holds it any more
    if changed:
        write(name + "/20/summary.json", content(name + "/20/summary.json") + " ")
    r = run("-o", name)
    check(f"{name}: goes on", r.returncode == 0, r.stderr)
    stayed = complete(name)["20"] == made["20"]
    check(f"{name}: {'made again' if changed else 'not made again'}", stayed != changed, made)
    if not changed:
        check(f"{name}: it counts", f"{len(made)} of 5 runs are those" in r.stderr, r.stderr)
        check(f"{name}: nothing is set aside", os.listdir(path(name, "20")) == os.listdir(path("whole/20")))
    check(f"{name}: the values of an undisturbed run", values(name) == truth)

# A folder of somebody else's is never taken for a leftover, the second time neither.
os.makedirs(path("foreign"))
shutil.copytree(path("whole/40"), path("foreign/40"))
for _ in range(2):
    check_refused("another run's folder", run("-o", "foreign"), "foreign/40: holds a run already")
check("which stays", content("foreign/40/summary.json") == content("whole/40/summary.json"))
check("and nothing is begun", os.listdir(path("foreign")) in (["40"], ["40", "run.lock"], ["run.lock", "40"]))

# A model that was changed in the meantime makes other runs.
p = subprocess.Popen([program, "run", "vary.yaml", "--threads", "1", "-o", "changed", "--quiet"], cwd=work)
while p.poll() is None and not complete("changed"):
    time.sleep(0.002)
p.kill()
p.wait()
write("pendulum.xml", PENDULUM.replace('"Fc0" value="0.03"', '"Fc0" value="0.04"'))
check_refused("another model", run("-o", "changed"), "not of this scenario")
r = run("-o", "changed", "--force", "--quiet")
check(
    "--force begins anew", r.returncode == 0 and values("changed") != truth and len(complete("changed")) == 5, r.stderr
)
finish()
