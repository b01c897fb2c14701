"""`export --c`: the joint of a model or of PARAMS.yaml as a C file that tests itself, and what is refused."""
import json, os, subprocess, sys

from harness import check, check_refused, content, finish, path, run

program, source = map(os.path.abspath, sys.argv[1:3])
os.environ["PATH"] += ":" + os.path.dirname(program)
model = os.path.join(source, "mjcf/irb6620.xml")
strict = "-std=c99 -Wall -Wextra -Wpedantic -Werror".split()

params = """law: extended
parameters: {Fc0: 3.11e-2, Fcl: 2.34e-2, Fs0: -2.5e-2, FsT: 1.6e-3, Fsl: 0.126, vs0: -24.81, vsT: 0.98, vsl: 9.22,
  alpha: 1.36, Fv0: 1.3e-4, FvT: 1.32e-3, TV0: 20.71}
"""
with open(path("params.yaml"), "w") as f:
    f.write(params)


def compiles(file, upper):
    made = run("cc", *strict, f"-D{upper}_SELF_TEST_MAIN", file, "-o", "self", "-lm")
    return made.returncode == 0 and run(path("self")).returncode == 0, made.stderr


made = run(program, "export", model, "--joint", "joint2", "--c", "joint2.c")
check("joint of a model", made.returncode == 0 and made.stdout == "", made.stderr)
check("its self test", *compiles("joint2.c", "JOINT2"))
check("names begin with the joint", "double joint2_step(" in content("joint2.c"))
check("no include path", content("joint2.c").count("#include <") == 1)  # math.h; the other is in its head comment

made = run(program, "export", "params.yaml", "--c", "gear.c", "--name", "gear", "--tau-max", 7500, "--gear-ratio", 178)
check("joint of parameters", made.returncode == 0, made.stderr)
check("its self test, too", *compiles("gear.c", "GEAR"))

# The model's joint against the published numbers, from outside: friction at 50 degC, 1 rad/s, unloaded.
with open(path("user.c"), "w") as f:
    f.write(
        '#include <stdio.h>\n#define GEAR_DECLARATIONS\n#include "gear.c"\nint main(void) {\n  gear_state s;\n'
        "  gear_init(&s);\n  gear_set_temperature(&s, 50.0);\n"
        '  printf("%.17g\\n", gear_step(&s, 1.0, 0.0, 1e-3));\n  return 0;\n}\n'
    )
made = run("cc", *strict, "user.c", "gear.c", "-o", "user", "-lm")
check("a user's program", made.returncode == 0, made.stderr)
friction = float(run(path("user")).stdout)
curve = run(program, "curve", "params.yaml", "--temperature", 50, "--load", 0, "--speeds", "178:178:1")
row = dict(zip(*(line.split(",") for line in curve.stdout.strip().splitlines()[:2]))) if curve.returncode == 0 else {}
if check("curve", "friction_norm" in row, curve.stderr + curve.stdout):
    expected = 7500 * float(row["friction_norm"])
    check("friction is that of the law", abs(friction / expected - 1) < 1e-5, f"{friction} {expected}")

made = run(program, "export", model, "--joint", "joint2", "--c", "j.c", "--name", "arm_2", "--json")
check("--json", made.returncode == 0 and json.loads(made.stdout) == {"files": ["j.c"]}, made.stdout)

refuse = lambda name, says, *arguments: check_refused(name, run(program, "export", *arguments), says)
refuse("a file that exists", "exists", model, "--joint", "joint2", "--c", "joint2.c")
refuse("several joints", "--joint says which", model, "--c", "x.c")
refuse("no such joint", ["elbow", "joint2"], model, "--joint", "elbow", "--c", "x.c")
refuse("a name that is none in C", "becomes part of C", model, "--joint", "joint2", "--name", "2nd", "--c", "x.c")
refuse("no gear ratio", "gear_ratio", "params.yaml", "--c", "x.c", "--tau-max", 7500)
refuse("a joint of parameters", "--joint elbow", "params.yaml", "--joint", "elbow", "--c", "x.c")
refuse("units of a model", "--tau-max", model, "--joint", "joint2", "--tau-max", 1, "--c", "x.c")
check("nothing half-written", not os.path.exists(path("x.c")))
finish()
