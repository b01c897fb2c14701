"""`tribotwin sweep --slurm` on a real Slurm: the file works as it is; a killed rank, a crashed node, a requeue and the
end of the time lose nothing and double nothing. Argument: program."""
import csv, glob, json, os, re, signal, subprocess, sys, time

import harness
from harness import check, check_refused, content, finish, path
from pendulum import PENDULUM
from slurm import Slurm, missing, processes

program = sys.argv[1]
if missing():
    print("SKIPPED: not installed:", *missing(), "(Debian: slurmctld slurmd slurm-client, or tests/run.sh)")
    sys.exit(1 if os.environ.get("TRIBOTWIN_EVERY_TEST") else 77)

RUNS, FEW = 96, 32  # of a job that is disturbed several times; of one that is stopped once at most
ENDS = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL")
RESULTS = ("results.csv", "results.h5", "statistics.json")


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


def sweep(*arguments, **options):
    return harness.run(program, "sweep", *arguments, **options)


def bytes_of(folder):
    return {name: content(os.path.join(folder, name), "rb") for name in RESULTS if os.path.exists(path(folder, name))}


write("pendulum.xml", PENDULUM)
write(
    "scenario.yaml",
    "model: pendulum.xml\nduration_s: 75\n"
    "motion: {type: cycle, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}], speed_rad_s: 2}\n",
)
PLAN = f"""scenario: scenario.yaml
factors: {{drives.hinge.Fc0: {{uniform: [0.02, 0.04]}}, temperature_degC: {{uniform: [20, 40]}}}}
design: {{type: sobol, runs: {RUNS}}}
outputs: [heat_J, max_abs(hinge.friction_nm)]
"""
write("plan.yaml", PLAN)
write("few.yaml", PLAN.replace(f"runs: {RUNS}", f"runs: {FEW}"))
write("wrong.yaml", PLAN.replace("heat_J", "heat_W"))

# ---- The file.
r = sweep("few.yaml", "-o", "sized", "--slurm", "--json")
sized = json.loads(r.stdout)
check("a short sweep is one rank", r.returncode == 0 and sized["ranks"] == 1, (r.stdout, r.stderr))
check(
    "beside the folder, which the job makes",
    sized["file"] == path("sized.sbatch") and not os.path.exists(path("sized")),
)
before = content("sized.sbatch")
check_refused("not over another file", sweep("few.yaml", "-o", "sized/", "--slurm"), "--force")
check("which stays", content("sized.sbatch") == before)
r = sweep("few.yaml", "-o", "sized", "--slurm", "--force", "--ranks", "64", "--threads", "2")
text = content("sized.sbatch")
check("--force", r.returncode == 0 and "64 ranks of 2 threads" in r.stdout, (r.stdout, r.stderr))
check("the size that was asked for", "--ntasks=64\n#SBATCH --cpus-per-task=2\n" in text, text)
check("bash reads it", subprocess.run(["bash", "-n", path("sized.sbatch")]).returncode == 0)
r = sweep("few.yaml", "-o", "new/folders/sweep", "--slurm", "--quiet")
check(
    "in new folders",
    r.returncode == 0 and r.stdout == "" and os.path.exists(path("new/folders/sweep.sbatch")),
    r.stderr,
)
r = harness.run("bash", "sized.sbatch")
check("bash alone does not start it", r.returncode == 2 and "start it with sbatch" in r.stderr, r.stderr)
check_refused("a name that sbatch cannot hold", sweep("few.yaml", "-o", 'a"b', "--slurm"), "quotation mark")
check_refused("a wrong plan", sweep("wrong.yaml", "-o", "wrong", "--slurm"), "heat_W")
check_refused("--ranks alone", sweep("few.yaml", "-o", "wrong", "--ranks", "4"), "mpirun -n N")
check("nothing is written", not glob.glob(path("wrong*h")) and not os.path.exists(path("wrong")))
one, many = (json.loads(sweep("few.yaml", "--dry-run", "--ranks", n, "--json").stdout) for n in (1, 64))
check("--dry-run foretells for 64 ranks", abs(many["seconds"] / many["seconds_of_one"] - -(-FEW // 64)) < 1e-6, many)
check("and for threads", abs(one["seconds"] / one["seconds_of_one"] - -(-FEW // one["threads"])) < 1e-6, one)

truth = {}  # results of each plan on threads
for plan in ("plan.yaml", "few.yaml"):
    r = sweep(plan, "-o", "undisturbed " + plan, "--threads", "2", "--quiet")
    truth[plan] = bytes_of("undisturbed " + plan)
    check(plan + " on threads", r.returncode == 0 and len(truth[plan]) == 3, r.stderr)

# ---- A launcher that ends well without having started a rank (srun, when a step times out while it is given up).
os.mkdir(path("launchers"))
write("launchers/srun", "#!/bin/bash\n[ $1 != --mpi=list ] || echo pmix\n")
os.chmod(path("launchers/srun"), 0o755)
in_a_job = {
    **harness.MPI_ENVIRONMENT,
    "OMPI_MCA_ras": "^slurm",
    "PATH": path("launchers") + ":" + os.environ["PATH"],
    "SLURM_JOB_ID": "1",
    "SLURM_NTASKS": "2",
}
r = harness.run("bash", "sized.sbatch", env=in_a_job)
check("a launcher that starts nothing is not believed", ": srun " in r.stdout and ": mpirun " in r.stdout, r)
check("the results are there", r.returncode == 0 and bytes_of("sized") == truth["few.yaml"], r)

# Two nodes on one machine would take each other's shared memory for theirs.
loopback = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_btl": "self,tcp",
    "OMPI_MCA_btl_tcp_if_include": "lo",
    "OMPI_MCA_oob_tcp_if_include": "lo",
    "TMPDIR": path("slurm"),
}


class Job:
    """A submitted file, and what is known of its parts."""

    def __init__(self, slurm, folder):
        self.slurm, self.folder, self.restarts, self.made = slurm, folder, 0, {}
        r = slurm.call("sbatch", "--parsable", path(folder + ".sbatch"), env={**slurm.environment, **loopback})
        check(folder + ": sbatch takes it", r.returncode == 0, r.stderr)
        self.number = r.stdout.strip()

    def state(self):
        return self.slurm.job(self.number).get("JobState", "?")

    def parts(self):
        return len(glob.glob(path(glob.escape(self.folder), "runs", "[0-9]*.json")))

    def ranks(self):
        """Process of each rank that runs; not those of its tasks, its children."""
        found, parents = {}, {}
        for pid, variables in processes("SLURM_JOB_ID", self.number).items():
            try:
                with open(f"/proc/{pid}/cmdline") as f, open(f"/proc/{pid}/stat") as stat:
                    if f.read().split("\0")[0] == program and "PMIX_RANK" in variables:
                        found[pid] = int(variables["PMIX_RANK"])
                        parents[pid] = int(stat.read().rsplit(")", 1)[1].split()[1])
            except OSError:
                pass
        return {rank: pid for pid, rank in found.items() if parents[pid] not in found}

    def log(self):
        return content(f"{self.folder}.slurm-{self.number}.log")

    def makes(self, more):
        """Waits until so many more parts are there and four ranks run; False where the job is over before."""
        wanted, looked = self.parts() + more, [0, "PENDING"]

        def there():
            if time.monotonic() > looked[0] + 1:  # asking Slurm takes longer than some runs
                looked[:] = time.monotonic(), self.state()
            return self.parts() >= wanted and len(self.ranks()) == 4 or looked[1] in ENDS

        self.slurm.wait(there, "parts; " + self.name())
        return looked[1] not in ENDS

    def name(self):
        return f"{self.folder}, job {self.number}"

    def compare_parts(self):
        """No part that was finished is lost or made again."""
        sums = [line.split(" ")[-1] for line in content(self.folder + "/checksums").splitlines()]
        there = {n: os.stat(path(self.folder, "runs", n)).st_mtime_ns for n in sums}
        check(
            f"{self.name()}: finished parts stay",
            len(sums) == len(set(sums)) and all(there.get(n) == when for n, when in self.made.items()),
            note=f"({len(there)} runs)",
        )
        self.made = there

    def comes_back(self, why):
        """Slurm has it in its queue again. It would wait for two minutes; before the next second slurmd refuses it."""
        self.restarts += 1
        self.slurm.wait(
            lambda: self.slurm.job(self.number).get("Restarts") == str(self.restarts) and self.state() == "PENDING",
            f"requeue ({why}) of {self.name()}: {self.log()}",
        )
        self.compare_parts()
        self.slurm.ask("scontrol", "update", "JobId=" + self.number, "StartTime=now+1")

    def ends(self, state):
        self.slurm.wait(lambda: self.state() in ENDS, "end of " + self.name())
        check(f"{self.name()}: {state}", self.state() == state, (self.slurm.job(self.number), self.log()))


def kill_rank(rank):
    return lambda job: os.kill(job.ranks()[rank], signal.SIGKILL)


def crash_node(job):
    """Its processes are gone before the job starts again: Slurm would take the old step's end for that of the new."""
    job.slurm.crash("b")
    job.slurm.wait(lambda: job.state() == "PENDING", "requeue after a node's crash")
    job.slurm.boot("b")


def requeue(job):
    job.slurm.ask("scontrol", "requeue", job.number)


def time_is_over(job):
    job.slurm.ask("scancel", "--batch", "--signal=USR1", job.number)


def disturbed(slurm, folder, launcher, disturbances):
    """A sweep whose job ends that many times before it is complete."""
    r = sweep("plan.yaml", "-o", folder, "--slurm", "--ranks", "4")
    check(folder + ": written", r.returncode == 0 and f"sbatch {path(folder)}.sbatch" in r.stdout, (r.stdout, r.stderr))
    job = Job(slurm, folder)
    for name, disturb in disturbances.items():
        if not check(f"{job.name()}: runs until {name}", job.makes(RUNS // 16)):
            break
        disturb(job)
        job.comes_back(name)
    job.ends("COMPLETED")
    job.compare_parts()
    check(job.name() + ": the ranks were started by " + launcher, f": {launcher} " in job.log(), job.log())
    check(job.name() + ": the bytes of threads", bytes_of(folder) == truth["plan.yaml"], sorted(bytes_of(folder)))
    numbers = [int(row["run"]) for row in csv.DictReader(open(path(folder, "results.csv")))]
    check(job.name() + ": nothing lost, nothing doubled", numbers == list(range(RUNS)))
    return job


os.mkdir(path("slurm"))
with Slurm(path("slurm")) as slurm:
    # The node has the socket of the step that was killed on its disk, which PMIx of Slurm refuses. The crash is last,
    # because ranks are started otherwise after it.
    disturbances = {
        "rank 0 is killed": kill_rank(0),
        "the time is over": time_is_over,
        "a rank is killed": kill_rank(2),  # which leaves the other ranks at work until Slurm ends them
        "a node crashes": crash_node,
    }
    job = disturbed(slurm, "50% by Slurm's srun", "srun", disturbances)
    log = job.log()
    check(
        "after the crash: srun failed, mpirun did not", log.count(": srun ") == 5 and log.count(": mpirun ") == 1, log
    )

    # ---- scancel ends a job for good; the same file goes on.
    sweep("few.yaml", "-o", "cancelled", "--slurm", "--ranks", "4")
    job = Job(slurm, "cancelled")
    job.makes(FEW // 8)
    slurm.ask("scancel", job.number)
    job.ends("CANCELLED")
    job.compare_parts()
    check("cancelled: not complete, not queued", "results.csv" not in bytes_of("cancelled"), job.log())
    made, job = job.made, Job(slurm, "cancelled")
    job.made = made
    job.ends("COMPLETED")
    job.compare_parts()
    check("cancelled: submitted again it goes on", bytes_of("cancelled") == truth["few.yaml"], job.log())

    # ---- Work that cannot succeed is not queued for ever.
    text = content("cancelled.sbatch")
    write("nowhere.sbatch", text.replace(path("cancelled"), path("nowhere")).replace("few.yaml", "gone.yaml"))
    write(
        "crash.sbatch", re.sub("(?m)^program=.*", "program=/bin/false", text.replace(path("cancelled"), path("crash")))
    )
    for name, says in (("nowhere", "gone.yaml"), ("crash", "no run was finished since the start")):
        job = Job(slurm, name)
        job.ends("FAILED")
        check(name + ": says why", says in job.log(), job.log())

    # ---- A rank that dies when the results are written changes nothing of them.
    write("late.sh", f'#!/bin/bash\n{program} "$@" || exit\n[ "${{PMIX_RANK:-0}}" != 1 ] || kill -9 $$\n')
    os.chmod(path("late.sh"), 0o755)
    write(
        "late.sbatch",
        re.sub("(?m)^program=.*", f"program={path('late.sh')}", text.replace(path("cancelled"), path("late"))),
    )
    job = Job(slurm, "late")
    job.ends("COMPLETED")
    check("late: a rank was killed", "killed" in job.log().lower(), job.log())
    check("late: the results are whole", bytes_of("late") == truth["few.yaml"], job.log())

    # ---- Tasks that do not know each other never write into one folder.
    r = slurm.call("srun", "--mpi=none", "-n", 2, program, "sweep", path("few.yaml"), "-o", path("strangers"))
    check("srun without PMI", r.returncode == 1 and "srun --mpi=pmix" in r.stderr, (r.returncode, r.stderr))
    check("srun without PMI: nothing is written", not os.path.exists(path("strangers")))

    # ---- A Slurm without PMIx.
    slurm.hide_pmix()
    disturbances = {"an operator queues it again": requeue, "a rank is killed": kill_rank(2)}
    disturbed(slurm, "mpirun", "mpirun", disturbances)
finish()
