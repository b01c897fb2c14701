"""stdout, stderr and -o that are no plain files, for every command: full, closed, slow and broken streams, devices,
pipes; an output that is an input; two writers of one output; an old result without --force. By day each command meets
two of the six streams and one of the three links to its input, drawn by the seed and its name, and two writers meet
once instead of three times. Options: programs.py."""
import errno, functools, random, re, stat

from programs import *

ABORT = ("terminate called", "what():", "Traceback", "Aborted")


def ended_well(r, code):
    return r.code == code and not any(word in r.stderr for word in ABORT)


def run_with(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, closed=(), argv=None, folder=None, wrapper=()):
    """The command with other streams; `closed` are descriptors that it does not get at all."""
    folder = folder or prepare(command, False)
    outcome = Outcome(folder, snapshot(folder), {})
    shell = ["sh", "-c", 'exec "$@" ' + " ".join(f"{fd}>&-" for fd in closed), "sh"] if closed else []
    process, thread = start(
        [*wrapper, *shell, *(argv or argv_of(command))],
        folder,
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=stderr,
        start_new_session=True,
    )
    out, err = process.communicate(timeout=120)
    if thread:
        thread.join()
    outcome.code, outcome.stdout, outcome.stderr = (
        process.returncode,
        (out or b"").decode(errors="replace"),
        (err or b"").decode(errors="replace"),
    )
    outcome.after = snapshot(folder)
    return outcome


@functools.cache
def usual(command):
    """What it does with plain files: made once for all that is compared with it."""
    return run(command)


def missing(outcome, truth):
    return [
        name for name, data in truth.items() if name not in outcome.after or not_whole(name, outcome.after[name], data)
    ]


def wrong(outcome, truth):
    """Results that are neither absent nor whole."""
    return [
        name
        for name in outcome.after
        if outcome.after[name] != outcome.before.get(name)
        and (name not in truth or not_whole(name, outcome.after[name], truth[name]))
    ]


# ---- Streams that take nothing.
def streams(command):
    plain, name = usual(command), command.name
    truth, prints = plain.after, bool(plain.stdout)
    if not check(f"{name}: works", plain.code == 0, (plain.code, plain.stderr[-300:])):
        return
    lost = 1 if prints else 0
    ways = [stdout_full, stderr_full, stdout_closed, stderr_closed, all_closed, nobody_reads]
    if not nightly:
        ways = random.Random(f"{seed} {name}").sample(ways, 2)
    for way in ways:
        way(command, truth, lost)


def holds_nothing_wrong(command, what, r, code, truth, more=True):
    check(
        f"{command.name}: {what}",
        ended_well(r, code) and more and not wrong(r, truth),
        (r.code, r.stderr[-300:], wrong(r, truth)),
    )


def stdout_full(command, truth, lost):
    with open("/dev/full", "w") as full:
        r = run_with(command, stdout=full)
    holds_nothing_wrong(command, "stdout is full", r, lost, truth, bool(r.stderr) >= bool(lost))


def stderr_full(command, truth, lost):
    with open("/dev/full", "w") as full:
        r = run_with(command, stderr=full)
    whole = not missing(r, truth) and bool(r.stdout) == bool(lost)
    holds_nothing_wrong(command, "stderr is full", r, 0, truth, whole)


def stdout_closed(command, truth, lost):
    holds_nothing_wrong(command, "stdout is closed", run_with(command, closed=[1]), lost, truth)


def stderr_closed(command, truth, lost):
    r = run_with(command, closed=[2])
    holds_nothing_wrong(command, "stderr is closed", r, 0, truth, not missing(r, truth))


def all_closed(command, truth, lost):
    r = run_with(command, closed=[0, 1, 2])
    holds_nothing_wrong(command, "stdin, stdout and stderr are closed", r, lost, truth)


def nobody_reads(command, truth, lost):
    read, writing = os.pipe()
    os.close(read)
    r = run_with(command, stdout=writing)
    os.close(writing)
    holds_nothing_wrong(command, "nobody reads stdout", r, lost, truth)


def helps():
    for program in (p for p in programs if programs[p]):
        words = [[]] + [
            list(w)
            for w in sorted(
                {
                    (c.argv[1],) + ((c.argv[2],) if c.argv[2] == "learn" else ())
                    for c in commands
                    if c.argv[0] == program and re.fullmatch("[a-z]+", c.argv[1])
                }
            )
        ]
        for word in words:
            for option in ("--help", *(["--version"] if not word else [])):
                argv, name = [programs[program], *word, option], " ".join([program, *word, option])
                nobody = Command(name, ())
                plain = run_with(nobody, argv=argv)
                check(name, plain.code == 0 and plain.stdout and plain.stderr == "", (plain.code, plain.stderr))
                with open("/dev/full", "w") as full:
                    r = run_with(nobody, argv=argv, stdout=full)
                    check(f"{name}: stdout is full", ended_well(r, 1) and r.stderr, (r.code, r.stderr))
                    r = run_with(nobody, argv=argv, stderr=full)
                    check(f"{name}: stderr is full", r.code == 0 and r.stdout == plain.stdout, r.code)
                r = run_with(nobody, argv=argv, closed=[1])
                check(f"{name}: stdout is closed", ended_well(r, 1), (r.code, r.stderr))
                r = run_with(nobody, argv=argv, closed=[2])
                check(f"{name}: stderr is closed", r.code == 0 and r.stdout == plain.stdout, r.code)


def codes():
    """What stderr loses changes no exit code, what stdout loses is a failure."""
    tribotwin = programs["tribotwin"]
    check_healthy = [tribotwin, "diagnose", "check", inputs + "/healthy.yaml", inputs + "/worn.csv"]
    for name, argv, code in (
        ("wrong option", [tribotwin, "run", "--fast"], 2),
        ("no such scenario", [tribotwin, "run", "nothing"], 2),
        ("a limit is exceeded", check_healthy, 3),
    ):
        with open("/dev/full", "w") as full:
            nobody = Command(name, ())
            check(f"{name}: exit code {code}", run_with(nobody, argv=argv).code == code)
            check(f"{name}, stderr is full: exit code {code}", run_with(nobody, argv=argv, stderr=full).code == code)
            check(f"{name}, stderr is closed: exit code {code}", run_with(nobody, argv=argv, closed=[2]).code == code)
            if code == 3:
                check(f"{name}, stdout is full: exit code 1", run_with(nobody, argv=argv, stdout=full).code == 1)


# ---- Control characters in names of a user's files, which a terminal would obey.
def control_characters():
    name = "a\x1b]0;title\x07\x7f\rb"
    in_table = name.replace("\r", "")
    with open(inputs + "/pendulum.xml") as f:
        model = f.read().replace("hinge", "".join(c if c.isalnum() else f"&#{ord(c)};" for c in name))
    write("named.xml", model)
    write("named.yaml", "model: named.xml\nduration_s: 0.1\n" + MOTION)
    with open(inputs + "/fleet.csv") as f:
        write("named.csv", f.read().replace("hinge", in_table))
    tribotwin = programs["tribotwin"]
    for argv, said in (
        ([tribotwin, "run", "named.yaml", "-o", "named_run"], name),
        ([tribotwin, "fleet", "learn", "named.csv", "-o", "named.db"], in_table),
    ):
        for more in ([], ["--json"], ["--color", "always"]):
            shutil.rmtree(inputs + "/named_run", True)
            r = subprocess.run([*argv, *more], cwd=inputs, capture_output=True)
            out = r.stdout.decode()
            title = " ".join(["control characters:", *argv[1:3], *more])
            controls = re.findall("[\0-\x08\x0b-\x1f\x7f]", out)
            check(title, r.returncode == 0 and not controls, (r.returncode, controls, r.stderr[-300:]))
            if more == ["--json"]:
                check(title + ", as they are", said in strings_in(json.loads(out)), out)
            else:
                check(title + ", shown", r"a\x1b]0;title\x07\x7f" in out, out[:300])


def strings_in(value):
    if isinstance(value, (dict, list)):
        return {s for part in (value.values() if isinstance(value, dict) else value) for s in strings_in(part)}
    return {value} if isinstance(value, str) else set()


# ---- Slow and impatient readers.
LONG = [
    programs["tribotwin"],
    "curve",
    inputs + "/pendulum.xml",
    "--joint",
    "hinge",
    "--speeds",
    "1:280:80000",
    "--quiet",
]  # 5 MB


def slow_readers():
    whole = subprocess.run(LONG, capture_output=True).stdout
    check("a result of 5 MB", len(whole) > 5e6, len(whole))
    for blocking in (True, False):
        read, writing = os.pipe()
        os.set_blocking(writing, blocking)
        process = subprocess.Popen(LONG, stdout=writing, stderr=subprocess.PIPE)
        os.close(writing)
        got = bytearray()
        while part := os.read(read, 65536):
            got += part
            time.sleep(0.004)
        os.close(read)
        error = process.communicate(timeout=60)[1]
        check(
            f"a slow reader of a {'' if blocking else 'non-'}blocking pipe gets all",
            process.returncode == 0 and got == whole,
            (process.returncode, len(got), len(whole), error),
        )
    process = subprocess.Popen(LONG, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.read(10)
    process.stdout.close()
    error = process.stderr.read().decode()
    code = process.wait(60)
    check(
        "a reader that goes away early: exit code 1, and it is said",
        code == 1 and error and not any(w in error for w in ABORT),
        (code, error),
    )


# ---- -o that is a device, a pipe or a FIFO. As root the devices are copies, out of everybody else's sight.
OWN_DEVICES = """d=$(mktemp -d) && mount -t tmpfs devices $d && cp -a /dev/null /dev/zero /dev/full /dev/random \
/dev/urandom $d &&
ln -s /proc/self/fd $d/fd && ln -s /proc/self/fd/0 $d/stdin && ln -s /proc/self/fd/1 $d/stdout &&
ln -s /proc/self/fd/2 $d/stderr &&
mount --move $d /dev && rmdir $d || exit 99
"$@"
code=$?
test -c /dev/null && test -c /dev/full && test -L /dev/stdout && test "$(ls /dev | wc -l)" = 9 ||
{ echo "devices were replaced: $(ls -l /dev)" >&2; exit 98; }
exit $code"""
own_devices = ["unshare", "-m", "sh", "-c", OWN_DEVICES, "sh"] if os.geteuid() == 0 else []
safe_devices = not own_devices or subprocess.run([*own_devices, "true"], capture_output=True).returncode == 0


def with_output(command, output):
    return [output if a == command.stream else a for a in argv_of(command)]


def fifo_content(path, result):
    with open(path, "rb") as f:
        result.append(f.read())


def devices(command):
    truth, own = usual(command).after[command.stream], command.stream.encode()  # a page says how it was made
    name = f"{command.name} to "
    for device, code in (("/dev/null", 0), ("/dev/full", 1)):
        r = run_with(command, argv=with_output(command, device), wrapper=own_devices)
        check(
            name + device,
            ended_well(r, code) and not r.after and (code == 0 or device in r.stderr),
            (r.code, r.stderr[-300:], list(r.after)),
        )
    r = run_with(command, argv=with_output(command, "/dev/stdout"), wrapper=own_devices)
    check(
        name + "/dev/stdout",
        ended_well(r, 0) and truth in re.sub(rb"-o (/dev/)?stdout\b", b"-o " + own, r.stdout.encode()) and not r.after,
        (r.code, r.stderr[-300:], r.stdout[:100]),
    )

    # bash's >(cat > x): a descriptor of a pipe by its name below /dev/fd.
    read, writing = os.pipe()
    folder = prepare(command, False)
    process = subprocess.Popen(
        [*own_devices, *with_output(command, f"/dev/fd/{writing}")],
        cwd=folder,
        pass_fds=[writing],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    os.close(writing)
    with os.fdopen(read, "rb") as f:
        got = f.read()
    error = process.communicate(timeout=60)[1]
    check(
        name + "a pipe, as by >(cat)",
        process.returncode == 0
        and re.sub(rb"-o (/dev/fd/)?%d\b" % writing, b"-o " + own, got) == truth
        and not os.listdir(folder),
        (process.returncode, error, len(got), os.listdir(folder)),
    )

    folder = prepare(command, False)
    path, got = os.path.join(folder, command.stream), []
    os.mkfifo(path)
    reader = threading.Thread(target=fifo_content, args=(path, got), daemon=True)
    reader.start()
    process = subprocess.Popen(argv_of(command), cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    error = process.communicate(timeout=60)[1]
    is_fifo = stat.S_ISFIFO(os.lstat(path).st_mode)
    if is_fifo:  # nobody wrote: let the reader go
        try:
            os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        except OSError as e:
            assert e.errno == errno.ENXIO
    reader.join(10)
    check(
        name + "a FIFO",
        process.returncode == 0 and is_fifo and got == [truth],
        (process.returncode, error, is_fifo, [len(g) for g in got]),
    )


# ---- An output that is an input.
def output_is_input(command):
    """Each input of the command, as it stands, by a symbolic and by a hard link, given as its output."""
    output = next(o for o in command.out if not o.endswith("/"))
    for index, argument in enumerate(command.argv):
        source = argument.split("{in}/")[-1] if "{in}/" in argument else None
        if not source or not os.path.isfile(os.path.join(inputs, source)):
            continue
        kinds = ["itself", "a symbolic link", "a hard link"]
        for kind in kinds if nightly else random.Random(f"{seed} {command.name} {index}").sample(kinds, 1):
            folder = prepare(command, False)
            copy_of_input, link = os.path.join(folder, source), os.path.join(folder, "link_" + source)
            copy(os.path.join(inputs, source), copy_of_input)
            if source != "pendulum.xml":
                copy(inputs + "/pendulum.xml", folder)  # which scenarios name
            if kind == "a symbolic link":
                os.symlink(source, link)
            elif kind == "a hard link":
                os.link(copy_of_input, link)
            target = source if kind == "itself" else "link_" + source
            suffix = os.path.splitext(output)[1]
            if not target.endswith(suffix) and suffix in (".png", ".svg", ".mp4", ".html"):
                continue  # refused for its name
            argv = [
                a.replace(inputs + "/" + source, source) if i == index else a
                for i, a in enumerate(command.argument_lists())
            ]
            argv = [target if a == output else a for a in argv]
            before = snapshot(folder)
            for force in ([], ["--force"] if command.knows_force else []):
                r = run_with(command, argv=argv + force, folder=folder)
                untouched = snapshot(folder) == before and (kind != "a symbolic link" or os.path.islink(link))
                check(
                    f"{command.name}: its output is {kind} of its input {source}{' with --force' if force else ''}",
                    ended_well(r, 2) and untouched and source in r.stderr,
                    (r.code, r.stderr[-300:], "" if untouched else "the input was changed"),
                )
                if not command.knows_force:
                    break


def more_inputs():
    """Outputs that are folders, records or written beside their input."""
    tribotwin = programs["tribotwin"]
    cases = [
        ("run into the folder of its own scenario", [tribotwin, "run", "run/scenario.yaml", "-o", "run"]),
        ("export --recording into the record", [tribotwin, "export", "run", "--recording", "-o", "run/telemetry.h5"]),
        (
            "predict with one file for both results",
            [
                tribotwin,
                "predict",
                inputs + "/pendulum.xml",
                inputs + "/robot.yaml",
                inputs + "/recorded.csv",
                "-o",
                "both.csv",
                "--wrench",
                "both.csv",
            ],
        ),
    ]
    if programs["report"]:
        cases += [("a page into the record", [programs["report"], "run", "-o", "run/telemetry.h5"])]
    if programs["hil"]:
        cases += [
            (
                "a session recorded into its scenario",
                [
                    programs["hil"],
                    "drive",
                    "scenario.yaml",
                    "--can",
                    "memory:x",
                    "--duration",
                    "0.1",
                    "--record",
                    "scenario.yaml",
                ],
            ),
            (
                "a session recorded and counted into one file",
                [
                    programs["hil"],
                    "drive",
                    "scenario.yaml",
                    "--can",
                    "memory:x",
                    "--duration",
                    "0.1",
                    "--record",
                    "one",
                    "--stats",
                    "one",
                ],
            ),
        ]
    for name, argv in cases:
        for force in ([], ["--force"]):
            folder = new_folder()
            for source in ("run", "scenario.yaml", "pendulum.xml"):
                copy(os.path.join(inputs, source), os.path.join(folder, source))
            before = snapshot(folder)
            try:
                r = subprocess.run(argv + force, cwd=folder, capture_output=True, text=True, timeout=10)
                code, error = r.returncode, r.stderr
            except subprocess.TimeoutExpired:
                code, error = "ran on", ""
            check(
                f"{name}{' with --force' if force else ''}: refused",
                code == 2 and snapshot(folder) == before,
                (code, error[-300:], "" if snapshot(folder) == before else "an input was changed"),
            )


# ---- An old result, and two writers of a new one.
def old_result(command):
    """Refused without --force, replaced with it."""
    folder = prepare(command, True)
    before = snapshot(folder)
    r = run_with(command, folder=folder)
    check(
        f"{command.name}: an old result is not replaced unasked",
        ended_well(r, 2) and r.after == before and "--force" in r.stderr,
        (r.code, r.stderr[-300:], sorted(k for k in {*before, *r.after} if before.get(k) != r.after.get(k))),
    )
    if check(f"{command.name}: knows --force", command.knows_force):
        r = run(command, True)
        check(
            f"{command.name}: --force replaces",
            r.code == 0 and not missing(r, usual(command).after),
            (r.code, r.stderr[-300:]),
        )


def two_writers(command, first, second):
    """Both at once: one wins and the other is refused, or with --force the last one wins; what is there is whole."""
    truths = [run_with(command, argv=argv).after for argv in (first, second)]
    for force in ([], ["--force"] if command.knows_force else []):
        for _ in range(3 if nightly else 1):
            folder = prepare(command, False)
            both = [
                subprocess.Popen(
                    argv + force,
                    cwd=folder,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    text=True,
                )
                for argv in (first, second)
            ]
            errors = [p.communicate(timeout=60)[1] for p in both]
            codes, after = [p.returncode for p in both], snapshot(folder)
            whole = [
                all(name in after and not not_whole(name, after[name], data) for name, data in truth.items())
                and set(after) == set(truth)
                for truth in truths
            ]
            if force:
                good = 0 in codes and set(codes) <= {0, 1, 2} and any(whole)
            else:
                good = sorted(codes) in ([0, 1], [0, 2]) and whole[codes.index(0)]
            if not good:
                break
        check(
            f"{command.name}: two at once{' with --force' if force else ''}",
            good,
            (codes, whole, sorted(after), errors),
        )
        if not command.knows_force:
            break


def varied(command, *more):
    return [argv_of(command), argv_of(command) + list(more)]


if not safe_devices:
    print(
        "SKIPPED: devices could not be copied (mount namespaces); -o DEVICE was NOT tested, "
        "because as root it could replace the real ones"
    )
with open(inputs + "/healthy.csv") as f:
    header, *rows = f.read().splitlines()
with open(inputs + "/worn.csv", "w") as f:  # twice the friction
    f.write(header + "\n")
    for row in rows[:15]:
        *start_of_row, norm, nm, error = row.split(",")
        f.write(",".join([*start_of_row, str(2 * float(norm)), str(2 * float(nm)), error]) + "\n")
quick = [c for c in commands if not c.slow]
in_parallel(streams, quick)
if not options.only:
    helps(), codes(), control_characters(), slow_readers(), more_inputs()
if safe_devices:
    in_parallel(devices, [c for c in quick if c.stream])
in_parallel(output_is_input, [c for c in quick if any(not o.endswith("/") for o in c.out) and not c.given])
in_parallel(old_result, [c for c in quick if c.old or c.given == ("run",) or any(not o.endswith("/") for o in c.out)])
for c in quick:
    if c.name in ("run", "lab"):
        two_writers(c, *varied(c, "--set", "seed=2"))
    elif c.name == "identify":
        two_writers(c, *varied(c, "--fix", "alpha=1.36"))
    elif c.name == "report pose":
        two_writers(c, *varied(c, "--pose", "hinge=0.5"))
finish()
