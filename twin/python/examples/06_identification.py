"""The parameters of a law from measured friction, here made up from known ones so that the result can be judged."""

import numpy as np

import tribotwin

truth = tribotwin.Law('extended')
temperature_degC, load_norm, speed_rad_s = (
    x.ravel() for x in np.meshgrid([40.0, 55.0, 70.0], [0.1, 0.4, 0.7], np.geomspace(2, 280, 28), indexing='ij')
)
noise = np.random.default_rng(1).normal(0, 5e-4, speed_rad_s.size)
fit = tribotwin.identify(
    'extended',
    speed_rad_s=speed_rad_s,
    load_norm=load_norm,
    temperature_degC=temperature_degC,
    friction_norm=truth(speed_rad_s, load_norm, temperature_degC) + noise,
    fixed={'alpha': 1.36},
)
for name, p in fit.parameters.items():
    off = abs(p.value - truth.parameters[name])
    print(f'{name:6} {"known" if p.status == "fixed" else "within 3 sigma" if off < 3 * p.sigma else "off"}')
print(f'R^2 {fit.r_squared:.4f}; not identifiable: {fit.not_identifiable or "none"}')

# Prints:
# Fc0    within 3 sigma
# Fcl    within 3 sigma
# Fs0    within 3 sigma
# FsT    within 3 sigma
# Fsl    within 3 sigma
# vs0    within 3 sigma
# vsT    within 3 sigma
# vsl    within 3 sigma
# alpha  known
# Fv0    within 3 sigma
# FvT    within 3 sigma
# TV0    within 3 sigma
# R^2 0.9999; not identifiable: none
