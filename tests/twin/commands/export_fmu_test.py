"""`export --fmu`: the FMU's files, its description, its library against joint.c, and what is refused."""
import ctypes, json, os, re, sys, zipfile
import xml.etree.ElementTree as xml

from harness import check, check_refused, content, finish, path, run

program, source = map(os.path.abspath, sys.argv[1:3])
os.environ["PATH"] += ":" + os.path.dirname(program)
model = os.path.join(source, "mjcf/irb6620.xml")

with open(path("params.yaml"), "w") as f:
    f.write(
        "law: extended\nparameters: {Fc0: 3.11e-2, Fcl: 2.34e-2, Fs0: -2.5e-2, FsT: 1.6e-3, Fsl: 0.126, vs0: -24.81,\n"
        "  vsT: 0.98, vsl: 9.22, alpha: 1.36, Fv0: 1.3e-4, FvT: 1.32e-3, TV0: 20.71}\n"
    )


def described(fmu):
    """Root of modelDescription.xml and its variables: name -> (attributes, attributes of the type)."""
    root = xml.fromstring(zipfile.ZipFile(path(fmu)).read("modelDescription.xml"))
    variables = {}
    for v in root.find("ModelVariables"):
        inner = v[0].attrib if len(v) else v.attrib
        variables[v.attrib["name"]] = v.attrib, inner
    return root, variables


def check_description(fmu, version):
    root, variables = described(fmu)
    check("version", root.attrib["fmiVersion"] == f"{version}.0")
    units = {u.attrib["name"] for u in root.iter("Unit")}
    used = {inner["unit"] for _, inner in variables.values() if "unit" in inner}
    check("units are defined and used", units == used, str(units ^ used))
    base = {u.attrib["name"]: dict(b.attrib) for u in root.iter("Unit") for b in u}
    check("N.m", base.get("N.m") == {"kg": "1", "m": "2", "s": "-2"}, str(base))
    check("degC", base.get("degC") == {"K": "1", "offset": "273.15"}, str(base))
    check("rad/(s.K)", base.get("rad/(s.K)") == {"s": "-1", "K": "-1", "rad": "1"}, str(base))
    kinds = {name: (a["causality"], a["variability"]) for name, (a, _) in variables.items()}
    law = "Fc0 Fcl Fs0 FsT Fsl vs0 vsT vsl alpha Fv0 FvT TV0".split()
    check("every law parameter", all(kinds.get(p) == ("parameter", "tunable") for p in law), str(kinds))
    check("they have start values", float(variables["Fsl"][1]["start"]) == 0.126, str(variables["Fsl"]))
    check("inputs", [n for n, k in kinds.items() if k[0] == "input"] == ["speed_rad_s", "load_nm", "ambient_degC"])
    outputs = [n for n, k in kinds.items() if k[0] == "output"]
    check("outputs", outputs == ["friction_nm", "limit_nm", "heat_W", "temperature_degC", "outside"], str(outputs))
    references = [int(a["valueReference"]) for a, _ in variables.values()]
    check("value references", references == list(range(len(references))))
    structure = root.find("ModelStructure")
    if version == 2:
        named = [list(variables)[int(u.attrib["index"]) - 1] for u in structure.find("Outputs")]
    else:
        named = [list(variables)[int(u.attrib["valueReference"])] for u in structure.iter("Output")]
    check("structure", named == outputs, str(named))
    return root.attrib["guid" if version == 2 else "instantiationToken"]


class Fmi2:
    """An instance of the shipped library, by FMI 2.0."""

    def __init__(self, fmu):
        root, self.variables = described(fmu)
        self.library = ctypes.CDLL(extracted(fmu, "binaries/linux64/joint2.so"))
        logger = ctypes.CFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p
        )
        self.callbacks = (ctypes.c_void_p * 5)()
        self.logger = logger(lambda *_: None)
        self.callbacks[0] = ctypes.cast(self.logger, ctypes.c_void_p)
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        token = root.attrib["guid"].encode()
        self.instance = ctypes.c_void_p(
            self.library.fmi2Instantiate(b"one", 1, token, b"", ctypes.byref(self.callbacks), 0, 0)
        )
        assert self.instance.value

    def reference(self, name):
        return (ctypes.c_uint * 1)(int(self.variables[name][0]["valueReference"]))

    def set(self, name, value):
        return self.library.fmi2SetReal(self.instance, self.reference(name), 1, (ctypes.c_double * 1)(value))

    def get(self, name):
        value = (ctypes.c_double * 1)()
        assert self.library.fmi2GetReal(self.instance, self.reference(name), 1, value) == 0
        return value[0]

    def begin(self):
        none = ctypes.c_double(0)
        assert self.library.fmi2SetupExperiment(self.instance, 0, none, none, 0, none) == 0
        assert self.library.fmi2EnterInitializationMode(self.instance) == 0
        assert self.library.fmi2ExitInitializationMode(self.instance) == 0

    def step(self, time_s, dt_s):
        return self.library.fmi2DoStep(self.instance, ctypes.c_double(time_s), ctypes.c_double(dt_s), 1)


def extracted(fmu, name):
    return zipfile.ZipFile(path(fmu)).extract(name, path("x" + fmu))


def steps_equal_joint_c():
    made = run(program, "export", model, "--joint", "joint2", "--c", "joint2.c")
    check("joint.c", made.returncode == 0, made.stderr)
    made = run("cc", "-std=c99", "-O2", "-fPIC", "-shared", "joint2.c", "-o", "joint2.so", "-lm")
    check("it compiles", made.returncode == 0, made.stderr)
    joint = ctypes.CDLL(path("joint2.so"))
    joint.joint2_step.restype = joint.joint2_temperature.restype = ctypes.c_double
    state = (ctypes.c_double * 100)()
    joint.joint2_init(state)
    fmu = Fmi2("two.fmu")
    fmu.begin()
    worst, time_s = 0, 0.0
    for k in range(2000):
        speed, load, dt_s = 1.2 * ((k * 7 % 11) - 5) / 5, 900.0 * ((k * 3 % 13) - 6), 1e-3 if k % 3 else 5.0
        expected = joint.joint2_step(state, *map(ctypes.c_double, (speed, load, dt_s)))
        assert fmu.set("speed_rad_s", speed) == 0 and fmu.set("load_nm", load) == 0
        assert fmu.step(time_s, dt_s) == 0
        time_s += dt_s
        worst = max(worst, abs(fmu.get("friction_nm") - expected))
        worst = max(worst, abs(fmu.get("temperature_degC") - joint.joint2_temperature(state)))
    check("the library's steps are those of joint.c, bit by bit", worst == 0, str(worst))
    check("it warms up", fmu.get("temperature_degC") > 26, str(fmu.get("temperature_degC")))
    friction = fmu.get("friction_nm")
    check("a parameter is tuned", fmu.set("Fc0", 0.08) == 0)
    check("one beyond its range is not", fmu.set("Fc0", 1e9) == 2 and fmu.get("Fc0") == 0.08)
    assert fmu.step(time_s, 1e-3) == 0
    check("friction follows", abs(fmu.get("friction_nm")) > abs(friction) + 100, f"{friction} {fmu.get('friction_nm')}")


MOTOR = """<mujoco><option timestep="0.001" tolerance="1e-10"/>
<extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
  <config key="Fc" value="0.03"/><config key="Fs" value="0.02"/><config key="Fv" value="4e-4"/>
  <config key="vs" value="10"/><config key="alpha" value="1.3"/><config key="torque_max_nm" value="100"/>
  <config key="gear_ratio" value="50"/><config key="winding_resistance_ohm" value="0.5"/>
  <config key="torque_constant_nm_A" value="0.1"/><config key="winding_heat_capacity_J_K" value="5"/>
  <config key="winding_thermal_resistance_K_W" value="0.4"/></instance></plugin></extension>
<worldbody><body><joint name="joint2" armature="2" frictionloss="1" solreffriction=".001 1"
  solimpfriction=".9999 .9999 .001 .5 2"/><geom size=".1" mass="4"/></body></worldbody>
<actuator><plugin name="drive" joint="joint2" plugin="tribotwin.drive" instance="j" actdim="6" dyntype="user"/>
</actuator></mujoco>"""


def motor_with_winding():
    with open(path("motor.xml"), "w") as f:
        f.write(MOTOR)
    made = run(program, "export", "motor.xml", "--c", "motor.c", "--name", "motor")
    check("joint.c of a motor", made.returncode == 0, made.stderr)
    made = run("cc", "-std=c99", "-DMOTOR_SELF_TEST_MAIN", "motor.c", "-o", "motor", "-lm")
    check("its self test", made.returncode == 0 and run(path("motor")).returncode == 0, made.stderr)
    made = run(program, "export", "motor.xml", "--fmu", "motor.fmu", "--name", "joint2")
    check("its FMU", made.returncode == 0, made.stderr)
    root, variables = described("motor.fmu")
    base = {u.attrib["name"]: dict(b.attrib) for u in root.iter("Unit") for b in u}
    check("ohm", base.get("ohm") == {"kg": "1", "m": "2", "s": "-3", "A": "-2"}, str(base))
    check("Nm/A", base.get("N.m/A") == {"kg": "1", "m": "2", "s": "-2", "A": "-1"}, str(base))
    fmu = Fmi2("motor.fmu")
    fmu.begin()
    assert fmu.set("load_nm", 25.0) == 0  # 5 A at rest: 12.5 W
    for k in range(1000):
        assert fmu.step(k * 1e-3, 1e-3) == 0
    rise = 0.0
    for _ in range(1000):
        warm = 5 / (1 - 1e-3 * rise)  # amperes beside weaker magnets
        rise += (warm**2 * 0.5 * (1 + 0.00393 * rise) - rise / 0.4) * 1e-3 / 5
    found = fmu.get("winding_temperature_degC")
    check("its winding warms", abs(found - 25 - rise) < 1e-3 * rise and rise > 1.5, f"{found} {rise}")


made = run(program, "export", model, "--joint", "joint2", "--fmu", "two.fmu")
check("FMI 2", made.returncode == 0 and made.stdout == "" and made.stderr == "", made.stderr)
made = run(program, "export", model, "--joint", "joint2", "--fmu", "three.fmu", "--fmi", 3, "--json")
check("FMI 3", made.returncode == 0 and json.loads(made.stdout) == {"files": ["three.fmu"]}, made.stderr)
common = ["documentation/index.html", "documentation/licenses/license.txt", "modelDescription.xml"]
common += ["resources/joint.yaml", "sources/joint2.c"]
files = {n: sorted(zipfile.ZipFile(path(n)).namelist()) for n in ("two.fmu", "three.fmu")}
check("files", files["two.fmu"] == sorted(common + ["binaries/linux64/joint2.so", "sources/fmi2.c"]), str(files))
three = ["binaries/x86_64-linux/joint2.so", "sources/fmi3.c", "sources/buildDescription.xml"]
check("files of FMI 3", files["three.fmu"] == sorted(common + three), str(files))
tokens = [check_description("two.fmu", 2), check_description("three.fmu", 3)]
check("tokens", all(re.fullmatch(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", t) for t in tokens), str(tokens))
check("each its own", tokens[0] != tokens[1])
steps_equal_joint_c()
motor_with_winding()

made = run(
    program, "export", "params.yaml", "--fmu", "gear.fmu", "--name", "gear", "--tau-max", 7500, "--gear-ratio", 178
)
check("parameters", made.returncode == 0, made.stderr)
kinds = {name: a["causality"] for name, (a, _) in described("gear.fmu")[1].items()}
check("their temperature is an input", kinds.get("temperature_degC") == "input" and "ambient_degC" not in kinds)

again = run(program, "export", model, "--joint", "joint2", "--fmu", "again.fmu")
same = open(path("again.fmu"), "rb").read() == open(path("two.fmu"), "rb").read()
check("the same joint gives the same bytes", again.returncode == 0 and same)

os.makedirs(path("empty"))
made = run(
    program, "export", model, "--joint", "joint2", "--fmu", "bare.fmu", env={**os.environ, "PATH": path("empty")}
)
check("no compiler is said", made.returncode == 0 and "no C compiler" in made.stderr, made.stderr)
check("and leaves sources", "binaries" not in " ".join(zipfile.ZipFile(path("bare.fmu")).namelist()))

refuse = lambda name, says, *arguments, lines=1: check_refused(
    name, run(program, "export", *arguments), says, lines=lines
)
joint2 = (model, "--joint", "joint2")
refuse("a file that exists", "exists", *joint2, "--fmu", "two.fmu")
refuse("another version", "--fmi", *joint2, "--fmu", "x.fmu", "--fmi", 1, lines=2)
refuse("both kinds", "--c", *joint2, "--fmu", "x.fmu", "--c", "x.c", lines=2)
refuse("-o beside it", "-o", *joint2, "--fmu", "x.fmu", "-o", "y.fmu")
refuse("several joints", "--joint says which", model, "--fmu", "x.fmu")
refuse("a name that is none in C", "becomes part of C", *joint2, "--name", "2nd", "--fmu", "x.fmu")
gantry = os.path.join(source, "tests/twin/gears/gantry.xml")
made = run(program, "add-drives", gantry, "-o", "gantry.xml")
if check("a gantry", made.returncode == 0, made.stderr):
    slide = re.search(r'joint="([^"]*)"', content("gantry.xml")).group(1)
    refuse("a slide", "is a slide", "gantry.xml", "--joint", slide, "--fmu", "x.fmu")
refuse("--commands of a joint", "the FMU of a robot", *joint2, "--fmu", "x.fmu", "--commands", "torque")
refuse("--joint of a robot", "belong to one joint", "irb6620_hold", "--joint", "joint2", "--fmu", "x.fmu")
refuse("several runs", "several runs (vary)", "rh380n_tracking", "--fmu", "x.fmu")
refuse("a robot's name", "--name 1st", "irb6620_hold", "--name", "1st", "--fmu", "x.fmu")
check("nothing half-written", not os.path.exists(path("x.fmu")))

made = run(program, "export", "irb6620_hold", "--fmu", "robot.fmu", "--commands", "position")
check("a robot", made.returncode == 0 and made.stdout == made.stderr == "", made.stderr)
kinds = {name: (a["causality"], t.get("unit")) for name, (a, t) in described("robot.fmu")[1].items()}
check("its inputs", kinds.get("joint2.position_command_rad") == ("input", "rad"), str(kinds))
quantities = "position_rad velocity_rad_s torque_nm friction_nm load_nm temperature_degC heat_J".split()
units = [kinds.get(f"joint6.{q}") for q in quantities]
check("its outputs", units == [("output", u) for u in ("rad", "rad/s", "N.m", "N.m", "N.m", "degC", "J")], str(units))
names = zipfile.ZipFile(path("robot.fmu")).namelist()
check("its resources", {"resources/scenario.yaml", "resources/model1/model.xml"} < set(names), str(names))
check(
    "what it needs", b"libmujoco" in zipfile.ZipFile(path("robot.fmu")).read("documentation/externalDependencies.txt")
)
made = run(program, "export", "irb6620_warmup", "--fmu", "warm.fmu", "--fmi", 3)
check("cycles that a run skips are said", made.returncode == 0 and "multirate is on" in made.stderr, made.stderr)
made = run(program, "export", *joint2, "--fmu", "two.fmu", "--force")
check("--force", made.returncode == 0, made.stderr)
finish()
