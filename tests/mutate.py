"""Which small mistakes the tests of a folder find. One mistake after another, chosen by a seed, is put into a source of
the folder; its test programs (the same folder under tests/) are built and run, and the source is restored:

    python3 tests/mutate.py --build build/release --count 20 plugins/friction hil/canopen+hil/cia402

A folder behind + has further tests of the first. Prints one line per mistake that no test found, and a table, also
when a signal ends it. Exit code 1 below --least. Works in a checkout without changes in these folders, one at a time.
What the compiler refuses is not counted. A test that a mistake keeps from ending, for 20 s and five times its time
without one, has found it."""
import argparse, os, random, re, signal, subprocess, sys, time

# What is mistaken for what: operators, comparisons, numbers, signs, conditions, statements left out.
CHANGES = [
    (r"(?<= )<(?= )", "<="),
    (r"(?<= )>(?= )", ">="),
    (r"<=(?!>)", "<"),
    (r">=", ">"),
    (r"==", "!="),
    (r"!=", "=="),
    (r"(?<= )\+(?= )", "-"),
    (r"(?<= )-(?= )", "+"),
    (r"(?<= )\*(?= )", "/"),
    (r"(?<= )/(?= )", "*"),
    (r"&&(?= )(?!&)", "||"),
    (r"\|\|", "&&"),
    (r"(?<![\w.])0(?![\w.])", "1"),
    (r"(?<![\w.])1(?![\w.])", "2"),
    (r"\btrue\b", "false"),
    (r"\bfalse\b", "true"),
    (r"std::min\(", "std::max("),
    (r"std::max\(", "std::min("),
    (r"!(?=[\w(])", ""),
    (r"(?<=[(,=] )-(?=[\w(])|(?<=return )-(?=[\w(])", ""),
    (r"\bif \((?P<condition>[^;]*?)\)(?= (\{|return|continue|break)|$)", r"if (!(\g<condition>))"),
    (r"^(?P<indent> +)[\w.\[\]()>-]+ [-+*/|&]?= [^;]*;$", r"\g<indent>;"),
    (r"^(?P<indent> +)[\w.:>-]+\([^;]*\);$", r"\g<indent>;"),
]
COMMENT_OR_TEXT = re.compile(
    r'//.*$|"(?:\\.|[^"\\])*"|\'(?:\\.|[^\'\\])\'|^ *#.*$|static_assert.*$|template.*$|using .*$'
)


def mistakes_of(file):
    """(line number, line, mistaken line) for every change that fits, outside comments, texts and types."""
    with open(file) as f:
        lines = f.read().split("\n")
    for number, line in enumerate(lines):
        blank = COMMENT_OR_TEXT.sub(lambda m: "\0" * len(m[0]), line)
        for pattern, change in CHANGES:
            for m in re.finditer(pattern, blank):
                groups = {name: line[m.start(name) : m.end(name)] for name in m.groupdict()}
                new = line[: m.start()] + re.sub(r"\\g<(\w+)>", lambda g: groups[g[1]], change) + line[m.end() :]
                if new.rstrip() != line.rstrip():
                    yield number, line, new


def run(command, seconds=None, **environment):
    """Whether it ends well, within that many seconds."""
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env=os.environ | environment,
    )
    try:
        return process.wait(seconds) == 0
    except subprocess.TimeoutExpired:
        return False
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


class Folder:
    def __init__(self, root, build, folders):
        self.name, *more = folders.split("+")
        self.build, self.path = build, os.path.join(root, self.name)
        self.tried = self.found = self.refused = 0
        self.programs = [program for folder in (self.name, *more) for program in self.test_programs(root, folder)]
        self.seconds = dict.fromkeys(self.programs)  # how long each may take
        if not self.programs or not run(["ninja", "-C", build, *self.programs]) or not self.passes():
            sys.exit(f"{folders}: has no test programs that are built and pass without a mistake")
        self.programs.sort(key=self.seconds.get)

    @staticmethod
    def test_programs(root, folder):
        names = sorted(name for name in os.listdir(os.path.join(root, "tests", folder)) if name.endswith("_test.cc"))
        return [f"{folder}/{name[:-3]}".replace("/", "_") for name in names]

    def passes(self):
        return all(self.passes_one(program) for program in self.programs)

    def passes_one(self, program):
        test = os.path.join(self.build, "tests", program)
        limited = ["prlimit", f"--as={4 << 30}"]  # a mistake may ask for any memory
        begun = time.monotonic()
        good = run([*limited, test, "--gtest_brief=1", "--gtest_fail_fast"], self.seconds[program])
        self.seconds[program] = self.seconds[program] or 20 + 5 * (time.monotonic() - begun)
        return good

    def mistakes(self):
        files = sorted(os.path.join(self.path, name) for name in os.listdir(self.path) if name.endswith(".cc"))
        return [(file, *mistake) for file in files for mistake in mistakes_of(file)]

    def finds(self, file, number, new):
        """Whether a test fails; None where the mistake does not compile."""
        with open(file) as f:
            text = f.read()
        lines = text.split("\n")
        lines[number] = new
        try:
            with open(file, "w") as f:
                f.write("\n".join(lines))
            built = run(["ninja", "-C", self.build, *self.programs], 1800, CCACHE_DISABLE="1")
            return not self.passes() if built else None
        finally:
            with open(file, "w") as f:
                f.write(text)

    def try_out(self, count, choice):
        """That many mistakes, counted in tried, found and refused (by the compiler)."""
        possible = self.mistakes()
        choice.shuffle(possible)
        for file, number, old, new in possible:
            if self.tried == count:
                break
            result = self.finds(file, number, new)
            self.tried += result is not None
            self.found += bool(result)
            self.refused += result is None
            if result is False:
                print(f"{self.name}/{os.path.basename(file)}:{number + 1}: {old.strip()} -> {new.strip()}", flush=True)
        run(["ninja", "-C", self.build, *self.programs])

    def row(self):
        share = 100 * self.found / max(1, self.tried)
        return (
            f"| {self.name} | {self.tried} | {self.found} | {share:.0f} % | {self.refused} | {len(self.mistakes())} |"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+")
    parser.add_argument("--build", default="build/release", help="folder of a build with Ninja and tests")
    parser.add_argument("--count", type=int, default=20, help="mistakes per folder")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--least", type=float, default=0, help="smallest share of all that must be found")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # after the source is restored
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    sources = [folders.split("+")[0] for folders in options.folders]
    if subprocess.run(["git", "-C", root, "diff", "--quiet", "--", *sources]).returncode:
        sys.exit("mutate.py: commit what is changed in these folders first")
    begun = []
    try:
        for folders in options.folders:
            begun.append(Folder(root, os.path.abspath(options.build), folders))
            begun[-1].try_out(options.count, random.Random(options.seed))
    finally:
        print("| folder | mistakes | found | share | refused by the compiler | possible |\n|---|---|---|---|---|---|")
        print("\n".join(folder.row() for folder in begun))
    sys.exit(sum(folder.found for folder in begun) < options.least * sum(folder.tried for folder in begun))


if __name__ == "__main__":
    main()
