"""Whether a joint is healthy: friction curves learned cold to hot, then one of a worn joint."""

import pathlib
import tempfile

import numpy as np

import tribotwin

random = np.random.default_rng(3)
speed_rad_s = np.geomspace(1.5, 170, 15)


def write_curve(file, temperature_degC, wear):
    """A measured curve of a joint that gets easier to turn as it warms."""
    warm = np.exp(-(temperature_degC - 40) / 40)
    law = tribotwin.Law(
        'steady_state',
        {
            'Fc': 9 * (1 + wear),
            'Fs': 12 * (1 + wear),
            'Vs': 8 * (1 + wear),
            'alpha': 1.3,
            'Fv': 0.35 * warm,
            'beta': 0.8,
        },
    )
    friction_nm = law(speed_rad_s) + random.normal(0, 0.05, speed_rad_s.size)
    rows = np.column_stack([speed_rad_s, friction_nm, np.full(15, temperature_degC)])
    np.savetxt(file, rows, delimiter=',', header='speed_rad_s,friction_nm,temperature_degC', comments='')
    return file


with tempfile.TemporaryDirectory() as folder:
    path = pathlib.Path(folder)
    healthy = tribotwin.learn([write_curve(path / f'{i}.csv', 25 + 1.5 * i, 0) for i in range(20)])
    print(f'learned from {healthy.observations} curves, 25 to {healthy.temperature_high_degC:.1f} degC')
    for wear in (0.0, 0.2):
        verdict = healthy.check([write_curve(path / 'new.csv', 45, wear)], false_alarm=0.01)[0]
        print(f'wear of {wear:.0%}: {verdict.pattern}, anomalous: {verdict.anomalous}')
        if verdict.anomalous:
            print(f'severity {verdict.severity:.1f}, confidence above 0.9: {verdict.confidence > 0.9}')

# Prints:
# learned from 20 curves, 25 to 53.5 degC
# wear of 0%: healthy, anomalous: False
# wear of 20%: wear, anomalous: True
# severity 0.2, confidence above 0.9: True
