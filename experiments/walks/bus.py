"""Walks over the simulated servo bus in lock-step, where nothing but the bus takes time."""

from typing import NamedTuple

import numpy as np

from srl_jax.env.damage_names import HEALTHY
from srl_jax.portable import Policy
from srl_jax.robot import bus, imu, safety, servo
from srl_jax.robot.hexapod import Hexapod
from srl_jax.robot.loop import Loop, Outcome
from srl_jax.robot.policy import Walker
from srl_jax.robot.simulate.body import Body
from srl_jax.robot.simulate.line import faults
from srl_jax.robot.simulate.wire import Lockstep, Wire


class Trip(NamedTuple):
    """What came of a walk over the bus."""

    way: np.ndarray  # f64[2] m ahead and to the left
    outcome: Outcome
    struck: float  # s of walking after which its damage struck
    fell: bool


def over_bus(
    policy: Policy, seconds: float, damage: str, *, given: str = "", strike: float = 0.0, seed: int = 0
) -> Trip:
    """A walk in lock-step, until it falls.

    Args:
        policy: that walks.
        seconds: of the walk.
        damage: of the robot.
        given: what goes wrong on the line, see `line.faults`.
        strike: s after which the damage strikes; 0: the robot has it from the start.
        seed: of noise and bad packets.
    """
    body = Body(HEALTHY if strike else damage, seed=seed, noise=1.0)
    body.prepare(damage)
    clock, calibration, watch = Lockstep(body), servo.Calibration(), safety.Watch()
    own = bus.Bus(Wire(clock, faults(given), seed=seed), calibration.ranges())
    robot = Hexapod(own, imu.Imu(clock, clock), calibration, servo.Servos())
    safety.Poses(robot, clock, watch, lambda: False).rise()
    place = body.data.qpos[:2].copy()
    struck: list[float] = []

    def react(now: float, _: object) -> None:
        if strike and now >= strike and not struck:
            struck.append(now)
            body.strike(damage)

    walk, fell = Loop(robot, Walker(policy), clock, watch, lambda: False, react=react), False
    try:
        walk.run(seconds)
    except safety.TippedError:
        fell = True
    return Trip(body.data.qpos[:2] - place, walk.outcome, struck[0] if struck else 0.0, fell)
