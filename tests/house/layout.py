"""The tree's layout: which folder may include which, and how many files a folder holds. Argument: source tree."""
import os, re, sys

os.chdir(sys.argv[1])

# What each part may not include, as the beginning of an include path.
FORBIDDEN = [
    ("plugins", r"tribotwin/(twin|hil|render)/", "knows of twins, buses or pictures"),
    ("plugins/friction", r"(mujoco|tribotwin/plugins/(thermal|drive|mujoco)/)", "a law is values in, value out"),
    ("plugins/thermal", r"(mujoco|Eigen|tribotwin/plugins/(friction|drive|mujoco)/)", "a law is values in, value out"),
    ("plugins/drive", r"(mujoco|tribotwin/plugins/mujoco/)", "a drive knows no engine"),
    ("twin", r"tribotwin/(hil|render)/", "a twin knows no bus and no picture"),
    ("hil", r"tribotwin/render/", "the bench knows no pictures"),
    ("render", r"tribotwin/hil/", "reports know no bus"),
]

# Inside a part each folder may use itself and those above it. A folder comes before its subfolders.
ORDER = {
    "twin": [
        "io",
        "io/command_line",
        "io/mcap",
        "io/telemetry",
        "io/tables",
        "numerics",
        "numerics/executor",
        "robot",
        "robot/coupling",
        "robot/inertial_prior",
        "control",
        "simulation",
        "live/protocol",
        "live",
        "identification",
        "identification/resampling",
        "identification/samples",
        "identification/curves",
        "identification/dynamic_friction",
        "identification/thermal",
        "identification/rigid_body",
        "identification/drive_gains",
        "identification/verdict",
        "identification/dynamics_choice",
        "identification/experiment_design",
        "gears",
        "portable",
        "portable/robot",
        "diagnosis",
        "diagnosis/fleet/database",
        "diagnosis/fleet",
        "diagnosis/fleet/learning",
        "diagnosis/fleet/overview",
        "experiments",
        "experiments/friction",
        "experiments/fault_study",
        "experiments/working_days",
        "experiments/sweep",
        "examples",
        "commands/calibrate",
        "commands",
        "python",
        "python/tribotwin",
        "python/examples",
        "scenarios",
        "",
    ],
    "hil": [
        "can",
        "drives",
        "canopen",
        "canopen/setup",
        "motion",
        "cia402",
        "ros2",
        "mirror",
        "faults",
        "timing",
        "session",
        "live",
        "shadow",
        "conform",
        "examples",
        "commands",
        "",
    ],
    "render": [
        "theme",
        "process",
        "offscreen",
        "pose",
        "figure",
        "page",
        "report",
        "report/record",
        "report/run",
        "report/sweep",
        "report/thermal",
        "report/dynamics",
        "report/thermal",
        "report/dynamics",
        "report/fleet",
        "commands",
        "",
    ],
}
KNOWN_EXCEPTIONS = set()  # (file, included file)
MAX_FILES = 25  # sources in one folder
SOURCE = (".hpp", ".cc", ".inc", ".h", ".c", ".py")

problems = []
for part in ("plugins", "twin", "hil", "render", "tests"):
    for folder, folders, files in os.walk(part):
        folders[:] = [f for f in folders if f != "__pycache__"]
        sources = sorted(f for f in files if f.endswith(SOURCE))
        if len(sources) > MAX_FILES:
            problems.append(f"{folder}: {len(sources)} source files; at most {MAX_FILES}")
        if os.path.basename(folder) in ("utils", "common", "misc"):
            problems.append(f"{folder}: say what is in it")
        order = ORDER.get(part)
        room = folder[len(part) + 1 :]
        if order and sources and room not in order:
            problems.append(f"{folder}: has no place in the order of {part}/")
            continue
        for file in sources:
            path = f"{folder}/{file}"
            with open(path, encoding="utf-8") as f:
                lines = f.read().splitlines()
            for number, line in enumerate(lines, 1):
                include = re.match(r'\s*#\s*include\s*[<"]([^>"]+)[>"]', line)
                if not include:
                    continue
                for where, pattern, why in FORBIDDEN:
                    if (folder + "/").startswith(where + "/") and re.match(pattern, include[1]):
                        problems.append(f"{path}:{number}: {where}: {why}: {include[1]}")
                if not include[1].startswith("tribotwin/"):
                    continue
                included = include[1][len("tribotwin/") :]
                if not os.path.exists(included):
                    problems.append(f"{path}:{number}: there is no {included}")
                if order and included.startswith(part + "/") and (path, included) not in KNOWN_EXCEPTIONS:
                    used = os.path.dirname(included)[len(part) + 1 :]
                    if used not in order or order.index(used) > order.index(room):
                        problems.append(f"{path}:{number}: {room or part} is above {used or part}: {included}")
for part, order in ORDER.items():
    problems += [
        f"{part}/{room}: is in the order, but not there"
        for room in order
        if room and not os.path.isdir(f"{part}/{room}")
    ]

print("\n".join(problems))
sys.exit(bool(problems))
