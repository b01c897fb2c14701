"""`export --bam`: numbers of BAM's m4 against BAM's formula and joint.c, the error that is said, refusals."""
import ctypes, json, math, os, re, sys

from harness import check, check_refused, content, finish, path, run

program, source = map(os.path.abspath, sys.argv[1:3])
model = os.path.join(source, "mjcf/irb6620.xml")
joint2 = (model, "--joint", "joint2")
tau_max, gear = 120.0, 57.0
law = {"Fc0": 0.03, "Fcl": 0.0234, "Fs0": 0.025, "Fsl": 0.126, "vs": 9.22, "alpha": 1.36, "Fv": 4e-4}
with open(path("load.yaml"), "w") as f:
    f.write(f"law: load\nparameters: {json.dumps(law)}\n")
with open(path("two.yaml"), "w") as f:
    f.write("law: stribeck\nparameters: {Fc: 0.034, Fs: 0.046, Fv: 3.68e-4, vs: 10.68, alpha: 1.93}\n")


def m4(p, speed_rad_s, load_nm):
    """BAM's Model("m4").compute_frictions: frictionloss + damping |dtheta|."""
    s = math.exp(-(abs(speed_rad_s / p["dtheta_stribeck"]) ** p["alpha"]))
    loss = p["friction_base"] + p["load_friction_base"] * abs(load_nm)
    loss += s * (p["friction_stribeck"] + p["load_friction_stribeck"] * abs(load_nm))
    return loss + p["friction_viscous"] * abs(speed_rad_s)


def joint_c(name, *arguments):
    made = run(program, "export", *arguments, "--c", f"{name}.c", "--name", name)
    check("joint.c", made.returncode == 0, made.stderr)
    run("cc", "-std=c99", "-O2", "-fPIC", "-shared", f"{name}.c", "-o", f"{name}.so", "-lm")
    library = ctypes.CDLL(path(f"{name}.so"))
    step, init, heat = (getattr(library, f"{name}_{f}") for f in ("step", "init", "set_temperature"))
    step.restype = ctypes.c_double
    state = (ctypes.c_double * 100)()

    def friction(speed_rad_s, load_nm, temperature_degC):
        init(state)
        heat(state, ctypes.c_double(temperature_degC))
        return step(state, *map(ctypes.c_double, (speed_rad_s, load_nm, 0.0)))

    return friction


gearbox = ("--tau-max", tau_max, "--gear-ratio", gear)
made = run(program, "export", "load.yaml", "--bam", "load.json", "--actuator", "mx64", *gearbox)
check("the law load", made.returncode == 0 and "exactly" in made.stderr and "kt, R" in made.stderr, made.stderr)
p = json.loads(content("load.json"))
check("model and actuator", (p["model"], p["actuator"]) == ("m4", "mx64"), str(p))
expected = {
    "friction_base": tau_max * law["Fc0"],
    "friction_stribeck": tau_max * law["Fs0"],
    "load_friction_base": law["Fcl"],
    "load_friction_stribeck": law["Fsl"],
    "dtheta_stribeck": law["vs"] / gear,
    "alpha": law["alpha"],
    "friction_viscous": tau_max * law["Fv"] * gear,
}
for name, value in expected.items():
    check(name, abs(p[name] / value - 1) < 1e-14, f"{p[name]} {value}")
friction = joint_c("load_joint", "load.yaml", *gearbox)
points = [(v, l) for v in (1e-3, 0.1, 0.5, 2, 4.9) for l in (0, -20, 60, 85)]
worst = max(abs(m4(p, v, l) / friction(v, l, 25) - 1) for v, l in points)
check("BAM's formula gives the drive's friction", worst < 1e-12, str(worst))

made = run(program, "export", "two.yaml", "--bam", "two.json", "--actuator", "mx64", *gearbox)
check(
    "stribeck is m4 without load",
    "exactly" in made.stderr and json.loads(content("two.json"))["load_friction_base"] == 0,
)

made = run(program, "export", *joint2, "--bam", "warm.json", "--actuator", "mx64", "--temperature", 50)
check("another law", made.returncode == 0 and "best fit" in made.stderr and "heat" in made.stderr, made.stderr)
p = json.loads(content("warm.json"))
said = float(re.search(r"([0-9.e+-]+) Nm at most", made.stderr).group(1))
friction = joint_c("joint2", *joint2)
fastest = float(re.search(r"up to ([0-9.e+-]+) rad/s", made.stderr).group(1))
speeds = [fastest * (i / 60) ** 2 for i in range(1, 61)]
largest = float(re.search(r"and ([0-9.e+-]+) Nm of load", made.stderr).group(1))
worst = max(abs(m4(p, v, l * largest / 5) - friction(v, l * largest / 5, 50)) for v in speeds for l in range(6))
check("the error that is said", abs(worst / said - 1) < 0.01, f"{worst} {said}")
level = [friction(v, 0, 50) for v in speeds]
check("it is a fit", worst < 0.15 * max(level), f"{worst} {max(level)}")

refuse = lambda name, says, *arguments, lines=1: check_refused(
    name, run(program, "export", *arguments), says, lines=lines
)
refuse("without an actuator", "--actuator", *joint2, "--bam", "x.json", lines=1)
refuse("a file that exists", "exists", *joint2, "--bam", "warm.json", "--actuator", "mx64")
refuse("a temperature outside", "38 .. 81.2", *joint2, "--bam", "x.json", "--actuator", "mx64", "--temperature", 20)
refuse("several joints", "--joint says which", model, "--bam", "x.json", "--actuator", "mx64")
check("nothing half-written", not os.path.exists(path("x.json")))
finish()
