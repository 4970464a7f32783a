"""How an estimator of the damage is learned: from walks, and from others the temperature that makes it honest."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.estimating import simulated_walks
from experiments.estimating import walks as walks_of
from experiments.estimating.network import FEATURES, WINDOW, Estimator, Network, logits, row
from experiments.estimating.walks import Lot, Walks
from srl_jax.atlas.file import Atlas
from srl_jax.types import Params

SEEDS = (1_000, 1_001, 2_000)  # of walks in C MuJoCo, in the simulator, and of those to calibrate by
SHARES = (0.2, 0.2)  # of training's windows that are of healthy robots, and of damages that are none of these


class Course(NamedTuple):
    """From how many walks an estimator is learned, and how."""

    converged: int = 20  # walks of every damage in C MuJoCo at 2 ms
    simulated: int = 100  # and in the simulator
    held_out: int = 2  # walks of every damage in C MuJoCo by which it is calibrated
    others: float = 1 / 3  # walks of healthy robots, and of damages that are none of these, to one of an atlas' damage
    updates: int = 8_000
    batch: int = 512
    rate: float = 2e-3  # at the start; it falls to 0 along a cosine
    decay: float = 0.05  # of weights (Loshchilov & Hutter 2019): walks are fewer than windows
    smoothing: float = 0.01  # share of every label that is spread over all classes
    block: int = 250  # updates between two looks of the host


COURSE = Course()


class Drawn(NamedTuple):
    """Robots, and how they walked."""

    lots: list[Lot]
    walks: Walks


def draw(atlas: Atlas, course: Course = COURSE) -> tuple[Drawn, Drawn]:
    """Walks to learn from, and walks to calibrate by."""

    def lots(seed: int, each: int) -> list[Lot]:
        more = int(each * len(atlas.damages) * course.others)
        return walks_of.lots(atlas, seed, each=each, healthy=more, none=more)

    first, second, held_out = (lots(*pair) for pair in zip(SEEDS, course[:3], strict=True))
    parts = [walks_of.walked(atlas, first)]
    if second:
        parts.append(simulated_walks.walked(atlas, second))
    return Drawn(first + second, walks_of.joined(parts)), Drawn(held_out, walks_of.walked(atlas, held_out))


def taught(learned_from: Walks, held_out: Walks, classes: int, course: Course = COURSE) -> Estimator:
    """An estimator that is learned and calibrated."""
    return calibrated(learn(learned_from, classes, 0, course), held_out, 0)


def learn(walks: Walks, classes: int, seed: int, course: Course = COURSE) -> Estimator:
    """An estimator from walks; `calibrated` comes next, on others.

    Args:
        walks: of all classes that it is to know.
        classes: D + 1.
        seed: of weights and batches.
        course: how.

    Raises:
        ValueError: no walk is of a healthy robot, or none has a damage.
    """
    rows, batches = _padded(walks), _Batches(walks.label, classes, seed)
    params = Network(classes).init(jax.random.key(seed), jnp.zeros((WINDOW, FEATURES)))
    optimiser = optax.adamw(optax.cosine_decay_schedule(course.rate, course.updates), weight_decay=course.decay)

    def loss(params: Params, windows: jax.Array, label: jax.Array) -> jax.Array:
        wanted = optax.smooth_labels(jax.nn.one_hot(label, classes), course.smoothing)
        return jnp.mean(optax.softmax_cross_entropy(logits(params, windows, classes), wanted))

    def update(carry, chosen: tuple[jax.Array, jax.Array]):
        params, state = carry
        place, label = chosen
        gradient = jax.grad(loss)(params, _windows(rows, place), label)
        direction, state = optimiser.update(gradient, state, params)
        return (optax.apply_updates(params, direction), state), None

    run = jax.jit(lambda carry, chosen: jax.lax.scan(update, carry, chosen)[0])
    carry = params, optimiser.init(params)
    for _ in range(-(-course.updates // course.block)):
        carry = run(carry, batches.draw(course.block, course.batch))
    return Estimator(carry[0], jnp.log(batches.shares), jnp.ones(()))


def calibrated(estimator: Estimator, walks: Walks, seed: int, count: int = 8_000) -> Estimator:
    """With the temperature that makes held-out windows likeliest (Guo et al. 2017)."""
    place, label = _Batches(walks.label, len(estimator.log_share), seed).draw(1, count)
    windows, shares = _windows(_padded(walks), place[0]), estimator.log_share
    found = jnp.where(jnp.isfinite(shares), logits(estimator.params, windows, len(shares)), -jnp.inf)
    choices = np.geomspace(0.5, 4.0, 60)
    own = [optax.softmax_cross_entropy_with_integer_labels(found / choice, label[0]).mean() for choice in choices]
    return estimator._replace(temperature=jnp.float32(choices[int(np.argmin(own))]))


def every_window(walks: Walks) -> jax.Array:
    """All windows f32[N, T, 20, 60], one for every step."""
    rows = _padded(walks)
    return jnp.stack([rows[:, first : first + WINDOW] for first in range(walks.label.shape[1])], axis=1)


class _Batches:
    """Windows by class: healthy robots and none of these in their `SHARES`, all other damages alike."""

    def __init__(self, label: np.ndarray, classes: int, seed: int):
        self._random = np.random.default_rng(seed)
        flat = label.reshape(-1)
        self._order = np.argsort(flat, kind="stable")
        self._count = np.bincount(flat, minlength=classes)
        self._first = np.concatenate([[0], np.cumsum(self._count)[:-1]])
        self._steps = label.shape[1]
        there = self._count > 0
        if not there[0] or not there[1:].any():
            raise ValueError("walks must be of healthy robots and of damaged ones: an estimator tells them apart.")
        weight = there.astype(float)
        weight[1:-1] *= (1.0 - sum(SHARES)) / max(there[1:-1].sum(), 1)
        weight[[0, -1]] *= SHARES
        self.shares = (weight / weight.sum()).astype(np.float32)

    def draw(self, updates: int, batch: int) -> tuple[jax.Array, jax.Array]:
        """Robots and steps i32[updates, batch, 2], and their classes i32[updates, batch]."""
        shares = self.shares.astype(float)
        label = self._random.choice(len(shares), (updates, batch), p=shares / shares.sum())
        which = (self._random.random(label.shape) * self._count[label]).astype(int)
        place = self._order[self._first[label] + which]
        return jnp.stack([place // self._steps, place % self._steps], -1).astype(jnp.int32), jnp.asarray(label)


def _padded(walks: Walks) -> jax.Array:
    """Rows f32[N, 19 + T, 60], behind those of a robot that stands."""
    rows = np.asarray(row(walks.action, walks.felt, walks.answering))
    return jnp.asarray(np.pad(rows, ((0, 0), (WINDOW - 1, 0), (0, 0))))


def _windows(rows: jax.Array, place: jax.Array) -> jax.Array:
    """The windows f32[B, 20, 60] that end with these steps i32[B, 2]."""
    cut = partial(jax.lax.dynamic_slice, rows, slice_sizes=(1, WINDOW, FEATURES))
    return jax.vmap(lambda at: cut((at[0], at[1], 0))[0])(place)
