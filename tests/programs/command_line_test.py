"""The command lines of all programs, read from what the programs say of themselves: help, version, colours, one meaning
per option, completion by a real bash, manual pages. Options: --tribotwin, --hil, --report (may be left out)."""
import argparse, glob, json, os, pty, re, shutil, subprocess, sys

from harness import check, finish, path, run, work

parser = argparse.ArgumentParser()
for option in ("--tribotwin", "--hil", "--report", "--source", "--build"):
    parser.add_argument(option, default="")
options = parser.parse_args()
programs = {os.path.basename(p): os.path.abspath(p) for p in (options.tribotwin, options.hil, options.report) if p}
os.symlink(os.path.join(options.source, "mjcf"), path("mjcf"))


# ---- What help says.
def commands_in(text):
    return (
        re.findall(r"^  ([a-z][a-z0-9-]*) ", text.split("Commands:\n")[1].split("\n\n")[0], re.M)
        if "Commands:" in text
        else []
    )


def helps(program, words=()):
    """(words, help) of a program and all its commands."""
    r = run(programs[program], *words, "--help")
    yield words, r.stdout
    for command in commands_in(r.stdout):
        yield from helps(program, (*words, command))


all_helps = [(program, words, text) for program in programs for words, text in helps(program)]
check("commands are found", len(all_helps) > 20, len(all_helps))
for program, words, text in all_helps:
    name = " ".join([program, *words])
    long_lines = [line for line in text.splitlines() if len(line) > 80 and " " in line.strip()]
    check(f"{name} --help: at most 80 columns", text and not long_lines, long_lines)
    check(f"{name} --help: usage names the program", f"Usage: {name} " in text, text[:200])
    check(f"{name} --help: no colour in a pipe", "\033" not in text)
    if "Commands:" not in text:
        check(f"{name} --help: has an example", re.search(r"^Example:\n  " + program, text, re.M), text[-300:])


# ---- Alone, and without the command that is needed.
for program in programs:
    r = run(programs[program])
    whole = run(programs[program], "--help").stdout
    check(f"{program} alone: its help, exit code 2", (r.returncode, r.stdout, r.stderr) == (2, "", whole), r)
r = run(programs["tribotwin"], "diagnose")
check("a command is missing: help", r.returncode == 2 and "  learn " in r.stderr and not r.stdout, r)

# ---- Version.
for program in programs:
    lines = run(programs[program], "--version").stdout.splitlines()
    check(
        f"{program} --version: first line", re.fullmatch(program + r" \d+\.\d+\.\d+, MuJoCo \d[\d.]*", lines[0]), lines
    )
    check(
        f"{program} --version: commit, compiler, build type",
        re.fullmatch(r"commit ([0-9a-f]{7,}(\+changes)?|unknown), (GCC|Clang) \d\S*.*, \w+", lines[1]),
        lines,
    )
    for arguments in (("--version", "--json"), ("--json", "--version")):
        v = json.loads(run(programs[program], *arguments).stdout)
        check(
            f"{program} {arguments}: as the text",
            f"{v['program']} {v['version']}, MuJoCo {v['engine']['version']}" == lines[0],
            v,
        )
    check(
        f"{program}: versions of libraries",
        {"fmt", "HDF5", "Ceres", "CLI11"} <= set(v["libraries"])
        and all(re.match(r"\d", x) for x in v["libraries"].values()),
        v,
    )


# ---- Colours.
def on_terminal(*argv, **environment):
    """stdout and stderr of a program on a terminal."""
    master, slave = pty.openpty()
    env = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "TERM")} | {"TERM": "xterm"} | environment
    process = subprocess.Popen(argv, stdout=slave, stderr=slave, stdin=subprocess.DEVNULL, env=env, cwd=work)
    os.close(slave)
    text = b""
    while True:
        try:
            part = os.read(master, 65536)
        except OSError:
            break
        if not part:
            break
        text += part
    process.wait()
    os.close(master)
    return text.decode()


tribotwin = programs["tribotwin"]
wrong = (tribotwin, "run", "nowhere.yaml")
for name, argv, environment, coloured in (
    ("an error on a terminal", wrong, {}, True),
    ("help on a terminal", (tribotwin, "run", "--help"), {}, True),
    ("with NO_COLOR", wrong, {"NO_COLOR": "1"}, False),
    ("with an empty NO_COLOR", wrong, {"NO_COLOR": ""}, True),
    ("on a dumb terminal", wrong, {"TERM": "dumb"}, False),
    ("--color never", (*wrong, "--color", "never"), {}, False),
    ("--color=never before the command", (tribotwin, "--color=never", *wrong[1:]), {}, False),
    ("--color always against NO_COLOR", (*wrong, "--color", "always"), {"NO_COLOR": "1"}, True),
    ("--colour", (*wrong, "--colour", "never"), {}, False),
):
    text = on_terminal(*argv, **environment)
    check(f"colour: {name}", ("\033[" in text) == coloured and ("nowhere" in text or "Usage" in text), repr(text[:300]))
r = run(*wrong)
check("colour: none in a pipe", "\033" not in r.stderr and r.stderr.startswith("tribotwin: "), r.stderr)
r = run(*wrong, "--color", "always")
check("colour: the program's name in red", r.stderr.startswith("\033[1;31mtribotwin:\033[0m "), repr(r.stderr))
r = run(*wrong, "--color", "sometimes")
check("colour: a wrong value", r.returncode == 2 and "sometimes" in r.stderr and "never" in r.stderr, r.stderr)


# ---- One meaning per option.
def options_in(text):
    """Option -> (its value in help, the units that its help names)."""
    found, section = {}, text.split("Options:\n")[1].split("\n\n")[0]
    for row in re.split(r"\n(?=  -)", section):
        label, _, rest = re.sub(r"\n {28}", "  ", row.strip(), count=1).partition("  ")
        names, value = re.fullmatch(r"((?:-\w, )?--[\w-]+)(.*)", label).groups()
        units = re.findall(r"\[(?![^]]*=)[^] ]+\]", re.sub(r"\s+", " ", rest))
        if rest.strip().startswith("[JOINT=]N"):  # a number, for one joint or for all
            value = "NUMBER"
        found[names.split(", ")[-1]] = (value.strip(), tuple(units[:1]))
    return found


meanings = {}
for program, words, text in all_helps:
    for option, meaning in options_in(text).items():
        meanings.setdefault(option, {}).setdefault(meaning, []).append(" ".join([program, *words]))
for option, found in sorted(meanings.items()):
    if sum(map(len, found.values())) > 1:
        values, units = {v for v, _ in found}, {u for _, u in found if u}
        check(f"{option}: one kind of value and one unit", len(values) == 1 and len(units) <= 1, found)


# Former spellings: accepted, and not shown. A command that refuses the value names the option of today.
for program, words, former, today in (
    ("tribotwin", ("curve", "mjcf/irb6620.xml", "--joint", "joint2"), "--csv", "--output"),
    ("tribotwin", ("curve", "mjcf/irb6620.xml", "--joint", "joint2"), "--noise", "--torque-noise-nm"),
    ("tribotwin", ("diagnose", "learn", "x.csv"), "--robust", "--leave-out-outliers"),
    ("tribotwin", ("excite", "mjcf/irb6620.xml"), "--rate", "--sampling"),
    ("tribotwin", ("export", "mjcf/irb6620.xml", "--native"), "--speed", "--joint-speed"),
    ("tribotwin", ("predict", "mjcf/irb6620.xml", "p.yaml", "x.csv"), "--window", "--interval"),
    ("tribotwin", ("thermal", "x.csv"), "--cycle", "--work-cycle"),
    ("tribotwin-hil", ("shadow", "x.yaml", "--can", "log:x"), "--csv", "--output"),
    ("tribotwin-hil", ("replay", "x.yaml", "x.log"), "--rate", "--speed-factor"),
    ("tribotwin-hil", ("drive", "x.yaml", "--can", "vcan0"), "--bit-rate", "--bitrate"),
    ("tribotwin-report", ("pose", "mjcf/irb6620.xml"), "--temperature", "--joint-temperature"),
):
    if program in programs:
        text = next(t for p, w, t in all_helps if p == program and w == words[: len(w)] and "Commands:" not in t)
        check(f"{program} {words[0]} {former}: not shown", today in options_in(text) and former not in options_in(text))
        errors = [run(programs[program], *words, option, "/nowhere/at all").stderr for option in (former, today)]
        check(f"{program} {words[0]} {former}: as {today}", errors[0] and errors[0] == errors[1], errors)


# ---- Lists.
tables = {}
for kind in commands_in(run(tribotwin, "list", "--help").stdout):
    text, rows = run(tribotwin, "list", kind).stdout, json.loads(run(tribotwin, "list", kind, "--json").stdout)
    tables[kind] = [row["name"] for row in rows]
    described = all(row["description"] and f"{row['description']}\n" in text for row in rows)
    check(f"list {kind}: a name and a description each", rows and described, text)
    check(f"list {kind}: the table has the same names", [line.split()[0] for line in text.splitlines()] == tables[kind])
    check(f"list {kind}: files exist", all(os.path.exists(row["file"]) for row in rows if "file" in row), rows)
files = {f[:-5] for f in os.listdir(os.path.join(options.source, "twin", "scenarios")) if f.endswith(".yaml")}
check(
    "list: every shipped file is in one list",
    sorted(tables["scenarios"] + tables["campaigns"] + tables["fits"] + tables["plans"]) == sorted(files),
    tables,
)
old = {line.split()[0] for line in run(tribotwin, "run", "--list").stdout.splitlines()}
check("run --list stays", old == set(tables["scenarios"]), old)
for name in tables["models"]:
    r = run(tribotwin, "curve", name, "--joint", "none of them", "--quiet")
    check(f"list models: {name} can be used by name", "none of them" in r.stderr or "no tribotwin.drive" in r.stderr, r)
run(tribotwin, "list", "laws", "-o", "laws.txt")
check("list -o", open(path("laws.txt")).read() == run(tribotwin, "list", "laws").stdout)
r = run(tribotwin, "list", "laws", "-o", "laws.txt")
check("list -o: an existing file stays", r.returncode == 2 and "--force" in r.stderr, r)

# ---- What a name that is nearly right meant.
for program, words, meant in (
    ("tribotwin", ("run", "irb6620_warmpu"), "irb6620_warmup"),
    ("tribotwin", ("run", "irb6620_holds.yaml"), "irb6620_hold"),
    ("tribotwin", ("lab", "br609_campain", "-o", "x"), "br609_campaign"),
    ("tribotwin", ("calibrate", "xl330_fits"), "xl330_fit"),
    ("tribotwin", ("sweep", "irb6620_swep", "--dry-run"), "irb6620_sweep"),
    ("tribotwin", ("curve", "irb6602", "--joint", "joint2"), "irb6620"),
    ("tribotwin", ("curve", "mjcf/irb6602.xml", "--joint", "joint2"), "irb6620"),
    ("tribotwin", ("curve", "irb6620", "--joint", "jiont2"), "joint2"),
    ("tribotwin", ("identify", "x.csv", "--law", "extendet"), "extended"),
    ("tribotwin", ("dynamics", "er3a_c60", "x.csv", "--friction", "polynomal"), "polynomial"),
    ("tribotwin", ("list", "senarios"), "scenarios"),
    ("tribotwin", ("run", "--sed", "1", "irb6620_hold"), "--seed"),
    ("tribotwin-hil", ("budget", "irb6620_hodl"), "irb6620_hold"),
    ("tribotwin-hil", ("bugdet", "irb6620_hold"), "budget"),
    ("tribotwin-report", ("pose", "br690.xml"), "br609"),
):
    if program in programs:
        r = run(programs[program], *words)
        said = re.search(r"did you mean '(\S+)'\?", r.stderr)
        check(f"meant: {program} {' '.join(words)}", r.returncode == 2 and said and said[1] == meant, r.stderr)
r = run(tribotwin, "run", "nowhere.yaml")
check("meant: nothing where nothing is like it", r.returncode == 2 and "did you mean" not in r.stderr, r.stderr)


# ---- Results as JSON, and into files that are not replaced silently.
def strict(text):
    def refuse(word):
        raise ValueError(word)

    return json.loads(text, parse_constant=refuse)


for program, words, text in all_helps:
    if "Commands:" not in text or program == "tribotwin-report":
        known = options_in(text)
        check(f"{' '.join([program, *words])}: has --json", "--json" in known)
        writes = "--output" in known
        # A fleet's store is added to; what may replace something in it are curves.
        force = "--replace" if program == "tribotwin" and "fleet" in words else "--force"
        check(f"{' '.join([program, *words])}: -o comes with {force}", not writes or force in known, list(known))
curve = ("curve", "irb6620", "--joint", "joint2", "--speeds", "1:200:3", "--torque-noise-nm", "1", "--experiment")
points = strict(run(tribotwin, *curve, "--json", "--quiet").stdout)["points"]
rows = [line.split(",") for line in run(tribotwin, *curve, "--quiet").stdout.splitlines()]
check(
    "curve --json: the numbers of the CSV, every digit",
    [[p[key] for key in rows[0]] for p in points] == [[float(x) for x in row] for row in rows[1:]],
    (points, rows),
)
r = run(tribotwin, "curve", "irb6620", "--joint", "joint2", "--speeds", "1:200:3", "--json")
check("JSON: not a number is null", strict(r.stdout)["points"][0]["stderr_nm"] in (0, None), r.stdout)
for name, program, words, file in (
    ("curve", "tribotwin", ("curve", "irb6620", "--joint", "joint2"), "c.csv"),
    ("budget", "tribotwin-hil", ("budget", "irb6620_hold", "--json"), "b.json"),
    ("eds", "tribotwin-hil", ("eds", "irb6620_hold", "--json"), "d.eds"),
    ("dbc", "tribotwin-hil", ("dbc", "irb6620_hold", "--json"), "d.dbc"),
    ("a figure", "tribotwin-report", ("curve", "irb6620", "--joint", "joint2", "--json"), "c.svg"),
    ("a picture", "tribotwin-report", ("pose", "irb6620", "--size", "64x64", "--json"), "p.png"),
):
    if program in programs:
        r = run(programs[program], *words, "-o", file)
        named = not r.stdout or strict(r.stdout) == {"files": [file]}
        check(f"-o of {name}: writes", r.returncode == 0 and os.path.getsize(path(file)) > 0 and named, r)
        before = os.stat(path(file))
        r = run(programs[program], *words, "-o", file)
        kept = os.stat(path(file)).st_mtime_ns == before.st_mtime_ns
        check(f"-o of {name}: does not replace", r.returncode == 2 and "--force" in r.stderr and kept, r)
        r = run(programs[program], *words, "-o", file, "--force")
        check(f"-o of {name}: --force replaces", r.returncode == 0 and os.stat(path(file)).st_ino != before.st_ino, r)
budget = strict(run(programs["tribotwin-hil"], "budget", "irb6620_hold", "--json").stdout)["buses"][0]
check("budget --json", 0 < budget["min"] <= budget["max"] < 1 and budget["cycle_s"] == 0.002, budget)
r = run(programs["tribotwin-hil"], "eds", "irb6620_hold", "--json")
check("--json of files needs a file", r.returncode == 2 and "-o FILE" in r.stderr and not r.stdout, r)


# ---- Completion.
def complete(program, *words):
    """What bash offers for the last of the words."""
    script = f"""source {path(program + '.bash')}
COMP_WORDS=({' '.join("'" + w + "'" for w in (program, *words))}); COMP_CWORD={len(words)}
{"_" + program.replace("-", "_")}
printf '%s\\n' "${{COMPREPLY[@]}}\""""
    r = run("bash", "--norc", "-c", script)
    return set(r.stdout.split()) if r.returncode == 0 and not r.stderr else {"(failed)", r.stderr}


for program in programs:
    for shell in ("bash", "zsh", "fish"):
        r = run(programs[program], "completion", shell)
        check(f"{program} completion {shell}", r.returncode == 0 and program in r.stdout, r)
        with open(path(f"{program}.{shell}"), "w") as f:
            f.write(r.stdout)
        if shutil.which(shell):
            r = run(shell, "-n", f"{program}.{shell}")
            check(f"{program} completion {shell}: its syntax", (r.returncode, r.stderr) == (0, ""), r.stderr)
    r = run(programs[program], "completion", "tcsh")
    check(f"{program} completion of no such shell", r.returncode == 2 and "bash" in r.stderr, r.stderr)
    text = run(programs[program], "--help").stdout
    check(f"{program} --help does not show completion", "completion" not in text and "man-page" not in text, text)
for program, words, text in all_helps:  # every command and every option that help shows
    missing = set(commands_in(text)) - complete(program, *words, "")
    missing |= set(options_in(text)) - complete(program, *words, "-")
    check(f"completion of {' '.join([program, *words])}: all commands and options", not missing, missing)
open(path("mine.yaml"), "w").close()
for name, words, expected in (
    ("a beginning of a command", ("ru",), {"run"}),
    ("an option", ("run", "--qui"), {"--quiet"}),
    ("a choice", ("curve", "mjcf/br609.xml", "--load-by", "p"), {"pose"}),
    ("--option=value", ("curve", "--load-by", "=", "p"), {"pose"}),
    ("--color", ("run", "--color", "n"), {"never"}),
    ("a scenario", ("run", "irb6620_w"), {"irb6620_warmup"}),
    ("a campaign", ("lab", "br"), {"br609_campaign", "br609_diagnosis"}),
    ("a plan", ("sweep", "irb"), {"irb6620_sweep"}),
    ("a model", ("curve", "irb"), {"irb6620"}),
    ("a law", ("identify", "--law", "exten"), {"extended"}),
    ("a list", ("list", "f"), {"faults", "fits"}),
    ("a file", ("run", "mi"), {"mine.yaml"}),
    ("a file of an option", ("identify", "--evaluate", "mi"), {"mine.yaml"}),
    ("a command inside a command", ("diagnose", "wa"), {"watch"}),
    ("an option of it", ("diagnose", "watch", "--false"), {"--false-alarm"}),
    ("a number has no completion", ("run", "--seed", ""), set()),
):
    check(f"completion: {name}", complete("tribotwin", *words) == expected, complete("tribotwin", *words))

# ---- Manual pages.
for program in programs:
    r = run(programs[program], "man-page")
    check(f"{program} man-page", r.returncode == 0 and r.stdout.startswith(".TH"), r)
    with open(path(program + ".1"), "w") as f:
        f.write(r.stdout)
    for linter in (("groff", "-man", "-ww", "-z", "-Tutf8"), ("mandoc", "-Tlint", "-Wwarning")):
        if shutil.which(linter[0]):
            r = run(*linter, program + ".1")
            check(f"{program}.1: {linter[0]} has nothing to say", (r.returncode, r.stdout + r.stderr) == (0, ""), r)
    if shutil.which("man"):
        r = run(
            "man", "-l", "--warnings", program + ".1", env={**os.environ, "MANWIDTH": "80", "MAN_KEEP_FORMATTING": ""}
        )
        shown = re.sub(r".\b", "", r.stdout)
        check(f"{program}.1: man shows it without warnings", r.returncode == 0 and not r.stderr, r.stderr)
        for p, words, text in all_helps:
            if p == program and "Commands:" not in text:
                wanted = [o for o in options_in(text) if o != "--help"]
                missing = [o for o in wanted if o not in r.stdout]
                check(
                    f"{program}.1: {' '.join(words)}", " ".join([program, *words]) in r.stdout and not missing, missing
                )

# ---- What is installed.
if options.build and options.report:
    r = run("cmake", "--install", os.path.abspath(options.build), "--component", "programs", "--prefix", path("usr"))
    check("install", r.returncode == 0, r.stderr)
    for program in programs:
        share = path("usr", "share")
        for place in (
            "man/man1/NAME.1*",
            "bash-completion/completions/NAME",
            "zsh/vendor-completions/_NAME",
            "fish/vendor_completions.d/NAME.fish",
        ):
            found = glob.glob(os.path.join(share, place.replace("NAME", program)))
            check(f"installed: {place.replace('NAME', program)}", len(found) == 1 and os.path.getsize(found[0]) > 500)
    before = run(tribotwin, "completion", "bash").stdout
    with open(path("usr", "share", "bash-completion", "completions", "tribotwin")) as f:
        check("installed: the completion is that of the program", f.read() == before)
finish()
