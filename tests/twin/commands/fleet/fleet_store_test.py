"""tribotwin fleet with a store that another program has changed: exit code 2 and one message with the store's name,
before anything is learned or judged from it; the store stays as it is. Argument: tribotwin."""
import os, shutil, sqlite3, sys

import harness
from fleet_plant import Plant
from harness import check, check_refused, content, finish, path

program = sys.argv[1]
NOBODY = "is no number that tribotwin fleet writes there; the store was changed"

plant = Plant(12, seed=2)
plant.write(path("healthy.csv"), 14)
plant.write(path("week.csv"), 3, {("R0003", "joint2"): 0.2})
COMMANDS = {
    "learn": ("learn", "healthy.csv", "-o", "store.db"),
    "check": ("check", "-o", "store.db"),
    "watch": ("watch", "-o", "store.db"),
}


def run(*arguments):
    return harness.run(program, "fleet", *arguments, "--quiet")


def dump():
    with sqlite3.connect(path("store.db")) as db:
        return list(db.iterdump())


def changed(*statements):
    shutil.copy(path("good.db"), path("store.db"))
    with sqlite3.connect(path("store.db")) as db:
        for sql in statements:
            db.execute(sql)
    db.close()
    return dump()


def refused(name, statements, says, commands=COMMANDS):
    before = changed(*statements)
    for command in commands:
        check_refused(f"{name}: {command}", run(*COMMANDS[command]), ["store.db: ", *says], 2)
    check(f"{name}: the store stays", dump() == before)


run("learn", "healthy.csv", "-o", "good.db"), run("check", "week.csv", "-o", "good.db")
changed()
before = {command: run(*COMMANDS[command]) for command in COMMANDS}
check("a store that nobody changed", [r.returncode for r in before.values()] == [0, 3, 3], before)

# ---- Numbers that no fit has: SQLite keeps any of them.
for column, value in (
    ("Fc_nm", "NULL"), ("Fs_nm", "9e999"), ("Vs_rad_s", "-1"), ("Fv", "'many'"), ("beta", "1e300"),
    ("temperature_degC", "1e300"), ("load_norm", "9e999"), ("scatter1", "-5"), ("scatter2", "NULL"),
    ("claim11", "1e300"), ("claim33", "0"), ("claim54", "-1e300"), ("time_s", "time_s * 100000"),
):  # fmt: skip
    what = "claim11 to claim55" if column == "claim33" else column
    refused(f"{column} = {value}", [f"UPDATE observations SET {column} = {value}"], ["robot R00", f": {what} ", NOBODY])
changed("UPDATE observations SET temperature_degC = NULL, load_norm = NULL, claim11 = NULL WHERE learned = 0")
r = run(*COMMANDS["check"])
check("temperature, load and claims may lack", r.returncode in (0, 3), r)
refused(
    "the name of a robot has control characters",
    ["UPDATE robots SET name = char(27) || '[31m' || name", "UPDATE observations SET Fc_nm = -1"],
    ["robot ?[31mR00", NOBODY],
)

# ---- Other tables.
for name, statement in (
    ("no table of observations", "DROP TABLE observations"),
    ("no table of notes", "DROP TABLE notes"),
    ("a column less", "ALTER TABLE observations DROP COLUMN weak"),
):
    refused(name, [statement], ["no such ", "its tables are not those of a store of tribotwin fleet"])
refused(
    "a view without an end in place of a table",
    [
        "DROP TABLE models",
        "CREATE VIEW models AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) "
        "SELECT n AS type, n AS joint, n AS model FROM c",
    ],
    ["its tables are not those of a store of tribotwin fleet"],
    ["check", "watch"],
)

refused(
    "a constraint of somebody else's",
    ["DROP TABLE checks", "CREATE TABLE checks(kind TEXT, time_s INTEGER, rate REAL, judged INTEGER CHECK(judged < 0), "
     "PRIMARY KEY(kind, time_s))"],
    ["CHECK constraint failed", "its tables are not those of a store of tribotwin fleet"],
    ["check", "watch"],
)  # fmt: skip


# ---- A file that SQLite itself cannot read: no word of it.
def damaged(name, damage):
    shutil.copy(path("good.db"), path("store.db"))
    damage(path("store.db"))
    before = content("store.db", "rb")
    for command in COMMANDS:
        r = run(*COMMANDS[command])
        check_refused(f"{name}: {command}", r, ["store.db: is damaged", "learn again into a new file"], 2, lines=1)
        check(f"{name}: {command}: no word of SQLite", "malformed" not in r.stderr and "schema" not in r.stderr, r)
    check(f"{name}: the store stays", content("store.db", "rb") == before)


def schema(statement):
    def change(file):
        with sqlite3.connect(file) as db:
            db.execute("PRAGMA writable_schema = ON")
            db.execute(f"UPDATE sqlite_master SET {statement}")
        db.close()

    return change


def byte(at, value):
    def change(file):
        with open(file, "r+b") as f:
            f.seek(at), f.write(bytes([value]))

    return change


for name, damage in (
    ("a table without an end", schema("sql = 'CREATE TABLE robots(id INTEGER' WHERE name = 'robots'")),
    ("a table that is none", schema("sql = 'hello' WHERE name = 'robots'")),
    ("control characters", schema("sql = 'CREATE TABLE robots(' || char(27) || '[31m)' WHERE name = 'robots'")),
    ("a table behind the end", schema("rootpage = 99999 WHERE name = 'robots'")),
    ("a table in place of another", schema("rootpage = (SELECT rootpage FROM sqlite_master WHERE name = 'notes')")),
    ("half a file", lambda file: os.truncate(file, os.path.getsize(file) // 2)),
    ("another page", byte(100, 7)),
    ("of a later SQLite", byte(18, 9)),
):
    damaged(name, damage)

# ---- A trigger of somebody else's does not run.
changed("CREATE TRIGGER all_away AFTER INSERT ON verdicts BEGIN DELETE FROM observations; END")
r = run(*COMMANDS["check"])
with sqlite3.connect(path("store.db")) as db:
    left = db.execute("SELECT count(*) FROM observations").fetchone()[0]
check("a trigger: the verdict is the same", r.stdout == before["check"].stdout, r)
check("a trigger: no observation is gone", left == 12 * 2 * 17, left)
finish()
