"""tribotwin on MPI ranks: the same bytes as on threads, whatever is killed; one program prints. Arguments: program,
source tree; kills of the job (default 3), tasks of the job that is killed (default 80), a seed."""
import glob, json, os, random, re, shutil, signal, sqlite3, subprocess, sys, time

import h5py

import harness
from fleet_plant import Plant
from harness import OF_THE_CLOCK, MPI_ENVIRONMENT as environment, check, content, finish, path, work
from pendulum import PENDULUM, write_recordings

program, source = sys.argv[1], sys.argv[2]
kills, tasks, seed = (int(x) for x in (sys.argv[3:] + ["3", "80", "1"][len(sys.argv) - 3 :]))


def on_ranks(ranks, *arguments, **options):
    return harness.run("mpirun", "-n", ranks, program, *arguments, env=environment, timeout=120, **options)


def files(folder, but=()):
    """Content by name; wall times and what HDF5 says of the clock left out."""
    found = {}
    for name in sorted(glob.glob(path(folder, "**"), recursive=True)):
        key = os.path.relpath(name, path(folder))
        if not os.path.isfile(name) or os.path.basename(name) in but:
            continue
        if name.endswith(".h5"):
            with h5py.File(name) as f:
                columns = {}
                text = lambda x: repr(x[()].tolist()) if isinstance(x, h5py.Dataset) else ""
                f.visititems(lambda k, x: columns.update({k: text(x)}))
                found[key] = columns
        else:
            text = open(name).read()
            found[key] = re.sub(OF_THE_CLOCK, "", text)
    return found


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


write("pendulum.xml", PENDULUM)
write(
    "lab.yaml",
    "model: pendulum.xml\njoint: hinge\nprocedure: plus_minus\nspeeds_rad_s: [100, 200]\nlevel_noise_nm: 0.001\n"
    "series:\n  - {name: grid, load: {by: torque, norm: {from: 0, to: 0.5, count: 12}}, "
    "temperature: {prescribed_degC: 40}}\n",
)
motion = "motion: {type: cycle, speed_rad_s: 1, waypoints: [{position_rad: 0}, {position_rad: 0.5}]}\n"
write(
    "vary.yaml",
    "model: pendulum.xml\nduration_s: 5\ntelemetry_rate_hz: 100\nvary: [{temperature_degC: [20, 30, 40, 50, 60]}]\n"
    + motion,
)
write("scenario.yaml", "model: pendulum.xml\nduration_s: 2\n" + motion)
write(
    "sweep.yaml",
    "scenario: scenario.yaml\nfactors: {temperature_degC: {uniform: [20, 40]}}\n"
    "design: {type: sobol, runs: 40}\noutputs: [heat_J]\nbands: {telemetry: [hinge.friction_nm], times: 5}\n"
    "stop: {failures: 3}\n",
)
write_recordings()
write(
    "fit.yaml",
    """recordings: {files: made_*.json}
hold_out: {folds: by gain}
search: {starts: 2, evaluations: 16}
control: {error_gain: 0.0028774, supply_V: 7.4, resistance_ohm: 3.4, kt_nm_A: 0.36}
variants:
  - label: load
    model: pendulum.xml
    law: load
    drive: {Fc0: {start: 0.02, low: 0.002, high: 0.06, sigma: 1, scale: logarithmic}, Fcl: 0.3, Fs0: 0, Fsl: 0.1,
      vs: 100, alpha: 1.4, Fv: 3e-5}
""",
)

# The same bytes on one thread, several threads, several ranks; one program speaks.
for name, arguments in {
    "lab": ("lab", "lab.yaml"),
    "run": ("run", "vary.yaml"),
    "calibrate": ("calibrate", "fit.yaml"),
    "sweep": ("sweep", "sweep.yaml"),
}.items():
    alone = harness.run(program, *arguments, "-o", name + "1", "--threads", "1")
    truth = files(name + "1")
    check("%s on one thread" % name, alone.returncode == 0 and truth, alone.stderr)
    r = harness.run(program, *arguments, "-o", name + "8", "--threads", "8")
    check("%s on eight threads: the same bytes" % name, r.returncode == 0 and files(name + "8") == truth, r.stderr)
    r = on_ranks(4, *arguments, "-o", name + "4")
    check("%s on four ranks: the same bytes" % name, r.returncode == 0 and files(name + "4") == truth, r.stderr)
    plain = lambda text: re.sub(name + r"[14]\b|[0-9.]+ s\b", "", text)
    check("%s: rank 0 prints, once" % name, plain(r.stdout) == plain(alone.stdout), (r.stdout, alone.stdout))
    check("%s: and warns once" % name, plain(r.stderr) == plain(alone.stderr), (r.stderr, alone.stderr))


namespaces = set()  # of the jobs seen, as the names of Open MPI's files have them


def processes_of(job):
    """Ranks of the job in their order; not the processes of their tasks, which are their children."""
    found, parents = {}, {}
    for name in glob.glob("/proc/[0-9]*/environ"):
        try:
            variables = dict(x.split("=", 1) for x in open(name).read().split("\0") if "=" in x)
            command = open(name.replace("environ", "cmdline")).read().split("\0")
            parent = open(name.replace("environ", "stat")).read().rsplit(")", 1)[1].split()[1]
        except OSError:
            continue
        if command[0] == program and variables.get("TRIBOTWIN_TEST_JOB") == job:
            found[name.split("/")[2]] = int(variables["OMPI_COMM_WORLD_RANK"])
            namespaces.add(int(variables["PMIX_NAMESPACE"]))
            parents[name.split("/")[2]] = parent
    return {rank: int(pid) for pid, rank in found.items() if parents[pid] not in found}


# --dry-run foretells for the ranks that were asked for, else for those of the job.
for more, ranks, threads in (((), 3, 1), (("--ranks", 8), 8, 1), (("--ranks", 1), 1, os.cpu_count())):
    said = json.loads(on_ranks(3, "sweep", "sweep.yaml", "--dry-run", "--json", *more).stdout)
    foretold = said["seconds"] / said["seconds_of_one"]
    check(
        "--dry-run %s on three ranks" % " ".join(map(str, more)),
        (said["ranks"], said["threads"]) == (ranks, threads) and abs(foretold - -(-40 // (ranks * threads))) < 1e-6,
        said,
    )


# One search alone is work for all: the points of a generation, and where there are fewer of them, their recordings.
def parents():
    """Parent by process, of all."""
    found = {}
    for name in glob.glob("/proc/[0-9]*/stat"):
        try:
            with open(name) as f:
                found[int(name.split("/")[2])] = int(f.read().rsplit(")", 1)[1].split()[1])
        except OSError:
            pass
    return found


def children(pid):
    return [child for child, parent in parents().items() if parent == pid]


for method in ("cma_es", "gauss_newton"):
    lone, folder = "lone_%s.yaml" % method, "lone_" + method
    search = "starts: 1, evaluations: 300, method: %s" % method
    write(lone, re.sub("hold_out: .*\n", "", content("fit.yaml").replace("starts: 2, evaluations: 16", search)))
    r = harness.run(program, "calibrate", lone, "-o", folder + "1", "--threads", "1")
    check("one start by %s" % method, r.returncode == 0, r.stderr)
    job = "%d.%s" % (os.getpid(), method)
    p = subprocess.Popen(
        ["mpirun", "-n", "4", program, "calibrate", lone, "-o", folder + "4", "--quiet"], cwd=work, stdout=-3,
        stderr=-3, env={**environment, "TRIBOTWIN_TEST_JOB": job},
    )  # fmt: skip
    worked = set()
    while p.poll() is None:
        running = set(parents().values())
        worked |= {rank for rank, pid in processes_of(job).items() if pid in running}
    same = files(folder + "4") == files(folder + "1")
    check("one start by %s on four ranks: the same bytes" % method, p.returncode == 0 and same, p.returncode)
    check("one start by %s: every rank simulates" % method, worked == {0, 1, 2, 3}, worked)

# A simulation whose process is killed is made again; without that its fit fails, and no other.
write("fits.yaml", content("fit.yaml").replace("evaluations: 16", "evaluations: 200, method: cma_es"))
r = harness.run(program, "calibrate", "fits.yaml", "-o", "fits", "--threads", "1", "--quiet")
truth = files("fits")
check("the calibration to be disturbed", r.returncode == 0, r.stderr)


def disturbed(folder, *arguments):
    """Its first simulations are killed."""
    command = [program, "calibrate", "fits.yaml", "-o", folder, "--threads", "2", *arguments]
    p = subprocess.Popen(command, cwd=work, stdout=-3, stderr=subprocess.PIPE, text=True)
    while p.poll() is None and not children(p.pid):
        time.sleep(0.001)
    os.kill(children(p.pid)[0], signal.SIGKILL)
    return p.communicate()[1], p.returncode


said, code = disturbed("fits_again", "--quiet")
check("a killed simulation: the same bytes", code == 0 and files("fits_again") == truth, (code, said))
said, code = disturbed("fits_failed", "--quiet", "--retries", "0")
check("not made again: exit code 1 names its fit", code == 1 and "variant 'load'" in said and "signal 9" in said, said)
check(
    "not made again: the other three fits are there", content("fits_failed/calibration.json").count('"objective"') == 3
)
recorded = content("fits_failed/failures.csv")
check("not made again: recorded with its input", "drive.Fc0=0.0" in recorded and "signal 9" in recorded, recorded)
r = harness.run(program, "calibrate", "fits.yaml", "-o", "fits_failed", "--quiet")
check("the next call makes it", r.returncode == 0 and files("fits_failed") == truth, r.stderr)

# Two machines of a hostfile: two addresses of this one, with a stand-in for ssh.
# Each has a folder for temporary files of its own.
write(
    "ssh",
    "#!/bin/bash\nwhile [[ $1 == -* ]]; do shift; done\nmkdir -p tmp-$1\nexport TMPDIR=$PWD/tmp-$1\nshift\n"
    'exec sh -c "$*"\n',
)
os.chmod(path("ssh"), 0o755)
write("hosts", "127.0.0.2 slots=2\n127.0.0.3 slots=2\n")
over_tcp = {k: v for k, v in environment.items() if k not in ("OMPI_MCA_plm", "OMPI_MCA_rmaps_base_oversubscribe")}
over_tcp.update(OMPI_MCA_plm_rsh_agent=path("ssh"), OMPI_MCA_btl="self,tcp", OMPI_MCA_btl_tcp_if_include="lo")
r = harness.run(
    "mpirun", "--hostfile", "hosts", "-n", 4, program, "sweep", "sweep.yaml", "-o", "hosts4", "--quiet",
    env={**over_tcp, "OMPI_MCA_oob_tcp_if_include": "lo"}, timeout=120,
)  # fmt: skip
check("a hostfile: the same bytes", r.returncode == 0 and files("hosts4") == files("sweep1"), r.stderr)
check("a hostfile: both machines", all(os.path.isdir(path("tmp-127.0.0.%d" % n)) for n in (2, 3)), os.listdir(work))


# A fleet: the store is one file of rank 0.
def dump(store):
    with sqlite3.connect(path(store)) as db:
        return list(db.iterdump())


plant = Plant(40, seed=4)
plant.write(path("healthy.csv"), 8)
plant.write(path("week.csv"), 6, {("R0003", "joint2"): 0.4})
stores = {}
for name, how in {"threads1": ("--threads", "1"), "threads2": ("--threads", "2"), "ranks4": None}.items():
    store = "fleet_%s.db" % name
    said = []
    for command, code in (("learn healthy.csv", 0), ("check week.csv", 3), ("watch", 3)):
        arguments = ["fleet", *command.split(), "-o", store, "--json"]
        r = on_ranks(4, *arguments) if how is None else harness.run(program, *arguments, *how)
        check(
            "fleet %s, %s" % (command, name),
            r.returncode == code and '"R0003"' in r.stdout + '"R0003"' * (code == 0),
            r,
        )
        said.append((r.stdout.replace(store, ""), r.stderr))
    stores[name] = (dump(store), said)
for name in ("threads2", "ranks4"):
    check("fleet on %s: the same store" % name, stores[name][0] == stores["threads1"][0])
    for (out, notes), (out1, notes1) in zip(stores[name][1], stores["threads1"][1]):
        # mpirun says more where the exit code is 3.
        once = out == out1 and all(notes.count(line) == notes1.count(line) for line in notes1.splitlines())
        check("fleet on %s: the same words, once" % name, once, (out, out1, notes, notes1))
r = on_ranks(3, "fleet", "check", "none.csv", "-o", "fleet_ranks4.db")
check("fleet: wrong input on ranks", r.returncode == 2 and r.stderr.count("none.csv") == 1, (r.returncode, r.stderr))
check("fleet: and the store stays", dump("fleet_ranks4.db") == stores["ranks4"][0])

# Errors: said once, the exit code is that of rank 0.
r = harness.run(
    "mpirun", "-n", 2, program, "lab", "lab.yaml", "-o", path("partly"), "--quiet", ":",
    "-n", 1, "--wdir", "/", program, "lab", "lab.yaml", "-o", path("partly"), "--quiet", env=environment,
)  # fmt: skip
check(
    "a rank that cannot read its input is named, the others do its work",
    r.returncode == 0 and files("partly") == files("lab1") and r.stderr.count("failed and rank 0 did not") == 1,
    (r.returncode, r.stderr),
)
r = on_ranks(3, "lab", "none.yaml", "-o", "never")
check("wrong input", r.returncode == 2 and r.stderr.count("none.yaml: ") == 1, (r.returncode, r.stderr))
r = on_ranks(3, "lab", "lab.yaml", "-o", "lab1", "--set", "level_noise_nm=0.002")
check(
    "another campaign's folder", r.returncode == 2 and r.stderr.count("another campaign") == 1, (r.returncode, r.stderr)
)
r = on_ranks(3, "run", "vary.yaml", "-o", "run1")
check("a folder that holds a run", r.returncode == 2 and r.stderr.count("holds a run") == 1, (r.returncode, r.stderr))
check("and it stays", files("run1") == files("run8"))
r = harness.run(
    "mpirun", "-n", 1, program, "run", "vary.yaml", "-o", "apart1", "--quiet", ":",
    "-n", 1, program, "run", "vary.yaml", "-o", "apart2", "--quiet", env=environment,
)  # fmt: skip
check(
    "ranks with different arguments are programs of their own",
    r.returncode == 0 and files("apart1") == files("apart2") == files("run1") and "different arguments" in r.stderr,
    (r.returncode, r.stderr),
)

# N programs never write into one folder because they do not know of each other.
lonely = path("bin")
os.mkdir(lonely)
shutil.copy(program, lonely)
for name, how, says in (
    ("without the MPI part", ["mpirun", "-n", "2", lonely + "/tribotwin"], "no MPI"),
    ("without PMI", [program], "srun --mpi=pmix"),
):
    slurm = {"SLURM_PROCID": "0", "SLURM_STEP_NUM_TASKS": "2"} if name == "without PMI" else {}
    r = harness.run(*how, "lab", "lab.yaml", "-o", "never", env={**environment, **slurm})
    check(name, r.returncode == 1 and says in r.stderr and "2 ranks" in r.stderr, (r.returncode, r.stderr))
    check(name + ": nothing is written", not os.path.exists(path("never")))
r = harness.run(lonely + "/tribotwin", "lab", "lab.yaml", "-o", "alone", "--quiet")
check("one process needs no MPI", r.returncode == 0 and files("alone") == files("lab1"), r.stderr)

# kill -9 of a worker, of rank 0, or of the whole job, until all is done: nothing lost, nothing doubled.
instants = random.Random(seed)


def curves_of(folder):
    """Finished parts and when they were made."""
    if not os.path.exists(path(folder, "checksums")):
        return {}
    names = [line.split(" ")[-1] for line in content(folder + "/checksums").splitlines() if line.count(" ") == 1]
    there = {name: path(folder, "curves", name) for name in names}
    return {name: os.stat(file).st_mtime_ns for name, file in there.items() if os.path.exists(file)}


def runs_of(folder):
    """Finished runs, and when their summaries were written."""
    names = [str(x) for x in range(20, 20 + RUNS)] if os.path.exists(path(folder, "summary.json")) else []
    listed = path(folder, ".unfinished", "checksums")
    try:
        names = [line.split(" ")[-1] for line in content(listed).splitlines() if line.count(" ") == 1] or names
    except FileNotFoundError:
        pass
    return {name: os.stat(path(folder, name, "summary.json")).st_mtime_ns for name in names}


def wait_for_tasks(process, parts, folder, more):
    """Until so many parts more are finished, or the job has ended."""
    wanted = len(parts(folder)) + more
    while process.poll() is None and len(parts(folder)) < wanted:
        time.sleep(0.002)


def attempt(name, folder, kill, parts, most, tally):
    """The job once, killed or not; its exit code."""
    job = "%d.%s.%d" % (os.getpid(), folder, sum(tally.values()))
    p = subprocess.Popen(
        ["mpirun", "-n", "4", program, *name, "-o", folder, "--quiet"], cwd=work, stdout=-3, stderr=-3,
        env={**environment, "TRIBOTWIN_TEST_JOB": job}, start_new_session=True,
    )  # fmt: skip
    if kill:
        wait_for_tasks(p, parts, folder, instants.randint(0, most))
        victims = processes_of(job)
        if p.poll() is None and len(victims) == 4:
            if kill == "job":
                os.killpg(p.pid, signal.SIGKILL)
                for victim in victims.values():
                    os.kill(victim, signal.SIGKILL)
            else:
                os.kill(victims[0 if kill == "rank 0" else instants.randint(1, 3)], signal.SIGKILL)
            tally[kill] = tally.get(kill, 0) + 1
    code = p.wait(120)
    while processes_of(job):  # mpirun ends before its last rank does
        time.sleep(0.01)
    return code


def survives(command, parts, count):
    r = harness.run(program, *command, "-o", "undisturbed_" + command[0])
    check("%s to be killed, undisturbed" % command[0], r.returncode == 0, r.stderr)
    truth, tally, jobs = files("undisturbed_" + command[0]), {}, 0
    while sum(tally.values()) < kills:
        folder, made, code = "killed_%s_%d" % (command[0], jobs), {}, 1
        jobs += 1
        for _ in range(kills + 10):
            kinds = ("worker", "rank 0", "job")
            kill = kinds[sum(tally.values()) % 3] if sum(tally.values()) < kills else ""
            code = attempt(command, folder, kill, parts, max(1, count // 8), tally)
            there = parts(folder)
            again = [n for n, when in made.items() if there.get(n) != when]
            if again and not check("no finished part is lost or made twice", False, (folder, kill, again[:3])):
                return
            made = there
            if code == 0:
                break
        found = files(folder)
        if found != truth:
            check("%s is as if undisturbed" % folder, False, sorted(set(found) ^ set(truth)))
        shutil.rmtree(path(folder))
    check(
        "%d kills of %d jobs of %s: 0 lost, 0 doubled, the same bytes" % (sum(tally.values()), jobs, command[0]),
        sum(tally.values()) >= kills,
        note=str(tally),
    )


RUNS = max(8, min(tasks, 40))
write("many.yaml", content("lab.yaml").replace("[100, 200]", "[200]").replace("count: 12", "count: %d" % tasks))
survives(("lab", "many.yaml"), curves_of, tasks)
temperatures = ", ".join(str(x) for x in range(20, 20 + RUNS))
write("runs.yaml", content("vary.yaml").replace("20, 30, 40, 50, 60", temperatures).replace("_s: 5", "_s: 20"))
survives(("run", "runs.yaml"), runs_of, RUNS)
left = [name for name in os.listdir("/dev/shm") if any(f".{n:x}." in name for n in namespaces)]
check("jobs leave nothing in /dev/shm, killed or not", namespaces and not left, (namespaces, left))

finish()
