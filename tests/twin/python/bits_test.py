"""Python gives the same doubles as C++: laws, drives with faults, a twin. Arguments: the program of reference.cc."""
import subprocess, sys, tempfile, unittest

import numpy as np

import tribotwin

reference = sys.argv.pop(1)
random = np.random.default_rng(20261125)


def cpp(*arguments, values=()):
    """The doubles that reference.cc computes; its own messages on an error."""
    r = subprocess.run(
        [reference, *map(str, arguments)], input=np.asarray(values, float).tobytes(), capture_output=True
    )
    if r.returncode:
        raise AssertionError(r.stderr.decode())
    return np.frombuffer(r.stdout)


def same(a, b):
    return np.array_equal(np.asarray(a, float).view(np.uint64), np.asarray(b, float).view(np.uint64))


def some_law(name):
    """A law of that name with random parameters that it accepts."""
    for _ in range(200_000):
        parameters = {}
        for p in tribotwin.laws()[name].parameters:
            size = 10 ** random.uniform(-4, 1.5) * (-1 if p.minimum < 0 and random.integers(3) == 0 else 1)
            parameters[p.name] = float(np.clip(size, p.minimum, p.maximum))
        try:
            return tribotwin.Law(name, parameters)
        except tribotwin.Error:
            pass
    raise AssertionError(f"no parameters of {name} found")


class Laws(unittest.TestCase):
    def test_every_law_at_random_states(self):
        n = 13_000  # times 8 laws: 10^5 states
        for name in tribotwin.laws():
            law = some_law(name)
            with self.subTest(name):
                speed = 10 ** random.uniform(-6, 3, n) * random.choice([-1, 1], n)
                speed[:20] = [0, -0.0, np.nan, np.inf, -np.inf, 1e300, 5e-324, 1, -1, 280] * 2
                load, temperature = random.uniform(-2, 2, n), random.uniform(-50, 150, n)
                load[3], temperature[4] = np.nan, np.nan
                arguments = [f"{k}={v!r}" for k, v in law.parameters.items()]
                expected = cpp("law", f"law={name}", *arguments, values=np.column_stack([speed, load, temperature]))
                self.assertEqual(len(expected), 2 * n)
                self.assertTrue(same(law(speed, load, temperature, exact=True), expected[:n]))
                self.assertTrue(same(law(speed, load, temperature), expected[n:]))
                for i in range(0, n, 100):
                    number = law(float(speed[i]), float(load[i]), float(temperature[i]))
                    self.assertTrue(same([number], expected[i : i + 1]))


FAULTS = {"wear": 0.3, "lubricant_loss": 0.2, "backlash": 1e-3, "pitted_bearing": 0.4, "torque_constant": 0.1}


class Drives(unittest.TestCase):
    def keys(self, name, **more):
        return {
            "law": name,
            **some_law(name).parameters,
            "torque_max_nm": 250.5,
            "gear_ratio": 101,
            "thermal": "second_order",
            "c1": 1e-5,
            "c2": 3e-6,
            "t1": 300,
            "t2": 5000,
            "asymmetry": 0.1,
            **more,
        }

    def compare(self, keys, n=7_000):
        # A law that locks its own gear is refused: try other parameters.
        drive = tribotwin.Drive(keys)
        speed, load = random.uniform(-3, 3, n), random.uniform(-300, 300, n)
        speed[::17] = 0
        arguments = [f"{key}={value}" for key, value in keys.items()]
        for fault, severity in FAULTS.items():
            drive.add_fault(fault, severity)
            arguments.append(f"fault:{fault}={severity!r}")
        expected = cpp("slide", 0.004, *arguments, values=np.column_stack([speed, load])).reshape(n, 4)
        half = n // 2
        self.assertTrue(same(drive.slide(speed[:half], load[:half], 0.004), expected[:half, 0]))
        for k in range(half, n):  # one by one
            self.assertTrue(same([drive.slide(speed[k], load[k], 0.004)], expected[k : k + 1, 0]))
        self.assertTrue(same([drive.temperature_degC], expected[-1:, 1]))
        self.assertGreater(np.ptp(expected[:, 1]), 0)

    def test_every_law_and_dynamics_with_faults(self):
        dynamics = [{}, {"friction": "lugre", "sigma0": 50, "sigma1": 1e-3, "vd": 0.1}]
        dynamics.append({"friction": "gear_loss", "mu_avg": 0.2, "mu_dif": 0.05, "h": 0.01})
        for name in tribotwin.laws():
            for more in dynamics:
                for _ in range(1000):
                    keys = self.keys(name, **more)
                    try:
                        tribotwin.Drive(keys)
                        break
                    except tribotwin.Error:
                        keys = None
                with self.subTest(law=name, **more):
                    self.compare(keys)

    def test_winding(self):
        """Every step equals C++, and the temperatures those of the winding's equation solved here."""
        n, dt = 4_000, 0.004
        R, k, C, R_th, u, a, ref = 0.5, 0.8, 30.0, 0.4, 178, 0.0042, 20.0
        keys = {
            "law": "extended",
            **tribotwin.Law("extended").parameters,
            "torque_max_nm": 7500,
            "gear_ratio": u,
            "thermal": "first_order",
            "R_th": 0.15,
            "kappa": 600,
            "winding_resistance_ohm": R,
            "torque_constant_nm_A": k,
            "winding_heat_capacity_J_K": C,
            "winding_thermal_resistance_K_W": R_th,
            "winding_copper_1_K": a,
            "winding_reference_degC": ref,
            "current_max_A": 45,
        }
        drive = tribotwin.Drive(keys)
        speed = np.sin(np.arange(n) * dt)
        load = 5500 * np.sin(np.arange(n) * dt / 3)
        arguments = [
            f"{key}={value!r}" if isinstance(value, float) else f"{key}={value}" for key, value in keys.items()
        ]
        expected = cpp("slide", dt, *arguments, values=np.column_stack([speed, load])).reshape(n, 4)
        winding, gear, limited = drive.winding_temperature_degC, drive.temperature_degC, 0
        self.assertEqual(winding, 25)
        for i in range(n):
            friction = drive.slide(speed[i], load[i], dt)
            row = [friction, drive.temperature_degC, drive.winding_temperature_degC, drive.motor_current_A]
            self.assertTrue(same(row, expected[i]), f"step {i}: {row} {expected[i]}")
            # Warm magnets deliver less: the default is 0.1 % per K.
            needed = (load[i] + friction) / (1 - 0.001 * (winding - ref)) / (u * k)
            limit = 45 * np.clip((155 - winding) / (155 - 130), 0, 1)
            current = np.clip(needed, -limit, limit)
            limited += abs(current) == limit
            end = gear + R_th * current**2 * R * (1 + a * (winding - ref))
            winding += (end - winding) * -np.expm1(-dt / (R_th * C))
            self.assertAlmostEqual(drive.motor_current_A, current, delta=1e-9 * abs(current))
            self.assertAlmostEqual(drive.winding_temperature_degC, winding, delta=1e-8)
            gear = drive.temperature_degC
        self.assertGreater(np.count_nonzero(expected[:, 3]), 0.99 * n)
        self.assertTrue(0 < limited < n / 2, limited)
        stored = C * (drive.winding_temperature_degC - 25)
        self.assertAlmostEqual(drive.copper_loss_J, drive.winding_heat_J + stored, delta=1e-8 * drive.copper_loss_J)


class Twins(unittest.TestCase):
    settings = {"duration_s": 0.5}

    def test_a_scenario_to_its_end(self):
        expected = cpp("scenario", "irb6620_warmup", "duration_s=0.5", "multirate.enabled=false").reshape(-1, 3)
        twin = tribotwin.Twin("irb6620_warmup", {**self.settings, "multirate.enabled": False})
        twin.run()
        self.assertTrue(twin.finished)
        for column, array in enumerate((twin.position_rad, twin.friction_nm, twin.temperature_degC)):
            self.assertTrue(same(array, expected[:, column]))

    def test_torques_from_python_in_every_step(self):
        n = 500
        twin = tribotwin.Twin("irb6620_hold", commanded=True)
        joints = len(twin.joints)
        torques = random.uniform(-300, 300, (n, joints))
        expected = cpp("twin", "irb6620_hold", n, values=torques).reshape(n, joints, 3)
        for k in range(n):
            self.assertTrue(twin.step(torque_nm=torques[k]))
            for column, array in enumerate((twin.position_rad, twin.friction_nm, twin.temperature_degC)):
                self.assertTrue(same(array, expected[k, :, column]), f"step {k}")

    def test_telemetry_is_that_of_a_run(self):
        with tempfile.TemporaryDirectory() as folder:
            tribotwin.run("irb6620_hold", f"{folder}/run", self.settings)
            run = tribotwin.read_run(f"{folder}/run")
        twin = tribotwin.Twin("irb6620_hold", self.settings, record=True)
        twin.run()
        mine = twin.telemetry
        self.assertTrue(run.complete and mine.complete)
        self.assertTrue(same(run.time_s, mine.time_s))
        self.assertEqual(run.joints, mine.joints)
        for joint in run.joints:
            self.assertEqual(run[joint].keys(), mine[joint].keys())
            self.assertEqual(run.units[joint], mine.units[joint])
            for name, values in run[joint].items():
                self.assertTrue(same(values, mine[joint][name]), f"{joint}/{name}")


if __name__ == "__main__":
    unittest.main()
