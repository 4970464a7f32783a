"""The ring buffer against a deque, and its rows against the transitions they hold."""

from collections import deque

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.program import replay
from srl_jax.types import Transition

STATE, ACTION, N = 3, 2, 200
add = jax.jit(replay.add)
sample = jax.jit(replay.sample, static_argnums=(2, 4))


def transitions(*shape: int, seed: int = 0) -> Transition:
    rng = np.random.default_rng(seed)
    draw = lambda *size: rng.normal(size=(*shape, *size)).astype(np.float32)  # noqa: E731
    return Transition(draw(STATE), draw(ACTION), draw(), draw(), draw(STATE), draw(), draw())


def numbered(first: int, count: int) -> Transition:
    """Transitions whose every entry is the number of the write."""
    number = jnp.arange(first, first + count, dtype=jnp.float32)
    column = number[:, None]
    return Transition(
        jnp.tile(column, STATE), jnp.tile(column, ACTION), number, number, jnp.tile(column, STATE), number, lot=number
    )


@pytest.mark.parametrize("shape", [(), (4,), (2, 5)])
def test_unpack_inverts_pack(shape):
    t = transitions(*shape)
    rows = replay.pack(t)
    assert rows.shape == (*shape, replay.width(STATE, ACTION))
    chex.assert_trees_all_equal(replay.unpack(rows, STATE), t)


def test_a_lot_comes_out_of_a_buffer_as_it_went_in():
    lots = np.array([0, 1, 2**24 - 1, 12_345_677], np.float32)
    buffer = add(replay.init(4, STATE, ACTION), transitions(4)._replace(lot=lots), jnp.int32(0))
    stored = replay.unpack(buffer.rows, STATE).lot
    np.testing.assert_array_equal(stored.astype(jnp.uint32), [0, 1, 2**24 - 1, 12_345_677])


def test_empty_buffer_has_the_packed_width():
    assert replay.init(7, STATE, ACTION).rows.shape == replay.pack(transitions(7)).shape


@pytest.mark.parametrize(("capacity", "block"), [(6, 1), (6, 2), (6, 3), (8, 8)])
def test_ring_keeps_what_a_deque_keeps(capacity, block):
    buffer, reference = replay.init(capacity, STATE, ACTION), deque(maxlen=capacity)
    for at in range(0, 3 * capacity, block):
        new = transitions(block, seed=at)
        buffer = add(buffer, new, jnp.int32(at))
        reference.extend(np.asarray(replay.pack(new)))
        # The oldest row lies where the next write will go.
        filled = min(at + block, capacity)
        oldest = (at + block) % capacity if filled == capacity else 0
        in_order = np.roll(buffer.rows, -oldest, axis=0)[:filled]
        np.testing.assert_array_equal(in_order, np.stack(reference))
        assert not np.any(buffer.rows[filled:])


def test_samples_come_from_filled_rows_only_and_reach_all_of_them():
    buffer = add(replay.init(8, STATE, ACTION), numbered(1, 4), jnp.int32(0))
    batch = sample(buffer, jnp.int32(4), N, jax.random.key(0), STATE)
    assert set(np.asarray(batch.reward)) == {1.0, 2.0, 3.0, 4.0}
    counts = np.bincount(np.asarray(batch.reward, int))[1:]
    assert np.all(abs(counts - 50) < 25)  # 4 standard deviations of a binomial


def test_sampled_rows_are_whole_transitions():
    buffer = add(replay.init(8, STATE, ACTION), numbered(0, 8), jnp.int32(0))
    batch = sample(buffer, jnp.int32(8), N, jax.random.key(1), STATE)
    for field in batch:
        np.testing.assert_array_equal(field.reshape(N, -1)[:, 0], batch.reward)


def test_after_the_wrap_only_the_newest_are_sampled():
    buffer = replay.init(8, STATE, ACTION)
    for at in range(0, 20, 4):
        buffer = add(buffer, numbered(at, 4), jnp.int32(at))
    batch = sample(buffer, jnp.int32(8), N, jax.random.key(2), STATE)
    assert set(np.asarray(batch.reward)) == set(np.arange(12.0, 20.0))


def test_an_empty_buffer_samples_its_zero_row():
    batch = sample(replay.init(8, STATE, ACTION), jnp.int32(0), N, jax.random.key(0), STATE)
    chex.assert_trees_all_equal(batch, jax.tree.map(jnp.zeros_like, batch))


@pytest.mark.parametrize("write", [replay.add, jax.vmap(replay.add, (0, 0, None))], ids=["axes", "vmap"])
def test_lanes_keep_their_own_rows(write):
    buffers = jax.vmap(lambda _: replay.init(4, STATE, ACTION))(jnp.arange(3))
    new = transitions(3, 2)
    wide = jax.jit(write)(buffers, new, jnp.int32(2))
    for lane in range(3):
        alone = add(replay.init(4, STATE, ACTION), jax.tree.map(lambda x, i=lane: x[i], new), jnp.int32(2))
        np.testing.assert_array_equal(wide.rows[lane], alone.rows)


def test_an_unwanted_write_changes_nothing():
    buffer = add(replay.init(4, STATE, ACTION), transitions(4), jnp.int32(0))
    same = add(buffer, transitions(2, seed=1), jnp.int32(4), jnp.array(False))
    np.testing.assert_array_equal(same.rows, buffer.rows)
    two, new = jax.tree.map(lambda x: jnp.stack([x, x]), (buffer, transitions(2, seed=1)))
    some = add(two, new, jnp.int32(4), jnp.array([False, True]))
    np.testing.assert_array_equal(some.rows[0], buffer.rows)
    assert np.any(some.rows[1] != buffer.rows)
