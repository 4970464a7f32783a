"""How good a posterior dropout and ensembles are where the exact one is known: python -m experiments.posterior_quality.

Functions are drawn from a Bayesian linear model on random Fourier features, so the exact posterior is calibrated. The
critic's network, with its own masks and draws, is trained on the same noisy data in [-1, 1] and asked there ("inside")
and at 1 < |x| < 2 ("outside"). It goes without LayerNorm, which of a single input leaves little but the sign.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
import tyro
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from rich.console import Console
from rich.table import Table

from srl_jax.agents.networks import Critic
from srl_jax.bayes import dropout
from srl_jax.bayes.calibration import coverage, spread
from srl_jax.cli.ending import leave
from srl_jax.report.style import PALETTE, STYLE
from srl_jax.statistics import stratified_interval

FEATURES, POINTS, LENGTH, NOISE, MASKS = 100, 40, 0.5, 0.1, 50  # the functions have standard deviation 1
LEVELS = np.linspace(0.05, 0.95, 19)
ASKED = jnp.linspace(-2.0, 2.0, 160)
INSIDE = np.abs(np.asarray(ASKED)) <= 1.0


@dataclass(frozen=True)
class Arguments:
    """What to fit, and how often."""

    problems: int = 20
    """Functions drawn, each with its own data."""
    members: int = 5
    rates: tuple[float, ...] = (0.02, 0.1, 0.2)
    """Dropout rates, beside none."""
    updates: int = 2000
    out: Path = Path("runs/posterior_quality.png")


def problem(key: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Data x, y f32[POINTS], and at ASKED the true function and 500 draws of its exact posterior."""
    keys = jax.random.split(key, 6)
    frequency = jax.random.normal(keys[0], (FEATURES,)) / LENGTH
    phase = jax.random.uniform(keys[1], (FEATURES,), maxval=2.0 * jnp.pi)
    features = lambda x: jnp.sqrt(2.0 / FEATURES) * jnp.cos(x[:, None] * frequency[None] + phase[None])  # noqa: E731
    weights = jax.random.normal(keys[2], (FEATURES,))
    x = jax.random.uniform(keys[3], (POINTS,), minval=-1.0)
    y = features(x) @ weights + NOISE * jax.random.normal(keys[4], (POINTS,))
    factor = jnp.linalg.cholesky(jnp.eye(FEATURES) + features(x).T @ features(x) / NOISE**2)
    mean = jax.scipy.linalg.cho_solve((factor, True), features(x).T @ y / NOISE**2)
    posterior = mean[:, None] + jax.scipy.linalg.solve_triangular(factor.T, jax.random.normal(keys[5], (FEATURES, 500)))
    return x, y, features(ASKED) @ weights, (features(ASKED) @ posterior).T


def network_draws(x: jax.Array, y: jax.Array, key: jax.Array, rate: jax.Array, *, arguments: Arguments) -> jax.Array:
    """Posterior draws f32[members * MASKS, ASKED] of an ensemble trained with dropout, the members changing first."""
    members, widths = arguments.members, (64, 64)
    network, nothing = Critic(widths, layer_norm=False), jnp.zeros(0)
    critic: dropout.Critic = network.apply  # type: ignore[assignment]
    init_key, run_key, draw_key = jax.random.split(key, 3)
    params = jax.vmap(lambda k: network.init(k, nothing, x[:1]))(jax.random.split(init_key, members))
    optimiser = optax.adam(optax.cosine_decay_schedule(5e-3, arguments.updates))
    # Gal & Ghahramani 2016 with l = 1 and tau = 1 / noise^2; the loss is scaled so that its error term is a mean.
    decay = (1.0 - rate) * NOISE**2 / POINTS
    over_rows = jax.vmap(jax.vmap(critic, (None, None, 0, 0)), (0, None, None, 0))

    def loss(params, masks: tuple) -> jax.Array:
        error = over_rows(params, nothing, x[:, None], masks) - y[None]
        return jnp.mean(jnp.square(error), axis=1).sum() + decay * optax.tree.norm(params, squared=True)

    def update(carry, step_key: jax.Array):
        params, state = carry
        masks = dropout.sample_masks(step_key, widths, (members, POINTS), rate)
        direction, state = optimiser.update(jax.grad(loss)(params, masks), state)
        return (optax.apply_updates(params, direction), state), None

    carry = params, optimiser.init(params)
    (params, _), _ = jax.lax.scan(update, carry, jax.random.split(run_key, arguments.updates))
    masks = dropout.sample_masks(draw_key, widths, (members, MASKS), rate)
    return dropout.q_draws(critic, params, nothing, ASKED[:, None], masks)


def shares(all_draws: np.ndarray, truths: np.ndarray, where: np.ndarray, levels: ArrayLike) -> np.ndarray:
    """Coverage [problems, L] at the questions `where`, from draws [problems, M, ASKED]."""
    pairs = zip(all_draws[:, :, where], truths[:, where], strict=True)
    return np.array([coverage(draws, truth, levels, "gaussian") for draws, truth in pairs])


def tabulate(methods: dict[str, np.ndarray], truths: np.ndarray) -> Table:
    """One row per method, with intervals over problems, from draws [problems, M, ASKED]."""
    table = Table("method", "50 % in", "95 % in", "95 % out", "std in", "std out", "rmse in", "rmse out", box=None)
    for name, all_draws in methods.items():
        cells = [name]
        for level, where in ((0.5, INSIDE), (0.95, INSIDE), (0.95, ~INSIDE)):
            share = shares(all_draws, truths, where, level)
            low, high = stratified_interval(share, np.mean)
            cells.append(f"{share.mean():.2f} [{low:.2f}, {high:.2f}]")
        variance = np.mean([np.square(spread(draws, INSIDE)) for draws in all_draws], axis=0)
        error = np.square(all_draws.mean(1) - truths).mean(0)
        squares = (*variance, error[INSIDE].mean(), error[~INSIDE].mean())
        table.add_row(*cells, *(f"{np.sqrt(square):.3f}" for square in squares))
    return table


def draw(methods: dict[str, np.ndarray], truths: np.ndarray, path: Path) -> None:
    """Coverage against level, inside and outside the data."""
    with rc_context(STYLE):
        figure = Figure(figsize=(10.5, 4.6), dpi=150, layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, where, title in zip(panels, (INSIDE, ~INSIDE), ("inside the data", "outside"), strict=True):
            axes.plot([0, 1], [0, 1], color="#999999", linestyle=":", linewidth=1)
            for index, (name, all_draws) in enumerate(methods.items()):
                style = ":" if name.startswith("dropout") else "-"
                colour = PALETTE[index // 2 % len(PALETTE)] if index else "#111111"
                share = shares(all_draws, truths, where, LEVELS).mean(0)
                axes.plot(LEVELS, share, label=name, color=colour, linestyle=style, linewidth=1.8)
            axes.set(title=title, xlabel="level of the credible interval", ylabel="truths inside it")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)


def main(arguments: Arguments) -> None:
    """Fits, prints the table and draws the figure."""
    for name in ("problems", "members", "updates"):
        if getattr(arguments, name) < 1:
            raise ValueError(f"{name} is {getattr(arguments, name)}: give at least 1.")
    if any(not 0.0 < rate < 1.0 for rate in arguments.rates):
        raise ValueError(f"rates is {arguments.rates}: give dropout rates between 0 and 1; none is added to them.")
    keys = jax.random.split(jax.random.key(0), arguments.problems)
    x, y, truth, exact = jax.jit(jax.vmap(problem))(keys)
    methods = {"exact": np.asarray(exact)}
    fit = jax.jit(jax.vmap(partial(network_draws, arguments=arguments), (0, 0, 0, None)))
    for rate in (0.0, *arguments.rates):
        found = np.asarray(fit(x, y, jax.vmap(lambda key: jax.random.fold_in(key, 1))(keys), jnp.float32(rate)))
        if rate == 0.0:  # one draw a member: the masks change nothing
            methods["ensemble"] = found[:, : arguments.members]
        else:
            methods[f"dropout {rate:g}"] = found[:, :: arguments.members]
            methods[f"ensemble × dropout {rate:g}"] = found
    draw(methods, np.asarray(truth), arguments.out)
    Console(width=125).print(tabulate(methods, np.asarray(truth)), f"Drawn: {arguments.out}")


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
