"""Which stepper moves the robots: MJX, or on a CPU the `star` stepper, which does the same ten times as fast."""

import time
from functools import cache

import jax
import jax.numpy as jnp

from srl_jax.env import damage as damages
from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.damage import Damage
from srl_jax.env.model import load_model, mjx, put_model
from srl_jax.env.model import step as mjx_step
from srl_jax.env.star import batching
from srl_jax.env.star.body import Ground
from srl_jax.env.star.constants import Star, read
from srl_jax.env.star.refusals import NotAStarError
from srl_jax.env.star.stepper import State

TRIAL = 4_096  # robots by which the steppers are compared
CHOICES = ("auto", "star", "mjx")


def shipped_star(anatomy: Anatomy = PHANTOMX) -> Star:
    """A robot as the star stepper knows it; one object, so that programs compiled for it are found again.

    Raises:
        NotAStarError: its description is of what the stepper cannot represent; the message names the part.
    """
    return _star(anatomy)


@cache
def _star(anatomy: Anatomy) -> Star:
    return read(put_model(load_model(anatomy)))


def choose(physics: str, model: mjx.Model | None = None, anatomy: Anatomy = PHANTOMX) -> Star | None:
    """The stepper that a setting stands for: the star stepper's constants, or None for MJX.

    ``auto`` is MJX where the model is no star; else ``star`` on a CPU, and on an accelerator the faster of both, which
    are compiled and timed.

    Args:
        physics: auto, star or mjx.
        model: of another robot than `anatomy`'s. Programs are compiled for the object that is returned: keep it.
        anatomy: the robot, where there is no `model`.

    Raises:
        ValueError: another word.
        NotAStarError: ``star``, and the model is none; the message names the part.
    """
    if physics not in CHOICES:
        raise ValueError(f"physics is {physics!r}: choose one of {', '.join(CHOICES)}.")
    if physics == "mjx":
        return None
    try:
        star = shipped_star(anatomy) if model is None else read(model)
    except NotAStarError:
        if physics == "star":
            raise
        return None
    if physics == "star" or jax.default_backend() == "cpu":
        return star
    return _faster_for_shipped(anatomy) if model is None else faster(star, model)


@cache
def _faster_for_shipped(anatomy: Anatomy) -> Star | None:
    return faster(shipped_star(anatomy), put_model(load_model(anatomy)))


def faster(star: Star, model: mjx.Model) -> Star | None:
    """The stepper that takes less time for a model on this device: its star, or None for MJX."""
    return star if time_step(star, model) < time_step(None, model) else None


def time_step(star: Star | None, model: mjx.Model, robots: int = TRIAL, repeats: int = 5) -> float:
    """Seconds that ten steps of so many robots take, without compiling: the least of some repeats."""
    own = Damage(*(jnp.asarray(getattr(model, field)) for field in Damage._fields))
    at_rest = State(*(jnp.tile(x, (robots, 1)) for x in (model.qpos0, jnp.zeros(model.nv), jnp.zeros(model.nv))))
    data, targets = mjx.make_data(model), jnp.zeros(model.nu)
    run = jax.jit(jax.vmap(lambda state: simulate(star, model, data, own, state, targets, 10)))
    run(at_rest)[0].block_until_ready()

    def once() -> float:
        began = time.perf_counter()
        run(at_rest)[0].block_until_ready()
        return time.perf_counter() - began

    return min(once() for _ in range(repeats))


def simulate(
    star: Star | None,
    model: mjx.Model,
    data: mjx.Data,
    damage: Damage,
    state: State,
    control: jax.Array,
    count: int,
    ground: Ground | None = None,
) -> State:
    """`count` physics steps of one robot under constant position targets f32[nu] (rad); made for `vmap`.

    Args:
        star: from `choose`; None: MJX.
        model: of the healthy robot (MJX).
        data: a template (MJX).
        damage: unbatched values, in the shapes of the model's own leaves.
        state: before the steps.
        control: the targets.
        count: steps.
        ground: that it stands on, where it is not the model's.
    """
    if star is not None:
        return batching.simulate(star, damage, control, state, count, ground)
    return simulate_mjx(_on(model, ground), data, damage, state, control, count)


def together(star: Star | None, wanted: int) -> int:
    """Robots to step at once on a CPU: `wanted` by MJX, all (0) by the star stepper, which makes its own blocks."""
    return wanted if star is None else 0


def _on(model: mjx.Model, ground: Ground | None) -> mjx.Model:
    """The model on another floor: of two geoms that touch the larger friction holds, so it is the share of both."""
    if ground is None:
        return model
    gravity = jnp.linalg.norm(model.opt.gravity) * ground.down
    friction = model.geom_friction.at[:, 0].multiply(ground.friction)
    return model.replace(geom_friction=friction, opt=model.opt.replace(gravity=gravity))


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
