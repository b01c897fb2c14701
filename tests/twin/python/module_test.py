"""What a user of the Python module sees: arrays, messages, stubs, documentation. Arguments: program tribotwin, source
tree."""
import ast, inspect, os, pathlib, pydoc, re, subprocess, sys, tempfile, threading, unittest

import h5py
import numpy as np

import tribotwin

program, source = sys.argv.pop(1), pathlib.Path(sys.argv.pop(1))
M_STAR = tribotwin.Law("extended")


def refused(test, says, kind="input"):
    """A context in which tribotwin.Error is raised with these words."""

    class Context:
        def __enter__(self):
            return self

        def __exit__(self, cls, error, trace):
            test.assertIsNotNone(error, f"nothing was raised, {says!r} expected")
            if not isinstance(error, tribotwin.Error):
                return False
            for text in [says] if isinstance(says, str) else says:
                test.assertIn(text, str(error))
            test.assertEqual(error.kind, kind)
            return True

    return Context()


class Arrays(unittest.TestCase):
    def test_broadcasting(self):
        speed, load = np.linspace(1, 200, 7)[:, None], np.array([0.1, 0.3, 0.5])
        result = M_STAR(speed, load, 50.0, exact=True)
        self.assertEqual(result.shape, (7, 3))
        for i in range(7):
            for k in range(3):
                self.assertEqual(result[i, k], M_STAR(float(speed[i, 0]), float(load[k]), 50.0))

    def test_strided_lists_and_other_types(self):
        speed = np.linspace(1, 200, 40)
        expected = M_STAR(speed[::2].copy(), 0.2, 60, exact=True)
        for same in (speed[::2], list(speed[::2]), speed[::2].astype(">f8")):
            np.testing.assert_array_equal(M_STAR(same, 0.2, 60, exact=True), expected)
        np.testing.assert_allclose(M_STAR(speed[::2], 0.2, 60), expected, rtol=1e-12)
        self.assertIsInstance(M_STAR(10, 0.2, 60), float)
        self.assertEqual(M_STAR(np.zeros(0), np.zeros(0), np.zeros(0)).shape, (0,))
        with self.assertRaises(ValueError):
            M_STAR(np.zeros(3), np.zeros(4), 50)
        with self.assertRaises((ValueError, TypeError)):
            M_STAR("fast", 0.2, 50)

    def test_results_outlive_their_owner(self):
        twin = tribotwin.Twin("irb6620_hold", {"duration_s": 0.02}, record=True)
        twin.run()
        time = twin.telemetry.time_s
        position = twin.position_rad
        del twin
        self.assertEqual(time[0], 0)
        self.assertEqual(len(position), 6)

    def test_outside(self):
        self.assertEqual(list(M_STAR.outside([10, 300, 10, 10], [0.1, 0.1, 0.9, 0.1], [50, 50, 50, 20])), [0, 1, 1, 1])
        self.assertIs(M_STAR.outside(10.0, 0.1, 50.0), False)

    def test_threads(self):
        speed = np.linspace(1, 250, 200_000)
        expected = M_STAR(speed, 0.2, 60)
        wrong = []

        def work():
            for _ in range(5):
                if not np.array_equal(M_STAR(speed, 0.2, 60), expected):
                    wrong.append(1)

        threads = [threading.Thread(target=work) for _ in range(4)]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
        self.assertEqual(wrong, [])


class Messages(unittest.TestCase):
    def test_laws(self):
        with refused(self, ["law 'extendd' is not known", "did you mean 'extended'"]):
            tribotwin.Law("extendd")
        with refused(self, ["has no parameter 'c1'", "did you mean 'f1'"]):
            tribotwin.Law("polynomial", {"c1": 1.0})
        with refused(self, "publishes no value for parameter 'f1'"):
            tribotwin.Law("polynomial")
        with refused(self, "law 'extended' depends on temperature_degC"):
            M_STAR(10.0, 0.2)
        with refused(self, "validity is 'error'"):
            tribotwin.Law("extended", validity="error")

    def test_the_words_of_the_programs(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "wrong.yaml")
            pathlib.Path(file).write_text("model: irb6620.xml\nduration_s: 1\ncontrol: {type: torqe}\n")
            r = subprocess.run([program, "run", file], capture_output=True, text=True)
            self.assertEqual(r.returncode, 2)
            with refused(self, r.stderr.strip().removeprefix("tribotwin: ")):
                tribotwin.Twin(file)

    def test_twins(self):
        twin = tribotwin.Twin("irb6620_hold")
        with refused(self, "commanded=True"):
            twin.step(torque_nm=np.zeros(6))
        with refused(self, "commanded=True"):
            twin.command("joint2", "torque")
        with refused(self, "record=True"):
            twin.telemetry
        with refused(self, "n is -1"):
            twin.step(-1)
        commanded = tribotwin.Twin("irb6620_hold", commanded=True)
        with refused(self, "torque_nm has 5 values but must have 6"):
            commanded.step(torque_nm=np.zeros(5))
        with refused(self, ["no joint 'joint9'", "did you mean"]):
            commanded.command("joint9", "torque")
        with refused(self, "mode is 'fast'"):
            commanded.command(0, "fast")
        with refused(self, "never finishes"):
            commanded.run()
        with refused(self, ["type", "did you mean 'fault'"]):
            commanded.happen({"type": "falt"})
        with refused(self, "time_s"):
            commanded.happen({"type": "marker", "text": "x", "time_s": 1})
        with refused(self, "diverged", kind="work"):
            commanded.step(2000, torque_nm=[np.nan] * 6)

    def test_drives(self):
        with refused(self, "key 'law' is missing"):
            tribotwin.Drive({})
        drive = tribotwin.Drive({"law": "extended", **M_STAR.parameters, "torque_max_nm": 7500, "gear_ratio": 178})
        with refused(self, ["fault 'waer'", "did you mean 'wear'"]):
            drive.add_fault("waer", 0.1)
        with refused(self, "severity of 'preload_loss' is 2"):
            drive.add_fault("preload_loss", 2.0)
        with refused(self, ["'Fc' is no parameter", "did you mean 'Fc0'"]):
            drive.set_wear("Fc", 1.1)
        with refused(self, "needs a begin_step()"):
            drive.end_step(0.001, friction_nm=0, torque_nm=0, speed_rad_s=0)
        with refused(self, "dt_s is 0 but"):
            drive.slide(1.0, 0.0, 0.0)

    def test_runs(self):
        with tempfile.TemporaryDirectory() as folder:
            with refused(self, "no folder of a run"):
                tribotwin.read_run(folder)
            run = os.path.join(folder, "run")
            tribotwin.run("irb6620_hold", run, ["duration_s=0.1"])
            with refused(self, "run"):
                tribotwin.run("irb6620_hold", run, ["duration_s=0.1"])
            tribotwin.run("irb6620_hold", run, ["duration_s=0.2"], force=True)
            self.assertAlmostEqual(tribotwin.read_run(run).time_s[-1], 0.15)
            with h5py.File(os.path.join(run, "telemetry.h5")) as record:
                expected = record["joint2/friction_nm"][:]
            np.testing.assert_array_equal(tribotwin.read_run(run)["joint2"]["friction_nm"], expected)
            with refused(self, "no joint 'elbow'"):
                tribotwin.read_run(run)["elbow"]
            with refused(self, "lists several runs"):
                vary = pathlib.Path(folder, "vary.yaml")
                vary.write_text(
                    "model: irb6620.xml\nduration_s: 1\ncontrol: {type: torque}\nvary: [{ambient_degC: [20, 30]}]\n"
                )
                tribotwin.run(vary)


class Twins(unittest.TestCase):
    def test_steps_time_and_end(self):
        twin = tribotwin.Twin("irb6620_hold", {"duration_s": 0.1})
        self.assertTrue(twin.step(30))
        self.assertAlmostEqual(twin.time_s, 30 * twin.timestep_s)
        self.assertFalse(twin.step(10_000))
        self.assertTrue(twin.finished)
        self.assertAlmostEqual(twin.time_s, 0.1)
        self.assertFalse(twin.step())
        self.assertAlmostEqual(twin.summary()["simulated_s"], 0.1)
        self.assertNotIn("wall_s", twin.summary())

    def test_events_from_python(self):
        healthy, worn = (tribotwin.Twin("irb6620_warmup", {"duration_s": 1}) for _ in range(2))
        healthy.step(300), worn.step(300)
        worn.happen({"type": "fault", "joint": "joint2", "fault": "wear", "severity": 0.5})
        healthy.step(), worn.step()
        i = healthy.joints.index("joint2")
        self.assertGreater(abs(worn.friction_nm[i]), 1.05 * abs(healthy.friction_nm[i]))
        worn.happen({"type": "payload", "mass_kg": 20, "com_m": [0, 0, 0.1]})
        worn.happen({"type": "ambient", "temperature_degC": 60})
        worn.step(10)

    def test_commands(self):
        twin = tribotwin.Twin("irb6620_hold", commanded=True)
        start = twin.position_rad
        self.assertAlmostEqual(start[1], -0.1)
        twin.command("joint1", "position", position_rad=float(start[0] + 0.1))
        for joint in twin.joints[1:]:
            twin.set_brake(joint, True)
        twin.step(3000)
        self.assertLess(abs(twin.position_rad[0] - start[0] - 0.1), 2e-3)
        twin.hold_temperature(0, 70.0)
        twin.step()
        self.assertAlmostEqual(twin.temperature_degC[0], 70, places=3)


MOTOR = {
    "law": "stribeck",
    "Fc": 0.03,
    "Fs": 0.02,
    "Fv": 4e-4,
    "vs": 10,
    "alpha": 1.3,
    "torque_max_nm": 100,
    "gear_ratio": 50,
    "winding_resistance_ohm": 0.5,
    "torque_constant_nm_A": 0.1,
    "winding_heat_capacity_J_K": 5,
    "winding_thermal_resistance_K_W": 0.4,
    "current_max_A": 8,
}
ARM = """<mujoco><option timestep="0.001" tolerance="1e-10"/>
<extension><plugin plugin="tribotwin.drive"><instance name="j">{}</instance><instance name="k">{}</instance>
  </plugin></extension>
<worldbody><body><joint name="hinge" axis="0 1 0" armature="2" frictionloss="1" solreffriction=".001 1"
  solimpfriction=".9999 .9999 .001 .5 2"/><geom size=".1" pos=".5 0 0" mass="4"/>
  <body><joint name="plain" axis="0 1 0" armature="2" frictionloss="1" solreffriction=".001 1"
  solimpfriction=".9999 .9999 .001 .5 2"/><geom size=".1" mass="4"/></body></body></worldbody>
<actuator><plugin name="one" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="6" dyntype="user"/>
  <plugin name="two" joint="plain" plugin="tribotwin.drive" instance="k" actdim="3" dyntype="user"/>
</actuator></mujoco>"""


class Windings(unittest.TestCase):
    def test_a_drive_without_one(self):
        drive = tribotwin.Drive({k: v for k, v in MOTOR.items() if "winding" not in k and "_A" not in k})
        self.assertIsNone(drive.winding_temperature_degC)
        self.assertEqual((drive.limited_torque(1e6), drive.motor_current_A), (1e6, 0))
        with refused(self, ["has no winding", "winding_resistance_ohm"]):
            drive.winding_temperature_degC = 40

    def test_a_step_of_an_engine_of_ones_own(self):
        drive = tribotwin.Drive(MOTOR)
        with refused(self, "winding_temperature_degC is nan but must be within"):
            drive.winding_temperature_degC = np.nan
        drive.winding_temperature_degC = 142.5  # halfway between 130, where the limit begins to fall, and 155
        drive.begin_step(0.0, 0.0)
        self.assertAlmostEqual(drive.motor_current_limit_A, 4)
        self.assertAlmostEqual(drive.limited_torque(100.0), 4 * 0.1 * 50)
        self.assertAlmostEqual(drive.limited_torque(-3.0), -3)
        self.assertAlmostEqual(drive.delivered_share, 1 - 0.001 * (142.5 - 25))
        drive.end_step(1e-3, friction_nm=0, torque_nm=drive.limited_torque(100.0), speed_rad_s=0)
        self.assertAlmostEqual(drive.motor_current_A, 4)
        copper_W = 4**2 * 0.5 * (1 + 0.00393 * 117.5)
        self.assertAlmostEqual(drive.copper_loss_J, copper_W * 1e-3)
        change = (copper_W - 117.5 / 0.4) / 5 * 1e-3  # it cools to a gear of 25 degC
        self.assertAlmostEqual(drive.winding_temperature_degC, 142.5 + change, delta=1e-3 * abs(change))

    def test_a_twin(self):
        keys = lambda all: "".join(f'<config key="{k}" value="{v}"/>' for k, v in all.items())
        plain = {k: v for k, v in MOTOR.items() if "winding" not in k and "_A" not in k}
        with tempfile.TemporaryDirectory() as folder:
            pathlib.Path(folder, "arm.xml").write_text(ARM.format(keys(MOTOR), keys(plain)))
            scenario = pathlib.Path(folder, "s.yaml")
            scenario.write_text("model: arm.xml\nduration_s: 1\ntelemetry_rate_hz: 1000\nmotion: {type: hold}\n")
            twin = tribotwin.Twin(scenario, record=True)
            twin.run()
        summary, record = twin.summary(), twin.telemetry["hinge"]
        self.assertTrue(np.isnan([twin.winding_temperature_degC[1], twin.motor_current_A[1]]).all())
        self.assertEqual(twin.winding_temperature_degC[0], summary["joints"][0]["winding"]["temperature_degC"]["end"])
        self.assertEqual(twin.copper_loss_J[0], summary["joints"][0]["winding"]["copper_loss_J"])
        self.assertEqual(twin.motor_current_A[0], record["motor_current_A"][-1])
        self.assertEqual(twin.motor_current_limit_A[0], record["motor_current_limit_A"][-1])
        # What holds the arm heats the winding, beside a gear that stays at 25 degC (prescribed).
        winding = 25.0
        for current in record["motor_current_A"]:
            copper_W = current**2 * 0.5 * (1 + 0.00393 * (winding - 25))
            winding += (copper_W - (winding - 25) / 0.4) / 5 * 1e-3
        self.assertGreater(winding, 25.5)
        self.assertAlmostEqual(twin.winding_temperature_degC[0], winding, delta=1e-3 * (winding - 25))


class States(unittest.TestCase):
    settings = {
        "duration_s": 3,
        "multirate": {"enabled": False},
        "telemetry_rate_hz": 1000,
        "events": [
            {"time_s": 0.1, "type": "fault", "joint": "joint2", "fault": "wear", "severity": 0.3, "growth_per_h": 50},
            {"time_s": 0.7, "type": "payload", "mass_kg": 80},
        ],
    }

    def further(self, twin, steps=1000):
        """Rows of the next steps, to the last bit."""
        rows = []
        for _ in range(steps):
            self.assertTrue(twin.step())
            rows.append(np.concatenate([twin.position_rad, twin.torque_nm, twin.friction_nm, twin.temperature_degC]))
        return np.array(rows).tobytes()

    def test_steps_after_restoring_are_the_same_bits(self):
        make = lambda: tribotwin.Twin("irb6620_warmup", self.settings, record=True)
        one, two = make(), make()
        one.step(500)
        state = one.save()
        self.assertIsInstance(state, bytes)
        expected = self.further(one)
        one.restore(state)
        self.assertEqual((one.steps, len(one.telemetry.time_s)), (500, 0))
        self.assertEqual(one.save(), state)
        self.assertEqual(self.further(one), expected)
        self.assertEqual(len(one.telemetry.time_s), 1000)
        two.step(7)
        two.restore(state)
        self.assertEqual(self.further(two), expected)
        self.assertEqual(one.summary(), two.summary())

    def test_commands_are_part_of_it(self):
        make = lambda: tribotwin.Twin("irb6620_hold", commanded=True)
        one, two = make(), make()
        one.command("joint2", "velocity", velocity_rad_s=0.2)
        one.step(300)
        state = one.save()
        expected = self.further(one)
        two.restore(state)
        self.assertEqual(self.further(two), expected)

    def test_others_are_refused_and_change_nothing(self):
        twin = tribotwin.Twin("irb6620_warmup", self.settings)
        twin.step(200)
        state, own = twin.save(), twin.save
        events = [dict(self.settings["events"][0], severity=0.31), self.settings["events"][1]]
        for other in (
            tribotwin.Twin("irb6620_hold"),
            tribotwin.Twin("irb6620_warmup", dict(self.settings, events=events)),
            tribotwin.Twin("irb6620_warmup", self.settings, commanded=True),
        ):
            with refused(self, "the state is one of another scenario"):
                twin.restore(other.save())
            self.assertEqual(own(), state)
        changed = bytearray(state)
        changed[len(state) // 2] ^= 1
        for damaged in (b"", b"state", state[:-8], state[1:], state + b"x", bytes(changed)):
            with refused(self, ["bytes that are no whole state", "save()"]):
                twin.restore(damaged)
            self.assertEqual(own(), state)
        with self.assertRaises(TypeError):
            twin.restore("text")
        twin.happen({"type": "ambient", "temperature_degC": 35})
        with refused(self, "events that came from outside the scenario"):
            twin.save()
        twin.restore(state)
        self.assertEqual(own(), state)


class Fits(unittest.TestCase):
    def data(self, temperatures=(40.0, 55.0, 70.0)):
        random = np.random.default_rng(1)
        T, l, v = (x.ravel() for x in np.meshgrid(temperatures, (0.1, 0.4, 0.7), np.geomspace(2, 280, 28)))
        order = np.lexsort((v, l, T))
        T, l, v = T[order], l[order], v[order]
        return dict(
            speed_rad_s=v,
            load_norm=l,
            temperature_degC=T,
            friction_norm=M_STAR(v, l, T) + random.normal(0, 5e-4, v.size),
        )

    def test_identify_finds_what_was_measured(self):
        fit = tribotwin.identify("extended", **self.data(), fixed={"alpha": 1.36})
        self.assertEqual(fit.not_identifiable, [])
        for name, value in M_STAR.parameters.items():
            p = fit.parameters[name]
            if name == "alpha":
                self.assertEqual((p.value, p.status), (1.36, "fixed"))
            else:
                self.assertLess(abs(p.value - value), 4 * p.sigma, name)
        covariance = fit.covariance
        i = list(fit.parameters).index("Fcl")
        self.assertAlmostEqual(covariance[i, i] ** 0.5, fit.parameters["Fcl"].sigma, places=12)
        self.assertGreater(fit.r_squared, 0.999)
        self.assertLess(abs(fit.law(50.0, 0.4, 55.0) - M_STAR(50.0, 0.4, 55.0)), 1e-3)

    def test_identify_equals_the_program(self):
        data = self.data()
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "curves.csv")
            np.savetxt(file, np.column_stack(list(data.values())), "%.17g", ",", header=",".join(data), comments="")
            params = os.path.join(folder, "params.yaml")
            subprocess.run(
                [program, "identify", "--law", "extended", file, "-o", params, "--quiet"],
                check=True,
                stdout=subprocess.DEVNULL,
            )
            of_program = pathlib.Path(params).read_text()
            for fit in (tribotwin.identify("extended", **data), tribotwin.identify_files("extended", [file])):
                mine = os.path.join(folder, "mine.yaml")
                fit.save(mine, force=True)
                pick = lambda text: re.search(r"parameters:.*?residual", text, re.DOTALL)[0]
                self.assertEqual(pick(pathlib.Path(mine).read_text()), pick(of_program))
            with refused(self, "exists"):
                fit.save(mine)

    def test_what_data_do_not_tell(self):
        fit = tribotwin.identify("extended", **self.data([50.0]))
        self.assertIn("FsT", fit.not_identifiable)
        lacking = {l.parameter: l for l in fit.lacking}
        self.assertTrue(lacking["FsT"].withheld and lacking["FsT"].reason and lacking["FsT"].next)
        self.assertTrue(np.isnan(fit.parameters["FsT"].sigma))

    def test_wrong_data(self):
        data = self.data()
        with refused(self, ["law 'extended' depends on load", "load_norm"]):
            tribotwin.identify("extended", **{**data, "load_norm": None})
        with refused(self, "load_norm has 3 values but speed_rad_s has"):
            tribotwin.identify("extended", **{**data, "load_norm": [1, 2, 3]})
        with refused(self, "degrees"):
            tribotwin.identify("extended", **{**data, "speed_rad_s": 57.3 * data["speed_rad_s"]})
        with refused(self, ["no parameter 'alpa'", "did you mean 'alpha'"]):
            tribotwin.identify("extended", **data, fixed={"alpa": 1.36})
        holes = data["friction_norm"].copy()
        holes[5] = np.nan
        fit = tribotwin.identify("extended", **{**data, "friction_norm": holes})
        self.assertEqual(fit.samples, len(holes) - 1)
        self.assertTrue(any("1 rows" in note for note in fit.notes))


class Experiments(unittest.TestCase):
    def test_a_measured_curve_is_that_of_the_law(self):
        keys = tribotwin.drive_keys("mjcf/irb6620.xml")["joint2"]
        drive = tribotwin.Drive(keys)
        speed = np.array([20.0, 80.0, 200.0])
        curve = tribotwin.measure_curve("mjcf/irb6620.xml", "joint2", speed, load_norm=0.2, temperature_degC=50)
        np.testing.assert_allclose(curve["speed_rad_s"], speed, rtol=1e-3)
        expected = drive.law(curve["speed_rad_s"], curve["load_norm"], curve["temperature_degC"])
        np.testing.assert_allclose(curve["friction_norm"], expected, rtol=5e-3)
        noisy = tribotwin.measure_curve("mjcf/irb6620.xml", "joint2", speed, noise_nm=20, seed=3)
        self.assertTrue((noisy["stderr_norm"] > 0).all())
        self.assertEqual(tribotwin.Drive(drive.keys).keys, drive.keys)

    def test_wrong_measurements(self):
        with refused(self, "other than 0"):
            tribotwin.measure_curve("mjcf/irb6620.xml", "joint2", [0.0])
        with refused(self, "joint9"):
            tribotwin.measure_curve("mjcf/irb6620.xml", "joint9", [1.0])
        with refused(self, "load_by is 'weight'"):
            tribotwin.measure_curve("mjcf/irb6620.xml", "joint2", [1.0], load_by="weight")
        with refused(self, "nowhere.xml"):
            tribotwin.drive_keys("nowhere.xml")


class Documentation(unittest.TestCase):
    def stub(self):
        tree = ast.parse((source / "twin/python/tribotwin/__init__.pyi").read_text())
        return {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}

    def arguments_of(self, function):
        """Names of a bound function's arguments, from the signature that pybind11 writes."""
        if inspect.isfunction(function):  # one in Python
            return list(inspect.signature(function).parameters)
        head = function.__doc__.splitlines()[0]
        names = re.findall(r"(?:[(,] *)(\*|\w+)(?=[:,)])", re.sub(r"\[[^\[\]]*\]|\{[^}]*\}", "", head))
        return [name for name in names if name not in ("*", "self")]

    def stubbed(self, node):
        a = node.args
        return [x.arg for x in a.posonlyargs + a.args + a.kwonlyargs if x.arg != "self"]

    def test_stub_has_what_the_module_has(self):
        stub = self.stub()
        public = {name for name in tribotwin.__all__ if name != "__version__"}
        self.assertEqual(set(stub), public)
        for name in public:
            thing = getattr(tribotwin, name)
            if not inspect.isclass(thing):
                self.assertEqual(self.stubbed(stub[name]), self.arguments_of(thing), name)
            elif thing is not tribotwin.Error:
                self.same_class(name, thing, stub[name])

    def same_class(self, name, cls, node):
        members = {k for k in vars(cls) if not k.startswith("_")}
        functions = {f.name: f for f in node.body if isinstance(f, ast.FunctionDef)}
        plain = {f.target.id for f in node.body if isinstance(f, ast.AnnAssign)}
        visible = {f for f in functions if not f.startswith("_")} | plain
        self.assertEqual(visible, members, name)
        for member in members:
            thing = vars(cls)[member]
            if isinstance(thing, property):
                self.assertEqual(thing.fset is not None, member in plain, f"{name}.{member}")
            else:
                self.assertEqual(self.stubbed(functions[member]), self.arguments_of(thing), f"{name}.{member}")
        for special in ("__init__", "__call__"):
            if special in functions:
                self.assertEqual(self.stubbed(functions[special]), self.arguments_of(getattr(cls, special)), name)

    def test_everything_is_documented(self):
        for name in tribotwin.__all__:
            thing = getattr(tribotwin, name)
            if name == "__version__":
                continue
            self.assertTrue(thing.__doc__ and len(thing.__doc__.strip()) > 15, name)
            if inspect.isclass(thing) and thing is not tribotwin.Error:
                for member, value in vars(thing).items():
                    if not member.startswith("_"):
                        text = re.sub(r"^\w+\(.*\) -> .*\n*", "", value.__doc__ or "").strip()
                        self.assertTrue(text, f"{name}.{member}")

    def test_quantities_have_units(self):
        text = pydoc.plain(pydoc.render_doc(tribotwin.Twin)) + pydoc.plain(pydoc.render_doc(tribotwin.Drive))
        for unit in ("[rad]", "[rad/s]", "[Nm", "[degC]", "[J]", "[s]"):
            self.assertIn(unit, text)

    def test_follows_the_tables(self):
        readme = (source / "plugins/README.md").read_text()
        for name, law in tribotwin.laws().items():
            self.assertIn(f"`{name}`", readme)
            self.assertTrue(law.equation and law.parameters)
        self.assertTrue((pathlib.Path(tribotwin.__file__).parent / "py.typed").exists())

    def test_another_python_is_told(self):
        """A module of another version gives a message, no riddle."""
        with tempfile.TemporaryDirectory() as folder:
            package = pathlib.Path(folder, "tribotwin")
            package.mkdir()
            package.joinpath("__init__.py").write_text((source / "twin/python/tribotwin/__init__.py").read_text())
            package.joinpath("_tribotwin.cpython-27-nowhere.so").write_text("")
            r = subprocess.run(
                ["/usr/bin/python3", "-c", "import tribotwin"],
                env={**os.environ, "PYTHONPATH": folder},
                capture_output=True,
                text=True,
            )
            self.assertIn("was built for another Python than this", r.stderr)


class FrictionLimit(unittest.TestCase):
    keys = {"law": "extended", **M_STAR.parameters, "torque_max_nm": 250, "gear_ratio": 101, "T_amb": 45}

    def test_is_that_of_a_step(self):
        for more in ({}, {"asymmetry": 0.2}, {"law": "stribeck", **tribotwin.Law("stribeck").parameters}):
            keys = {**self.keys, **more} if "law" not in more else {**more, "torque_max_nm": 250, "gear_ratio": 101}
            for speed in (-2.5, -1e-3, 0.0, 0.02, 1.5):
                for load in (-200.0, 0.0, 90.0):
                    drive = tribotwin.Drive(keys)
                    drive.temperature_degC, drive.load_nm = 52.0, load
                    now = tribotwin.friction_limit(drive, speed, load, drive.temperature_degC)
                    self.assertEqual(now, drive.begin_step(0, speed))

    def test_arrays(self):
        drive = tribotwin.Drive(self.keys)
        speed, load = np.linspace(-2, 2, 5)[:, None], np.array([0.0, 50.0])
        all_of_them = tribotwin.friction_limit(drive, speed, load, 50.0)
        self.assertEqual(all_of_them.shape, (5, 2))
        one = tribotwin.friction_limit(drive, float(speed[1, 0]), 50.0, 50.0)
        self.assertIsInstance(one, float)
        self.assertEqual(all_of_them[1, 1], one)

    def test_is_written_where_the_solver_reads(self):
        class Data:  # as mujoco.MjData: two equality rows, friction of dofs 4 and 1 and of a tendon, a contact
            ne, nf, nisland = 2, 3, 0
            efc_type, efc_id = np.array([0, 0, 1, 1, 2, 5]), np.array([1, 4, 4, 1, 1, 1])
            efc_frictionloss = np.ones(6)

        data = Data()
        tribotwin.write_friction_limit(data, 1, 7.5)
        np.testing.assert_array_equal(data.efc_frictionloss, [1, 1, 1, 7.5, 1, 1])
        data.nisland, data.map_efc2iefc, data.iefc_frictionloss = 2, np.array([5, 4, 3, 2, 1, 0]), np.ones(6)
        tribotwin.write_friction_limit(data, 4, 2.5)
        np.testing.assert_array_equal(data.efc_frictionloss, [1, 1, 2.5, 7.5, 1, 1])
        np.testing.assert_array_equal(data.iefc_frictionloss, [1, 1, 1, 2.5, 1, 1])
        with refused(self, "dof 3 has no friction row"):
            tribotwin.write_friction_limit(data, 3, 1.0)


if __name__ == "__main__":
    unittest.main()
