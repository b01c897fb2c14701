"""The friction of one law over speed, load and temperature: numbers and arrays."""

import numpy as np

import tribotwin

law = tribotwin.Law('extended')  # with the numbers of its source
print(law.equation)
print(f'takes the speed of the {law.side}, gives torque over torque_max_nm: {law(50.0, 0.3, 40.0):.4f}')

speed_rad_s = np.array([10.0, 50.0, 150.0, 250.0])
temperature_degC = np.array([40.0, 80.0])
friction_norm = law(speed_rad_s[:, None], 0.3, temperature_degC)  # 4 x 2
for speed, row in zip(speed_rad_s, friction_norm):
    print(f'{speed:5.0f} rad/s: {row[0]:.4f} at 40 degC, {row[1]:.4f} at 80 degC')

print('outside its range at 20 degC:', law.outside(10.0, 0.3, 20.0))
try:
    tribotwin.Law('polynomial', {'c1': 1.0})
except tribotwin.Error as error:
    print(error)

# Prints:
# (Fc0 + Fcl l) + Fsl l e^-|v/vsl|^alpha + (Fs0 + FsT T) e^-|v/(vs0 + vsT T)|^alpha + (Fv0 + FvT e^(-T/TV0)) v
# takes the speed of the motor, gives torque over torque_max_nm: 0.0544
#    10 rad/s: 0.0749 at 40 degC, 0.1451 at 80 degC
#    50 rad/s: 0.0544 at 40 degC, 0.0875 at 80 degC
#   150 rad/s: 0.0863 at 40 degC, 0.0636 at 80 degC
#   250 rad/s: 0.1185 at 40 degC, 0.0776 at 80 degC
# outside its range at 20 degC: True
# law 'polynomial' has no parameter 'c1'; did you mean 'f1'? Parameters: f1, f2, f3, f4, a, T0
