"""What data do not tell is no number: friction that was measured at one temperature."""

import numpy as np

import tribotwin

truth = tribotwin.Law('extended')
load_norm, speed_rad_s = (x.ravel() for x in np.meshgrid([0.1, 0.4, 0.7], np.geomspace(2, 280, 28), indexing='ij'))
noise = np.random.default_rng(1).normal(0, 5e-4, speed_rad_s.size)
fit = tribotwin.identify(
    'extended',
    speed_rad_s=speed_rad_s,
    load_norm=load_norm,
    temperature_degC=50.0,
    friction_norm=truth(speed_rad_s, load_norm, 50.0) + noise,
)
print('not identifiable:', ', '.join(fit.not_identifiable))
first = fit.lacking[0]
print(f'{first.parameter}: {first.reason}; {first.next}')

# Prints:
# not identifiable: FsT, vsT, FvT, TV0
# FsT: these data show no effect of it; record speeds below 2 rad/s and another temperature than 50 degC
