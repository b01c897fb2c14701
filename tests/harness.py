"""What the Python tests share: a folder to work in, checks, programs to run, and the exit code at the end.

tests/ is in PYTHONPATH (tests/CMakeLists.txt). TRIBOTWIN_KEEP=1 leaves the folder."""
import atexit, os, re, shutil, signal, socket, subprocess, sys, tempfile, threading

sys.dont_write_bytecode = True
signal.signal(signal.SIGINT, signal.default_int_handler)  # programs keep it ignored, as `bash tests/run.sh &` has it
work = os.path.realpath(tempfile.mkdtemp(prefix="tribotwin_test_"))
failures = []
# Whether tests that sample take everything instead: --all, or TRIBOTWIN_NIGHTLY=1 for all tests of a ctest.
nightly = "--all" in sys.argv or os.environ.get("TRIBOTWIN_NIGHTLY") == "1"
# What summary.json says of the clock, as a regular expression.
OF_THE_CLOCK = r',?\s*"(finished_at|wall_s|realtime_factor)": [^,}]*'
# For mpirun on one machine: loopback, shared memory, and root, as in a container.
MPI_ENVIRONMENT = {
    **os.environ,
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_btl": "self,vader",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_plm": "isolated",
}
_lock = threading.Lock()


def free_ports(count):
    """Ports of loopback that nobody uses now."""
    sockets = [socket.socket() for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


def resident_kib(process):
    """What a process of that id has in memory."""
    with open(f"/proc/{process}/status") as f:
        return int(re.search(r"VmRSS:\s*(\d+)", f.read())[1])


@atexit.register
def _leave():
    if os.environ.get("TRIBOTWIN_KEEP"):
        print("kept:", work)
    else:
        shutil.rmtree(work, True)


def check(name, condition, detail="", note=""):
    """Prints the outcome of one check, with the detail of a failure; returns it. Threads may check at once."""
    with _lock:
        print("ok  " if condition else "FAIL", name, note, "" if condition else detail, flush=True)
        if not condition:
            failures.append(name)
    return bool(condition)


def finish():
    """Ends the test: exit code 1 where a check failed."""
    print(f"{len(failures)} failed:" if failures else "all passed")
    for name in failures:
        print("   ", name)
    sys.exit(bool(failures))


def path(*parts):
    return os.path.join(work, *parts)


def content(name, mode="r"):
    """Of a file; in a page spaces that break no line are spaces, as tests write them."""
    with open(path(name), mode) as f:
        read = f.read()
    return read.replace("\xa0", " ") if mode == "r" and str(name).endswith(".html") else read


def run(program, *arguments, timeout=300, **options):
    """The finished process, with stdout and stderr as text; it runs in the folder unless `cwd` says otherwise."""
    return subprocess.run(
        [program, *map(str, arguments)], capture_output=True, text=True, timeout=timeout, **{"cwd": work, **options}
    )


def check_refused(name, process, says=(), code=2, lines=1):
    """The exit code; every text of `says` on stderr, on that many lines (None: any); nothing on stdout."""
    says = [says] if isinstance(says, str) else says
    check(
        name,
        process.returncode == code
        and process.stdout == ""
        and (lines is None or len(process.stderr.strip().splitlines()) == lines)
        and all(s in process.stderr for s in says),
        (process.returncode, process.stdout[-500:], process.stderr),
    )
