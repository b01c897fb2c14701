"""`export --table` and `--urdf`: their numbers against joint.c and `--native`, what is said to be lost, refusals."""
import csv, ctypes, os, re, sys

from harness import check, check_refused, content, finish, path, run

program, source = map(os.path.abspath, sys.argv[1:3])
os.environ["PATH"] += ":" + os.path.dirname(program)
model = os.path.join(source, "mjcf/irb6620.xml")
joint2 = (model, "--joint", "joint2")


def table(name):
    return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(content(name).splitlines())]


def error_said(text):
    return float(re.search(r"by up to ([0-9.e+-]+) Nm", text).group(1))


def joint_c():
    run(program, "export", *joint2, "--c", "joint2.c")
    made = run("cc", "-std=c99", "-O2", "-fPIC", "-shared", "joint2.c", "-o", "joint2.so", "-lm")
    check("joint.c compiles", made.returncode == 0, made.stderr)
    joint = ctypes.CDLL(path("joint2.so"))
    joint.joint2_step.restype = ctypes.c_double
    state = (ctypes.c_double * 100)()

    def friction(speed_rad_s, load_nm, temperature_degC):
        joint.joint2_init(state)
        joint.joint2_set_temperature(state, ctypes.c_double(temperature_degC))
        return joint.joint2_step(state, *map(ctypes.c_double, (speed_rad_s, load_nm, 0.0)))

    return friction


def interpolated(values, axes, at):
    """By hand, from the eight corners around a point."""
    sides = []
    for axis, x in zip(axes, at):
        i = max(k for k in range(len(axis) - 1) if axis[k] <= x)
        share = (x - axis[i]) / (axis[i + 1] - axis[i])
        sides.append([(axis[i], 1 - share), (axis[i + 1], share)])
    return sum(values[w, l, T] * a * b * c for w, a in sides[0] for l, b in sides[1] for T, c in sides[2])


made = run(program, "export", *joint2, "--table", "table.csv")
check("table", made.returncode == 0 and made.stdout == "", made.stderr)
rows = table("table.csv")
axes = [sorted({r[c] for r in rows}) for c in ("speed_rad_s", "load_nm", "temperature_degC")]
check("a full grid", len(rows) == len(axes[0]) * len(axes[1]) * len(axes[2]), str([len(a) for a in axes]))
check("over the range of the law", (axes[2][0], axes[2][-1]) == (38, 81.2), str(axes[2]))
check("speeds of both directions", axes[0] == [-x for x in reversed(axes[0])] and 0 not in axes[0])
check("what is lost", "sticking" in made.stderr and "temperature is an input" in made.stderr, made.stderr)
friction = joint_c()
# A step rounds its temperature to 2^-14 K.
worst = max(abs(friction(r["speed_rad_s"], r["load_nm"], r["temperature_degC"]) - r["friction_nm"]) for r in rows)
check("the friction of joint.c", worst < 0.01, str(worst))
exact = [r for r in rows if r["temperature_degC"] == 38]
worst = max(abs(friction(r["speed_rad_s"], r["load_nm"], 38) / r["friction_nm"] - 1) for r in exact)
check("at whole degrees to the last bits", worst < 1e-14, str(worst))
said = error_said(made.stderr)
between = lambda axis, i: (axis[i] + axis[i + 1]) / 2
centres = [
    (between(axes[0], i), between(axes[1], j), between(axes[2], k))
    for i in range(0, len(axes[0]) - 1)
    for j in range(0, len(axes[1]) - 1)
    for k in range(0, len(axes[2]) - 1)
    if axes[0][i] * axes[0][i + 1] > 0
]
values = {(r["speed_rad_s"], r["load_nm"], r["temperature_degC"]): r["friction_nm"] for r in rows}
worst = max(abs(interpolated(values, axes, c) - friction(*c)) for c in centres)
check("the error that is said", abs(worst / said - 1) < 0.01, f"{worst} {said}")

made = run(program, "export", *joint2, "--table", "warm.csv", "--temperature", 50, "--joint-speed", 1)
warm = table("warm.csv")
check("one temperature", made.returncode == 0 and {r["temperature_degC"] for r in warm} == {50}, made.stderr)
check("a slower end", max(r["speed_rad_s"] for r in warm) == 1)

made = run(program, "export", model, "--urdf", "--temperature", 50)
check("URDF", made.returncode == 0 and "lost" in made.stderr, made.stderr)
dynamics = re.findall(r'<dynamics damping="(.*?)" friction="(.*?)"/>', made.stdout)
native = run(program, "export", model, "--native", "--temperature", 50).stdout
losses = re.findall(r'<joint name="joint\d"[^>]* frictionloss="([^"]*)"', native)
check("the friction of --native", [f for _, f in dynamics] == losses and len(losses) == 6, f"{dynamics} {losses}")

refuse = lambda name, says, *arguments, lines=1: check_refused(
    name, run(program, "export", *arguments), says, lines=lines
)
refuse("a file that exists", "exists", *joint2, "--table", "table.csv")
refuse("a temperature outside", "38 .. 81.2", *joint2, "--table", "x.csv", "--temperature", 20)
refuse("several joints", "--joint says which", model, "--table", "x.csv")
refuse("a temperature for C", "--temperature", *joint2, "--c", "x.c", "--temperature", 50)
refuse("both kinds", "--table", *joint2, "--table", "x.csv", "--fmu", "x.fmu", lines=2)
check("nothing half-written", not any(os.path.exists(path(n)) for n in ("x.csv", "x.c", "x.fmu")))
finish()
