"""Records that something cut short: interrupted runs, killed runs, files cut at any byte. Whatever tribotwin recover
makes of them are rows of the undisturbed run, bit by bit, and what it cannot read it leaves alone. Options:
programs.py."""
import glob, random

from programs import *

SETTINGS = ("--set", "duration_s=60", "--set", "telemetry_rate_hz=500")
KEPT = ("telemetry.h5.original", "telemetry.h5.damaged")  # where the original may stay
tribotwin = programs["tribotwin"]


def read(path):
    with open(path, "rb") as f:
        return f.read()


def recover(folder):
    return subprocess.run([tribotwin, "recover", folder], capture_output=True, text=True, timeout=60)


def last(found):
    return found["time_s"][-1] if len(found["time_s"]) else 0


def wrong(found):
    """What a recovered record says that the undisturbed one does not; beside first rows also whole rows from within are
    right."""
    why = wrong_rows(found, truth)
    if not why or found is None:
        return why
    rows = np.searchsorted(truth["time_s"], found["time_s"])
    if len(found["time_s"]) and (rows.max() >= len(truth["time_s"]) or np.any(np.diff(rows) <= 0)):
        return why
    for name in found:
        if (
            name != "complete"
            and "cycle" not in name
            and (len(found[name]) != len(rows) or found[name].tobytes() != truth[name][rows].tobytes())
        ):
            return why
    return ""


def said_samples(r):
    number = re.search(r"(\d+) samples", r.stdout)
    return int(number[1]) if number else None


made("tribotwin", "run", "scenario.yaml", "-o", "whole", "--quiet", *SETTINGS)
truth = columns(read(inputs + "/whole/telemetry.h5"))


# ---- SIGINT and SIGTERM.
def interrupted(what):
    name, number, wait = what
    folder = new_folder()
    process = subprocess.Popen(
        [tribotwin, "run", inputs + "/scenario.yaml", "-o", "out", "--realtime", *SETTINGS],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(wait)
    process.send_signal(number)
    error = process.communicate(timeout=30)[1]
    after = snapshot(folder)
    title = f"{name} after {wait} s"
    check(
        f"{title}: exit code 1, and it is said",
        process.returncode == 1 and "interrupted" in error,
        (process.returncode, error),
    )
    summary = json.loads(after.get("out/summary.json", b"{}"))
    check(
        f"{title}: the summary says interrupted",
        summary.get("interrupted") is True and 0 <= summary.get("simulated_s", -1) <= wait + 1,
        summary.keys(),
    )
    found = columns(after["out/telemetry.h5"]) if "out/telemetry.h5" in after else None
    if check(f"{title}: the record is plain HDF5", found is not None, sorted(after)):
        check(
            f"{title}: with the first rows, incomplete",
            not wrong_rows(found, truth) and found["complete"] == 0,
            wrong_rows(found, truth),
        )
        check(f"{title}: none of them is lost", last(found) >= wait - 1, last(found))
        check(
            f"{title}: the summary is that of these rows",
            abs(summary.get("simulated_s", -1) - last(found)) < 0.011,
            (summary.get("simulated_s"), last(found)),
        )
    check(
        f"{title}: no litter",
        set(after) <= {"out/telemetry.h5", "out/summary.json", "out/scenario.yaml"},
        sorted(after),
    )
    before = after.get("out/telemetry.h5")
    r = recover(folder + "/out")
    check(
        f"{title}: nothing to recover",
        r.returncode == 0 and snapshot(folder).get("out/telemetry.h5") == before,
        (r.returncode, r.stdout, r.stderr),
    )


# ---- kill -9: at most the last second is lost.
def killed(wait):
    folder = new_folder()
    process = subprocess.Popen(
        [tribotwin, "run", inputs + "/scenario.yaml", "-o", "out", "--realtime", "--quiet", *SETTINGS], cwd=folder
    )
    while process.poll() is None and not glob.glob(folder + "/out/telemetry.h5*"):
        time.sleep(0.002)
    time.sleep(wait)
    process.kill()
    process.wait()
    title = f"kill -9 after {wait:.2f} s"
    r = recover(folder + "/out")
    found = columns(read(folder + "/out/telemetry.h5"))
    if check(f"{title}: recovered", r.returncode == 0 and found is not None, (r.returncode, r.stderr)):
        check(
            f"{title}: the first rows, bit by bit, incomplete",
            not wrong_rows(found, truth) and found["complete"] == 0,
            wrong_rows(found, truth),
        )
        until = r.stdout.partition(" up to ")[2].partition(" s recovered")[0]
        check(
            f"{title}: it says until when",
            until == f"{last(found):.6g}" or not len(found["time_s"]),
            (r.stdout, last(found)),
        )
        check(f"{title}: all but the last second", last(found) >= wait - 1.1, last(found))
        check(f"{title}: as many as it says", said_samples(r) == len(found["time_s"]), (r.stdout, len(found["time_s"])))
    again = read(folder + "/out/telemetry.h5")
    r = recover(folder + "/out")
    check(
        f"{title}: recovering twice changes nothing",
        r.returncode == 0 and read(folder + "/out/telemetry.h5") == again,
        (r.returncode, r.stdout, r.stderr),
    )


# ---- A record cut at any byte.
def cut(case):
    """Complaints about the recovery of a record of which the first `size` bytes are left."""
    kind, data, rows, size = case
    folder = new_folder()
    path = os.path.join(folder, "telemetry.h5")
    with open(path, "wb") as f:
        f.write(data[:size])
    r = recover(folder)
    after = snapshot(folder)
    now = after.pop("telemetry.h5", None)
    kept = next((after.pop(name) for name in KEPT if name in after), None)
    complaints = []
    if after:
        complaints.append(f"litter: {sorted(after)}")
    if r.returncode == 1:
        if now != data[:size] or kept is not None:
            complaints.append("refused, and the original was changed")
        if "telemetry.h5" not in r.stderr:
            complaints.append(f"refused without naming the file: {r.stderr!r}")
    elif r.returncode == 0:
        found = columns(now)
        why = wrong(found)
        if why:
            complaints.append(why)
        if kept is not None and kept != data[:size]:
            complaints.append("what was kept is not the original")
        if kept is None and now != data[:size] and found and len(found["time_s"]) < rows:
            complaints.append("rows were lost, and the original is gone")
        if said_samples(r) is not None and found and said_samples(r) != len(found["time_s"]):
            complaints.append(f"says {said_samples(r)} samples of {len(found['time_s'])}")
    else:
        complaints.append(f"exit code {r.returncode}: {r.stderr[-200:]}")
    shutil.rmtree(folder)
    return r.returncode == 0, [f"{kind}, {size} of {len(data)} bytes: {c}" for c in complaints]


def cuts():
    source = random.Random(seed)
    whole, unfinished = read(inputs + "/whole/telemetry.h5"), read(inputs + "/torn/telemetry.h5")
    count = 500 if nightly else 50
    for kind, data in (("a finished record", whole), ("a killed run's record", unfinished)):
        # Anywhere, and near the end where the newest things are.
        sizes = (
            [0, 1, 8, 512, 2048, len(data) - 1]
            + [source.randrange(len(data)) for _ in range(count // 2)]
            + [len(data) - source.randrange(1, len(data) // 10) for _ in range(count // 2 - 6)]
        )
        uncut, complaints = cut((kind, data, 0, len(data)))
        check(f"{kind} that is not cut is recovered or complete", uncut and not complaints, complaints)
        rows = len(columns(recovered(data))["time_s"])
        results = in_parallel(cut, [(kind, data, rows, size) for size in sizes])
        complaints = [c for _, one in results for c in one]
        check(
            f"{kind} cut at {len(sizes)} places gives right rows or is refused",
            not complaints,
            "\n     ".join(["", *complaints[:6]]) + f"\n     {len(complaints)} in all",
        )
        print(f"    {sum(good for good, _ in results)} recovered", flush=True)


kill_while_running("torn", 4, *SETTINGS)
in_parallel(interrupted, [("SIGINT", signal.SIGINT, 0.4), ("SIGTERM", signal.SIGTERM, 2.0)])
moments = random.Random(seed)
kills = options.kills or (250 if nightly else 4)
in_parallel(killed, [moments.uniform(1.2, 4) for _ in range(kills)], at_once=4)  # they mostly wait
cuts()
finish()
