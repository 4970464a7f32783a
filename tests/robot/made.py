"""A robot in lock-step with its simulation, for tests."""

from typing import NamedTuple

from srl_jax.robot import imu, safety, servo
from srl_jax.robot.bus import Bus
from srl_jax.robot.hexapod import Hexapod
from srl_jax.robot.simulate.body import Body
from srl_jax.robot.simulate.line import faults
from srl_jax.robot.simulate.wire import Lockstep, Wire


class Made(NamedTuple):
    """All that a test may want to look at."""

    body: Body
    clock: Lockstep
    wire: Wire
    robot: Hexapod

    def poses(self, watch=None, stop=lambda: False):
        """Its poses, under a watch."""
        return safety.Poses(self.robot, self.clock, watch or safety.Watch(), stop)


def made(damage="healthy", given="", seed=0):
    """A robot that lies on the floor."""
    body = Body(damage, seed=seed)
    clock = Lockstep(body)
    wire, calibration = Wire(clock, faults(given), seed=seed), servo.Calibration()
    robot = Hexapod(Bus(wire, calibration.ranges()), imu.Imu(clock, clock), calibration, servo.Servos())
    return Made(body, clock, wire, robot)


def standing(**more):
    """A robot in its stance, with the torque on."""
    own = made(**more)
    own.robot.find()
    own.body.data.qpos[:] = own.body._model.key("stance").qpos
    own.robot.send(own.robot.calibration.steps(servo.STANDING))
    return own
