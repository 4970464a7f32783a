"""The healthy value of pi_B on the robot: fitted to healthy rollouts that are cut short, judged on whole ones.

    python -m experiments.healthy_value

Training sees noisy healthy rollouts of `--seen` steps, of which many are truncated. Its P(success) and time to the goal
are then compared with what came of rollouts of `--whole` steps: healthy ones, and damaged ones, of which the healthy
value must know nothing. Where it promises more than the damaged robot keeps, pi_B has lost its way.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from srl_jax.bayes import dropout, value, value_network
from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env import gait as gaits
from srl_jax.env.hexapod import Hexapod
from srl_jax.env.settings import EnvConfig


@dataclass(frozen=True)
class Arguments:
    """How much is seen, and of what."""

    episodes: int = 128
    """Of each kind."""
    seen: int = 80
    """Steps after which a training episode is truncated."""
    whole: int = 200
    """Steps of the episodes that judge."""
    noise: float = 0.25
    """Standard deviation on pi_B's actions, so that it does not always succeed."""
    damage: tuple[str, ...] = ("healthy", "tibia_rm", "leg_rf", "leg_rm", "leg_rm+leg_lm")
    members: int = 5
    masks: int = 20
    updates: int = value_network.ValueConfig.updates
    """Of each member, in its fit."""
    seed: int = 0


def roll(robot: Hexapod, teacher, noise: float, steps: int, damage, key: jax.Array):
    """One episode: observations f32[T + 1, O], its length, and whether it ended in success or in a fall."""
    reset_key, noise_key = jax.random.split(key)
    state, first = hexapod.reset(robot, damage, reset_key)

    def control(carry, step_key):
        state, observation = carry
        action = teacher(observation) + noise * jax.random.normal(step_key, (hexapod.ACTION_SIZE,))
        state, out = hexapod.step(robot, damage, state, jnp.clip(action, -1.0, 1.0))
        return (state, out.observation), (out.observation, out.success, out.fell)

    _, (seen, success, fell) = jax.lax.scan(control, (state, first), jax.random.split(noise_key, steps))
    ended = success | fell
    length = jnp.where(ended.any(), jnp.argmax(ended) + 1, steps)
    at_end = lambda flags: flags[length - 1]  # noqa: E731
    return jnp.concatenate([first[None], seen]), length, at_end(success) & ~at_end(fell), at_end(fell)


def predict(
    params, observations: jax.Array, masks: tuple, config: value_network.ValueConfig
) -> value_network.Posterior:
    """Mean and standard deviation of every field at observations f32[N, O]."""
    return jax.vmap(lambda o: value_network.posterior(value_network.draws(params, o, masks, config=config)))(
        observations
    )


def main(arguments: Arguments) -> None:
    """Rolls out, fits, prints one line per damage.

    Raises:
        ValueError: a number below 1, noise below 0, or a bad damage name.
    """
    for name in ("episodes", "seen", "whole", "members", "masks", "updates"):
        if getattr(arguments, name) < 1:
            raise ValueError(f"{name} is {getattr(arguments, name)}; at least 1 is needed.")
    if arguments.noise < 0.0:
        raise ValueError(f"noise is {arguments.noise}; at least 0 is needed.")
    damaged = {name: damages.build(name) for name in arguments.damage}
    gait = gaits.load()
    robot = hexapod.make("p2p", EnvConfig(episode_steps=arguments.whole), float(gait.frequency))
    teacher = partial(gaits.act, gait)
    one = partial(roll, robot, teacher, arguments.noise, arguments.whole)
    rolled = jax.jit(jax.vmap(one, (None, 0)))
    train_key, fit_key, mask_key, test_key = jax.random.split(jax.random.key(arguments.seed), 4)

    healthy = damages.build(damage_names.HEALTHY)
    seen, length, success, fell = jax.device_get(rolled(healthy, jax.random.split(train_key, arguments.episodes)))
    cut = length > arguments.seen
    data = value.healthy_episodes(
        seen[:, : arguments.seen + 1], np.minimum(length, arguments.seen), success & ~cut, fell & ~cut
    )
    config = value_network.ValueConfig(updates=arguments.updates)
    fit = jax.jit(jax.vmap(lambda key: value_network.fit(data, key, config=config)))
    found = fit(jax.random.split(fit_key, arguments.members))
    shape = (arguments.members, arguments.masks)
    masks = dropout.sample_masks(mask_key, config.hidden, shape, jnp.float32(config.dropout))
    judge = jax.jit(partial(predict, found.params, masks=masks, config=config))

    console = Console(width=130)
    console.print(f"{arguments.episodes} healthy episodes, {cut.mean():.0%} truncated at {arguments.seen} steps")
    names = ("damage", "P(success) predicted", "of rollouts", "steps predicted", "of rollouts", "V_B", "std of V_B")
    table = Table(*names, box=None)
    for number, (name, broken) in enumerate(damaged.items()):
        keys = jax.random.split(jax.random.fold_in(test_key, number), arguments.episodes)
        seen, length, success, _ = jax.device_get(rolled(broken, keys))
        at = judge(jnp.asarray(seen[:, 0]))
        # The predicted steps are those of the mean discount, so those of the rollouts are too.
        discount = np.mean(config.gamma ** (length[success] - 1.0)) if success.any() else np.nan
        steps = 1.0 + np.log(discount) / np.log(config.gamma)
        predicted = 1.0 + np.log(np.mean(at.mean.discount)) / np.log(config.gamma)
        cells = [np.mean(at.mean.success), success.mean(), predicted, steps, np.mean(at.mean.value)]
        table.add_row(name, *(f"{x:.2f}" for x in cells), f"{np.mean(at.std.value):.2f}")
    console.print(table)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
