"""The error of the policy gradient on a linear-quadratic problem, against the number of trajectories.

    python -m experiments.lqr

After the experiment of Ghavamzadeh, Engel & Valko (JMLR 2016): x_0 ~ N(.3, .001), x' = x + a + N(0, .01), cost
x^2 + .1 a^2, 20 steps, policy a ~ N(gain x, exp(2 log_scale)). Gradient and Fisher information are closed forms.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib import rc_context
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from experiments.bandit_table import ESTIMATORS
from srl_jax.bayes import gptd
from srl_jax.cli.ending import leave
from srl_jax.report.style import PALETTE, STYLE

STEPS, START, START_VARIANCE, DRIFT_VARIANCE = 20, 0.3, 1e-3, 1e-2
POLICY = jnp.array([-0.2, 0.0])  # gain and log-scale
VALUE = gptd.rbf(jnp.array([2.0, 0.5]), 500.0)  # of the state and of the fraction of the episode that is left
Estimator = Callable[..., jax.Array]  # Trajectories, Fisher information f32[2, 2], noise -> f32[2]


@dataclass(frozen=True)
class Arguments:
    """How often, with how many trajectories, and where the figure goes."""

    repetitions: int = 2000
    trajectories: tuple[int, ...] = (5, 10, 20, 50, 100)
    critic_steps: int = 400  # for the actor-critic, in 200 repetitions at most: its time grows with their cube
    noise: float = 1.0
    seed: int = 0
    out: Path = Path("runs/lqr.png")


class Trajectories(NamedTuple):
    states: jax.Array  # f32[M, STEPS + 1]
    rewards: jax.Array  # f32[M, STEPS]
    scores: jax.Array  # f32[M, STEPS, 2]


def moments(policy: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The expected return f32[] and the Fisher information f32[2, 2] of a trajectory, exactly."""
    gain, variance = policy[0], jnp.exp(2.0 * policy[1])

    def step(square: jax.Array, _):  # of E[x^2]
        reward = -(square + 0.1 * (gain**2 * square + variance))
        return (1.0 + gain) ** 2 * square + variance + DRIFT_VARIANCE, (reward, square)

    _, (rewards, squares) = jax.lax.scan(step, jnp.array(START**2 + START_VARIANCE), None, STEPS)
    return rewards.sum(), jnp.diag(jnp.stack([squares.sum() / variance, jnp.array(2.0 * STEPS)]))


def rollout(key: jax.Array, count: int) -> Trajectories:
    """Draws `count` trajectories."""
    gain, scale = POLICY[0], jnp.exp(POLICY[1])
    start, noise, drift = jnp.split(jax.random.normal(key, (2 * STEPS + 1, count)), (1, STEPS + 1))

    def step(x: jax.Array, draws: tuple[jax.Array, jax.Array]):
        action = gain * x + scale * draws[0]
        score = jnp.stack([draws[0] * x / scale, draws[0] ** 2 - 1.0], axis=-1)
        return x + action + DRIFT_VARIANCE**0.5 * draws[1], (x, -(x**2 + 0.1 * action**2), score)

    last, (states, rewards, scores) = jax.lax.scan(step, START + START_VARIANCE**0.5 * start[0], (noise, drift))
    return Trajectories(jnp.append(states, last[None], axis=0).T, rewards.T, scores.swapaxes(0, 1))


def whole(estimator, centred: bool, episodes: Trajectories, fisher: jax.Array, noise: float) -> jax.Array:
    """The gradient f32[2] from whole trajectories; `centred` takes the mean return off as a baseline."""
    returns = episodes.rewards.sum(1) - centred * episodes.rewards.sum(1).mean()
    return estimator(episodes.scores.sum(1), returns, fisher, noise=noise).mean


def actor_critic(correlated: bool, episodes: Trajectories, fisher: jax.Array, noise: float) -> jax.Array:
    """The gradient f32[2] from single steps, by a Gaussian-process critic with Engel's correlated noise or without."""
    left = jnp.broadcast_to(jnp.linspace(1.0, 0.0, STEPS + 1)[None], episodes.states.shape)
    points = jnp.stack([episodes.states, left], axis=-1)
    rewards, scores = episodes.rewards.ravel(), episodes.scores.reshape(-1, 2)
    goes_on = jnp.tile(jnp.arange(STEPS) < STEPS - 1, len(left))
    here, after = points[:, :-1].reshape(-1, 2), points[:, 1:].reshape(-1, 2)
    data = gptd.Transitions(here, scores, rewards, 1.0 * goes_on, after, 0.0 * scores)
    options = {"noise": noise, "scale": 10.0, "linked": goes_on if correlated else None}
    return STEPS * gptd.gradient(gptd.fit(data, VALUE, fisher / STEPS, **options)).mean


METHODS: dict[str, Estimator] = {
    f"{name}{', centred' * centred}": partial(whole, estimator, centred)
    for centred in (False, True)
    for name, estimator in ESTIMATORS.items()
} | {
    "actor-critic": partial(actor_critic, False),
    "actor-critic, correlated": partial(actor_critic, True),
}


def errors(keys: jax.Array, count: int, method: Estimator, noise: float) -> np.ndarray:
    """Relative squared error and angle (degrees): means and half 95 % intervals over repetitions, f64[2, 2]."""
    exact, fisher = np.asarray(jax.grad(lambda policy: moments(policy)[0])(POLICY), float), moments(POLICY)[1]
    one = jax.jit(lambda keys: jax.lax.map(lambda k: method(rollout(k, count), fisher, noise), keys, batch_size=50))
    found = np.asarray(one(keys), float)
    cosine = found @ exact / (np.linalg.norm(found, axis=1) * np.linalg.norm(exact)).clip(1e-30)
    each = np.stack([((found - exact) ** 2).sum(1) / (exact @ exact), np.degrees(np.arccos(cosine.clip(-1, 1)))])
    return np.stack([each.mean(1), 1.96 * each.std(1) / len(found) ** 0.5])


def draw(found: dict[str, dict[int, np.ndarray]], out: Path) -> None:
    """One panel for the squared error and one for the angle, each f64[2, 2] of mean and half an interval."""
    with rc_context(STYLE):
        figure = Figure(figsize=(11, 4.6), dpi=150, layout="constrained")
        labels = ("squared error / squared length", "angle to the gradient (°)")
        for metric, (panel, label) in enumerate(zip(figure.subplots(1, 2), labels, strict=True)):
            for colour, (name, rows) in zip(("#999999", *PALETTE), found.items(), strict=False):
                mean, half = np.array([row[:, metric] for row in rows.values()]).T
                style = "--" if "centred" in name else "-"
                panel.errorbar(list(rows), mean, half, color=colour, label=name, linestyle=style, marker=".")
            panel.set(xscale="log", yscale="log", xlabel="trajectories", ylabel=label)
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right upper")
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, format="png")


def main(arguments: Arguments) -> None:
    """Prints the table and draws the figure."""
    if arguments.repetitions < 1 or min(arguments.trajectories, default=0) < 1:
        counts = f"repetitions is {arguments.repetitions} and trajectories {arguments.trajectories}"
        raise ValueError(f"{counts}: give numbers of at least 1.")
    keys = jax.random.split(jax.random.key(arguments.seed), arguments.repetitions)
    table = Table("method", *(f"M = {count}" for count in arguments.trajectories))
    table.title = f"Squared error / squared length, and angle (°), with 95 % intervals; noise {arguments.noise:g}"
    found = {}
    for name, method in METHODS.items():
        slow = name.startswith("actor-critic")
        counts = [m for m in arguments.trajectories if not slow or m * STEPS <= arguments.critic_steps]
        used = keys[:200] if slow else keys
        found[name] = {count: errors(used, count, method, arguments.noise) for count in counts}
        table.add_row(name, *("\n".join(f"{m:.3g} ± {h:.2g}" for m, h in row.T) for row in found[name].values()))
    Console(width=140).print(table)
    draw(found, arguments.out)
    print(f"Drawn: {arguments.out}")


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
