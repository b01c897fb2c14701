"""A Slurm of one's own: slurmctld and two slurmd on loopback, with everything in one folder, without munge, cgroups,
systemd or accounting. It ends nothing but what it has started."""
import glob, os, pwd, signal, subprocess, time

from harness import free_ports

PLUGINS = "/usr/lib/*/slurm-wlm"


def missing():
    """What is not installed."""
    names = ("slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol")
    found = os.environ["PATH"] + ":/usr/sbin"
    return [n for n in names if not any(os.path.exists(os.path.join(f, n)) for f in found.split(":"))]


def processes(variable, value):
    """Processes with that value in their environment: {pid: environment}."""
    found = {}
    for name in glob.glob("/proc/[0-9]*/environ"):
        try:
            with open(name, errors="replace") as f:
                variables = dict(x.split("=", 1) for x in f.read().split("\0") if "=" in x)
        except OSError:
            continue
        if variables.get(variable) == value:
            found[int(name.split("/")[2])] = variables
    return found


class Slurm:
    def __init__(self, folder, cpus=2):
        """Two nodes, `a` and `b`, of so many processors, which need not exist."""
        self.folder = folder
        for name in ("state", "spool-a", "spool-b", "tmp-a", "tmp-b", "plugins"):
            os.makedirs(os.path.join(folder, name))
        for plugin in glob.glob(PLUGINS + "/*"):
            if "mpi_pmix" not in plugin:
                os.symlink(plugin, os.path.join(folder, "plugins", os.path.basename(plugin)))
        self.file = os.path.join(folder, "slurm.conf")
        text = self._configuration(pwd.getpwuid(os.getuid()).pw_name, free_ports(3), cpus)
        with open(self.file, "w") as f:
            f.write(text)
        self.daemons = {}
        self.environment = {**os.environ, "SLURM_CONF": self.file, "PATH": os.environ["PATH"] + ":/usr/sbin"}

    def _configuration(self, user, ports, cpus):
        d = self.folder
        return f"""ClusterName=test
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/none
CredType=cred/none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0
ReturnToService=2
KillWait=1
StateSaveLocation={d}/state
SlurmdSpoolDir={d}/spool-%n
TmpFS={d}/tmp-%n
SlurmctldPidFile={d}/slurmctld.pid
SlurmdPidFile={d}/slurmd-%n.pid
SlurmctldLogFile={d}/slurmctld.log
SlurmdLogFile={d}/slurmd-%n.log
NodeName=a NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports[1]} CPUs={cpus}
NodeName=b NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports[2]} CPUs={cpus}
PartitionName=all Nodes=a,b Default=YES MaxTime=INFINITE State=UP
"""

    def hide_pmix(self):
        """From now on this Slurm offers no PMIx to those who ask; the daemons keep theirs."""
        with open(self.file, "a") as f:
            f.write("PluginDir=" + os.path.join(self.folder, "plugins") + "\n")

    def _start(self, name, *command):
        # A test that is killed leaves no daemon.
        command = ["setpriv", "--pdeathsig", "TERM", *command]
        with open(os.path.join(self.folder, name + ".out"), "a") as out:
            self.daemons[name] = subprocess.Popen(
                command, env=self.environment, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True
            )

    def __enter__(self):
        self._start("slurmctld", "slurmctld", "-D", "-i")
        for node in ("a", "b"):
            self._start(node, "slurmd", "-D", "-N", node)
        self.wait(lambda: self.ask("sinfo", "-h", "-o", "%T %D") == "idle 2", "two idle nodes", 30)
        return self

    def __exit__(self, *_):
        self.ask("scancel", "--full", "--signal=KILL", "--partition=all")
        for daemon in self.daemons.values():
            daemon.terminate()
        for daemon in self.daemons.values():
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        for pid in processes("SLURM_CONF", self.file):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass

    def crash(self, node):
        """The machine of a node stops: its daemon, steps and ranks at once. Slurm is told what it finds out in time."""
        self.daemons[node].kill()
        self.daemons[node].wait()
        # Before the ranks: the job must not end because they are killed.
        self.ask("scontrol", "update", "NodeName=" + node, "State=DOWN", "Reason=crash")
        for pid in [pid for pid in processes("SLURM_CONF", self.file) if self._of_node(pid, node)]:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass

    def boot(self, node):
        """It is there again, with what its disk holds."""
        self._start(node, "slurmd", "-D", "-N", node)
        self.ask("scontrol", "update", "NodeName=" + node, "State=RESUME")
        self.wait(lambda: self.ask("sinfo", "-h", "-n", node, "-o", "%T") == "idle", f"idle node {node}")

    def _of_node(self, pid, node):
        """A rank or its task by its environment, a step by the log that it writes."""
        try:
            with open(f"/proc/{pid}/environ", errors="replace") as f:
                if f"SLURMD_NODENAME={node}" in f.read().split("\0"):
                    return True
            log = os.path.join(self.folder, f"slurmd-{node}.log")
            return any(os.readlink(file) == log for file in glob.glob(f"/proc/{pid}/fd/*"))
        except OSError:
            return False

    def call(self, *command, **options):
        return subprocess.run(
            [str(x) for x in command],
            capture_output=True,
            text=True,
            timeout=60,
            **{"env": self.environment, **options},
        )

    def ask(self, *command):
        return self.call(*command).stdout.strip()

    def wait(self, condition, what, seconds=60):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if condition():
                return
            time.sleep(0.02)
        raise TimeoutError(f"no {what} within {seconds} s; " + self.logs())

    def logs(self):
        text = ""
        jobs = glob.glob(os.path.join(os.path.dirname(self.folder), "*.slurm-*.log"))
        for name in jobs + sorted(glob.glob(self.folder + "/*.log") + glob.glob(self.folder + "/*.out")):
            with open(name, errors="replace") as f:
                text += f"\n== {name}\n" + "".join(f.readlines()[-15:])
        return text

    def job(self, number):
        """What scontrol says of a job: JobState, Reason, Restarts, ExitCode, ..."""
        words = self.ask("scontrol", "-o", "show", "job", number).split()
        return dict(word.split("=", 1) for word in words if "=" in word)
