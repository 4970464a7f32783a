"""What several tests of the environment share: damage of every kind on every joint, and robots in a given state."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from srl_jax.env import damage, hexapod
from srl_jax.env.settings import EnvConfig

WALKING = (
    "healthy",
    "tibia_rm",
    "tibia_rm:limp",
    "tibia_rm:locked",
    "femur_rf",
    "femur_lf:limp",
    "femur_lf:locked",
    "coxa_lm",
    "coxa_lr:limp",
    "coxa_lr:locked",
    "leg_rm",
    "leg_rm:limp",
    "leg_rf+leg_lr",
    "leg_rf+leg_rm",
    "tibia_rf:limp+leg_lm",
    "coxa_rm:locked+femur_rm:locked+tibia_rm:locked",
    "femur_lm:locked=-25",
    "leg_rr:weak=0.5",
    "tibia_lf:short=0.6",
)
CLOCK_HZ = 1.5


def make(task: str, **settings) -> hexapod.Hexapod:
    return hexapod.make(task, EnvConfig(**settings), CLOCK_HZ)


def state_at(robot, x=0.0, y=0.0, *, quaternion=(1.0, 0, 0, 0), goal=(0.0, 0.0), steps=0) -> hexapod.EnvState:
    state, _ = hexapod.reset(robot, damage.build("healthy"), jax.random.key(0))
    qpos = jnp.array([x, y, 0.11, *quaternion, *robot.stance[7:]])
    return state._replace(qpos=qpos, goal=jnp.array(goal), steps=jnp.int32(steps))


def products(function: Callable, *arguments) -> list[str]:
    """The matrix products of a traced, not compiled, program: its lines of StableHLO."""
    lines = jax.jit(function).lower(*arguments).as_text().splitlines()
    return [line for line in lines if "dot_general" in line]
