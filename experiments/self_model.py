"""Self-modelling: how often the robot names its damage, by the number of motions it has made to find out.

    python -m experiments.self_model --damages all --truth c

Every damage is simulated in MJX under every probing motion, from rest. Then each is the truth in turn: with another
start, noisy sensors and, with `--truth c`, other physics. Motions of greatest disagreement stand beside random ones.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import tyro
from matplotlib import rc_context
from matplotlib.figure import Figure

from srl_jax.blocks import blocked_map
from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env import senses as feeling
from srl_jax.env.settings import EnvConfig
from srl_jax.evaluate import converged_model
from srl_jax.ite import probing, selfmodel
from srl_jax.report.style import FIXED, STYLE
from srl_jax.statistics import stratified_interval

BLOCK = 128  # robots stepped together: as many as fit the cache
SENSES = {"all": slice(None), "imu": feeling.IMU}  # imu: gyroscope and gravity, no joint encoders
COLOURS: dict[str, str] = dict(zip(selfmodel.CHOICES, FIXED.values(), strict=True))


@dataclass(frozen=True)
class Args:
    """Names the damage from a few motions, and counts how often that is right."""

    damages: str = "all"  # hypotheses: all, losses21, or a comma list
    truth: Literal["mjx", "c"] = "mjx"  # physics of the hypotheses, or C MuJoCo at 2 ms with another friction
    friction: float = 0.8  # with --truth c: share of the hypotheses' friction
    motions: int = 16  # to choose from
    probes: int = 6  # motions made
    steps: int = 40  # control steps (1/20 s) of a motion
    amplitude: float = 0.5  # largest action; 1 is a joint's full excursion
    seeds: int = 5  # starts and sensor noises of each true damage
    seed: int = 0
    out: Path = Path("runs/self_model.png")


def in_mjx(robot: hexapod.Hexapod, names: tuple[str, ...], actions: jax.Array) -> Callable[..., jax.Array]:
    """``(spread, key) -> f32[D, P, T, F]``, every damage under every motion, compiled once."""
    count, motions = len(names), len(actions)
    each = jax.tree.map(lambda leaf: jnp.repeat(leaf, motions, axis=0), damages.stack(names))

    @jax.jit
    def simulate(each: damages.Damage, actions: jax.Array, spread: jax.Array, key: jax.Array) -> jax.Array:
        rows = (each, jnp.tile(actions, (count, 1, 1)), jax.random.split(key, count * motions))
        batched = jax.vmap(lambda row: probing.trace(robot, row[0], row[1], spread, row[2]))
        return blocked_map(batched, rows, BLOCK).reshape(count, *actions.shape[:2], feeling.SIZE)

    return partial(simulate, each, actions)


def in_c(robot: hexapod.Hexapod, actions: jax.Array, friction: float, name: str, key: jax.Array) -> np.ndarray:
    """One damage under every motion by C MuJoCo, converged and with another friction: f32[P, T, F]."""
    model, damage = converged_model(name), damages.build(name)
    model.geom_friction[:, 0] *= friction
    substeps = round(1.0 / (hexapod.CONTROL_HZ * model.opt.timestep))
    start = jax.vmap(lambda key: hexapod.reset(robot, damage, key)[0])(jax.random.split(key, len(actions)))
    poses, speeds = (np.zeros((*actions.shape[:2], size), np.float32) for size in (model.nq, model.nv))
    for p, controls in enumerate(np.asarray(jax.vmap(jax.vmap(partial(hexapod.targets, robot)))(actions))):
        data = mujoco.MjData(model)
        data.qpos[:] = start.qpos[p]
        for t, control in enumerate(controls):
            data.ctrl[:] = control
            mujoco.mj_step(model, data, nstep=substeps)
            poses[p, t], speeds[p, t] = data.qpos, data.qvel
    blank = jax.tree.map(lambda leaf: leaf[0], start)
    feel = jax.vmap(jax.vmap(lambda q, v: feeling.felt(hexapod.feel(robot, damage, blank._replace(qpos=q, qvel=v)))))
    return np.asarray(feel(poses, speeds))


def accuracy(
    predicted: jax.Array, observed: jax.Array, scales: jax.Array, key: jax.Array, probes: int, choice: str
) -> np.ndarray:
    """Top-1 and top-3 of every seed, true damage and number of probes n: f32[2, S, D, n]."""
    seeds, count = observed.shape[:2]
    identify = partial(selfmodel.identify, probes=probes, choice=choice, pairs=selfmodel.distances(predicted, scales))

    def one(traces: jax.Array, truth: jax.Array, key: jax.Array) -> jax.Array:
        beliefs = identify(predicted, traces, scales, key).log_posterior
        return jnp.stack([jax.vmap(partial(selfmodel.top, truth=truth, k=k))(beliefs) for k in (1, 3)])

    keys = jax.random.split(key, seeds * count)
    rows = (observed.reshape(-1, *observed.shape[2:]), jnp.tile(jnp.arange(count), seeds), keys)
    found = jax.jit(lambda rows: blocked_map(lambda rows: jax.vmap(one)(*rows), rows, BLOCK))(rows)
    return np.moveaxis(np.asarray(found).reshape(seeds, count, 2, probes), 2, 0)


def show(path: Path, results: dict[tuple[str, str], np.ndarray], title: str) -> None:
    """Prints accuracy against the number of motions made, with 95 % intervals over seeds, and saves a figure of it."""
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    with rc_context(STYLE):
        axes = dict(zip(SENSES, figure.subplots(1, len(SENSES), sharey=True), strict=True))
        for (senses, choice), found in results.items():
            steps = np.arange(1, found.shape[-1] + 1)
            for label, line, scores in zip(("top 1", "top 3"), ("-", "--"), found, strict=True):
                bands = [stratified_interval(scores[..., n - 1], np.mean) for n in steps]
                means = scores.mean((0, 1))
                cells = (f"{mean:.3f} [{low:.3f}, {high:.3f}]" for mean, (low, high) in zip(means, bands, strict=True))
                print(f"{senses:<5}{choice:<13}{label}", *cells, sep="  ")
                look = {"color": COLOURS[choice], "linestyle": line, "marker": "o", "markersize": 4}
                axes[senses].plot(steps, means, label=f"{choice}, {label}", **look)
                axes[senses].fill_between(steps, *np.transpose(bands), alpha=0.15, color=COLOURS[choice], linewidth=0)
            axes[senses].set(xlabel="motions made", title=f"senses: {senses}", ylim=(0.0, 1.02), xticks=steps)
        axes["all"].set_ylabel("share of robots")
        axes["all"].legend(loc="lower right")
        figure.suptitle(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def main(args: Args) -> None:
    """Simulates, identifies, prints the table and saves the figure."""
    if not 1 <= args.probes <= args.motions:
        raise ValueError(f"probes is {args.probes}; accepted are 1 to motions, {args.motions}.")
    if args.seeds < 1 or args.friction <= 0.0:
        raise ValueError(f"seeds is {args.seeds} and friction {args.friction}; at least 1, and above 0, are needed.")
    names = damage_names.parse_names(args.damages, "x")
    robot = hexapod.make("x", EnvConfig(), 1.0)
    motion_key, model_key, truth_key, noise_key, choice_key = jax.random.split(jax.random.key(args.seed), 5)
    actions = probing.probes(motion_key, args.motions, args.steps, amplitude=args.amplitude)
    simulate = in_mjx(robot, names, actions)
    predicted, repeated = simulate(jnp.zeros(()), model_key), simulate(jnp.ones(()), model_key)
    if args.truth == "mjx":
        truth = jnp.stack([simulate(jnp.ones(()), key) for key in jax.random.split(truth_key, args.seeds)])
    else:
        keys = jax.random.split(truth_key, (args.seeds, len(names)))
        each = partial(in_c, robot, actions, args.friction)
        truth = jnp.array([[each(*pair) for pair in zip(names, row, strict=True)] for row in keys])
    observed = jnp.asarray(truth + feeling.FELT_NOISE * np.asarray(jax.random.normal(noise_key, truth.shape)))
    title = f"{len(names)} damages, {args.seeds} seeds, truth in {args.truth}"
    print(title, "mean and 95 % interval after each motion", sep="\n")
    results = {}
    for senses, part in SENSES.items():
        model, again, felt = (traces[..., part] for traces in (predicted, repeated, observed))
        scales = selfmodel.residual_scales(model, again, jnp.asarray(feeling.FELT_NOISE[part]))
        for choice in selfmodel.CHOICES:
            results[senses, choice] = accuracy(model, felt, scales, choice_key, args.probes, choice)
    show(args.out, results, title)


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
