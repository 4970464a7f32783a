"""Which stepper moves the robots: MJX, or on a CPU the `star` stepper, which does the same ten times as fast."""

import time
from functools import cache

import jax
import jax.numpy as jnp

from srl_jax.env import damage as damages
from srl_jax.env.damage import Damage
from srl_jax.env.model import load_model, mjx, put_model, stance
from srl_jax.env.model import step as mjx_step
from srl_jax.env.star import batching
from srl_jax.env.star.constants import Star, read
from srl_jax.env.star.stepper import State

TRIAL = 4_096  # robots by which the steppers are compared


@cache
def shipped_star() -> Star:
    """The shipped robot as the star stepper knows it; one object, so that programs compiled for it are found again."""
    return read(put_model(load_model()))


def choose(physics: str) -> Star | None:
    """The stepper that a setting stands for: the star stepper's constants, or None for MJX.

    ``auto`` is ``star`` on a CPU; on an accelerator both are compiled and the faster one is taken.
    """
    if physics == "mjx":
        return None
    if physics == "star" or jax.default_backend() == "cpu":
        return shipped_star()
    return _faster()


@cache
def _faster() -> Star | None:
    seconds = {stepper: time_step(stepper) for stepper in (shipped_star(), None)}
    return min(seconds, key=lambda stepper: seconds[stepper])


def time_step(star: Star | None, robots: int = TRIAL, repeats: int = 5) -> float:
    """Seconds that ten steps of so many standing robots take, without compiling: the least of some repeats."""
    c_model = load_model()
    model, data, pose = put_model(c_model), mjx.make_data(c_model), stance(c_model)
    healthy = jax.tree.map(jnp.asarray, damages.build("healthy"))
    start = State(jnp.tile(pose, (robots, 1)), jnp.zeros((robots, c_model.nv)), jnp.zeros((robots, c_model.nv)))
    targets = jnp.asarray(pose[7:], jnp.float32)
    run = jax.jit(jax.vmap(lambda state: simulate(star, model, data, healthy, state, targets, 10)))
    run(start)[0].block_until_ready()

    def once() -> float:
        began = time.perf_counter()
        run(start)[0].block_until_ready()
        return time.perf_counter() - began

    return min(once() for _ in range(repeats))


def simulate(
    star: Star | None, model: mjx.Model, data: mjx.Data, damage: Damage, state: State, control: jax.Array, count: int
) -> State:
    """`count` physics steps of one robot under constant position targets f32[nu] (rad); made for `vmap`.

    Args:
        star: from `choose`; None: MJX.
        model: of the healthy robot (MJX).
        data: a template (MJX).
        damage: unbatched values.
        state: before the steps.
        control: the targets.
        count: steps.
    """
    if star is not None:
        return batching.simulate(star, damage, control, state, count)
    return simulate_mjx(model, data, damage, state, control, count)


def simulate_mjx(
    model: mjx.Model, data: mjx.Data, damage: Damage, state: State, control: jax.Array, count: int
) -> State:
    """`count` steps of `mjx.step`; data is a template."""
    model = damages.apply(model, damage)

    def substep(carry: State, _):
        # Only what changes is carried: copying all of mjx.Data from step to step costs more than some steps.
        now = data.replace(qpos=carry.qpos, qvel=carry.qvel, qacc_warmstart=carry.warmstart, ctrl=control)
        now = mjx_step(model, now)
        return State(now.qpos, now.qvel, now.qacc_warmstart), None

    return jax.lax.scan(substep, state, None, length=count)[0]
