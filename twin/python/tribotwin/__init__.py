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
    'identify',
    'identify_files',
    'laws',
    'learn',
    'measure_curve',
    'read_healthy',
    'read_run',
    'run',
]
