"""What the tests of whole programs share: checks, inputs made once, a table of all commands that write, one way to run
any of them in a folder of its own, and the judgement of what it left there.

Options: --tribotwin, --hil, --report (may be left out where it is not built), --source, --shim; --all for the long
form, --only WORD for the commands whose name holds it, --kills N for recover_test.py, --keep to leave the folder."""
import argparse, collections, concurrent.futures, contextlib, dataclasses, json, logging, os, re, shutil, signal
import socket, sqlite3, struct, subprocess, sys, threading, time

import h5py
import numpy as np

from harness import check, failures, finish, free_ports, nightly, work
from pendulum import PENDULUM
from web_viewer import WebSocket

parser = argparse.ArgumentParser()
for option in ("--tribotwin", "--hil", "--report", "--source", "--shim", "--machine", "--only"):
    parser.add_argument(option, default="")
for option in ("--all", "--keep"):
    parser.add_argument(option, action="store_true")
parser.add_argument("--kills", type=int)
options = parser.parse_args()
programs = {
    name: path and os.path.abspath(path)
    for name, path in (("tribotwin", options.tribotwin), ("hil", options.hil), ("report", options.report))
}
seed = 20261122

inputs = os.path.join(work, "inputs")
if options.keep:
    os.environ["TRIBOTWIN_KEEP"] = "1"
_lock = threading.Lock()
_folders = 0


def in_parallel(function, items, at_once=os.cpu_count()):
    """By day one at a time: other tests run beside this one."""
    with concurrent.futures.ThreadPoolExecutor(at_once if nightly else 1) as pool:
        return list(pool.map(function, items))


# ---- Commands.
@dataclasses.dataclass(frozen=True)
class Command:
    name: str
    argv: tuple  # the program's key, then its arguments; it runs in the case's folder, {in} is that of the inputs
    out: tuple = ()  # what it writes there
    given: tuple = ()  # inputs that are copied there, because it writes beside or over them
    old: tuple = ()  # (input, name there): an old result to be replaced with --force; files of `out` have one anyway
    resumable: bool = False  # started again, it goes on
    state: str | tuple = ""  # what it needs for that, beside its results; gone once they are complete
    as_one: bool = False  # its files are one result: the old one is whole until the new one is
    recording: bool = False  # what it recorded until it failed may stay: rows or lines that are right, not all of them
    slow: bool = False  # too long to be run hundreds of times
    stream: str = ""  # the value of its -o that may be a device or a pipe
    added_to: tuple = ()  # inputs that it adds to
    writes_last: bool = False  # its first change of the disk comes when its work is done
    tells_master: bool = False  # what cannot be written, not its exit code
    costly: bool = False  # its inputs take a minute to make: only in the long form, or where it is named
    masks: tuple = ("{in}/",)  # inputs in argv that no output may replace

    def argument_lists(self):
        return [programs[self.argv[0]], *(a.replace("{in}", inputs) for a in self.argv[1:])]

    @property
    def knows_force(self):
        words = [a for a in self.argv[1:3] if re.fullmatch("[a-z][a-z0-9-]*", a)]
        return "--force" in help_of(self.argv[0], *words)


_helps = {}


def help_of(program, *words):
    key = (program, *words)
    if key not in _helps:
        _helps[key] = subprocess.run([programs[program], *words, "--help"], capture_output=True, text=True).stdout
    return _helps[key]


commands = [
    c
    for c in [
        Command(
            "run",
            ("tribotwin", "run", "{in}/scenario.yaml", "-o", "out"),
            ("out/",),
            old=(("old_run", "out"),),
            as_one=True,
            recording=True,
        ),
        Command(
            "run, seconds long",
            ("tribotwin", "run", "{in}/long.yaml", "-o", "out"),
            ("out/",),
            old=(("old_run", "out"),),
            as_one=True,
            recording=True,
            slow=True,
        ),
        Command(
            "run --web",
            ("tribotwin", "run", "{in}/scenario.yaml", "--web", "127.0.0.1:0", "-o", "out"),
            ("out/",),
            old=(("old_run", "out"),),
            as_one=True,
            recording=True,
        ),
        Command(
            "run --web, a page connected",
            ("tribotwin", "run", "{in}/scenario.yaml", "--set", "duration_s=0.5", "--realtime")
            + ("--web", "127.0.0.1:{page}", "-o", "out"),
            ("out/",),
            old=(("old_run", "out"),),
            as_one=True,
            recording=True,
        ),
        Command(
            "run, varied",
            ("tribotwin", "run", "{in}/varied.yaml", "-o", "out", "--threads", "1", "--retries", "0"),
            ("out/",),
            resumable=True,
            state=("out/.unfinished/", "out/failures.csv"),
            recording=True,
        ),
        Command(
            "curve --csv",
            ("tribotwin", "curve", "{in}/pendulum.xml", "--joint", "hinge", "--csv", "curve.csv"),
            ("curve.csv",),
            stream="curve.csv",
        ),
        Command(
            "lab",
            ("tribotwin", "lab", "{in}/campaign.yaml", "-o", "out", "--threads", "1"),
            ("out/",),
            resumable=True,
            state=("out/failures.csv",),
        ),
        Command(
            "sweep", ("tribotwin", "sweep", "{in}/plan.yaml", "-o", "out", "--threads", "1"), ("out/",), resumable=True
        ),
        Command(
            "sweep --run",
            ("tribotwin", "sweep", "{in}/plan.yaml", "--run", "1", "-o", "out"),
            ("out/",),
            old=(("old_run", "out"),),
            as_one=True,
            recording=True,
        ),
        Command(
            "sweep --slurm",
            ("tribotwin", "sweep", "{in}/plan.yaml", "-o", "out", "--slurm", "--ranks", "2"),
            ("out.sbatch",),
            writes_last=True,
        ),
        Command(
            "calibrate",
            ("tribotwin", "calibrate", "{in}/fit.yaml", "-o", "out", "--threads", "1"),
            ("out/",),
            resumable=True,
            state=("out/calibration.unfinished",),
        ),
        Command(
            "identify",
            ("tribotwin", "identify", "--law", "stribeck", "{in}/curves.csv", "-o", "params.yaml"),
            ("params.yaml",),
            stream="params.yaml",
        ),
        Command(
            "diagnose learn",
            ("tribotwin", "diagnose", "learn", "{in}/healthy.csv", "-o", "healthy.yaml"),
            ("healthy.yaml",),
            stream="healthy.yaml",
        ),
        Command(
            "excite",
            (
                "tribotwin",
                "excite",
                "{in}/pendulum.xml",
                "--inertia-only",
                "--evaluations",
                "20",
                "--period",
                "2",
                "--rate",
                "100",
                "-o",
                "motion.csv",
            ),
            ("motion.csv",),
            stream="motion.csv",
            writes_last=True,
        ),
        Command(
            "dynamics",
            (
                "tribotwin",
                "dynamics",
                "--friction",
                "coulomb_viscous",
                "{in}/pendulum.xml",
                "{in}/recorded.csv",
                "-o",
                "robot.yaml",
            ),
            ("robot.yaml",),
            stream="robot.yaml",
        ),
        Command(
            "predict",
            (
                "tribotwin",
                "predict",
                "{in}/pendulum.xml",
                "{in}/robot.yaml",
                "{in}/recorded.csv",
                "-o",
                "predicted.csv",
            ),
            ("predicted.csv",),
            stream="predicted.csv",
        ),
        Command(
            "thermal",
            ("tribotwin", "thermal", "{in}/thermal.csv", "-o", "thermal.yaml"),
            ("thermal.yaml",),
            stream="thermal.yaml",
        ),
        Command("export --csv", ("tribotwin", "export", "run", "--csv"), ("run/telemetry.csv",), given=("run",)),
        Command(
            "export --mcap", ("tribotwin", "export", "run", "--mcap", "-o", "run.mcap"), ("run.mcap",), given=("run",)
        ),
        Command(
            "export --mcap --messages json",
            ("tribotwin", "export", "run", "--mcap", "--messages", "json", "-o", "json.mcap"),
            ("json.mcap",),
            given=("run",),
        ),
        Command(
            "export --recording",
            ("tribotwin", "export", "{in}/run", "--recording", "-o", "recorded.csv"),
            ("recorded.csv",),
            stream="recorded.csv",
        ),
        Command(
            "export --mjcf",
            (
                "tribotwin",
                "export",
                "{in}/params.yaml",
                "--mjcf",
                "--tau-max",
                "1",
                "--gear-ratio",
                "100",
                "-o",
                "joint.xml",
            ),
            ("joint.xml",),
            stream="joint.xml",
        ),
        Command(
            "export --native",
            ("tribotwin", "export", "{in}/pendulum.xml", "--native", "-o", "native.xml"),
            ("native.xml",),
            stream="native.xml",
        ),
        Command(
            "export --urdf",
            ("tribotwin", "export", "{in}/pendulum.xml", "--urdf", "-o", "joints.urdf"),
            ("joints.urdf",),
            stream="joints.urdf",
        ),
        Command(
            "export --c",
            ("tribotwin", "export", "{in}/params.yaml", "--c", "joint.c", "--tau-max", "1", "--gear-ratio", "100"),
            ("joint.c",),
            stream="joint.c",
        ),
        Command(
            "export --table",
            ("tribotwin", "export", "{in}/params.yaml", "--table", "t.csv", "--tau-max", "1", "--gear-ratio", "100"),
            ("t.csv",),
            stream="t.csv",
        ),
        Command(
            "export --fmu",
            ("tribotwin", "export", "{in}/params.yaml", "--fmu", "joint.fmu", "--tau-max", "1", "--gear-ratio", "100"),
            ("joint.fmu",),
        ),
        Command(
            "export --fmu of a scenario",
            ("tribotwin", "export", "{in}/scenario.yaml", "--fmu", "robot.fmu"),
            ("robot.fmu",),
        ),
        Command(
            "export --bam",
            ("tribotwin", "export", "{in}/params.yaml", "--bam", "bam.json", "--actuator", "mx64")
            + ("--tau-max", "1", "--gear-ratio", "100"),
            ("bam.json",),
            stream="bam.json",
        ),
        Command(
            "add-drives", ("tribotwin", "add-drives", "{in}/bare.xml", "-o", "robot.xml"), ("robot.xml", "robot.yaml")
        ),
        Command("recover", ("tribotwin", "recover", "killed"), given=("killed",)),
        Command("list", ("tribotwin", "list", "laws", "-o", "laws.txt"), ("laws.txt",), stream="laws.txt"),
        Command(
            "diagnose check",
            ("tribotwin", "diagnose", "check", "{in}/healthy.yaml", "{in}/healthy.csv", "-o", "verdicts.txt"),
            ("verdicts.txt",),
            stream="verdicts.txt",
        ),
        Command(
            "diagnose watch",
            ("tribotwin", "diagnose", "watch", "{in}/healthy.yaml", "{in}/healthy.csv", "-o", "watched.txt"),
            ("watched.txt",),
            stream="watched.txt",
        ),
        Command(
            "diagnose residuals",
            ("tribotwin", "diagnose", "residuals", "{in}/predicted.csv", "--window", "0.1", "--learn", "8")
            + ("-o", "residuals.txt"),
            ("residuals.txt",),
            stream="residuals.txt",
        ),
        Command(
            "fleet check",
            ("tribotwin", "fleet", "check", "{in}/fleet_later.csv", "-o", "learned.db", "--threads", "1"),
            given=("learned.db",),
            added_to=("learned.db",),
        ),
        Command(
            "fleet watch",
            ("tribotwin", "fleet", "watch", "{in}/fleet_later.csv", "-o", "learned.db", "--threads", "1"),
            given=("learned.db",),
            added_to=("learned.db",),
        ),
        # Made or added to, never replaced: a folder to the rules above.
        Command(
            "fleet learn",
            ("tribotwin", "fleet", "learn", "{in}/fleet.csv", "-o", "fleet.db", "--threads", "1"),
            ("fleet.db/",),
            resumable=True,
        ),
        Command(
            "hil drive",
            (
                "hil",
                "drive",
                "{in}/scenario.yaml",
                "--can",
                "socketcand://127.0.0.1:{port}/can0",
                "--duration",
                "0.1",
                "--record",
                "session.log",
                "--stats",
                "stats.json",
                "-o",
                "out",
            ),
            ("session.log", "session.log.session", "stats.json", "out/"),
            old=(("session.log", "session.log"), ("old_run", "out")),
            as_one=True,
            recording=True,
        ),
        Command(
            "hil drive --store",
            ("hil", "drive", "{in}/scenario.yaml", "--can", "socketcand://127.0.0.1:{port}/can0")
            + ("--duration", "0.1", "--store", "store"),
            ("store/",),
            tells_master=True,
        ),
        Command(
            "hil conform",
            ("hil", "conform", "--can", "gateway://127.0.0.1:{drive}/can0", "--only", "nmt.start", "-o", "report.txt"),
            ("report.txt",),
            writes_last=True,
        ),
        Command(
            "hil replay",
            ("hil", "replay", "{in}/scenario.yaml", "{in}/session.log", "--fast", "-o", "out"),
            ("out/",),
            old=(("old_run", "out"),),
            as_one=True,
            recording=True,
        ),
        Command(
            "hil shadow --csv",
            (
                "hil",
                "shadow",
                "{in}/scenario.yaml",
                "--lockstep",
                "--can",
                "log:{in}/session.log",
                "--csv",
                "shadow.csv",
            ),
            ("shadow.csv",),
            recording=True,
            stream="shadow.csv",
        ),
        Command(
            "hil budget",
            ("hil", "budget", "{in}/scenario.yaml", "--json", "-o", "budget.json"),
            ("budget.json",),
            stream="budget.json",
        ),
        Command("hil eds", ("hil", "eds", "{in}/scenario.yaml", "-o", "drive.eds"), ("drive.eds",), stream="drive.eds"),
        Command(
            "hil dbc", ("hil", "dbc", "{in}/scenario.yaml", "-o", "drives.dbc"), ("drives.dbc",), stream="drives.dbc"
        ),
        Command("hil ros2", ("hil", "ros2", "{in}/scenario.yaml", "-o", "bus"), ("bus/",), old=(("old_bus", "bus"),)),
        Command("report", ("report", "{in}/run", "-o", "page.html"), ("page.html",), stream="page.html"),
        Command("report of several", ("report", "{in}/run", "{in}/old_run", "-o", "several.html"), ("several.html",)),
        Command("report days", ("report", "days", "{in}/days", "-o", "days.html"), ("days.html",), costly=True),
        Command("report study", ("report", "study", "{in}/study", "-o", "study.html"), ("study.html",), costly=True),
        Command(
            "report --png",
            ("report", "fit", "{in}/params.yaml", "{in}/curves.csv", "--png", "-o", "fit.html"),
            ("fit.html", "fit_figures/"),
            old=(("old_figures", "fit_figures"),),
        ),
        Command(
            "report thermal",
            ("report", "thermal", "{in}/thermal.yaml", "{in}/thermal.csv", "-o", "thermal.html"),
            ("thermal.html",),
        ),
        Command(
            "report dynamics", ("report", "dynamics", "{in}/predicted.json", "-o", "dynamics.html"), ("dynamics.html",)
        ),
        Command(
            "report curve",
            ("report", "curve", "{in}/pendulum.xml", "--joint", "hinge", "-o", "curve.svg"),
            ("curve.svg",),
        ),
        Command(
            "report pose", ("report", "pose", "{in}/pendulum.xml", "--size", "64x64", "-o", "pose.png"), ("pose.png",)
        ),
        Command(
            "report sheet",
            ("report", "sheet", "{in}/run", "--size", "64x64", "--count", "2", "-o", "sheet.png"),
            ("sheet.png",),
        ),
        Command(
            "report diagnosis",
            ("report", "diagnosis", "{in}/healthy.yaml", "{in}/healthy.csv", "-o", "diagnosis.html"),
            ("diagnosis.html",),
        ),
        Command("report sweep", ("report", "sweep", "{in}/swept", "-o", "sweep.html"), ("sweep.html",)),
        Command("report fleet", ("report", "fleet", "{in}/plant.db", "-o", "fleet.html"), ("fleet.html",)),
        Command(
            "report video",
            ("report", "video", "{in}/run", "--seconds", "0.2", "--fps", "10", "--size", "64x64", "-o", "video.mp4"),
            ("video.mp4",),
        ),
    ]
    if programs[c.argv[0]]
]
commands = [c for c in commands if options.only in c.name and (nightly or options.only or not c.costly)]


# ---- Running one of them.
@dataclasses.dataclass
class Outcome:
    folder: str
    before: dict  # file -> bytes
    after: dict
    code: int = None
    stdout: str = ""
    stderr: str = ""
    calls: list = ()
    seconds: float = 0


def snapshot(folder):
    """Every file below a folder that is a plain one, by its path there."""
    files = {}
    for parent, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(parent, name)
            if os.path.isfile(path) and not os.path.islink(path):
                with open(path, "rb") as f:
                    files[os.path.relpath(path, folder)] = f.read()
    return files


def new_folder():
    global _folders
    with _lock:
        _folders += 1
        folder = os.path.join(work, "cases", "%05d" % _folders)
    os.makedirs(folder)
    return folder


def copy(source, target):
    shutil.copytree(source, target, dirs_exist_ok=True) if os.path.isdir(source) else shutil.copy(source, target)


def prepare(command, over_old):
    """A folder with what the command is given, and an old result where one is to be replaced."""
    folder = new_folder()
    for name in command.given:
        copy(os.path.join(inputs, name), os.path.join(folder, name))
    if over_old:
        for source, name in command.old:
            copy(os.path.join(inputs, source), os.path.join(folder, name))
        for name in command.out:
            if not name.endswith("/") and not os.path.exists(os.path.join(folder, name)):
                with open(os.path.join(folder, name), "w") as f:
                    f.write(f"what was in {name} before\n")
    return folder


def argv_of(command, over_old=False):
    return command.argument_lists() + (["--force"] if over_old and command.knows_force else [])


def master_of(process, port):
    """The bench's own master (tests/hil/master.py) cycles the drive until its session is over."""
    import can
    from master import Master, SdoAbort

    bus = None
    while bus is None and process.poll() is None:
        try:
            bus = can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=port)
        except OSError:
            time.sleep(0.01)
    try:
        master = Master(bus, [1])
        master.nmt(1)
        if "--store" in process.args:
            with contextlib.suppress(SdoAbort):  # the drive says that it cannot
                master.write(1, 0x1010, 1, "I", int.from_bytes(b"save", "little"))
        while process.poll() is None:
            master.cycle()
    except (can.CanError, OSError, AttributeError):  # it has gone; AttributeError: it was never there
        pass
    finally:
        if bus:
            bus.shutdown()


def drive_on(port):
    """A drive that waits for a master there."""
    bus = f"socketcand://127.0.0.1:{port}/can0"
    drive = subprocess.Popen([programs["hil"], "drive", inputs + "/scenario.yaml", "--can", bus, "--quiet"], stderr=-3)
    while drive.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return drive
        time.sleep(0.01)
    return drive


def end_behind(process, drive):
    process.wait()
    drive.terminate()
    drive.wait()


pages_connected = []  # rows that each page got


def page_of(process, port):
    """A page that takes all rows of a run until it ends."""
    while process.poll() is None:
        try:
            page = WebSocket("127.0.0.1", port, "tribotwin.live.v1")
            with page.connection:
                pages_connected.append(sum(opcode == 2 for opcode, _ in page.hear()))
        except (OSError, IndexError, struct.error):  # not there yet, or gone in the midst of what it said
            time.sleep(0.002)


def start(argv, folder, **popen):
    """A process, with a master beside it where it is a drive on a bus, with a drive where it is a master, and with a
    page where it serves one at a port of ours."""
    places = ("{port}", "{drive}", "{page}")
    port, drive_port, page_port = (free_ports(1)[0] if any(p in a for a in argv) else None for p in places)
    drive = drive_on(drive_port) if drive_port else None
    for place, number in zip(places, (port, drive_port, page_port)):
        argv = [a.replace(place, str(number)) for a in argv]
    process = subprocess.Popen(argv, cwd=folder, **popen)
    thread = threading.Thread(target=master_of, args=(process, port)) if port else None
    if page_port:
        thread = threading.Thread(target=page_of, args=(process, page_port))
    if drive:
        thread = threading.Thread(target=end_behind, args=(process, drive))
    if thread:
        thread.start()
    return process, thread


def run(command, over_old=False, folder=None, environment={}, kill_after=None, wrapper=(), timeout=120):
    """The command in a folder of its own, or in one it was in before."""
    folder = folder or prepare(command, over_old)
    outcome = Outcome(folder, snapshot(folder), {})
    began = time.monotonic()
    process, thread = start(
        [*wrapper, *argv_of(command, over_old)],
        folder,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        if kill_after is not None:
            try:
                process.wait(kill_after)
            except subprocess.TimeoutExpired:
                process.kill()
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        err += b"\n(did not end; killed by the test)"
    outcome.seconds = time.monotonic() - began
    if thread:
        thread.join()
    outcome.code, outcome.stdout, outcome.stderr = (
        process.returncode,
        out.decode(errors="replace"),
        err.decode(errors="replace"),
    )
    outcome.after = snapshot(folder)
    return outcome


def forget(outcome):
    if not options.keep:
        shutil.rmtree(outcome.folder, True)


def run_faulty(command, over_old, at, how):
    """The command with the disk's N-th change failing (faulty_disk.c); at 0 counts them."""
    folder = prepare(command, over_old)
    log = folder + ".calls"
    outcome = run(
        command,
        over_old,
        folder,
        {
            "LD_PRELOAD": os.path.abspath(options.shim),
            "FAULTY_DISK_FOLDER": folder,
            "FAULTY_DISK_PROGRAMS": ",".join(os.path.basename(p) for p in programs.values() if p),
            "FAULTY_DISK_AT": str(at),
            "FAULTY_DISK_HOW": how,
            "FAULTY_DISK_LOG": log,
            "ASAN_OPTIONS": "verify_asan_link_order=0",
        },
    )
    if os.path.exists(log):
        with open(log) as f:
            outcome.calls = [line.rstrip("\n").split(" ", 2)[1:] for line in f]
    return outcome


# ---- Judging what it left.
def columns(data):
    """All datasets of a telemetry.h5 that have rows; None where h5py does not open it."""
    path = os.path.join(new_folder(), "record.h5")
    with open(path, "wb") as f:
        f.write(data)
    try:
        with h5py.File(path, "r") as f:
            found = {"complete": int(f["complete"][()])}
            f.visititems(
                lambda name, d: found.update({name: d[:]}) if isinstance(d, h5py.Dataset) and d.shape else None
            )
            return found
    except (OSError, KeyError, RuntimeError):
        return None
    finally:
        shutil.rmtree(os.path.dirname(path))


def recovered(data):
    """The same record after tribotwin recover, in another folder."""
    folder = new_folder()
    with open(os.path.join(folder, "telemetry.h5"), "wb") as f:
        f.write(data)
    r = subprocess.run([programs["tribotwin"], "recover", folder], capture_output=True, timeout=60)
    result = snapshot(folder).get("telemetry.h5") if r.returncode == 0 else None
    shutil.rmtree(folder)
    return result


def wrong_rows(found, truth, all_of_them=False):
    """What is wrong with a record's rows, beside those of the undisturbed one; nothing where they are its first
    ones."""
    if found is None:
        return "is no readable HDF5"
    if set(found) != set(truth):
        return f"has other datasets: {sorted(set(found) ^ set(truth))}"
    for name in truth:
        if name == "complete":
            continue
        n = len(found[name])
        if n > len(truth[name]) or found[name].tobytes() != truth[name][:n].tobytes():
            return f"{name}: {n} rows that are not the first of the undisturbed run's {len(truth[name])}"
        if all_of_them and n != len(truth[name]):
            return f"{name}: {n} of {len(truth[name])} rows"
    for time_name in ("time_s", "cycle_time_s"):
        if time_name in found and np.any(np.diff(found[time_name]) <= 0):
            return f"{time_name} does not rise"
    # Channels are as long as the time column they belong to.
    lengths = {len(v) for k, v in found.items() if k != "complete" and "cycle" not in k}
    if len(lengths) > 1:
        return f"columns of different length: {sorted(lengths)}"
    if found["complete"] and not all(len(found[k]) == len(truth[k]) for k in truth if k != "complete"):
        return "says complete, and is not"
    return ""


VOLATILE = {"finished_at", "wall_s", "realtime_factor"}


def steady(value):
    """JSON without what differs from run to run."""
    if isinstance(value, dict):
        return {k: steady(v) for k, v in value.items() if k not in VOLATILE}
    return [steady(v) for v in value] if isinstance(value, list) else value


TURN_LINE = re.compile(rb"\d+( [a-z_]+(=\S+)?)*")


def wrong_session(data, ended):
    """What is wrong with the file beside a log; its times differ from run to run."""
    lines = data.split(b"\n")
    if lines.pop() != b"":
        return "has a line that is cut"
    if ended and (not lines or lines.pop() != b"end"):
        return "has no end"
    names = (b"tribotwin-hil session 2", b"clock ", b"cycle_us ", b"start_us ", b"scenario ", b"turns")
    head, turns = lines[: len(names)], [line for line in lines[len(names) :] if line != b"end"]
    if not all(line.startswith(name) for line, name in zip(head, names)) or ended and len(head) < len(names):
        return "has another head"
    return "" if all(TURN_LINE.fullmatch(line) for line in turns) else "has a line that is no turn"


# Of a job for Slurm: what was measured, and the folder of the case.
JOB_FIGURES = re.compile(rb"[0-9.e+-]+ (?=s |min |MB)|(?<=--time=)\d+|(?<=/cases/)\d+")

LOG_LINE = re.compile(rb"\(\d+\.\d{6}\) \S+ [0-9A-F]{3,8}#[0-9A-FR]*")


def rows_of(data):
    """All of a SQLite file; None where it is none. A new one that nothing was committed to has no rows."""
    path = os.path.join(new_folder(), "store.db")
    with open(path, "wb") as f:
        f.write(data)
    try:
        with contextlib.closing(sqlite3.connect(path)) as db:
            return list(db.iterdump())
    except sqlite3.DatabaseError:
        return None
    finally:
        shutil.rmtree(os.path.dirname(path))


def not_whole(name, data, truth):
    """What is wrong with a result; nothing where it is that of an undisturbed run."""
    if (
        data == truth or name.endswith(".html") and data.replace(b" --force", b"") == truth.replace(b" --force", b"")
    ):  # a page says how it was made
        return ""
    try:
        if name.endswith(".h5"):
            found = columns(data)
            return wrong_rows(found, columns(truth), True) or (
                "" if found["complete"] == columns(truth)["complete"] else "is not marked as the undisturbed one"
            )
        if name.endswith(".db"):
            return "" if rows_of(data) == rows_of(truth) else "has other rows"
        if name.endswith(".log"):
            lines = data.split(b"\n")
            return (
                ""
                if lines[-1] == b"" and all(LOG_LINE.fullmatch(line) for line in lines[:-1])
                else "has a line that is cut"
            )
        if name.endswith(".session"):
            return wrong_session(data, True)
        if name.endswith(".sbatch"):
            same = JOB_FIGURES.sub(b"N", data) == JOB_FIGURES.sub(b"N", truth)
            return "" if same else "is another job"
        if os.path.basename(name) == "summary.json":
            return "" if steady(json.loads(data)) == steady(json.loads(truth)) else "is not that of the undisturbed run"
        if os.path.basename(name) == "stats.json":
            return "" if set(json.loads(data)) == set(json.loads(truth)) else "has other keys"
    except ValueError as error:
        return f"cannot be read: {error}"
    return "is not that of an undisturbed run"


def wrong_part(name, data, truth, killed):
    """The same of a recording that was cut short: what it holds must be right. Kill -9 may cut a line of text."""
    if name.endswith(".h5"):
        found = columns(data)
        if found is None:  # SWMR's mark is still on it: recover takes it off
            again = recovered(data)
            if again is None:
                return "is neither readable nor recoverable"
            found = columns(again)
        return wrong_rows(found, columns(truth)) or (
            "says complete, and was cut short" if found["complete"] and wrong_rows(found, columns(truth), True) else ""
        )
    if name.endswith(".log"):
        return not_whole(name, data[: data.rfind(b"\n") + 1] if killed else data, truth)
    if name.endswith(".session"):
        return wrong_session(data[: data.rfind(b"\n") + 1] if killed else data, False)
    if name.endswith(".db"):  # its journal undoes what is half; that it does is seen when the command runs again
        return "" if killed else "is not whole"
    if name.endswith(".csv"):
        return (
            ""
            if truth.startswith(data) and (killed or data == b"" or data.endswith(b"\n"))
            else "does not hold the first rows"
        )
    if os.path.basename(name) == "checksums":  # a line per curve
        return (
            ""
            if truth.startswith(data) and (killed or not data or data.endswith(b"\n"))
            else "does not hold the first lines"
        )
    if os.path.basename(name) == "summary.json":
        return "" if json.loads(data)["interrupted"] else "is not that of an undisturbed run"
    if os.path.basename(name) == "stats.json":  # a session without a cycle has no latencies
        return "" if set(json.loads(data)) <= set(json.loads(truth)) else "has other keys"
    if os.path.basename(name) == "calibration.json":
        return "" if json.loads(data)["complete"] is False else "is not that of an undisturbed run"
    return "is not whole"


HIDDEN = re.compile(
    r"\..+\.partial-[A-Za-z0-9]+|.+\.db-journal"
)  # what a killed process may leave; run.lock holds nobody off


def judge(command, outcome, truth, killed=False):
    """Complaints about what a disturbed command left, and its litter. `truth`: the files an undisturbed one leaves."""
    complaints, litter = [], []
    before, after = outcome.before, outcome.after
    moved = collections.Counter(after.values())
    for name in sorted({*before, *after, *truth}):
        old, now, new = before.get(name), after.get(name), truth.get(name)
        if now == old or os.path.basename(name) == "run.lock" and now is None:
            continue
        if now is None:
            if moved[old] == 0:
                complaints.append(f"{name} is lost")
            continue
        if new is not None and new != old or name in command.out:
            why = not_whole(name, now, new)
            if why and (command.recording or command.resumable):
                why = wrong_part(name, now, new, killed)
            if why:
                complaints.append(f"{name} ({len(now)} bytes) {why}")
        elif now not in before.values() and not (command.state and name.startswith(command.state)):
            litter.append(name)
    for name, data in before.items():  # what it was given stays, under whatever name; an old result was not given
        given = name.split("/")[0] in command.given and name not in (*command.out, *command.added_to)
        if given and os.path.basename(name) != "run.lock" and not moved[data]:
            complaints.append(f"{name}, which it was given, is lost")
    for output in command.out if command.as_one else ():  # a folder is one result
        belongs = lambda name: name == output or output.endswith("/") and name.startswith(output)
        old_is_there = all(
            moved[data] for name, data in before.items() if belongs(name) and os.path.basename(name) != "run.lock"
        )
        new_is_there = all(
            name in after and not not_whole(name, after[name], data)
            for name, data in truth.items()
            if belongs(name) and before.get(name) != data
        )
        if not old_is_there and not new_is_there:
            complaints.append(f"{output}: neither the old result nor the new one is there as a whole")
    if litter and not killed:
        complaints.append("litter: " + ", ".join(litter))
    for name in litter:
        if (
            killed
            and not any(HIDDEN.fullmatch(part) for part in name.split("/"))
            and os.path.basename(name) != "run.lock"
        ):
            complaints.append("litter that is not hidden: " + name)
    return complaints, litter


# ---- Inputs.
MOTION = "motion: {type: cycle, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}], speed_rad_s: 2}\n"
BARE = """<mujoco><worldbody><body pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 .4 0 0" size=".04"/></body></worldbody></mujoco>
"""
CAMPAIGN = """model: pendulum.xml
joint: hinge
procedure: plus_minus
speeds_rad_s: [100, 200]
sensors: {encoder_increments_per_turn: 729088, torque_noise_nm: 0.001, sampling_hz: 250}
series:
  - name: loads
    load: {by: torque, norm: [0, 0.2]}
    temperature: {prescribed_degC: [30, 40]}
"""
PLAN = """scenario: scenario.yaml
set: {duration_s: 1}
factors: {temperature_degC: [20, 40]}
design: {type: grid}
outputs: [heat_J, max(hinge.temperature_degC)]
bands: {telemetry: [hinge.friction_nm], times: 5}
"""
FIT = """recordings: {files: made_*.json}
hold_out: {folds: by kp}
search: {starts: 1, evaluations: 12}
control: {error_gain: 0.0028774, supply_V: 7.4, resistance_ohm: 3.4,
  kt_nm_A: {start: 0.3, low: 0.2, high: 0.6, sigma: 0.3, scale: logarithmic}}
joint: {armature: 0.0014}
variants:
  - label: load
    model: pendulum.xml
    law: load
    drive: {Fc0: {start: 0.02, low: 0.002, high: 0.06, sigma: 1, scale: logarithmic},
            Fcl: 0.3, Fs0: 0, Fsl: 0.1, vs: 100, alpha: 1.4, Fv: 3e-5}
"""
DAYS = """model: SOURCE/mjcf/er3a_c60.xml
procedure: working_days
robots: 1
days: 1
duration_s: 530
sensors: {encoder_increments_per_turn: 6.5e6, torque_noise_share: 0.01}
excitation: {evaluations: 60, heating_s: 10}
"""
STUDY = """model: SOURCE/mjcf/br609.xml
procedure: test_cycle
level_noise_nm: 0.05
joints: {joint3: {}}
diagnosis: {learn: [healthy], check: [{series: load, state: thermal}], draws: 10}
series:
  - name: healthy
    load: {by: payload, mass_kg: 0}
    temperature: {prescribed_degC: {from: 25, to: 55, count: 8}}
  - name: load
    load: {by: payload, mass_kg: 2}
    temperature: {prescribed_degC: 40}
"""


def write(name, text):
    with open(os.path.join(inputs, name), "w") as f:
        f.write(text)


def write_table(name, header, *columns):
    np.savetxt(
        os.path.join(inputs, name), np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g"
    )


def made(program, *arguments, timeout=120):
    r = subprocess.run([programs[program], *arguments], cwd=inputs, capture_output=True, text=True, timeout=timeout)
    if r.returncode:
        sys.exit(f"an input cannot be made: {program} {arguments}: {r.returncode} {r.stderr}")
    return r.stdout


def kill_while_running(folder, seconds, *settings):
    """A run that kill -9 met in the middle, with rows in its record: its folder."""
    path = os.path.join(inputs, folder)
    process = subprocess.Popen(
        [
            programs["tribotwin"],
            "run",
            "scenario.yaml",
            "-o",
            folder,
            "--quiet",
            "--realtime",
            "--set",
            "duration_s=60",
            *settings,
        ],
        cwd=inputs,
    )
    time.sleep(seconds)
    process.kill()
    process.wait()
    if not os.path.exists(os.path.join(path, "telemetry.h5")):
        sys.exit("an input cannot be made: the run that is killed wrote nothing")


def make_inputs():
    os.makedirs(inputs)
    write_models()
    write_measurements(np.random.default_rng(seed))
    make_results()
    kill_while_running("killed", 2)
    if programs["hil"]:
        record_a_session()
        made("hil", "ros2", "scenario.yaml", "-o", "old_bus", "--cycle", "20")
    if programs["report"]:
        os.mkdir(inputs + "/old_figures")
        for name in ("01_curve.png", "of_another_page.png"):
            write("old_figures/" + name, "what was in it before\n")
    if any(c.costly for c in commands):
        make_campaigns()


def write_models():
    write("pendulum.xml", PENDULUM)
    write("bare.xml", BARE)
    write("scenario.yaml", "model: pendulum.xml\nduration_s: 3\ntelemetry_rate_hz: 100\n" + MOTION)
    write("long.yaml", "model: pendulum.xml\nduration_s: 600\ntelemetry_rate_hz: 200\n" + MOTION)
    write("varied.yaml", "model: pendulum.xml\nduration_s: 1\nvary: [{temperature_degC: [20, 30]}]\n" + MOTION)
    write("campaign.yaml", CAMPAIGN)
    write("fit.yaml", FIT)
    write("plan.yaml", PLAN)
    t = np.arange(0, 1.5, 0.01)
    for kp in (200, 400):
        write(
            f"made_{kp}.json",
            json.dumps(
                {
                    "kp": kp,
                    "trajectory": "sine",
                    "entries": [
                        {
                            "timestamp": x,
                            "goal_position": 0.6 * np.sin(3 * x),
                            "position": 0.54 * np.sin(3 * (x - 0.05)),
                            "temp": 30,
                        }
                        for x in t
                    ],
                }
            ),
        )


def write_measurements(random):
    # Friction curves of one joint, cold to hot: Stribeck's law with a little noise.
    speeds, temperatures = np.array([0.2, 0.9, 1.7, 2.6, 3.5, 5, 9, 14, 17, 26, 52, 79, 105, 140, 175]), np.linspace(
        25, 58, 10
    )
    v, T = np.tile(speeds, 10), np.repeat(temperatures, 15)
    friction = (
        6 + 0.01 * T + 2 * np.exp(-((v / 3) ** 1.3)) + 1.4 * np.exp(-T / 32) * v**0.6 + random.normal(0, 0.02, v.size)
    )
    write_table(
        "healthy.csv",
        "curve,speed_rad_s,load_norm,temperature_degC,friction_norm,friction_nm,stderr_nm",
        np.repeat(np.arange(1, 11), 15),
        v,
        0 * v,
        T,
        friction / 130,
        friction,
        0 * v + 0.02,
    )
    for name, month in (("fleet.csv", 11), ("fleet_later.csv", 12)):
        write(
            name,
            "robot,joint,date,speed_rad_s,temperature_degC,friction_nm\n"
            + "".join(
                f"R{i // 15 % 2},hinge,2026-{month}-{i // 30 + 1:02},"
                f"{v[i % v.size]},{T[i % v.size]},{friction[i % v.size]}\n"
                for i in range(180)  # 12 curves of 15 points
            ),
        )
    write_table(
        "curves.csv",
        "speed_rad_s,friction_norm",
        v,
        0.03 + 0.02 * np.exp(-((v / 10) ** 1.36)) + 1e-4 * v + random.normal(0, 1e-4, v.size),
    )

    time_s = np.arange(0, 4000, 10.0)
    power = np.where((time_s // 800).astype(int) % 2, 2.0, 0.5)
    warm, x = np.full(time_s.size, 20.0), np.zeros(2)
    for k in range(1, time_s.size):
        decay = np.exp(-10 / np.array([55, 1400]))
        x = x * decay + np.array([0.075 * 55, 0.0068 * 1400]) * (1 - decay) * power[k - 1]
        warm[k] += x.sum()
    write_table("thermal.csv", "time_s,power_w_arm,temperature_arm_degC", time_s, power, warm)


def make_results():
    made("tribotwin", "run", "scenario.yaml", "-o", "run", "--quiet")
    made(
        "tribotwin",
        "run",
        "scenario.yaml",
        "-o",
        "old_run",
        "--quiet",
        "--set",
        "duration_s=2",
        "--set",
        "temperature_degC=30",
    )
    made("tribotwin", "identify", "--law", "stribeck", "curves.csv", "-o", "params.yaml", "--quiet")
    made("tribotwin", "thermal", "thermal.csv", "-o", "thermal.yaml", "--quiet")
    made("tribotwin", "diagnose", "learn", "healthy.csv", "-o", "healthy.yaml", "--quiet")
    made("tribotwin", "sweep", "plan.yaml", "-o", "swept", "--quiet")
    made("tribotwin", "fleet", "learn", "fleet.csv", "-o", "plant.db", "--quiet")
    copy(inputs + "/plant.db", inputs + "/learned.db")
    made("tribotwin", "fleet", "check", "fleet_later.csv", "-o", "plant.db", "--quiet")
    made(
        "tribotwin",
        "excite",
        "pendulum.xml",
        "--inertia-only",
        "--evaluations",
        "20",
        "--period",
        "2",
        "--rate",
        "100",
        "-o",
        "motion.csv",
        "--quiet",
    )
    write("excited.yaml", "model: pendulum.xml\ntelemetry_rate_hz: 500\nmotion: {type: recording, file: motion.csv}\n")
    made("tribotwin", "run", "excited.yaml", "-o", "excited", "--quiet")
    made("tribotwin", "export", "excited", "--recording", "--torque-noise", "0.01", "-o", "recorded.csv")
    made(
        "tribotwin",
        "dynamics",
        "--friction",
        "coulomb_viscous",
        "pendulum.xml",
        "recorded.csv",
        "-o",
        "robot.yaml",
        "--quiet",
    )
    predict = ("predict", "pendulum.xml", "robot.yaml", "recorded.csv", "-o", "predicted.csv", "--json", "--quiet")
    write("predicted.json", made("tribotwin", *predict))


def make_campaigns():
    for name, text in (("days", DAYS), ("study", STUDY)):
        write(name + ".yaml", text.replace("SOURCE", options.source))
        made("tribotwin", "lab", name + ".yaml", "-o", name, "--quiet", timeout=600)


def record_a_session():
    process, thread = start(
        [
            programs["hil"],
            "drive",
            "scenario.yaml",
            "--can",
            "socketcand://127.0.0.1:{port}/can0",
            "--duration",
            "0.5",
            "--record",
            "session.log",
        ],
        inputs,
        stderr=subprocess.DEVNULL,
    )
    thread.join()
    if process.wait(10):
        sys.exit("an input cannot be made: no session was recorded")


sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "hil"))
logging.getLogger("can").setLevel(logging.CRITICAL)
for name in ("can", "can.interfaces.socketcand.socketcand"):
    logging.getLogger(name).addHandler(logging.NullHandler())
    logging.getLogger(name).propagate = False
make_inputs()
