"""tribotwin fleet where fitting one curve, judging or explaining one joint, or learning the model of one type crashes:
it fails alone, is named and recorded, all else is done, and the same command tries again; the same on threads and on
MPI ranks. Arguments: tribotwin, libcrash_in_task.so[, mpirun]."""
import json, os, shutil, sqlite3, sys

import harness
from fleet_plant import HEADER, Plant
from harness import check, finish, path

program, shim, *mpirun = sys.argv[1:]
ROBOT, JOINT = "R0007", "joint3"
SPEED, GAP = "0.1717", "1.25"  # rad/s of its slowest level on one day; days between two of its curves
CRASHES = {"LD_PRELOAD": shim}


def table(name, rows):
    with open(path(name), "w") as f:
        f.write("\n".join([HEADER, *rows]) + "\n")


def run(*arguments, on=("--threads", "2"), **crash):
    environment = {**os.environ, **(CRASHES if crash else {}), **crash}
    command = [program, "fleet", *arguments, "--json"]
    if on == "ranks":
        environment.update(OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
        return harness.run(*mpirun, "--oversubscribe", "-n", "4", *command, env=environment, timeout=120)
    return harness.run(*command, *on, env=environment)


def rows_of(store, sql):
    with sqlite3.connect(path(store)) as db:
        return db.execute(sql).fetchall()


def dump(store):
    with sqlite3.connect(path(store)) as db:
        return list(db.iterdump())


def notes(store):
    return [text for (text,) in rows_of(store, "SELECT text FROM notes WHERE text LIKE '%failed%'")]


plant = Plant(40, seed=4)
table("healthy.csv", plant.rows(8))
week = plant.rows(6, {("R0003", "joint2"): 0.4})
days = sorted({row.split(",")[2] for row in week})
mine = lambda row: row.startswith(f"{ROBOT},{JOINT},")
victim = next(i for i, row in enumerate(week) if mine(row) and days[2] in row and ",0.17," in row)
week[victim] = week[victim].replace(",0.17,", f",{SPEED},")
week = [row.replace(days[5], days[5] + "T06:00") if mine(row) else row for row in week]
table("week.csv", week)
r = run("learn", "healthy.csv", "-o", "learned.db")
check("learned", r.returncode == 0 and json.loads(r.stdout)["failed"] == [], r)
shutil.copy(path("learned.db"), path("undisturbed.db"))
undisturbed = run("check", "week.csv", "-o", "undisturbed.db")
check("undisturbed", undisturbed.returncode == 3 and notes("undisturbed.db") == [], undisturbed)

worn = json.loads(undisturbed.stdout)["joints"][0]
check("R0003 joint2 is the first of the list", (worn["robot"], worn["joint"]) == ("R0003", "joint2"), worn)
CHANGE = repr(worn["friction_change"])
r = run("learn", "week.csv", "-o", "models.db")
check("a week learned from", r.returncode == 0 and notes("models.db") == [], r)

ways = {"one": ("--threads", "1"), "two": ("--threads", "2"), **({"ranks": "ranks"} if mpirun else {})}
said = {}
for name, on in ways.items():
    # A curve.
    store = f"{name}.db"
    shutil.copy(path("learned.db"), path(store))
    r = run("check", "week.csv", "-o", store, on=on, CRASH_AT_LOG=SPEED)
    out = json.loads(r.stdout)
    check(f"{name}: a curve: exit code 1 names it", r.returncode == 1 and "all else is done" in r.stderr, r)
    check(
        f"{name}: a curve: robot and joint", f"fit: robot {ROBOT}, joint {JOINT}, {days[2]}: its process" in r.stderr, r
    )
    check(f"{name}: a curve: stderr", "last words: singular at 0.1717 (2 attempts)" in r.stderr, r.stderr)
    one = out["failed"]
    check(
        f"{name}: a curve: recorded with its input",
        len(one) == 1
        and (one[0]["robot"], one[0]["joint"], one[0]["date"]) == (ROBOT, JOINT, days[2])
        and one[0]["input"].endswith(f"week.csv:{victim + 2}"),
        one,
    )
    check(f"{name}: a curve: a note of the store", [f"week.csv:{victim + 2}: " in n for n in notes(store)] == [True])
    count = rows_of(store, "SELECT count(*) FROM observations WHERE learned = 0")
    check(f"{name}: a curve: the others are kept", count == [(6 * 80 - 1,)], count)
    check(f"{name}: a curve: the others are judged", out["judged"] == 80 and out["joints"][0]["robot"] == "R0003", out)
    stored = dump(store)
    r = run("check", "week.csv", "-o", store, on=on)
    again = json.loads(r.stdout)
    check(f"{name}: a curve: the same command goes on", r.returncode == 3 and again["imported"]["added"] == 1, r)
    check(f"{name}: a curve: and nothing failed any more", again["failed"] == [] and notes(store) == [], notes(store))
    check(f"{name}: a curve: then as undisturbed", again["joints"] == json.loads(undisturbed.stdout)["joints"])

    # A joint.
    r = run("check", "-o", store, on=on, CRASH_AT_POWER=GAP)
    joint = json.loads(r.stdout)
    check(f"{name}: a joint: exit code 1", r.returncode == 1, r)
    check(f"{name}: a joint: named", f"judgement: robot {ROBOT}, joint {JOINT}, {days[5]}" in r.stderr, r.stderr)
    check(f"{name}: a joint: the others are judged", (joint["judged"], joint["without_verdict"]) == (79, 1), joint)
    check(f"{name}: a joint: R0003 is listed", joint["joints"][0]["robot"] == "R0003", joint)
    check(
        f"{name}: a joint: a note", [n.startswith("check failed: 6 curves, 8 healthy") for n in notes(store)] == [True]
    )
    r = run("watch", "-o", store, on=on, CRASH_AT_POWER=GAP)
    check(f"{name}: watch: named", r.returncode == 1 and f"robot {ROBOT}, joint {JOINT}" in r.stderr, r)
    check(f"{name}: watch: a note of each", len(notes(store)) == 2, notes(store))
    watched = json.loads(r.stdout)
    check(
        f"{name}: afterwards they succeed",
        [run(c, "-o", store, on=on).returncode for c in ("check", "watch")] == [3, 3],
    )
    check(f"{name}: and no note is left", notes(store) == [], notes(store))
    # What a listed joint looks like.
    r = run("check", "-o", store, on=on, CRASH_AT_CHANGE=CHANGE)
    looks = json.loads(r.stdout)
    check(f"{name}: an explanation: exit code 1 names the joint", "judgement: robot R0003, joint joint2" in r.stderr, r)
    check(f"{name}: an explanation: signal, stderr, attempts", "signal 6" in r.stderr and "(2 attempts)" in r.stderr, r)
    one = looks["failed"]
    check(
        f"{name}: an explanation: that the joint was listed is recorded",
        r.returncode == 1
        and len(one) == 1
        and "listed with q = " in one[0]["input"]
        and "singular" in one[0]["message"],
        one,
    )
    check(f"{name}: an explanation: a note", ["to be explained" in n for n in notes(store)] == [True], notes(store))
    check(
        f"{name}: an explanation: the others are as undisturbed",
        [{**j, "rank": 0} for j in looks["joints"]] == [{**j, "rank": 0} for j in again["joints"][1:]]
        and (looks["judged"], looks["without_verdict"]) == (79, 1),
        looks,
    )
    check(f"{name}: an explanation: then it succeeds", run("check", "-o", store, on=on).returncode == 3)
    check(f"{name}: an explanation: and no note is left", notes(store) == [], notes(store))
    said[name] = (out, joint, watched, looks, stored, dump(store))

    # Once only: tried again.
    r = run("check", "-o", store, on=on, CRASH_AT_POWER=GAP, CRASH_ONCE=path(name + ".once"))
    check(f"{name}: once: done the next time", r.returncode == 3 and os.path.exists(path(name + ".once")), r)

    # learn.
    r = run("learn", "week.csv", "-o", f"{name}_learn.db", "--retries", "0", on=on, CRASH_AT_LOG=SPEED)
    failed = json.loads(r.stdout)["failed"]
    check(
        f"{name}: learn: named, and learns from the others",
        r.returncode == 1
        and len(failed) == 1
        and failed[0]["attempts"] == 1
        and len(json.loads(r.stdout)["models"]) == 2,
        r,
    )

    # The model of a type.
    store = f"{name}_model.db"
    r = run("learn", "week.csv", "-o", store, "--retries", "0", on=on, CRASH_AT_POWER=GAP)
    model = json.loads(r.stdout)
    check(
        f"{name}: a model: exit code 1 names it",
        r.returncode == 1 and "model: joint joint3: its process" in r.stderr,
        r,
    )
    one = model["failed"]
    check(
        f"{name}: a model: recorded with its input",
        len(one) == 1
        and (one[0]["work"], one[0]["joint"], one[0]["input"]) == ("model", JOINT, "240 curves of 40 robots")
        and "signal 6" in one[0]["message"]
        and "last words: singular at 1.25" in one[0]["message"],
        one,
    )
    check(
        f"{name}: a model: a note", [n.startswith("model of joint joint3 failed: 240") for n in notes(store)] == [True]
    )
    check(f"{name}: a model: the others are learned", [m["joint"] for m in model["models"]] == ["joint2"], model)
    failed = dump(store)
    once = {"CRASH_AT_POWER": GAP, "CRASH_ONCE": path(name + "_model.once")}
    r = run("learn", "week.csv", "-o", store, on=on, **once)
    check(f"{name}: a model: tried again", r.returncode == 0 and os.path.exists(once["CRASH_ONCE"]), r)
    check(f"{name}: a model: then the store is as undisturbed", dump(store) == dump("models.db"))
    said[name] += (model["models"], model["failed"], failed)
for name in said:
    check(f"{name}: the same verdicts and store", said[name] == said["one"])

# No model at all.
table("one.csv", [row for row in week if f",{JOINT}," in row])
r = run("learn", "one.csv", "-o", "none.db", CRASH_AT_POWER=GAP)
check("no model: exit code 1, an empty list", r.returncode == 1 and json.loads(r.stdout)["models"] == [], r)
check("no model: the curves are kept", rows_of("none.db", "SELECT count(*) FROM observations") == [(240,)])
finish()
