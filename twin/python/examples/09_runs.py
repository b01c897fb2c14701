"""A run into a folder, as the program makes it, and its record as arrays."""

import pathlib
import tempfile

import numpy as np

import tribotwin

with tempfile.TemporaryDirectory() as folder:
    directory = pathlib.Path(folder, 'warmup')
    summary = tribotwin.run('irb6620_warmup', directory, {'duration_s': 3600})
    run = tribotwin.read_run(directory)
    print(f'{summary["simulated_s"]:.0f} s, of which multi-rate computed {summary["steps_computed"]} steps')
    print(sorted(p.name for p in directory.iterdir() if not p.name.startswith('.')))

print('joints:', ', '.join(run.joints))
print('columns:', ', '.join(run['joint2']))
temperature = run.cycles('joint2')['cycle_temperature_degC']
half = np.searchsorted(run.cycle_time_s, 1800)
print(f'joint2: {temperature[0]:.1f}, {temperature[half]:.1f}, {temperature[-1]:.1f} degC at start, middle and end')

# Prints:
# 3600 s, of which multi-rate computed 42561 steps
# ['scenario.yaml', 'summary.json', 'telemetry.h5']
# joints: joint1, joint2, joint3, joint4, joint5, joint6
# columns: position_rad, velocity_rad_s, motor_torque_nm, torque_nm, friction_nm, load_nm, temperature_degC
# joint2: 25.0, 38.9, 49.2 degC at start, middle and end
