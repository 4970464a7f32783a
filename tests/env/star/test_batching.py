"""How one robot's step becomes that of many: any vmap gives what each robot alone gives."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env.model import put_model
from srl_jax.env.star import batching
from srl_jax.env.star.batching import BLOCK, VECTOR
from srl_jax.env.star.constants import read
from srl_jax.env.star.stepper import State
from tests.env.star.reference import leaves, states
from tests.env.star.robots import hopper

ROBOTS = BLOCK + VECTOR + 3  # two blocks, the last of which is filled up
STEPS = 3


@pytest.fixture(scope="module")
def star():
    return read(put_model(hopper()))


@pytest.fixture(scope="module")
def robots():
    """Leaves, targets and states of robots that all differ; leading axis N."""
    model = hopper()
    start, targets = states(model, ROBOTS)
    values = leaves([model] * ROBOTS, spread=0.2)
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (values, targets[0], start))


@pytest.fixture(scope="module")
def together(star):
    """All robots at once."""
    return jax.jit(jax.vmap(partial(step, star)))


@pytest.fixture
def toy(monkeypatch):
    """Robots that do next to nothing, so that every way to batch them is compiled at once; who is who still shows."""

    def steps(star, body, control, state, count):
        assert control.ndim == 2 and body.mass.shape[:2] == star.ids.body.shape, "robots lie last"
        laid.append(control.shape[-1])
        moved = state.qpos + count * control.sum(0) * body.mass.sum((0, 1))
        return State(moved, state.qvel * body.base_mass, state.warmstart + body.radius[0].sum(0))

    laid: list[int] = []
    monkeypatch.setattr(batching, "steps", steps)
    return laid


def step(star, values, control, state, count=STEPS) -> State:
    return batching.simulate(star, values, control, state, count)


def moved(values, control, state, count=STEPS) -> State:
    """What the toy makes of robots [..., N]."""
    qpos = state.qpos + count * (control.sum(-1) * values.body_mass[..., 2])[..., None]
    return State(qpos, state.qvel * values.body_mass[..., 1:2], state.warmstart + values.geom_size[..., 2, :1])


def some(robots, chosen):
    return jax.tree.map(lambda x: x[chosen], robots)


def same(found: State, expected: State, tolerance: float = 1e-6) -> None:
    """Equal but for how sums are rounded, which fusion decides."""
    for x, y in zip(found, expected, strict=True):
        assert x.shape == y.shape
        np.testing.assert_allclose(x, y, rtol=0, atol=tolerance * max(1.0, float(np.abs(y).max())))


# Robots


def test_every_robot_goes_where_it_would_go_alone(star, robots, together):
    alone = jax.jit(partial(jax.lax.map, lambda row: step(star, *row)))(robots)
    same(together(*robots), alone, 1e-5)
    assert np.isfinite(alone.qpos).all() and np.ptp(alone.qpos, axis=0).min() > 1e-3


def test_no_robot_sees_its_neighbours(robots, together):
    """Neither those of its block nor those of another, not even where they are not finite."""
    expected = together(*robots)
    values, control, state = jax.tree.map(lambda x: x[::-1], robots)
    strange = values, control, state._replace(qvel=state.qvel.at[::2].set(jnp.nan), warmstart=1e9 * state.warmstart)
    for place in (0, BLOCK - 1, ROBOTS - 1):
        mixed = jax.tree.map(lambda x, y, place=place: y.at[place].set(x[place]), robots, strange)
        found = together(*mixed)
        assert np.isnan(found.qvel).any()
        jax.tree.map(np.testing.assert_array_equal, some(found, place), some(expected, place))


# Toys


@pytest.mark.parametrize(
    ("size", "block"), [(1, 1), (2, 16), (VECTOR, 16), (VECTOR + 1, 32), (BLOCK, 256), (BLOCK + 1, 144), (ROBOTS, 144)]
)
def test_robots_are_laid_in_blocks_of_whole_vectors(star, robots, toy, size, block):
    found = jax.jit(jax.vmap(partial(step, star)))(*some(robots, slice(size)))
    same(found, moved(*some(robots, slice(size))))
    assert toy[-1] == block  # the first time one robot is traced, for the shapes


def test_steps_are_counted(star, robots, toy):
    same(
        jax.jit(jax.vmap(partial(step, star, count=5)))(*some(robots, slice(9))),
        moved(*some(robots, slice(9)), count=5),
    )


def test_a_robot_without_vmap(star, robots, toy):
    same(jax.jit(partial(step, star))(*some(robots, 7)), moved(*some(robots, 7)))


def test_what_is_not_batched_is_shared(star, robots, toy):
    values, control, state = robots
    shared = jax.jit(jax.vmap(partial(step, star), in_axes=(None, None, 0)))
    same(some(shared(some(values, 3), control[3], state), 3), moved(*some(robots, 3)))
    each = jax.jit(jax.vmap(partial(step, star), in_axes=(0, None, None)))
    same(some(each(values, control[5], some(state, 5)), 5), moved(*some(robots, 5)))


def test_vmaps_may_be_nested_in_any_order(star, robots, toy):
    """Damage by row, targets by column, states by both: as lanes and their environments."""
    values, control, state = robots
    rows, columns = 3, 7
    grid = jax.tree.map(lambda x: x[: rows * columns].reshape(rows, columns, *x.shape[1:]), state)
    by_row, by_column = some(values, slice(rows)), control[:columns]
    within = jax.vmap(partial(step, star), in_axes=(None, 0, 0))
    found = jax.jit(jax.vmap(within, in_axes=(0, None, 0)))(by_row, by_column, grid)
    expected = moved(jax.tree.map(lambda x: x[:, None], by_row), by_column[None], grid)
    same(found, expected)
    across = jax.vmap(partial(step, star), in_axes=(0, None, 0), out_axes=-1)
    turned = jax.jit(jax.vmap(across, in_axes=(None, 0, 1), out_axes=-1))(by_row, by_column, grid)
    same(jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), turned), expected)


def test_a_model_that_is_a_constant_keeps_its_stages_apart(star, robots):
    """XLA folds what follows from constants, and with the seams gone a program takes minutes to compile."""
    model, (_, control, state) = put_model(hopper()), some(robots, slice(VECTOR))
    program = jax.jit(jax.vmap(lambda control, state: step(star, model, control, state)))
    assert program.lower(control, state).compile().as_text().count(" while(") > 40
