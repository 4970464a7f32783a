"""How wrong the physics is: MJX against C MuJoCo, and training's coarse settings against converged physics.

    python experiments/physics_error.py --episodes 8

The first table gives the largest difference of position and of joint angles over one second, at equal
settings, from random joint angles and clocks. The second gives the distance walked in five seconds.
"""

from dataclasses import dataclass, replace

import jax
import numpy as np
import tyro

from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.env import gait as gaits
from srl_jax.env import hexapod
from srl_jax.env.damage_names import canonical
from srl_jax.env.settings import EnvConfig
from srl_jax.evaluate import Policy, Rollout, converged_model, rollout_c, rollout_mjx

KINDS = (
    "healthy",
    *(f"{segment}_rm{kind}" for segment in ("coxa", "femur", "tibia") for kind in ("", ":limp", ":locked")),
    *("leg_lf:limp", "leg_rf+leg_lr"),
)
WALKS = (
    "healthy",
    "tibia_rm",
    "tibia_rf",
    "leg_rf",
    "leg_rm",
    "leg_rr",
    "tibia_lm:limp",
    "femur_lf:locked",
    "leg_rf+leg_lr",
)


@dataclass(frozen=True)
class Args:
    """Measure the error of the physics under the scripted gait."""

    episodes: int = 8
    """Random starts for each damage."""
    noise: float = 0.2
    """Half-width of the joint angles' noise in the first table, rad."""
    seed: int = 0


def differences(robot: hexapod.Hexapod, policy: Policy, keys: jax.Array) -> None:
    """Prints the largest differences of MJX and C MuJoCo over 20 control steps, by damage."""
    print(f"MJX against C MuJoCo, equal settings, 1 s, {len(keys)} random starts")
    print(f"{'damage':<18}{'position (m)':>14}{'joints (rad)':>14}{'median (m)':>14}{'travelled (m)':>15}")
    for name in map(canonical, KINDS):
        ours = jax.device_get(rollout_mjx(robot, damages.build(name), policy, keys, 20))
        theirs = [rollout_c(robot, name, policy, key, 20) for key in keys]
        gap = np.abs(ours.qpos - np.stack([rollout.qpos for rollout in theirs]))
        position = gap[..., :3].max(axis=(1, 2))
        travelled = np.mean(np.linalg.norm(ours.qpos[:, -1, :2], axis=-1))
        row = (position.max(), gap[..., 7:].max(), np.median(position))
        print(f"{name:<18}" + "".join(f"{value:>14.1e}" for value in row) + f"{travelled:>15.2f}")


def distances(robot: hexapod.Hexapod, policy: Policy, keys: jax.Array) -> None:
    """Prints the distance along x in 100 control steps, coarse and converged, by damage."""
    print(f"\nCoarse settings against converged physics, 5 s, C MuJoCo, mean of {len(keys)} starts")
    titles = ("coarse (m)", "converged (m)", "error (m)", "error (%)", "per start (m)")
    print(f"{'damage':<18}" + "".join(f"{title:>15}" for title in titles))
    for name in WALKS:
        converged = converged_model(name)
        rollouts: list[tuple[Rollout, Rollout]] = [
            (
                rollout_c(robot, name, policy, key, 100),
                rollout_c(robot, name, policy, key, 100, model=converged),
            )
            for key in keys
        ]
        each = np.array([[float(rollout.distance) for rollout in pair] for pair in rollouts])
        coarse, fine = each.mean(0)
        spread = np.abs(each[:, 0] - each[:, 1]).mean()
        error = coarse - fine
        print(f"{name:<18}{coarse:>15.3f}{fine:>15.3f}{error:>15.3f}{100 * error / abs(fine):>15.1f}", end="")
        print(f"{spread:>15.3f}")


def main(args: Args) -> None:
    """Prints both tables.

    Raises:
        ValueError: no episode, or noise below 0.
    """
    if args.episodes < 1 or args.noise < 0.0:
        raise ValueError(f"episodes is {args.episodes} and noise {args.noise}; at least 1 and 0 are needed.")
    gait = gaits.load()
    policy = jax.tree_util.Partial(gaits.act, gait)
    keys = jax.random.split(jax.random.key(args.seed), args.episodes)
    config = EnvConfig()
    noisy = replace(config, start_noise=args.noise)
    differences(hexapod.make("x", noisy, float(gait.frequency)), policy, keys)
    distances(hexapod.make("x", config, float(gait.frequency)), policy, keys)


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
