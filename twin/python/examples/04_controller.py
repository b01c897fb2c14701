"""A controller in Python: a torque for every joint in every time step."""

import numpy as np

import tribotwin

twin = tribotwin.Twin('irb6620_hold', commanded=True)
for joint in twin.joints[1:]:
    twin.set_brake(joint, True)
goal_rad = twin.position_rad + np.array([0.2, 0, 0, 0, 0, 0])
stiffness_nm_rad, damping_nm_s_rad = 4e4, 1e4

torque_nm = np.zeros(6)
for _ in range(4000):
    torque_nm[0] = stiffness_nm_rad * (goal_rad - twin.position_rad)[0] - damping_nm_s_rad * twin.velocity_rad_s[0]
    twin.step(torque_nm=torque_nm)

error_mrad = 1e3 * abs(goal_rad - twin.position_rad)[0]
print(f'after {twin.time_s:.0f} s friction holds joint1 {"short of" if error_mrad > 1 else "at"} its goal')
print(f'the motor gives {abs(twin.torque_nm[0]):.0f} Nm, friction takes {abs(twin.friction_nm[0]):.0f} Nm')

# Prints:
# after 4 s friction holds joint1 short of its goal
# the motor gives 517 Nm, friction takes 517 Nm
