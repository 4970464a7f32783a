"""Sums over vector steps, and the means that are reported of them."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.env.hexapod import EnvStep
from srl_jax.env.task import RewardTerms
from srl_jax.program.state import Episode, Program, on_all, on_rows
from srl_jax.types import ActState

PER_EPISODE = ("return", "distance", "success", "fell")


class Tally(NamedTuple):
    """Sums since the last report; a mean is a sum over its count."""

    episodes: jax.Array  # f32[R]
    totals: dict[str, jax.Array]  # f32[R] summed over finished episodes: return, distance, success, fell
    steps: jax.Array  # f32[R]
    rates: dict[str, jax.Array]  # f32[R] summed over environment steps: who was chosen, reward terms
    updates: jax.Array  # f32[]
    losses: dict[str, dict[str, jax.Array]]  # f32[n] summed over updates, per algorithm that updates


class Measured(NamedTuple):
    """One metric of some rows."""

    rows: np.ndarray  # i[n] which of the program's rows
    values: np.ndarray  # f64[n], NaN where nothing was counted


def empty(program: Program) -> Tally:
    """A tally of nothing for all rows, on the devices."""
    zeros = jnp.zeros(len(program.layout.rows))
    losses = {
        algo: {name: jnp.zeros(len(program.layout.rows_of[algo])) for name in agent.metrics}
        for algo, agent in program.agents.items()
        if agent.update
    }
    several = range(1, 1 + len(program.teachers)) if len(program.teachers) > 1 else ()
    rates = ["chosen_teacher", *(f"chosen_{n}" for n in several), *(f"reward_{n}" for n in RewardTerms._fields)]
    made = Tally(
        episodes=zeros,
        totals=dict.fromkeys(PER_EPISODE, zeros),
        steps=zeros,
        rates=dict.fromkeys(rates, zeros),
        updates=zeros[0],
        losses=losses,
    )
    made = jax.tree.map(jnp.copy, made)  # it will be donated, and donated buffers must not alias
    by_row = {name: on_rows(program, getattr(made, name)) for name in Tally._fields if name != "updates"}
    return Tally(**by_row, updates=on_all(program, made.updates))


def count_step(
    tally: Tally,
    episode: Episode,
    act_state: ActState,
    step: EnvStep,
    alive: jax.Array,
    *,
    first_only: jax.Array,
) -> tuple[Tally, Episode]:
    """Adds one vector step to the running episodes and, of those that end, to the tally.

    An evaluation counts the first episode of each robot only: short ones would otherwise count more often.
    """
    weight = alive.astype(jnp.float32)
    done = (step.terminated | step.truncated).astype(jnp.float32) * weight[:, None]
    counted = done * (~first_only | (episode.finished == 0.0))
    reward, progress = episode.reward + step.reward, episode.progress + step.progress
    ended = {"return": reward, "distance": progress, "success": step.success, "fell": step.fell}
    choice = act_state.guidance.choice
    rates = {"chosen_teacher": choice > 0}
    rates |= {name: choice == int(name.removeprefix("chosen_")) for name in tally.rates if name[7:].isdigit()}
    rates |= {f"reward_{name}": value for name, value in step.terms._asdict().items()}
    tally = tally._replace(
        episodes=tally.episodes + counted.sum(1),
        totals={name: tally.totals[name] + (counted * value).sum(1) for name, value in ended.items()},
        steps=tally.steps + weight * done.shape[1],
        rates={name: tally.rates[name] + weight * value.astype(jnp.float32).sum(1) for name, value in rates.items()},
    )
    going = 1.0 - done
    return tally, Episode(reward * going, progress * going, episode.finished + done)


def means(program: Program, tally: Tally, *, training: bool) -> dict[str, Measured]:
    """A tally's means by metric: per episode, and in training also per step and per update of the algorithms' rows."""
    found: Tally = jax.device_get(tally)
    everyone = np.arange(len(program.layout.rows))
    measured = {name: Measured(everyone, _mean(found.totals[name], found.episodes)) for name in PER_EPISODE}
    if training:
        measured |= {name: Measured(everyone, _mean(total, found.steps)) for name, total in found.rates.items()}
        losses = {a: {n: _mean(x, found.updates) for n, x in sums.items()} for a, sums in found.losses.items()}
        measured |= by_metric(program, losses)
    return measured


def by_metric(program: Program, values: dict[str, dict[str, Any]]) -> dict[str, Measured]:
    """Metrics f[n] of each algorithm as metrics of rows, where several algorithms may have one of the same name."""
    parts: dict[str, list[Measured]] = {}
    for algo, metrics in values.items():
        for name, each in metrics.items():
            row = Measured(program.layout.rows_of[algo], np.asarray(each, np.float64))
            parts.setdefault(name, []).append(row)
    return {name: Measured(*(np.concatenate(x) for x in zip(*found, strict=True))) for name, found in parts.items()}


def _mean(total: Any, count: Any) -> np.ndarray:
    total, count = np.asarray(total, np.float64), np.asarray(count, np.float64)
    return np.where(count > 0, total / np.where(count > 0, count, 1.0), np.nan)
