"""The drive in an engine of your own: a block on a joint that sticks, slides and sticks again.

The engine decides whether the joint sticks: it tries the torque that would stop it within the step."""

import tribotwin

drive = tribotwin.Drive(
    {'law': 'stribeck', **tribotwin.Law('stribeck').parameters, 'torque_max_nm': 100, 'gear_ratio': 50}
)
inertia_kg_m2, dt_s = 0.5, 1e-3
position_rad = speed_rad_s = 0.0
for k in range(3000):
    motor_nm = 4.0 if k < 1000 else 12.0 if k < 2000 else 4.0
    limit_nm = drive.begin_step(k * dt_s, speed_rad_s, position_rad)
    stopping_nm = motor_nm + inertia_kg_m2 * speed_rad_s / dt_s
    friction_nm = max(-limit_nm, min(limit_nm, stopping_nm))
    speed_rad_s += (motor_nm - friction_nm) / inertia_kg_m2 * dt_s
    position_rad += speed_rad_s * dt_s
    drive.end_step(
        dt_s, friction_nm=friction_nm, torque_nm=motor_nm, speed_rad_s=speed_rad_s, position_rad=position_rad
    )
    if k % 500 == 499:
        print(
            f'{(k + 1) * dt_s:.1f} s: motor {motor_nm:4.1f} Nm, friction {friction_nm:5.2f} Nm, {speed_rad_s:.2f} rad/s'
        )
print(f'heat {drive.heat_J:.1f} J')

# Prints:
# 0.5 s: motor  4.0 Nm, friction  4.00 Nm, 0.00 rad/s
# 1.0 s: motor  4.0 Nm, friction  4.00 Nm, 0.00 rad/s
# 1.5 s: motor 12.0 Nm, friction 10.58 Nm, 3.90 rad/s
# 2.0 s: motor 12.0 Nm, friction 11.77 Nm, 4.55 rad/s
# 2.5 s: motor  4.0 Nm, friction  5.24 Nm, 0.99 rad/s
# 3.0 s: motor  4.0 Nm, friction  4.29 Nm, 0.42 rad/s
# heat 46.4 J
