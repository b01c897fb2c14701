"""The smallest model with a drive, in numbers near mjcf/xl330_pendulum.xml: its friction depends on load; and
recordings of it. Found as harness.py is."""
import json, math, re

from harness import path

PENDULUM = """<mujoco model="pendulum">
  <extension><plugin plugin="tribotwin.drive"><instance name="servo">
    <config key="law" value="load"/> <config key="Fc0" value="0.03"/> <config key="Fcl" value="0.3"/>
    <config key="Fs0" value="0"/>
    <config key="Fsl" value="0.1"/> <config key="vs" value="100"/> <config key="alpha" value="1.4"/>
    <config key="Fv" value="3e-5"/>
    <config key="torque_max_nm" value="0.52"/> <config key="gear_ratio" value="288.35"/>
    <config key="load_max" value="1.2"/>
    <config key="speed_max_rad_s" value="6000"/>
  </instance></plugin></extension>
  <worldbody><body name="pendulum" pos="0 0 0.2">
    <inertial pos="0 0 -0.1" mass="0.49" diaginertia="1e-6 1e-6 1e-6"/>
    <joint name="hinge" axis="0 1 0" armature="0.0014" frictionloss="0.01" solreffriction=".001 1"
      solimpfriction=".9999 .9999 .001 .5 2"/>
    <geom type="sphere" size=".02" pos="0 0 -.1" mass="0" contype="0" conaffinity="0"/>
  </body></worldbody>
  <actuator><plugin name="servo" joint="hinge" plugin="tribotwin.drive" instance="servo" actdim="3"/></actuator>
</mujoco>
"""


def several(joints):
    """A model with such a pendulum for each of the joints, side by side; the first joint is "hinge"."""
    xml = PENDULUM
    for k, joint in enumerate(joints[1:], 1):
        for tag, inner in (("</plugin>", "instance"), ("</worldbody>", "body"), ("</actuator>", "plugin name")):
            part = re.search(rf"<{inner}.*?(?=<{inner}|{tag})", PENDULUM, re.S).group(0)
            part = part.replace("servo", f"servo{k}").replace("hinge", joint).replace("pendulum", f"pendulum{k}")
            xml = xml.replace(tag, part.replace('pos="0 0 0.2"', f'pos="0 {0.1 * k:g} 0.2"') + tag, 1)
    return xml


def write_recordings():
    """made_200.json, made_300.json, made_400.json: one motion with three gains, 10 % less wide and 50 ms late."""
    times = [0.01 * i for i in range(200)]
    for kp in (200, 300, 400):
        entries = [
            {
                "timestamp": t,
                "goal_position": 0.6 * math.sin(3 * t),
                "position": 0.54 * math.sin(3 * (t - 0.05)),
                "temp": 30,
            }
            for t in times
        ]
        with open(path("made_%d.json" % kp), "w") as f:
            json.dump({"kp": kp, "trajectory": "sine", "entries": entries}, f)
