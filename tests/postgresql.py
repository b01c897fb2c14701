"""A PostgreSQL of one's own: data and socket in one folder, no port. It ends nothing but what it has started."""
import glob, os, pwd, shutil, signal, subprocess, tempfile, time


def programs():
    """The folder of the server's programs; None where there is none."""
    found = sorted(glob.glob("/usr/lib/postgresql/*/bin/initdb"), key=lambda f: int(f.split("/")[4]))
    return os.path.dirname(found[-1]) if found else None


class Postgresql:
    USER = "fleet"

    def __init__(self):
        # The name of a socket is short, and its folder is entered by the user of the server.
        self.folder = tempfile.mkdtemp(prefix="tribotwin_pg_", dir="/tmp")
        self.data = os.path.join(self.folder, "data")
        # It ends with the test, also where that is killed.
        self.process, self.as_user = None, ["setpriv", "--pdeathsig=INT"]
        if os.getuid() == 0:  # as root it refuses to run
            user = pwd.getpwnam("nobody")
            os.chown(self.folder, user.pw_uid, user.pw_gid)
            self.as_user += [f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
        os.chmod(self.folder, 0o755)
        self._run("initdb", "-D", self.data, "-U", self.USER, "-A", "trust", "-E", "UTF8", "--locale=C.UTF-8", "-N")

    def _command(self, name, *arguments):
        return [*self.as_user, os.path.join(programs(), name), *arguments]

    def _run(self, name, *arguments, **options):
        r = subprocess.run(
            self._command(name, *arguments), cwd=self.folder, capture_output=True, text=True, timeout=120, **options
        )
        assert r.returncode == 0, (name, r.stdout, r.stderr)
        return r.stdout

    def start(self):
        self.process = subprocess.Popen(
            self._command("postgres", "-D", self.data, "-k", self.folder, "-c", "listen_addresses=", "-c", "fsync=off"),
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for _ in range(600):
            try:
                return self.query("SELECT 1")
            except AssertionError:
                assert self.process.poll() is None, "postgres ended"
                time.sleep(0.1)
        raise AssertionError("postgres does not answer")

    def stop(self):
        if self.process:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(60)
            self.process = None

    def remove(self):
        self.stop()
        shutil.rmtree(self.folder, True)

    def query(self, sql, database="postgres"):
        return self._run(
            "psql", "-X", "-q", "-A", "-t", "-v", "ON_ERROR_STOP=1", "-h", self.folder, "-U", self.USER, "-d", database,
            "-c", sql,
        )  # fmt: skip

    def dump(self, database):
        """All lines of a database in an order of their own; without those of pg_dump with a random key."""
        text = self._run("pg_dump", "-h", self.folder, "-U", self.USER, "--inserts", "-d", database)
        return sorted(line for line in text.splitlines() if not line.startswith(("\\restrict", "\\unrestrict")))

    def make(self, database):
        """A new database; its URL."""
        self.query(f'CREATE DATABASE "{database}"')
        return self.url(database)

    def url(self, database):
        return f"postgresql://{self.USER}@{self.folder.replace('/', '%2F')}/{database}"
