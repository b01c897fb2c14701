"""Friction of a joint in MuJoCo's own Python package (3.2 or newer), without the plugin.

Between mj_step1 and mj_step2 the limit of the joint's friction constraint is written; the engine decides whether the
joint sticks. Drive.begin_step() and end_step() in place of friction_limit() add heat, bristles and faults."""

import sys

import tribotwin

try:
    import mujoco
    from mujoco import MjModel  # not a folder that happens to have the name
except ImportError:
    print('SKIPPED: the package mujoco (3.2 or newer) is not installed; `pip install mujoco` brings it')
    sys.exit()

model = MjModel.from_xml_string(
    '''
<mujoco>
  <option timestep="0.001" tolerance="1e-10"/>
  <worldbody><body>
    <joint name="hinge" axis="0 0 1" frictionloss="1" solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/>
    <geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="8"/>
  </body></worldbody>
  <actuator><motor joint="hinge"/></actuator>
</mujoco>'''
)
data = mujoco.MjData(model)
gear = {'torque_max_nm': 100, 'gear_ratio': 50}
drive = tribotwin.Drive({'law': 'extended', **tribotwin.Law('extended').parameters, **gear})
dof, load_nm, temperature_degC = 0, 0.0, 40.0
for k in range(3000):
    data.ctrl[0] = 2.0 if k < 1000 else 12.0
    mujoco.mj_step1(model, data)
    limit_nm = tribotwin.friction_limit(drive, data.qvel[dof], load_nm, temperature_degC)
    tribotwin.write_friction_limit(data, dof, limit_nm)
    mujoco.mj_step2(model, data)
    friction_nm = -data.qfrc_constraint[dof]
    load_nm = data.ctrl[0] - friction_nm
    if k % 1000 == 999:
        print(f'{data.time:.0f} s: motor {data.ctrl[0]:4.1f} Nm, limit {limit_nm:.2f} Nm, {data.qvel[dof]:.2f} rad/s')

# Prints without the package mujoco:
# SKIPPED: the package mujoco (3.2 or newer) is not installed; `pip install mujoco` brings it
