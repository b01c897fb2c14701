"""tribotwin calibrate, killed (-9) again and again: the same command goes on, no simulation that was finished is made
twice, and the results are those of an undisturbed run. Arguments: program; kills of each search (default 8); with
"mpirun", also of ranks."""
import collections, os, random, signal, struct, subprocess, sys, time, zlib

import harness
from harness import check, check_refused, content, finish, path, work
from pendulum import PENDULUM, write_recordings

program, kills, mpirun = sys.argv[1], int((sys.argv[2:] + ["8"])[0]), sys.argv[3:]
FIRST_LINE = b"tribotwin, finished tasks of unfinished work, 1\n"
SLOPE, WHOLE = 255, 2  # kinds of tasks: an answer made of several simulations; all recordings at the best point


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


def calibrate(fit, folder, *more, **options):
    return harness.run(program, "calibrate", fit, "-o", folder, "--threads", "2", *more, **options)


def started(fit, folder, ranks=0):
    """On two threads, or on so many ranks; its error messages go to stderr.txt."""
    launcher = [*mpirun, "-n", str(ranks)] if ranks else []
    threads = [] if ranks else ["--threads", "2"]
    with open(path("stderr.txt"), "w") as stderr:
        return subprocess.Popen(
            [*launcher, program, "calibrate", fit, "-o", folder, "--quiet", *threads], cwd=work, stdout=-3,
            stderr=stderr, start_new_session=True, env=harness.MPI_ENVIRONMENT,
        )  # fmt: skip


def children_of(pid):
    """Direct and indirect ones; a process that is gone has none."""
    try:
        with open("/proc/%s/task/%s/children" % (pid, pid)) as f:
            children = f.read().split()
    except FileNotFoundError:
        return []
    return children + [grandchild for child in children for grandchild in children_of(child)]


def kill(process, ranks):
    """Kills (-9) the program; of an MPI job a rank, and the launcher ends the others. They end a little later.
    Until then the folder is in use."""
    family = children_of(process.pid)
    if ranks:
        with open("/proc/%d/task/%d/children" % (process.pid, process.pid)) as f:
            os.kill(int(instants.choice(f.read().split())), signal.SIGKILL)
    else:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    while any(os.path.exists("/proc/" + pid) for pid in family):
        time.sleep(0.01)


def records_of(file):
    """The tasks in a file of unfinished work, each with its result; a torn end is left out."""
    with open(file, "rb") as f:
        text = f.read()
    if not text.startswith(FIRST_LINE):
        return []
    at, found = len(FIRST_LINE), []
    while at + 12 <= len(text):
        size = struct.unpack_from("<Q", text, at)[0]
        body = text[at + 12 : at + 12 + size]
        if len(body) < size:
            break
        task = struct.unpack_from("<Q", body)[0]
        found.append((body[8 : 8 + task], body[16 + task :]))
        at += 12 + size
    return found[1:]  # the first one is the identity


def simulations(tasks):
    """How often each recording was simulated at each point of each search."""
    count = collections.Counter()
    for name, _ in tasks:
        if name[16] != SLOPE:
            first, last = struct.unpack_from("<QQ", name, len(name) - 16)
            count.update((name[:-16], recording) for recording in range(first, last))
    return count


def results_of(folder):
    return {name: content(os.path.join(folder, name)) for name in sorted(os.listdir(path(folder)))}


def journal(folder):
    return path(folder, "calibration.unfinished")


def linked(process, folder, name):
    """Another name of the file of unfinished work, which stays when the process removes the file."""
    while process.poll() is None and not os.path.exists(journal(folder)):
        time.sleep(0.001)
    if not os.path.exists(path(name)) and os.path.exists(journal(folder)):
        os.link(journal(folder), path(name))


write("pendulum.xml", PENDULUM)
write_recordings()
FIT = """recordings: {files: made_*.json}
hold_out: {folds: by gain}
search: {starts: 2, evaluations: 120, method: %s}
control: {error_gain: 0.0028774, supply_V: 7.4, resistance_ohm: 3.4, kt_nm_A: 0.36}
joint: {armature: {start: 0.001, low: 2e-4, high: 0.005, scale: logarithmic}}
variants:
  - label: load
    model: pendulum.xml
    law: load
    drive: {Fc0: {start: 0.02, low: 0.002, high: 0.06, sigma: 1, scale: logarithmic}, Fcl: 0.3, Fs0: 0, Fsl: 0.1,
      vs: 100, alpha: 1.4, Fv: 3e-5}
"""
instants = random.Random(1)


def killed_midway(method, kills, ranks=0):
    """One calibration, killed until it is complete, against an undisturbed one."""
    fit, folder = method + ".yaml", method + str(ranks or "")
    write(fit, FIT % method)
    p = started(fit, folder + "_whole", ranks)
    linked(p, folder + "_whole", folder + "_whole.tasks")
    check(folder + ", undisturbed", p.wait() == 0, content("stderr.txt"))
    truth, tasks = results_of(folder + "_whole"), records_of(path(folder + "_whole.tasks"))
    check(folder + ": nothing unfinished is left behind", "calibration.unfinished" not in truth, truth.keys())
    wanted, done, there = simulations(tasks), 0, []
    total = wanted.total()
    while done < kills:
        p = started(fit, folder, ranks)
        linked(p, folder, folder + ".tasks")
        # A quarter of all on average: on a busy machine the kill comes later than it is aimed.
        aim = len(there) + instants.randint(0, max(1, len(tasks) // (2 * kills)))
        while p.poll() is None and len(records_of(path(folder + ".tasks"))) < aim:
            time.sleep(0.001)
        if p.poll() is not None:
            check(folder + ": goes on after a kill", p.returncode == 0, content("stderr.txt"))
            break
        kill(p, ranks)
        done += 1
        now = records_of(path(folder + ".tasks"))
        if now[: len(there)] != there and not check(folder + ": what was finished stays", False, (len(now), done)):
            return
        there = now
    # Ranks answer in batches: on a busy machine the last one may come before the last kill.
    least = kills // 2 if ranks else kills
    check("%s: at least %d kills before it is complete" % (folder, least), least <= done, done)
    left = total - simulations(there).total()
    check("%s: some is finished, and some is not" % folder, 0 < left < total, (left, total))
    p = started(fit, folder, ranks)
    check(folder + ": the same command goes on", p.wait() == 0, content("stderr.txt"))
    made = simulations(records_of(path(folder + ".tasks")))
    # Gauss-Newton's search, too, asks for some points again, with a narrower step.
    again = made - wanted
    check(folder + ": no simulation is made once more than undisturbed", made and not again, (again.total(), len(made)))
    check(folder + ": and none is lost", not wanted - made, ((wanted - made).total(), len(wanted)))
    same = results_of(folder) == truth
    check("%s: after %d kills the same bytes" % (folder, done), same, note="%d simulations" % total)


killed_midway("cma_es", kills)
killed_midway("gauss_newton", kills)
if mpirun:
    killed_midway("cma_es", kills // 2, ranks=3)

# What it says, and what it refuses to go on from.
p = started("cma_es.yaml", "stopped")
while p.poll() is None and not os.path.exists(journal("stopped")):
    time.sleep(0.001)
p.send_signal(signal.SIGINT)
p.wait()
said = content("stderr.txt")
check(
    "Ctrl-C before the first fit: what is kept is said",
    p.returncode == 1 and "stopped/calibration.unfinished" in said and "the same command continues" in said,
    said,
)
kept = content("stopped/calibration.unfinished", "rb")
write("other.yaml", (FIT % "cma_es").replace("Fcl: 0.3", "Fcl: 0.31"))
r = calibrate("other.yaml", "stopped")
check_refused("another FIT", r, ["stopped/calibration.unfinished", "input", "remove this file"])
r = calibrate("cma_es.yaml", "stopped", "--seed", "5")
check_refused("another seed", r, "stopped/calibration.unfinished")
check("and it stays", content("stopped/calibration.unfinished", "rb") == kept)
write("stopped/calibration.unfinished", "my notes\n")
r = calibrate("cma_es.yaml", "stopped")
check_refused("a file of somebody else", r, "stopped/calibration.unfinished: is no file of unfinished work")
check("which stays, too", content("stopped/calibration.unfinished") == "my notes\n")
for name, damaged in (("cut", kept[:-7]), ("cut within the first record", kept[: len(FIRST_LINE) + 20])):
    with open(journal("stopped"), "wb") as f:
        f.write(damaged)
    r = calibrate("cma_es.yaml", "stopped")
    if name == "cut":
        check("a torn last record is made again", r.returncode == 0 and "continues" in r.stderr, r.stderr)
        check("and the same bytes", results_of("stopped") == results_of("cma_es_whole"))
        os.remove(path("stopped", "calibration.json"))
    else:
        check_refused(name, r, "stopped/calibration.unfinished: is damaged")

# Whole records with answers of another shape: of one quantity too many, of a curvature that is cut off.
identity = content("gauss_newton_whole.tasks", "rb")[len(FIRST_LINE) :]
identity = identity[: 12 + struct.unpack_from("<Q", identity)[0]]
slopes = [name for name, _ in records_of(path("gauss_newton_whole.tasks")) if name[16] == SLOPE]
check("a search by slopes keeps some", slopes)
for wrong in (struct.pack("<Q9dQ81d", 9, *[1] * 9, 81, *[1] * 81), struct.pack("<QdQ", 1, 1, 1)):
    os.makedirs(path("forged"), exist_ok=True)
    with open(journal("forged"), "wb") as f:
        f.write(FIRST_LINE + identity)
        for name in slopes:
            body = b"".join(struct.pack("<Q", len(part)) + part for part in (name, wrong))
            f.write(struct.pack("<QI", len(body), zlib.crc32(body)) + body)
    r = calibrate("gauss_newton.yaml", "forged", "--quiet")
    check_refused("answers of another shape", r, "forged/calibration.unfinished: holds an answer of another shape")

finish()
