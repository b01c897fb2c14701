"""The law 'extended' and the published parameters of M* (Bittencourt 2012, Tables 2 and 3), in numpy: what the Python
tests make data with and compare results with. Found as harness.py is."""
import numpy as np

# Fc0 Fcl Fs0 FsT Fsl vs0 vsT vsl alpha Fv0 FvT TV0
M_STAR = np.array([3.11e-2, 2.34e-2, -2.5e-2, 1.6e-3, 0.126, -24.81, 0.98, 9.22, 1.36, 1.3e-4, 1.32e-3, 20.71])


def law(p, v, l, T):
    """Friction [-] with the parameters `p` at the speed v [rad/s, motor side], the load l [-] and T [degC]."""
    return (
        p[0]
        + p[1] * l
        + p[4] * l * np.exp(-np.abs(v / p[7]) ** p[8])
        + (p[2] + p[3] * T) * np.exp(-np.abs(v / (p[5] + p[6] * T)) ** p[8])
        + (p[9] + p[10] * np.exp(-T / p[11])) * v
    )
