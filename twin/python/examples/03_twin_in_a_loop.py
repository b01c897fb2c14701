"""A whole robot in a loop of your own, and its samples as arrays."""

import numpy as np

import tribotwin

twin = tribotwin.Twin('irb6620_warmup', {'duration_s': 20, 'ambient_degC': 30}, record=True)
friction_max_nm = np.zeros(len(twin.joints))
while twin.step():
    friction_max_nm = np.maximum(friction_max_nm, abs(twin.friction_nm))

print(f'{twin.time_s:.0f} s in {twin.steps} steps of {twin.timestep_s} s')
joint2 = twin.joints.index('joint2')
print(f'joint2: max. friction {1e-3 * friction_max_nm[joint2]:.1f} kNm, {twin.temperature_degC[joint2]:.1f} degC')

samples = twin.telemetry
speed = samples['joint2']['velocity_rad_s']
print(f'{len(samples.time_s)} samples; fastest {abs(speed).max():.2f} {samples.units["joint2"]["velocity_rad_s"]}')

# Prints:
# 20 s in 20000 steps of 0.001 s
# joint2: max. friction 1.3 kNm, 30.2 degC
# 400 samples; fastest 1.38 rad/s
