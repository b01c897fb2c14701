"""Full and read-only disks, signals and kill -9, for every command that writes: what was there stays, what is new is
absent or whole, and the exit code says which. Three ways: the N-th change of the disk fails or kills (faulty_disk.c), a
disk that is really full (a small tmpfs), kill -9 at random instants. By day two changes of the disk of each command
fail, and a command that neither records nor goes on meets one of the others alone, drawn by the seed and its name:
SIGKILL, a signal or a full tmpfs. Options: programs.py."""
import os, random, signal, subprocess

from programs import *

REASON = "No space left on device"
READ_ONLY = "Read-only file system"
kills = 8 if nightly else 1  # at random instants, per command and start
variants = [
    (c, over)
    for c in commands
    for over in ([False, True] if c.old or c.stream or any(not o.endswith("/") for o in c.out) else [False])
]
if not nightly:  # by day a command has one of its two starts
    starts = {}
    for c, over in variants:
        starts.setdefault(c, []).append(over)
    variants = [(c, random.Random(f"{seed} {c.name}").choice(overs)) for c, overs in starts.items()]


def title(command, over_old):
    return command.name + (" over an old result" if over_old else "")


def not_forced(command, outcome):
    """Of the command's files those whose folder was not forced to disk after they got their names there."""
    named = {}
    for at, (call, path) in enumerate(outcome.calls):
        if call.startswith(("open", "rename")):
            named[path] = at
    last_sync = {path: at for at, (call, path) in enumerate(outcome.calls) if call == "fsync"}
    files = [os.path.join(outcome.folder, o) for o in command.out if not o.endswith("/")]
    return [os.path.basename(f) for f in files if f in named and last_sync.get(os.path.dirname(f), -1) < named[f]]


def undisturbed(variant):
    """What the command leaves, how long it takes and the changes it makes; that a second one leaves the same."""
    command, over_old = variant
    first, second = run_faulty(command, over_old, 0, "full"), run(command, over_old)
    good = (
        first.code == 0 and first.calls and first.after != first.before and not judge(command, second, first.after)[0]
    )
    check(
        f"{title(*variant)}: undisturbed, it works and repeats",
        good,
        (first.code, first.stderr[-500:], judge(command, second, first.after)),
    )
    check(
        f"{title(*variant)}: the names are forced to disk", not not_forced(command, first), not_forced(command, first)
    )
    forget(first), forget(second)
    return first.after, second.seconds, first.calls, good


def chosen(count):
    """Of many calls, at night the first and last 15 and 30 between; by day two."""
    few, ends, between = (40, 15, 30) if nightly else (2, 0, 2)
    if count <= few:
        return list(range(1, count + 1))
    inner = range(ends + 1, count - ends + 1)
    return sorted(
        {
            *range(1, ends + 1),
            *range(count - ends + 1, count + 1),
            *random.Random(f"{seed} {count}").sample(inner, min(between, len(inner))),
        }
    )


def missing(outcome, truth):
    """What is not there as a whole, although the exit code was 0."""
    found = {
        name: not_whole(name, outcome.after[name], data) if name in outcome.after else "is not there"
        for name, data in truth.items()
    }
    return [f"exit code 0, but {name} {why}" for name, why in found.items() if why]


def names_the_file(stderr, call, reason):
    """The message names what could not be written: the file itself, not its temporary name."""
    name = os.path.basename(call[1])
    plain = re.sub(r"\.(partial(-\w+)?|recovering)$", "", name).lstrip(".")
    if call[0] == "fsync" and os.path.splitext(plain)[1] == "":  # of a folder: the file in it, or the folder
        return bool(re.search(r"[\w./-]+: ", stderr.split(reason)[0].split("\n")[-1].split(": ", 1)[-1]))
    return plain in stderr


class Tally:
    """Complaints about many runs of one kind, as one line each of the first and a number."""

    def __init__(self, name):
        self.name, self.runs, self.bad, self.litter = name, 0, [], collections.Counter()

    def add(self, where, complaints, litter=()):
        self.runs += 1
        self.bad += [f"{where}: {c}" for c in complaints]
        self.litter.update(re.sub(r"(\.partial-)[A-Za-z0-9]+$", r"\1XXXXXX", name) for name in litter)

    def add_all(self, one, cases):
        """`one` of every case is what add() takes."""
        for where, complaints, litter in in_parallel(one, cases):
            self.add(where, complaints, litter)

    def report(self, covered):
        litter = (
            "; litter: " + ", ".join(f"{n} x {name}" for name, n in sorted(self.litter.items())) if self.litter else ""
        )
        more = [f"{len(self.bad) - 4} more"] if len(self.bad) > 4 else []
        check(self.name, not self.bad, "\n     ".join(["", *self.bad[:4], *more]), f"({covered}{litter})")


def change(n, how, r):
    """Where a run was disturbed: "change 5 (SIGTERM: rename a b)"."""
    return f"change {n} ({how}: {' '.join(r.calls[n - 1]) if len(r.calls) >= n else '?'})"


def but_journals(command, complaints):
    """A store that cannot be put right on its disk keeps its journal, which does that when it is opened again."""
    stores = tuple(f"{start}{name}" for name in command.added_to for start in ("", "litter: "))
    return [c for c in complaints if not (stores and c.startswith(stores))]


def full_disk(variant, truth, calls):
    """The N-th change fails, one way after the other; with --all in every way. What can go on does so once."""
    command, over_old = variant
    ways = ["full", "short", "once"]
    cases = [(n, how) for n in chosen(len(calls)) for how in (ways if nightly else [ways[n % 3]])]
    can_go_on = command.resumable
    read_only = chosen(len(calls))[:: 1 if nightly else 2] if can_go_on else []
    cases += [(n, "read-only") for n in read_only]
    resumed = read_only[len(read_only) // 2 :][:1]

    def one(case):
        n, how = case
        reason = READ_ONLY if how == "read-only" else REASON
        r = run_faulty(command, over_old, n, how)
        found, litter = judge(command, r, truth)
        complaints = but_journals(command, found)
        reached = len(r.calls) >= n  # how often a run flushes depends on the clock
        failed_at = r.calls[n - 1] if reached else ["none", r.folder]
        hint = (
            reached and how == "once" and "fallocate" in failed_at[0]
        )  # space that cannot be kept in advance may be there later
        # of work that is kept until it is done, and then removed or written anew
        hint |= reached and how == "once" and failed_at[0] == "close" and failed_at[1].endswith(".unfinished")
        hint |= reached and command.name.startswith("fleet") and "sync" in failed_at[0] and os.path.isdir(failed_at[1])
        if r.code == 0 and command.tells_master:
            forget(r)
            return f"change {n} ({how})", complaints, litter
        if r.code == 0 and (hint or not reached):
            complaints += missing(r, truth)
            forget(r)
            return f"change {n} ({how})", complaints, litter
        if r.code != 1:
            complaints.insert(0, f"exit code {r.code}")
        # SQLite tries again to open its files, without making them, and says why that failed; of a sync, of a short
        # write, which has no errno, and of a write to a read-only disk it says less.
        unsaid = command.name.startswith("fleet") and (
            failed_at[0].startswith("open")
            or "disk I/O error" in r.stderr
            and ("sync" in failed_at[0] or how in ("short", "read-only"))
        )
        if reason not in r.stderr and not unsaid:
            complaints.append(f"the reason is not said: {r.stderr[-200:]!r}")
        # What is left of a short write may have its place on the disk already: then a later change is the first that
        # fails.
        elif not unsaid and not any(
            names_the_file(r.stderr, call, reason)
            for call in (r.calls[n - 1 :] if how == "short" and reached else [failed_at])
        ):
            complaints.append(f"the file is not named: {r.stderr[-200:]!r}")
        if how == "read-only" and n in resumed or complaints != found and r.code:
            complaints += again(command, over_old, r, truth)
        forget(r)
        return (f"change {n} ({how}: {failed_at[0]} {os.path.relpath(failed_at[1], r.folder)})", complaints, litter)

    tally = Tally(title(*variant) + ": the disk is full or read-only")
    tally.add_all(one, cases)
    tally.report(f"{tally.runs} runs, {len(chosen(len(calls)))} of {len(calls)} changes of the disk")


# A disk of `size` bytes is mounted over the case's folder, out of everybody else's sight; what was left on it is
# carried out.
REALLY_FULL = """mount -t tmpfs -o size=$1 full "$2" && mkdir "$2/case" && cp -a "$3/." "$2/case/" && cd "$2/case" &&
head -c 4096 /dev/zero > ../one_page || exit 99
result=$4; shift 4; "$@"
code=$?; cp -a . "$result/"; exit $code"""
may_mount = (
    subprocess.run(["unshare", "-m", "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True).returncode == 0
)


def really_full(variant, truth):
    """A tmpfs with room for nothing, half, or all but the last page of the result: also what stdio buffers and children
    write."""
    command, over_old = variant
    page = 4096
    pages = lambda files: sum(-(-len(data) // page) for data in files.values())

    def one(share):
        folder = prepare(command, over_old)
        before = snapshot(folder)
        has, needs = pages(before), pages({**before, **truth})
        size = page * (1 + max(has, {"nothing": has, "half": (has + needs) // 2, "all but a page": needs - 1}[share]))
        disk, result = new_folder(), new_folder()
        r = run(
            command,
            over_old,
            folder,
            wrapper=["unshare", "-m", "sh", "-c", REALLY_FULL, "sh", str(size), disk, folder, result],
        )
        r.before, r.after = before, snapshot(result)
        complaints, litter = judge(command, r, truth)
        if r.code == 0:  # it may have made room by replacing what was there
            complaints += [] if command.tells_master else missing(r, truth)
        elif r.code != 1 or REASON not in r.stderr:
            complaints.insert(0, f"exit code {r.code}, {r.stderr[-200:]!r}")
        for path in (folder, disk, result):
            shutil.rmtree(path, True)
        return f"room for {share}", complaints, litter

    tally = Tally(title(*variant) + ": a disk that is really full")
    shares = ["nothing", "half", "all but a page"]
    if not nightly:
        shares = random.Random(title(*variant)).sample(shares, 1)
    tally.add_all(one, shares)
    tally.report(f"{tally.runs} sizes")


def again(command, over_old, killed, truth):
    """After a kill or a failure: a record is recovered, the command works again, and nothing stands in its way."""
    complaints = []
    folder = killed.folder
    if command.name.startswith("run") and not command.name.endswith("varied"):
        record = killed.after.get("out/telemetry.h5")
        if record is not None and record != killed.before.get("out/telemetry.h5"):
            r = subprocess.run(
                [programs["tribotwin"], "recover", "out"], cwd=folder, capture_output=True, text=True, timeout=60
            )
            found, seen = columns(snapshot(folder)["out/telemetry.h5"]), columns(record)
            if r.returncode == 0:
                why = wrong_rows(found, columns(truth["out/telemetry.h5"]))
                if why:
                    complaints.append("recovered: " + why)
                printed = re.search(r"(\d+) samples", r.stdout)
                if printed and found and int(printed[1]) != len(found["time_s"]):
                    complaints.append(f"recover says {printed[1]} samples of {len(found['time_s'])}")
            elif r.returncode != 1 or seen and len(seen["time_s"]):
                complaints.append(f"recover: exit code {r.returncode}, {r.stderr[-200:]}")
            elif snapshot(folder)["out/telemetry.h5"] != record:
                complaints.append("recover refused and changed the original")
    over = command.state and "out/summary.json" in killed.after  # it was killed when all was done
    r = run(command, command.knows_force and (not command.resumable or over), folder)
    if r.code != 0:
        return complaints + [f"started again: exit code {r.code}, {r.stderr[-200:]!r}"]
    return complaints + ["started again: " + why for why in missing(r, truth)]


def killed_at_calls(variant, truth, calls):
    command, over_old = variant
    cases = [
        (n, how) for n in chosen(len(calls)) for how in (["kill", "torn"] if nightly else [["kill", "torn"][n % 2]])
    ]
    if not nightly:
        cases = random.Random(f"{seed} {title(*variant)}").sample(cases, 1)

    def one(case):
        n, how = case
        r = run_faulty(command, over_old, n, how)
        complaints, litter = judge(command, r, truth, killed=True)
        if r.code != (-9 if len(r.calls) >= n else 0):
            complaints.insert(0, f"exit code {r.code}")
        complaints += again(command, over_old, r, truth)
        forget(r)
        return change(n, how, r), complaints, litter

    tally = Tally(title(*variant) + ": SIGKILL in place of a change of the disk")
    tally.add_all(one, cases)
    tally.report(f"{tally.runs} kills")
    return tally.runs


def ended_by_signals(variant, truth, calls):
    """SIGINT, SIGTERM or SIGHUP just before a change of the disk: nothing temporary stays. Before the first change
    the work is yet to be done, and the signal must end it."""
    command, over_old = variant
    names = ("SIGTERM", "SIGINT", "SIGHUP")
    cases = [(n, names[n % 3]) for n in chosen(len(calls))]
    if not nightly:
        draw = random.Random(f"{seed} {title(*variant)} signals")
        cases = [(1, draw.choice(names)), *draw.sample(cases[1:], min(1, len(cases) - 1))]

    def one(case):
        n, name = case
        r = run_faulty(command, over_old, n, name)
        complaints, litter = judge(command, r, truth)
        if r.code == 0 and n == 1 and not command.writes_last:
            complaints.insert(0, "the signal was swallowed: exit code 0")
        elif r.code == 0:  # it came when all was done, or the work ended by itself
            complaints += missing(r, truth)
        elif r.code != -getattr(signal, name) and not (r.code == 1 and "interrupted" in r.stderr):
            complaints.insert(0, f"exit code {r.code}, {r.stderr[-200:]!r}")
        complaints += again(command, over_old, r, truth)
        forget(r)
        return change(n, name, r), complaints, litter

    tally = Tally(title(*variant) + ": a signal just before a change of the disk")
    tally.add_all(one, cases)
    tally.report(f"{tally.runs} signals")


def killed_at_random(variant, truth, seconds):
    command, over_old = variant
    instants = random.Random(f"{seed} {title(*variant)}")
    hits = 0

    def one(instant):
        r = run(command, over_old, kill_after=instant)
        complaints, litter = judge(command, r, truth, killed=True)
        if r.code == 0:
            complaints += missing(r, truth)
        elif r.code != -9:
            complaints.insert(0, f"exit code {r.code}")
        complaints += again(command, over_old, r, truth)
        forget(r)
        return r.code == -9, f"after {instant:.4f} s", complaints, litter

    tally = Tally(title(*variant) + ": kill -9 at random instants")
    while hits < kills and tally.runs < 3 * kills:
        for hit, where, complaints, litter in in_parallel(
            one, [instants.uniform(0, seconds) for _ in range(kills - hits)]
        ):
            hits += hit
            tally.add(where, complaints, litter)
    tally.report(f"{hits} kills, {tally.runs - hits} came too late")
    return hits


def others(variant, truth, calls):
    """Kills, signals and a full tmpfs, or by day one of them (see above); how many kills there were."""
    command = variant[0]
    ways = [killed_at_calls, ended_by_signals, lambda *_: really_full(variant, truth) if may_mount else None]
    if not nightly and not command.recording and not command.resumable:
        ways = random.Random(f"{seed} {command.name} others").sample(ways, 1)
    return sum(way(variant, truth, calls) or 0 for way in ways)


LATE = """#!/bin/sh
touch "$LATE_FOLDER/begun"
while kill -0 $PPID 2> /dev/null; do sleep 0.02; done
for last; do :; done
: > "$last"
touch "$LATE_FOLDER/ended"
"""


def late_child(name):
    """A signal while ffmpeg has not yet begun: when it does, it makes no file again that the signal removed."""
    command = next(c for c in commands if c.name == "report video")
    folder, place = prepare(command, False), new_folder()
    with open(place + "/ffmpeg", "w") as f:
        f.write(LATE)
    os.chmod(place + "/ffmpeg", 0o755)
    environment = {**os.environ, "PATH": place + ":" + os.environ["PATH"], "LATE_FOLDER": place}
    process = subprocess.Popen(argv_of(command), cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=-3)
    wait_for = lambda file: [time.sleep(0.02) for _ in range(1500) if not os.path.exists(f"{place}/{file}")]
    wait_for("begun")
    before = os.listdir(folder)
    process.send_signal(getattr(signal, name))
    code = process.wait(30)
    removed = os.listdir(folder)
    wait_for("ended")
    seen = (code, before, removed, os.listdir(folder), os.listdir(place))
    good = code == -getattr(signal, name) and len(before) == 1 and removed == [] == os.listdir(folder)
    check(f"{name} before ffmpeg has begun: nothing is left", good and os.path.exists(place + "/ended"), seen)


if not may_mount:
    print(
        "SKIPPED: no tmpfs can be mounted here (needs root or user namespaces): "
        "a disk that is really full was NOT tested"
    )
total = at_random = 0
for variant in variants:
    truth, seconds, calls, good = undisturbed(variant)
    if not good:
        continue
    if not variant[0].slow:
        full_disk(variant, truth, calls)
        total += others(variant, truth, calls)
    # Between two changes of the disk a kill leaves what one at the next change leaves, but for children and rows.
    if nightly or variant[0].slow or variant[0].recording or variant[0].resumable:
        at_random += killed_at_random(variant, truth, seconds)
if any(c.name == "report video" for c in commands):
    for name in ("SIGTERM", "SIGINT", "SIGHUP"):
        late_child(name)
if any("{page}" in word for c in commands for word in c.argv):
    rows = sorted(pages_connected)
    check("a page was connected in most runs with one", rows and rows[len(rows) // 2] > 0, rows)
print(f"{total} kills in place of a change of the disk, {at_random} at random instants")
finish()
