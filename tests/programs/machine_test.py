"""A machine that fails in other ways than by a full disk (disaster_test.py): a file that cannot be read or written, a
folder that cannot be listed to its end, no descriptor or memory left, a disk that fails a sync, calls that are
interrupted or move half, a clock that jumps (faulty_machine.c); few descriptors from the beginning; a locale with
decimal commas. Either the command says so, with
its exit code and one line that names the file, or its results are those of an undisturbed machine. Afterwards it works
as ever. Options: programs.py."""
import random, re

from foreign import FOREIGN
from programs import *

# Of each: whether every call fails or the N-th one, and what the message says.
FAULTS = {
    "interrupted": (False, ""),
    "short": (False, ""),
    "clock_back": (False, ""),
    "clock_forth": (False, ""),
    "decimal_comma": (False, ""),
    "read": (True, "Input/output error"),
    "open": (True, "Too many open files"),
    "list": (True, "Input/output error"),
    "write": (True, "Input/output error"),
    "sync": (True, "Input/output error"),
    "memory": (True, "out of memory"),
    "descriptors": (True, "Too many open files"),  # no more than N
}
# How `fleet` ends where some of its work failed.
ALL_ELSE = re.compile(
    r"^tribotwin: (model|fit|judgement): [^;]+: .+; all else is done and kept, and the same command tries again$", re.M
)
DESCRIPTORS = range(4, 25)  # with 3 the program itself is not loaded
SAMPLES = 12 if nightly else 1  # of one fault and command, where every N would be too many
own = {os.path.basename(p) for p in programs.values() if p}


def german():
    """What makes a program write 0,5; nothing where no such locale can be made."""
    place = os.path.join(work, "locales")
    os.makedirs(place)
    made = subprocess.run(
        ["localedef", "--no-archive", "-i", "de_DE", "-f", "UTF-8", place + "/de_DE.UTF-8"], capture_output=True
    )
    environment = {"LOCPATH": place, "LC_ALL": "de_DE.UTF-8"}
    r = subprocess.run(["locale", "decimal_point"], env={**os.environ, **environment}, capture_output=True, text=True)
    return environment if made.returncode == 0 and r.stdout == ",\n" else None


def run_on(command, fault, at, over_old):
    """The command on a machine whose N-th call of a kind fails; how many there were, and what failed."""
    folder = prepare(command, over_old)
    if fault == "decimal_comma":
        return run(command, over_old, folder, locale), 1, ""
    if fault == "descriptors":
        r = run(command, over_old, folder, wrapper=["sh", "-c", f'ulimit -n {at}; exec "$@"', "sh"])
        return r, at, f"at most {at}"
    count, log = folder + ".count", folder + ".log"
    environment = {
        "LD_PRELOAD": os.path.abspath(options.machine),
        "FAULTY_MACHINE": fault,
        "FAULTY_MACHINE_AT": str(at),
        "FAULTY_MACHINE_FOLDER": work,
        "FAULTY_MACHINE_PROGRAMS": ",".join(own),
        "FAULTY_MACHINE_COUNT": count,
        "FAULTY_MACHINE_LOG": log,
    }
    r = run(command, over_old, folder, environment)
    failed = ""
    if os.path.exists(log):
        with open(log) as f:
            failed = f.read().strip()
    with open(count, "rb") as f:
        calls = int.from_bytes(f.read(), "little")
    return r, calls, failed


def missing(r, truth):
    found = {n: not_whole(n, r.after[n], data) if n in r.after else "is not there" for n, data in truth.items()}
    return [f"{name} {why}" for name, why in found.items() if why]


def wrong_message(r, fault, failed):
    """What is wrong with stderr of a command that gave up."""
    lines = [line for line in r.stderr.splitlines() if line.startswith(tuple(p + ": " for p in own))]
    others = [
        line
        for line in r.stderr.splitlines()
        if line not in lines and not line.startswith(("note:", "warning:", "web:"))
    ]
    if len(lines) != 1:
        return f"{len(lines)} messages: {r.stderr[-300:]!r}"
    if others or FOREIGN.search(r.stderr):
        return f"other words: {r.stderr[-300:]!r}"
    name = os.path.basename(failed.split(" ", 1)[-1])
    plain = re.sub(r"\.partial-\w+$|(?<=\.db)-journal$", "", name).lstrip(".")
    if fault in ("read", "open", "list", "write") and plain not in lines[0]:
        return f"does not name {plain}: {lines[0]!r}"
    return ""


def wrong_reason(r, fault):
    """For a limit that the machine keeps: the message must say which it was."""
    return "" if fault != "descriptors" or FAULTS[fault][1] in r.stderr else f"the reason is not said: {r.stderr!r}"


def works_again(command, over_old, r, truth):
    """The command once more, in the folder that the fault left."""
    again = run(command, command.knows_force and not command.resumable, r.folder)
    if again.code != 0:
        return [f"made again: exit code {again.code}, {again.stderr[-200:]!r}"]
    return ["made again: " + why for why in missing(again, truth)]


def judge_fault(command, over_old, truth, fault, at):
    """Complaints about one command with one fault; whether the fault was met."""
    r, calls, failed = run_on(command, fault, at, over_old)
    complaints, _ = judge(command, r, truth)
    if r.code == 1 and command.name.startswith("fleet") and ALL_ELSE.search(r.stderr):
        stores = tuple(command.added_to + command.out)  # they have rows of what did not fail
        complaints = [c for c in complaints if not c.startswith(stores)]
    met = bool(failed) if FAULTS[fault][0] else calls > 0
    if r.code == 0:
        complaints += [] if command.tells_master else missing(r, truth)
        if FOREIGN.search(r.stderr):
            complaints.append(f"other words: {r.stderr[-300:]!r}")
    elif not met or not FAULTS[fault][0]:
        complaints.append(f"exit code {r.code}: {r.stderr[-300:]!r}")
    else:
        # 2 where it takes what cannot be read for wrong input.
        if r.code != 1 and not (r.code == 2 and fault in ("read", "open", "list", "descriptors")):
            complaints.append(f"exit code {r.code}: {r.stderr[-300:]!r}")
        elif why := wrong_message(r, fault, failed) or wrong_reason(r, fault):
            complaints.append(why)
        complaints += works_again(command, over_old, r, truth)
    forget(r)
    return met, [f"{fault} {at} ({failed}): {c}" for c in complaints]


def cases_of(command, over_old):
    """Faults and places of them: with --all every read, opening and sync, and samples of the allocations."""
    for fault, (by_number, _) in FAULTS.items():
        if fault == "decimal_comma" and not locale:
            continue
        if not by_number:
            yield fault, 1
            continue
        if fault == "descriptors":
            yield from ((fault, at) for at in DESCRIPTORS)
            continue
        r, calls, _ = run_on(command, fault, 0, over_old)
        forget(r)
        places = range(1, calls + 1)
        most = 4 * SAMPLES if fault == "memory" else 200
        for at in places if len(places) <= most else sorted(random.Random(seed).sample(places, most)):
            yield fault, at


def test(command, over_old, cases):
    """`cases`: as of cases_of()."""
    name = command.name + (" over an old result" if over_old else "")
    usual = run(command, over_old)
    if not check(f"{name}: works", usual.code == 0, (usual.code, usual.stderr[-300:])):
        return 0
    results = in_parallel(lambda case: judge_fault(command, over_old, usual.after, *case), cases)
    complaints = [c for _, some in results for c in some]
    met = sum(met for met, _ in results)
    more = [f"{len(complaints) - 6} more"] if len(complaints) > 6 else []
    check(
        f"{name}: faults of the machine", not complaints, "\n     ".join(["", *complaints[:6], *more]), f"({met} met)"
    )
    forget(usual)
    return met


def engine_gives_up():
    """A model whose stack in the engine is too small for its contacts, which come when the beam has fallen."""
    beam = "".join(f'<geom type="box" size=".04 .04 .04" pos="{i / 10} 0 0"/>' for i in range(40))
    fall = f'<geom type="plane" size="5 5 .1" pos="2 0 -1"/><body pos="2 0 0"><freejoint/>{beam}</body>'
    write("beam.xml", PENDULUM.replace("<worldbody>", f'<size nstack="2000"/><worldbody>{fall}'))
    write("beam.yaml", "model: beam.xml\nduration_s: 3\n" + MOTION)
    folder = new_folder()
    r = subprocess.run(
        [programs["tribotwin"], "run", f"{inputs}/beam.yaml", "-o", "out"], cwd=folder, capture_output=True, text=True
    )
    after = snapshot(folder)
    said = r.stderr == "tribotwin: the engine gave up: Stack overflow\n"
    check("the engine gives up: exit code 1, and it is said", r.returncode == 1 and said, (r.returncode, r.stderr))
    check("the engine gives up: what is left", set(after) == {"out/telemetry.h5", "out/scenario.yaml"}, sorted(after))
    found = columns(recovered(after["out/telemetry.h5"]))
    check("the engine gives up: the record is recovered", found and not found["complete"], found)


locale = german()
if not locale:
    print("SKIPPED: localedef cannot make de_DE.UTF-8; decimal commas were NOT tested")


def whole():
    return sum(test(c, o, list(cases_of(c, o))) for c in commands for o in [False, bool(c.out)] if not c.slow)


# Commands and the faults that ctest gives them: those that once lost data, and some of every kind.
SAMPLE = {
    "export --mcap": [("read", 81), ("read", 82), ("read", 83)],
    "recover": [("sync", 1), ("sync", 2), ("sync", 3), ("memory", 1)],
    "diagnose learn": [("read", 2), ("read", 7), ("read", 8), ("short", 1)],
    "run": [("interrupted", 1), ("open", 1), ("memory", 1000), ("decimal_comma", 1), ("descriptors", 5)],
    "run --web, a page connected": [("interrupted", 1), ("short", 1), ("write", 3), ("memory", 600)]
    + [("descriptors", at) for at in (8, 12, 14)],
    "lab": [("memory", 4), ("sync", 2), ("clock_back", 1), ("write", 3), ("decimal_comma", 1)],
    "calibrate": [("read", 2), ("short", 1), ("clock_forth", 1)],
    "export --csv": [("memory", 4), ("sync", 1)],
    "fleet learn": [("descriptors", 8), ("write", 2)],
    "hil dbc": [("read", 1), ("memory", 20)],
    "hil replay": [("read", 3), ("interrupted", 1), ("write", 2), ("descriptors", 6)],
    "report": [("read", 2), ("decimal_comma", 1), ("descriptors", 8)],
    "report --png": [("write", 2), ("sync", 3), ("descriptors", 8)],
    "report sweep": [("list", 2), ("list", 8)],
}


def sample():
    possible = lambda cases: [case for case in cases if locale or case[0] != "decimal_comma"]
    return sum(test(c, False, possible(SAMPLE[c.name])) for c in commands if c.name in SAMPLE)


print(whole() if nightly else sample(), "faults met")
if not options.only:
    engine_gives_up()
finish()
