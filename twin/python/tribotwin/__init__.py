"""One robot joint whose friction depends on speed, load and temperature; the twin of a robot made of them.

Units are in the names: rad, rad/s, Nm, s, degC, K. Torques are those of the arm side unless the name says motor_; a
name with _norm is a torque over torque_max_nm.

    import tribotwin
    law = tribotwin.Law('extended')
    law(speed_rad_s=50.0, load_norm=0.3, temperature_degC=40.0)     # friction_norm

See help(tribotwin.Law), Drive, Twin, identify, learn, read_run, run. Every mistake is a tribotwin.Error.
"""

import sys as _sys

try:
    from . import _tribotwin
except ImportError as _error:
    import importlib.machinery as _machinery
    import pathlib as _pathlib

    _built = sorted(p.name for p in _pathlib.Path(__file__).parent.glob('_tribotwin*.so'))
    if _built and not any('_tribotwin' + suffix in _built for suffix in _machinery.EXTENSION_SUFFIXES):
        raise ImportError(
            f'tribotwin was built for another Python than this {_sys.version_info[0]}.{_sys.version_info[1]} '
            f'({_sys.executable}): {_built[0]}; use that one, or build with -DPython_EXECUTABLE={_sys.executable}'
        ) from _error
    raise

from ._tribotwin import (
    Drive,
    Error,
    Estimate,
    FaultInfo,
    Fit,
    Healthy,
    Lacking,
    Law,
    LawInfo,
    Parameter,
    Recording,
    RegionVerdict,
    Twin,
    Verdict,
    __version__,
    drive_keys,
    faults,
    friction_limit,
    identify,
    identify_files,
    laws,
    learn,
    measure_curve,
    read_healthy,
    read_run,
    run,
)

__all__ = [
    'Drive',
    'Error',
    'Estimate',
    'FaultInfo',
    'Fit',
    'Healthy',
    'Lacking',
    'Law',
    'LawInfo',
    'Parameter',
    'Recording',
    'RegionVerdict',
    'Twin',
    'Verdict',
    '__version__',
    'drive_keys',
    'faults',
    'friction_limit',
    'identify',
    'identify_files',
    'laws',
    'learn',
    'measure_curve',
    'read_healthy',
    'read_run',
    'run',
    'write_friction_limit',
]


def write_friction_limit(data, dof, limit_nm):
    """Writes a friction limit [Nm] into the constraint row of a joint, for the step that mj_step2 ends.

    data: a mujoco.MjData between mj_step1 and mj_step2 (package mujoco, 3.2 or newer). dof: the joint's place in qvel.
    The joint needs frictionloss above 0 in its model. mj_step1 and mj_step2 step with Euler where a model asks for
    RK4.
    """
    friction_of_a_joint = 1  # mjCNSTR_FRICTION_DOF
    for row in range(data.ne, data.ne + data.nf):
        if data.efc_type[row] == friction_of_a_joint and data.efc_id[row] == dof:
            data.efc_frictionloss[row] = limit_nm
            if data.nisland > 0 and hasattr(data, 'map_efc2iefc'):  # from 3.3.3 on islands solve a copy of the row
                copy = data.map_efc2iefc[row]
                if copy >= 0:
                    data.iefc_frictionloss[copy] = limit_nm
            return
    error = Error(f'dof {dof} has no friction row; its joint needs frictionloss above 0 in the model')
    error.kind = 'input'
    raise error
