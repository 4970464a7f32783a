"""Robots that are stars: one like those that are sold, one as irregular as can be, and the smallest."""

import mujoco

# Parts of the hopper, to be edited.
FLAG = '<flag eulerdamp="disable"/>'
FOOT = '<geom name="foot" size="0.02" pos="0.02 0 -0.12" mass="0.2" contype="1"/>'
SERVO = '<position name="servo" joint="hinge" kp="5"/>'


def option(timestep: float, iterations: int = 1) -> str:
    newton = f'solver="Newton" iterations="{iterations}" ls_iterations="10"'
    return f'<option timestep="{timestep}" integrator="Euler" cone="pyramidal" {newton}>{FLAG}</option>'


HOPPER = f"""
<mujoco>
  {option(0.01)}
  <default><geom contype="0" conaffinity="0" type="sphere"/><joint damping="0.1" armature="0.01"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" conaffinity="1"/>
    <body name="ball" pos="0 0 0.2">
      <joint name="root" type="free" damping="0" armature="0"/>
      <geom name="skin" size="0.05" mass="1"/>
      <body name="leg" pos="0.05 0 0">
        <joint name="hinge" axis="0 1 0" range="-60 60"/>
        {FOOT}
      </body>
    </body>
  </worldbody>
  <actuator>{SERVO}</actuator>
  <keyframe><key name="stance" qpos="0 0 0.14 1 0 0 0 0"/></keyframe>
</mujoco>"""


def quadruped(iterations: int = 1, timestep: float = 0.005) -> mujoco.MjModel:
    """A dog of the size of a Unitree Go1, of a box, capsules and sphere feet."""
    legs = "".join(
        f"""
        <body name="hip_{leg}" pos="{x} {0.047 * side} 0">
          <inertial pos="0 {0.01 * side} 0" mass="0.6" diaginertia="0.0007 0.0006 0.0008"/>
          <joint name="abduction_{leg}" axis="1 0 0" range="-0.86 0.86"/>
          <body name="thigh_{leg}" pos="0 {0.08 * side} 0">
            <inertial pos="-0.004 {-0.02 * side} -0.03" quat="0.99 0.02 0.1 0" mass="0.9"
             diaginertia="0.006 0.006 0.001"/>
            <joint name="hip_{leg}" axis="0 1 0" range="-0.7 4.5"/>
            <body name="calf_{leg}" pos="0 0 -0.213">
              <geom type="capsule" fromto="0 0 0 0 0 -0.19" size="0.01" mass="0.13"/>
              <joint name="knee_{leg}" axis="0 1 0" range="-2.8 -0.9"/>
              <geom name="foot_{leg}" type="sphere" pos="0 0 -0.213" size="0.02" mass="0.06" contype="1"
               friction="0.8" priority="1"/>
            </body>
          </body>
        </body>"""
        for leg, x, side in (("fr", 0.188, -1), ("fl", 0.188, 1), ("rr", -0.188, -1), ("rl", -0.188, 1))
    )
    joints = [f"{joint}_{leg}" for leg in ("fr", "fl", "rr", "rl") for joint in ("abduction", "hip", "knee")]
    servos = "".join(f'<position joint="{joint}" kp="60" kv="1" forcerange="-24 24"/>' for joint in joints)
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>{option(timestep, iterations)}
      <default><geom contype="0" conaffinity="0"/><joint damping="1.5" armature="0.01"/></default>
      <worldbody>
        <geom name="floor" type="plane" size="0 0 1" conaffinity="1" friction="0.6"/>
        <body name="trunk" pos="0 0 0.3">
          <freejoint/>
          <geom type="box" size="0.16 0.06 0.05" pos="0.01 0 0.005" mass="5"/>{legs}
        </body>
      </worldbody>
      <actuator>{servos}</actuator>
      <keyframe><key name="stance" qpos="0 0 0.28 1 0 0 0 {"0 0.9 -1.8 " * 4}"/></keyframe>
    </mujoco>""")


def crab(iterations: int = 1, timestep: float = 0.01) -> mujoco.MjModel:
    """A robot of three different limbs: one, two and three links; all that a hexapod's legs have in common differs.

    Spheres on the base, on an inner link, two on one foot and none on another; joints without limits, without a servo,
    with a reference angle, with springs; servos in another order than joints, with numbers of their own.
    """
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>{option(timestep, iterations)}
      <default>
        <geom contype="0" conaffinity="0" type="sphere" friction="0.7 0 0"/>
        <joint damping="0.1" armature="0.004" solreflimit="0.03 0.9" solimplimit="0.8 0.9 0.01 0.4 2"/>
        <default class="touching">
          <geom contype="1" mass="0" solref="0.04 1.1" solimp="0.85 0.97 0.004 0.3 2"/>
        </default>
      </default>
      <worldbody>
        <geom name="floor" type="plane" size="0 0 1" pos="0.3 -2 0" quat="0.9 0 0 0.3" conaffinity="1" solmix="1e-20"
         friction="0.3"/>
        <geom name="lamp" pos="0 0 2" size="0.1"/>
        <body name="shell" pos="0 0 0.25" quat="0.8 0.1 0.2 0.3">
          <freejoint/>
          <inertial pos="0.02 -0.01 0.03" quat="0.9 0.3 0.1 0.1" mass="1.4" diaginertia="0.01 0.014 0.02"/>
          <geom class="touching" name="keel" pos="0.01 0 -0.06" size="0.02"/>
          <body name="tail" pos="-0.15 0 0.01" quat="0.7 0 0.2 0.6">
            <joint name="tail" axis="0.6 0 0.8"/>
            <geom type="capsule" fromto="0 0 0 -0.1 0.01 0" size="0.01" mass="0.2"/>
            <geom class="touching" name="tip" pos="-0.11 0.01 0" size="0.013"/>
          </body>
          <body name="arm" pos="0.1 0.09 0" euler="0 0 50">
            <joint name="shoulder" axis="0 0 1" range="-70 60" ref="20" stiffness="0.8" springref="35"/>
            <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.012" mass="0.15"/>
            <body name="forearm" pos="0.1 0 0" euler="0 10 0">
              <joint name="elbow" axis="0 1 0" range="-90 40"/>
              <geom type="capsule" fromto="0 0 0 0.12 0 0" size="0.01" mass="0.1"/>
              <geom class="touching" name="thumb" pos="0.12 0.02 0" size="0.01"/>
              <geom class="touching" name="finger" pos="0.12 -0.02 0" size="0.012"/>
            </body>
          </body>
          <body name="coxa" pos="0.1 -0.09 0" euler="0 0 -50">
            <joint name="coxa" axis="0 0 1" range="-60 60" damping="0.2"/>
            <geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.012" mass="0.08"/>
            <body name="femur" pos="0.05 0 0">
              <joint name="femur" axis="0 -1 0" stiffness="0.3"/>
              <geom type="capsule" fromto="0 0 0 0.07 0 0" size="0.012" mass="0.06"/>
              <geom class="touching" name="knee" pos="0.07 0 0" size="0.014"/>
              <body name="tibia" pos="0.07 0 0" euler="0 60 0">
                <joint name="tibia" axis="0 -1 0" range="-80 80" armature="0.01"/>
                <geom type="capsule" fromto="0 0 0 0.12 0 0" size="0.009" mass="0.09"/>
              </body>
            </body>
          </body>
        </body>
      </worldbody>
      <actuator>
        <general joint="tibia" gainprm="9" biastype="affine" biasprm="0.1 -8 -0.2" forcerange="-1 1.4"/>
        <position joint="elbow" kp="6" ctrlrange="-1 0.6"/>
        <position joint="coxa" kp="12" forcerange="-1.5 1.5"/>
        <motor joint="tail" ctrlrange="-0.2 0.3"/>
        <position joint="shoulder" kp="8" kv="0.1"/>
      </actuator>
      <keyframe><key name="stance" qpos="0 0 0.15 1 0 0 0 0 0.4 0.3 -0.2 0.2 0.1"/></keyframe>
    </mujoco>""")


def hopper(*edits: tuple[str, str]) -> mujoco.MjModel:
    """A ball on one hinge with a foot, the smallest star; its description may be edited, old text by new."""
    text = HOPPER
    for old, new in edits:
        assert old in text, f"the hopper has no {old}"
        text = text.replace(old, new, 1)
    return mujoco.MjModel.from_xml_string(text)
