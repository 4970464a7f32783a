"""The ring buffer against a list of whole transitions, of which each observation is stored once."""

from functools import partial

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.program import replay
from srl_jax.types import Transition

STATE, ACTION, E, T, N = 3, 2, 2, 5, 16  # sizes, robots, steps of an episode, vector steps of the buffer
SIZES = replay.Sizes(STATE, ACTION, T)
add = jax.jit(partial(replay.add, episode_steps=T))
take = jax.jit(partial(replay.take, sizes=SIZES))
draw = jax.jit(partial(replay.draw, sizes=SIZES), static_argnums=2)


def empty() -> replay.Replay:
    return replay.init(N * E, E, SIZES)


def path(steps: int, seed: int = 0) -> list[tuple[Transition, np.ndarray, np.ndarray]]:
    """So many vector steps of E robots whose episodes are cut after T steps or end at random: step, cut, and latest.

    Numbers are halves of small integers, which the buffer keeps exactly.
    """
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.integers(-64, 64, (E, *shape)).astype(np.float32) / 2  # noqa: E731
    now, age, taken = draw(STATE), np.zeros(E, int), []
    for _ in range(steps):
        reached, age = draw(STATE), age + 1
        over = rng.random(E) < 0.1
        cut = (age == T) & ~over
        lot = rng.integers(0, 2**24, E).astype(np.float32)
        new = Transition(*map(jnp.asarray, (now, draw(ACTION), draw(), 1.0 - over, reached, draw(), lot)))
        age[over | cut] = 0
        now = np.where((over | cut)[:, None], draw(STATE), reached)
        taken.append((new, cut, now))
    return taken


def filled(steps: int, seed: int = 0) -> tuple[replay.Replay, list[Transition]]:
    buffer, taken = empty(), path(steps, seed)
    for t, row in enumerate(taken):
        buffer = add(buffer, *row, jnp.int32(t))
    return buffer, [new for new, *_ in taken]


@pytest.mark.parametrize("steps", [1, 4, 7, N - 1, N, N + 1, N + 5, 3 * N + 2])
def test_every_transition_comes_back_whole(steps):
    buffer, taken = filled(steps, seed=steps)
    kept = min(steps, N)
    rows = np.arange(steps - kept, steps)
    index = (rows % N)[:, None] * E + np.arange(E)
    found = take(buffer, index.reshape(-1), jnp.int32(steps))
    wanted = jax.tree.map(lambda *x: np.stack(x).reshape(-1, *x[0].shape[1:]), *taken[-kept:])
    counts = wanted.discount > 0  # where the episode ended by itself, the next observation does not count
    assert counts.any() and all(np.isfinite(leaf).all() for leaf in found)
    for name in Transition._fields:
        mask = counts if name == "next_observation" else slice(None)
        np.testing.assert_array_equal(getattr(found, name)[mask], getattr(wanted, name)[mask], err_msg=name)


def test_the_path_has_cuts_and_ends():
    taken = path(3 * N)
    assert sum(cut.sum() for _, cut, _ in taken) > 3 and sum((new.discount == 0).sum() for new, *_ in taken) > 3


def test_draws_come_from_the_filled_part_only_and_reach_all_of_it():
    buffer, taken = filled(4)
    found = draw(buffer, jnp.int32(4), 400, jax.random.key(0))
    lots, counts = np.unique(np.asarray(found.lot), return_counts=True)
    assert set(lots) == {lot for new in taken for lot in np.asarray(new.lot)}
    assert np.all(abs(counts - 50) < 28)  # 4 standard deviations of a binomial


def test_after_the_wrap_only_the_newest_are_drawn():
    buffer, taken = filled(N + 7)
    found = draw(buffer, jnp.int32(N + 7), 2_000, jax.random.key(2))
    assert set(np.asarray(found.lot)) == {lot for new in taken[-N:] for lot in np.asarray(new.lot)}


def test_an_empty_buffer_draws_its_first_row():
    found = draw(empty(), jnp.int32(0), 8, jax.random.key(0))
    chex.assert_trees_all_equal(found, jax.tree.map(jnp.zeros_like, found))


def test_numbers_are_kept_to_three_digits_and_never_become_infinite():
    new = Transition(*(jnp.zeros((E, *shape)) for shape in ((STATE,), (ACTION,), (), (), (STATE,), (), ())))
    new = new._replace(observation=jnp.array([[0.1234567, 1e-3, -3.3], [1e9, -jnp.inf, 0.0]]), reward=jnp.full(E, 1e9))
    buffer = add(empty(), new, jnp.zeros(E, bool), jnp.zeros((E, STATE)), jnp.int32(0))
    found = take(buffer, jnp.arange(E), jnp.int32(1))
    np.testing.assert_allclose(found.observation[0], new.observation[0], rtol=5e-4)
    assert jnp.isfinite(found.observation).all() and (found.observation[1, :2] == jnp.array([65504.0, -65504.0])).all()
    assert (found.reward == 1e9).all(), "what is not seen by a network keeps all its digits"


@pytest.mark.parametrize("mapped", [False, True], ids=["axes", "vmap"])
def test_lanes_keep_their_own_rows(mapped):
    lanes = [path(T, seed)[-1] for seed in range(3)]
    rows = jax.tree.map(lambda *x: jnp.stack(x), *lanes)
    assert rows[1].any() and not rows[1].all(), "some are cut"
    buffers = jax.vmap(lambda _: empty())(jnp.arange(3))
    write = partial(replay.add, step=jnp.int32(2), episode_steps=T)
    wide = jax.jit(jax.vmap(write) if mapped else write)(buffers, *rows)
    for lane in range(3):
        alone = add(empty(), *lanes[lane], jnp.int32(2))
        chex.assert_trees_all_equal(jax.tree.map(lambda x, i=lane: x[i], wide), alone)


def test_an_unwanted_write_changes_nothing():
    buffer, _ = filled(N)
    new, _, latest = path(1, seed=9)[0]
    row = new, np.ones(E, bool), latest
    chex.assert_trees_all_equal(add(buffer, *row, jnp.int32(N), wanted=jnp.array(False)), buffer)
    two, rows = jax.tree.map(lambda x: jnp.stack([x, x]), (buffer, row))
    some = add(two, *rows, jnp.int32(N), wanted=jnp.array([False, True]))
    chex.assert_trees_all_equal(jax.tree.map(lambda x: x[0], some), buffer)
    assert all(np.any(x[1] != y) for x, y in zip(some, buffer, strict=True))


def test_its_size_is_that_of_its_arrays():
    assert replay.size(N * E, E, SIZES) == sum(leaf.nbytes for leaf in empty())
    per_transition = replay.size(50_000, 10, replay.Sizes(51, 18, 100)) / 50_000
    assert per_transition < 165, "two bytes a number of observation and action, and twenty for the rest"
