"""The published bandit table: how exactly each estimator finds the gradient of a policy over one action.

    python -m experiments.bandit_table

After Ghavamzadeh & Engel (2006): the policy is N(0, 1), its scores (a, a^2 - 1) and its Fisher information diag(1, 2).
The rewards are a, with gradient (1, 0), and a^2, with gradient (0, 2).
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib import rc_context
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from srl_jax.bayes import quadrature
from srl_jax.cli.ending import leave
from srl_jax.report.style import PALETTE, STYLE

ESTIMATORS = {
    "Monte-Carlo": quadrature.monte_carlo,
    "model 1": quadrature.model1,
    "model 2": quadrature.model2,
}
REWARDS = {"a": 1, "a²": 2}  # name -> power
EXACT = {"a": (1.0, 0.0), "a²": (0.0, 2.0)}
PUBLISHED = {  # standard deviations of Monte-Carlo; model 1 with 100 samples is exact to 1e-4
    ("Monte-Carlo", "a", 10): "± .44, ± .98",
    ("Monte-Carlo", "a", 100): "± .14, ± .32",
    ("Monte-Carlo", "a²", 10): "± 1.2, ± 2.8",
    ("Monte-Carlo", "a²", 100): "± .39, ± .86",
    ("model 1", "a", 100): "exact to 1e-4",
    ("model 1", "a²", 100): "exact to 1e-4",
}


@dataclass(frozen=True)
class Arguments:
    """How often, with how many samples, and where the figure goes."""

    repetitions: int = 10_000
    samples: tuple[int, ...] = (10, 100)
    noise: float = 1e-3
    """Variance of what the Gaussian process cannot explain; the rewards themselves have no noise."""
    seed: int = 0
    out: Path = Path("runs/bandit_table.png")


@partial(jax.jit, static_argnames=("name", "power", "samples"))
def estimates(keys: jax.Array, name: str, power: int, samples: int, noise: float) -> jax.Array:
    """The estimated gradients f32[repetitions, 2]."""

    def one(key: jax.Array) -> jax.Array:
        actions = jax.random.normal(key, (samples,))
        scores = jnp.stack([actions, actions**2 - 1.0], axis=1)
        return ESTIMATORS[name](scores, actions**power, jnp.diag(jnp.array([1.0, 2.0])), noise=noise).mean

    return jax.lax.map(one, keys, batch_size=1000)


def draw(found: dict[tuple[str, str, int], np.ndarray], arguments: Arguments) -> None:
    """One panel per reward and number of samples: every estimator's cloud about the exact gradient."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9, 8), dpi=150, layout="constrained")
        grid = figure.subplots(len(REWARDS), len(arguments.samples), squeeze=False)
        for row, reward in zip(grid, REWARDS, strict=True):
            for axes, samples in zip(row, arguments.samples, strict=True):
                for colour, name in zip(("#999999", *PALETTE), ESTIMATORS, strict=False):
                    cloud = found[name, reward, samples][:500]
                    above = 3 - min(cloud.std(0).max(), 2.0)  # the tighter cloud lies on top
                    axes.plot(*cloud.T, ".", color=colour, label=name, markersize=5, alpha=0.6, zorder=above)
                axes.plot(*EXACT[reward], "+", color="#111111", markersize=16, label="exact", zorder=4)
                axes.set_title(f"reward {reward}, {samples} samples", loc="left", fontweight="bold")
                axes.set_xlabel("gradient in the mean")
                axes.set_ylabel("gradient in the log-scale")
        grid[0, 0].legend()
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(arguments.out, format="png")


def main(arguments: Arguments) -> None:
    """Prints the table and draws the figure."""
    if arguments.repetitions < 1 or min(arguments.samples, default=0) < 1:
        raise ValueError(
            f"repetitions is {arguments.repetitions} and samples {arguments.samples}: give numbers of at least 1."
        )
    keys = jax.random.split(jax.random.key(arguments.seed), arguments.repetitions)
    table = Table(title=f"Mean ± standard deviation of {arguments.repetitions:,} estimates, noise {arguments.noise:g}")
    for column in ("reward", "samples", "exact", "estimator", "in the mean", "in the log-scale", "published"):
        table.add_column(
            column, justify="right" if column in ("samples", "in the mean", "in the log-scale") else "left"
        )
    found = {}
    for reward, power in REWARDS.items():
        for samples in arguments.samples:
            for name in ESTIMATORS:
                values = np.asarray(estimates(keys, name, power, samples, arguments.noise))
                found[name, reward, samples] = values
                cells = [f"{m:.4f} ± {s:.2g}" for m, s in zip(values.mean(0), values.std(0), strict=True)]
                exact = "({:g}, {:g})".format(*EXACT[reward])
                table.add_row(reward, str(samples), exact, name, *cells, PUBLISHED.get((name, reward, samples), ""))
            table.add_section()
    Console(width=120).print(table)
    draw(found, arguments)
    print(f"Drawn: {arguments.out}")


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
