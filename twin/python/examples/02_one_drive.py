"""One joint drive that slides at constant speed for an hour and warms up."""

import numpy as np

import tribotwin

drive = tribotwin.Drive(
    {
        'law': 'extended',
        **tribotwin.Law('extended').parameters,
        'torque_max_nm': 7000,
        'gear_ratio': 178,
        'thermal': 'first_order',
        'R_th': 0.15,
        'kappa': 10944,
    },
    name='j2',
)
drive.temperature_degC = 35
for minute in range(0, 61, 15):
    print(f'{minute:2} min: friction {drive.slide(1.0, 0.0, 1e-9):6.1f} Nm at {drive.temperature_degC:5.2f} degC')
    drive.slide(np.full(9000, 1.0), 0.0, dt_s=0.1)  # a quarter of an hour in one call

drive.add_fault('wear', 0.2)
print(f'worn by 20 %: {drive.slide(1.0, 0.0, 1e-9):.1f} Nm')

# Prints:
#  0 min: friction  642.2 Nm at 35.00 degC
# 15 min: friction  599.7 Nm at 41.66 degC
# 30 min: friction  548.7 Nm at 47.12 degC
# 45 min: friction  515.5 Nm at 51.66 degC
# 60 min: friction  492.4 Nm at 55.51 degC
# worn by 20 %: 519.5 Nm
