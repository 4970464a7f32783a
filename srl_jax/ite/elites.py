"""MAP-Elites: for every cell of descriptor space, the fittest gait that was found there.

Mouret & Clune (2015), with the operators of Cully et al. (2015). Genes are levels 0..20 of twentieths, a descriptor is
six duty factors in five bins each. Everything is a pure function of an archive, and
nothing depends on the order within a batch but ties, which the first row wins.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.ite.family import GENES, REFERENCE

DIMENSIONS = 6
BINS = 5
CELLS = BINS**DIMENSIONS
LEVELS = 21  # of a gene: 0, 0.05, ..., 1
VALUES = np.linspace(0.0, 1.0, LEVELS, dtype=np.float32)
MUTATION = 0.05  # probability of each gene
ROUNDING = 1e-4  # bins: a duty factor of 0.6 must not fall short of its bin in f32


class Archive(NamedTuple):
    """The elites; C cells, the first dimension varying slowest."""

    fitness: jax.Array  # f32[C], -inf where empty
    genes: jax.Array  # u8[C, 36] levels
    descriptors: jax.Array  # f32[C, 6]


class Batch(NamedTuple):
    """Candidates that were evaluated."""

    fitness: jax.Array  # f32[B]; what is not finite enters no cell
    genes: jax.Array  # u8[B, 36]
    descriptors: jax.Array  # f32[B, 6]


def empty() -> Archive:
    """An archive without elites."""
    return Archive(
        fitness=jnp.full(CELLS, -jnp.inf),
        genes=jnp.zeros((CELLS, GENES), jnp.uint8),
        descriptors=jnp.zeros((CELLS, DIMENSIONS)),
    )


def gaits(genes: jax.Array) -> jax.Array:
    """Parameters f32[..., 36] in [0, 1] of levels u8[..., 36], bit for bit the same wherever it is called."""
    return jnp.asarray(VALUES)[genes]


def cell(descriptor: jax.Array) -> jax.Array:
    """The cell i32[] of a descriptor f32[6] in [0, 1]: five equal bins a dimension, the last one closed."""
    chex.assert_shape(descriptor, (DIMENSIONS,))
    bins = jnp.clip(jnp.floor(BINS * descriptor + ROUNDING).astype(jnp.int32), 0, BINS - 1)
    return jnp.dot(bins, BINS ** jnp.arange(DIMENSIONS - 1, -1, -1))


@jax.jit
def insert(archive: Archive, batch: Batch) -> Archive:
    """The archive after a batch: a candidate takes its cell if it is fitter than who is there and than its rivals.

    Of equals the one that is there stays, and within the batch the first row wins, whatever the device.
    """
    chex.assert_equal_shape_prefix([batch.fitness, batch.genes, batch.descriptors], 1)
    rows = len(batch.fitness)
    cells = jax.vmap(cell)(batch.descriptors)
    fitness = jnp.where(jnp.isfinite(batch.fitness), batch.fitness, -jnp.inf)
    best = archive.fitness.at[cells].max(fitness)
    wins = (fitness > archive.fitness[cells]) & (fitness == best[cells])
    # A scatter of several rows into one cell keeps any of them: the smallest row number is first made the only one.
    first = jnp.full(CELLS, rows, jnp.int32)
    first = first.at[cells].min(jnp.where(wins, jnp.arange(rows), rows))
    taken, row = first < rows, jnp.minimum(first, rows - 1)
    return Archive(
        fitness=best,
        genes=jnp.where(taken[:, None], batch.genes[row], archive.genes),
        descriptors=jnp.where(taken[:, None], batch.descriptors[row], archive.descriptors),
    )


def select(archive: Archive, count: int, key: jax.Array) -> jax.Array:
    """Levels u8[count, 36] of elites drawn uniformly, with replacement, from the filled cells; zeros if none is."""
    filled = jnp.isfinite(archive.fitness)
    places = jnp.nonzero(filled, size=CELLS, fill_value=0)[0]
    drawn = jax.random.randint(key, (count,), 0, jnp.maximum(filled.sum(), 1))
    return archive.genes[places[drawn]]


def sample(count: int, key: jax.Array) -> jax.Array:
    """Levels u8[count, 36] drawn uniformly."""
    return jax.random.randint(key, (count, GENES), 0, LEVELS, jnp.uint8)


def mutate(parents: jax.Array, key: jax.Array) -> jax.Array:
    """Children u8[B, 36] of parents u8[B, 36]: every gene is redrawn with a probability of 5 %, as published.

    Two things keep an evaluation from being spent on the parent once more, of which the simulator would make the same
    (16 % of the published operator's children): a redrawn gene takes one of the 20 other levels, and where no gene was
    drawn, one is, uniformly.
    """
    which_key, one_key, level_key = jax.random.split(key, 3)
    which = jax.random.bernoulli(which_key, MUTATION, parents.shape)
    one = jax.random.randint(one_key, parents.shape[:1], 0, GENES)
    spare = jnp.arange(GENES)[None] == one[:, None]
    which = jnp.where(which.any(axis=1, keepdims=True), which, spare)
    shift = jax.random.randint(level_key, parents.shape, 1, LEVELS, jnp.uint8)
    return jnp.where(which, (parents + shift) % jnp.uint8(LEVELS), parents)


def tripods(count: int, key: jax.Array) -> jax.Array:
    """Levels u8[count, 36] of tripods: the published one, with five numbers drawn anew and alike for all legs.

    They are the amplitudes and duties of coxa and femur, and the lag between the two.
    """
    amplitude_key, duty_key, lag_key = jax.random.split(key, 3)
    known = jnp.rint((LEVELS - 1) * REFERENCE).astype(jnp.int32).reshape(1, 6, 2, 3)
    amplitude = jax.random.randint(amplitude_key, (count, 1, 2), 0, LEVELS)
    duty = jax.random.randint(duty_key, (count, 1, 2), 0, LEVELS)
    lag = jax.random.randint(lag_key, (count, 1), 0, LEVELS - 1)  # of the femur behind the coxa
    lag = jnp.stack([jnp.zeros_like(lag), lag], axis=-1)
    phase = (known[..., 1] + lag) % (LEVELS - 1)
    genes = jnp.stack(jnp.broadcast_arrays(amplitude, phase, duty), axis=-1)
    return genes.reshape(count, GENES).astype(jnp.uint8)


@partial(jax.jit, static_argnames="count")
def breed(archive: Archive, count: int, key: jax.Array) -> jax.Array:
    """Levels u8[count, 36] to evaluate next: mutated elites; at first random gaits and `tripods`, in turn."""
    select_key, mutate_key, sample_key, tripod_key = jax.random.split(key, 4)
    children = mutate(select(archive, count, select_key), mutate_key)
    even = jnp.arange(count)[:, None] % 2 == 0
    first = jnp.where(even, tripods(count, tripod_key), sample(count, sample_key))
    return jnp.where(jnp.isfinite(archive.fitness).any(), children, first)


def step(
    archive: Archive, evaluate: Callable[[jax.Array], tuple[jax.Array, jax.Array]], count: int, key: jax.Array
) -> tuple[Archive, Batch]:
    """One generation: children are bred, evaluated and inserted. Returns the archive and what was evaluated.

    Args:
        archive: before.
        evaluate: parameters f32[count, 36] -> fitness f32[count] and descriptors f32[count, 6].
        count: size of the batch.
        key: random key.
    """
    children = breed(archive, count, key)
    fitness, descriptors = evaluate(gaits(children))
    batch = Batch(fitness, children, descriptors)
    return insert(archive, batch), batch
