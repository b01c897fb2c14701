"""tribotwin fleet with its store in a PostgreSQL: what SQLite gives; kills, two commands at once, wrong and foreign
databases. Argument: tribotwin."""
import atexit, json, os, subprocess, sys, time

import harness
from fleet_plant import HEADER, Plant
from harness import check, check_refused, finish, path, work
from postgresql import Postgresql, programs

program = sys.argv[1]
probe = harness.run(program, "fleet", "learn", "none.csv", "-o", "postgresql://nobody@%2Fnowhere/none")
lacks = [] if programs() else ["postgresql-15"]
if "built without PostgreSQL" in probe.stderr:
    check_refused("a build without PostgreSQL says so", probe, ["libpqxx-dev", "postgresql://nobody@"])
    lacks.append("libpqxx-dev, and a build with it")
if lacks:
    print("SKIPPED: not installed:", *lacks, "(Debian: postgresql-15 libpqxx-dev, or tests/run.sh)")
    sys.exit(1 if os.environ.get("TRIBOTWIN_EVERY_TEST") or harness.failures else 77)

server = Postgresql()
atexit.register(server.remove)
server.start()


def run(*arguments, code=0, **options):
    r = harness.run(program, "fleet", *arguments, **options)
    check(f"exit code {code}: fleet {' '.join(map(str, arguments))[:80]}", r.returncode == code, (r.stdout, r.stderr))
    return r


def table(name, rows):
    with open(path(name), "w") as f:
        f.write("\n".join([HEADER, *rows]) + "\n")


# ---- The same results.
worn = {(f"R{r:04}", "joint2"): 0.1 for r in (3, 7)}
plant = Plant(20, seed=4)
table("healthy.csv", plant.rows(14)), table("week.csv", plant.rows(10, worn))
url = server.make("plant")


def both(*arguments, code=0):
    found = []
    for store in ("plant.db", url):
        j = json.loads(run(*arguments, "-o", store, "--json", code=code).stdout)
        check("the store is named", j.get("files", [store]) == [store], j.get("files"))
        j.pop("files", None)
        found.append(j)
    check(f"{arguments}: the same JSON", found[0] == found[1], found)
    return found[1]


learned = both("learn", "healthy.csv")
check("learned", learned["imported"]["added"] == 560, learned["imported"])
checked = both("check", "week.csv", code=3)
check("the worn joints are listed", set(worn) <= {(j["robot"], j["joint"]) for j in checked["joints"]}, checked)
both("watch", code=3)
before = server.dump("plant")
again = both("check", "week.csv", code=3)
check("the same data again: all known", again["imported"]["known"] == 400 and again["imported"]["added"] == 0, again)
check("and nothing changes", server.dump("plant") == before)
changed = plant.rows(1)
table("changed.csv", [row.replace("2026-03-25", "2026-03-24") for row in changed])
for store in ("plant.db", url):
    check_refused("a changed curve", run("check", "changed.csv", "-o", store, code=2), ["week.csv:", "--replace"])
check("refused, nothing changes", server.dump("plant") == before)
both("check", "changed.csv", "--replace", code=3)

# ---- Another collation than that of bytes does not change the order; another schema is another store.
table("cases.csv", [r.replace("R0001", "r0001").replace("R0002", "Ä2") for r in Plant(8, seed=2).rows(10)])
server.query("CREATE SCHEMA \"Other one\"", "plant")
url_of_schema = url + "?options=-csearch_path%3D%22Other%5C%20one%22"
kept = server.dump("plant")
run("learn", "cases.csv", "-o", url_of_schema, "--quiet")
r = server.query('SELECT count(*) FROM "Other one".observations', "plant")
check("a schema of its own", r.strip() == "160", r)
rows = lambda dump: {line for line in dump if line.startswith("INSERT INTO public.")}
check("the first one stays", rows(server.dump("plant")) == rows(kept))

# ---- kill -9 in the midst.
url = server.make("killed")
run("learn", "week.csv", "-o", url, "--quiet")
before, old = server.dump("killed"), 0
for i in range(8):
    process = subprocess.Popen([program, "fleet", "learn", "healthy.csv", "-o", url], cwd=work, stdout=-3, stderr=-3)
    inserting = "SELECT count(*) FROM pg_stat_activity WHERE datname = 'killed' AND backend_xid IS NOT NULL"
    while process.poll() is None and server.query(inserting).strip() == "0":
        pass
    time.sleep(0.01 * i)
    killed = process.poll() is None
    process.kill(), process.wait()
    while server.query("SELECT count(*) FROM pg_stat_activity WHERE datname = 'killed'").strip() != "0":
        time.sleep(0.05)
    if killed and server.dump("killed") == before:
        old += 1
    else:
        n = server.query("SELECT count(*) FROM observations WHERE learned = 1", "killed").strip()
        check("what is not as before is whole", n == "960", n)
        break
check("killed with rows written, the database is as before", old >= 1, old)
run("learn", "healthy.csv", "-o", url, "--quiet")

# ---- Two at once: one after the other.
url = server.make("two")
both_at_once = [
    subprocess.Popen([program, "fleet", "learn", name, "-o", url, "--quiet"], cwd=work, stdout=-3, stderr=-1)
    for name in ("healthy.csv", "week.csv")
]
said = [p.communicate(timeout=120)[1] for p in both_at_once]
check("both do their work", [p.returncode for p in both_at_once] == [0, 0], said)
n = server.query("SELECT count(*), count(DISTINCT joint) FROM observations", "two").strip()
check("all curves of both are there", n == "960|40", n)
holder = subprocess.Popen(
    server._command("psql", "-X", "-A", "-t", "-h", server.folder, "-U", server.USER, "-d", "two"),
    stdin=-1, stdout=-1, text=True, cwd=server.folder,
)  # fmt: skip
holder.stdin.write("BEGIN; SELECT 'locked', pg_advisory_xact_lock(1413629524, hashtext('public'));\n")
holder.stdin.flush()
line = None
while line != "" and "locked|" not in (line := holder.stdout.readline()):
    pass
check("the lock is held", line != "")
check_refused("a store that is locked", run("watch", "-o", url, code=1), "another command works on this store", code=1)
holder.stdin.close(), holder.wait()

# ---- Wrong, foreign, down. A password is not said.
url = server.make("foreign")
server.query("CREATE TABLE notes(mine TEXT); INSERT INTO notes VALUES('stays')", "foreign")
before = server.dump("foreign")
r = run("learn", "healthy.csv", "-o", url, code=2)
check_refused("tables of something else", r, ["foreign", "'notes'", "nothing was changed"])
check("they stay", server.dump("foreign") == before)
for name, sql in (("newer", "version BIGINT); INSERT INTO tribotwin_fleet VALUES(2"), ("else", "mine TEXT")):
    url = server.make(name + "_marked")
    server.query(f"CREATE TABLE tribotwin_fleet({sql})", name + "_marked")
    before = server.dump(name + "_marked")
    r = run("learn", "healthy.csv", "-o", url, code=2)
    check_refused("a version of something else", r, ["tribotwin_fleet", "version", "nothing was changed"])
    check("it stays", server.dump(name + "_marked") == before)
url = server.make("changed")
run("learn", "healthy.csv", "-o", url, "--quiet")
run("check", "week.csv", "-o", url, "--quiet", code=3)
for name, sql, says in (
    (
        "a constraint of somebody else's",
        "ALTER TABLE checks ADD CHECK(judged < 0) NOT VALID",
        "violates check constraint",
    ),
    ("a column less", "ALTER TABLE observations DROP COLUMN weak", "does not exist"),
):
    server.query(sql, "changed")
    r = run("check", "week.csv", "-o", url, "--quiet", code=2)
    check_refused(name, r, [says, "its tables are not those of a store of tribotwin fleet"])
secret = server.url("none").replace("@", ":gEheim@")
r = run("learn", "healthy.csv", "-o", secret, code=1)
check_refused("no such database", r, ['database "none" does not exist', server.url("none")], code=1)
url = server.make("refused")
table("few.csv", Plant(1).rows(2))
check_refused("too few to learn from", run("learn", "few.csv", "-o", url, "--quiet", code=2), "needs 8 or more")
check("refused, no tables are left", "CREATE TABLE" not in "\n".join(server.dump("refused")))
for wrong in (
    "postgresql://u:gEheim@h:port/x",
    "postgresql://u:gEheim@h/x?nonsense=1",
    "postgresql://u:gEhe@im/x@h/x",
    "postgres://u@h:x/?password=gEheim",
):
    r = run("learn", "healthy.csv", "-o", wrong, code=2)
    check_refused("no URL of a database", r, ["is no URL of a database", "PGPASSWORD"])
    check("without the password", "gEh" not in r.stderr and "im" not in r.stderr.replace("time", ""), r.stderr)
j = json.loads(run("learn", "healthy.csv", "-o", server.make("last").replace("@", ":gEheim@"), "--json").stdout)
check("nor in results", j["files"] == [server.url("last")], j["files"])
server.stop()
r = run("learn", "healthy.csv", "-o", secret, code=1)
check_refused("the server is down", r, ["No such file or directory", server.url("none")], code=1, lines=1)
check("without the password", "gEheim" not in r.stderr, r.stderr)

finish()
