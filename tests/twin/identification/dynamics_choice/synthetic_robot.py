"""Robots simulated by tribotwin and recorded with the defects that real recordings have. Beside the tests that use it.

A robot is a chain of joints j1, j2, ..., each with a drive; units rad, Nm, or m, N where all joints are slides."""
import json
import os

import h5py
import numpy as np

import harness

SIMULATED_HZ = 1000
STICTION = 'frictionloss="1" solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"'


def link(axis, at, centre, mass_kg, armature, kind="hinge"):
    """A joint and its body, a compact one; `at` and `centre` are MJCF vectors."""
    inertia = 0.02 * mass_kg * np.array([1.1, 1.2, 0.8])
    return dict(axis=axis, at=at, centre=centre, mass_kg=mass_kg, inertia=inertia, armature=armature, kind=kind)


def misjudged(links, random, share):
    """What the user's model says: masses and inertias off by up to `share`."""
    factor = lambda: 1 + share * random.uniform(-1, 1)
    return [{**one, "mass_kg": one["mass_kg"] * factor(), "inertia": one["inertia"] * factor()} for one in links]


def drive(law, torque_max_nm, gear_ratio, **keys):
    return dict(law=law, torque_max_nm=torque_max_nm, gear_ratio=gear_ratio, **keys)


def mjcf(links, drives=(), tendon=""):
    """With `drives` the robot that is simulated, without them the model that is given to `dynamics`."""
    bodies = instances = actuators = ""
    for k, one in enumerate(links, 1):
        bodies += (
            f'<body pos="{one["at"]}"><inertial pos="{one["centre"]}" mass="{one["mass_kg"]:.6g}"'
            f' diaginertia="{" ".join(f"{x:.6g}" for x in one["inertia"])}"/>'
            f'<joint name="j{k}" type="{one["kind"]}" axis="{one["axis"]}" armature="{one["armature"]}"'
            f' {STICTION if drives else ""}/>'
        )
    for k, keys in enumerate(drives, 1):
        instances += f'<instance name="d{k}">'
        instances += "".join(f'<config key="{name}" value="{value}"/>' for name, value in keys.items()) + "</instance>"
        actuators += f'<plugin name="d{k}" joint="j{k}" plugin="tribotwin.drive" instance="d{k}" actdim="3"/>'
    extension = f'<extension><plugin plugin="tribotwin.drive">{instances}</plugin></extension>' if drives else ""
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{1 / SIMULATED_HZ}"/>{extension}'
        f'<worldbody>{bodies}{"</body>" * len(links)}</worldbody>{tendon}<actuator>{actuators}</actuator></mujoco>\n'
    )


def motion(random, length_s, top_speed, span, base_hz, terms=5):
    """Sums of sines with random amplitudes and phases, up to that speed and deflection; faded in from rest."""
    t = np.arange(0, length_s, 0.01)
    rise = np.clip(t, 0, 1)
    fade, slope = rise**2 * (3 - 2 * rise), 6 * rise * (1 - rise)
    columns = {"time_s": t}
    for j, (fastest, widest) in enumerate(zip(top_speed, span)):
        amplitude, phase = random.normal(size=(terms, 1)), random.uniform(0, 2 * np.pi, (terms, 1))
        w = 2 * np.pi * base_hz * (np.arange(1, terms + 1)[:, None] + 0.13 * j)
        q, v = (amplitude * np.sin(w * t + phase)).sum(0), (amplitude * w * np.cos(w * t + phase)).sum(0)
        scale = min(fastest / np.abs(v).max(), widest / np.abs(q).max())
        columns[f"position_j{j + 1}"] = scale * q * fade
        columns[f"velocity_j{j + 1}"] = scale * (v * fade + q * slope)
    return columns


def write_table(file, columns, slides):
    """Columns QUANTITY_JOINT, with the unit that the joints have appended; time_s and degC stay."""
    unit = (
        dict(position="m", velocity="m_s", torque="n")
        if slides
        else dict(position="rad", velocity="rad_s", torque="nm")
    )
    unit["temperature"] = "degC"
    names = [name if name == "time_s" else f"{name}_{unit[name.split('_')[0]]}" for name in columns]
    np.savetxt(
        harness.path(file), np.column_stack([*columns.values()]), "%.9g", ",", header=",".join(names), comments=""
    )


def simulated(program, name, model, columns, **scenario):
    """The signals of that motion, every millisecond: time_s, and joints x samples of each channel of telemetry.h5."""
    slides = 'type="slide"' in model
    with open(harness.path(f"{name}.xml"), "w") as f:
        f.write(model)
    write_table(f"{name}_motion.csv", columns, slides)
    scenario |= {"model": f"{name}.xml", "motion": {"type": "recording", "file": f"{name}_motion.csv"}}
    with open(harness.path(f"{name}.yaml"), "w") as f:
        json.dump({**scenario, "telemetry_rate_hz": SIMULATED_HZ}, f)
    ran = harness.run(program, "run", f"{name}.yaml", "-o", name, "--quiet")
    if ran.returncode:
        raise RuntimeError(ran.stderr)
    with h5py.File(harness.path(name, "telemetry.h5")) as record:
        joints = sorted(key for key in record if key.startswith("j"))
        signals = {c: np.array([record[j][c][:] for j in joints]) for c in record[joints[0]]}
        return {"time_s": record["time_s"][:], **signals}


def resonance(random, shape, hz, rate_hz):
    """Noise of unit variance about one frequency, as of a current loop on an elastic gear."""
    r = np.exp(-2 * np.pi * hz * 0.1 / rate_hz)
    e = random.normal(size=shape)
    for i in range(2, shape[1]):
        e[:, i] += 2 * r * np.cos(2 * np.pi * hz / rate_hz) * e[:, i - 1] - r * r * e[:, i - 2]
    return e / e.std(1, keepdims=True)


def recorded(signals, random, rate_hz, noise_nm, **defects):
    """What a controller records of it. `noise_nm`: standard deviation per joint, white. Defects: position_step (rad),
    ring (share of the noise, at 16 Hz), lag_s (of the torque), gain (per joint, of the torque), outliers (share of
    samples, thirty times the noise), velocity_noise (there is a velocity column), bearing (torque is measured behind
    gear and rotor, but for this share of the friction), temperature (there is a column)."""
    unknown = set(defects) - set("position_step ring lag_s gain outliers velocity_noise bearing armature".split())
    if unknown:
        raise KeyError(unknown)
    at = np.arange(100, len(signals["time_s"]), round(SIMULATED_HZ / rate_hz))
    torque = signals["torque_nm"]
    if "bearing" in defects:
        acceleration = np.gradient(signals["velocity_rad_s"], 1 / SIMULATED_HZ, axis=1)
        rotor = np.array(defects["armature"])[:, None] * acceleration
        torque = torque - (1 - defects["bearing"]) * signals["friction_nm"] - rotor
    torque = torque[:, at - round(SIMULATED_HZ * defects.get("lag_s", 0))]
    noise = np.array(noise_nm)[:, None]
    torque = torque + noise * random.normal(size=torque.shape)
    torque += defects.get("ring", 0) * noise * resonance(random, torque.shape, 16, rate_hz)
    hit = random.random(torque.shape) < defects.get("outliers", 0)
    torque += 30 * noise * hit * random.normal(size=torque.shape)
    torque *= np.array(defects.get("gain", np.ones(len(torque))))[:, None]
    step = defects.get("position_step", 1e-6)
    record = {"time_s": signals["time_s"][at] - signals["time_s"][at[0]], "torque": torque}
    record["position"] = step * np.round(signals["position_rad"][:, at] / step)
    record["true_speed"] = signals["velocity_rad_s"][:, at]
    if "velocity_noise" in defects:
        record["velocity"] = record["true_speed"] + defects["velocity_noise"] * random.normal(size=torque.shape)
    return record


def smooth(rows, rate_hz, band_hz):
    """Gaussian low-pass without phase, half power at the band."""
    deviation = np.sqrt(np.log(2)) / (2 * np.pi * band_hz) * rate_hz
    half = int(4 * deviation) + 1
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / deviation) ** 2)
    return np.array([np.convolve(np.pad(row, half, mode="edge"), kernel / kernel.sum(), "valid") for row in rows])


def with_integrated_velocity(record, rate_hz):
    """By hand: positions whose slope is the recorded velocity, but for what is slower than 0.5 Hz."""
    v = record["velocity"]
    integral = np.concatenate([np.zeros((len(v), 1)), np.cumsum(v[:, 1:] + v[:, :-1], axis=1) / 2 / rate_hz], axis=1)
    return {**record, "position": integral + smooth(record["position"] - integral, rate_hz, 0.5)}


def without_lag(record, lag_s):
    """By hand: the torque moved back in time."""
    t = record["time_s"]
    return {**record, "torque": np.array([np.interp(t + lag_s, t, row) for row in record["torque"]])}
