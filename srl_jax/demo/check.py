"""Whether policies walk for fifteen seconds after a cut in mid-walk: what a page is about to show, in C MuJoCo."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from srl_jax.env.damage import damaged_model
from srl_jax.portable import Policy
from srl_jax.show.walk import Walk
from srl_jax.show.walker import by_policy

HEALTHY, UNAWARE, STAND, AFTER, LAST = 60, 10, 20, 300, 100  # control steps; speed is that of the last
SLOW = 0.1  # m/s below which a robot does not walk


class Walked(NamedTuple):
    """How a policy went on after the cut."""

    speed: float  # m/s in the last five of fifteen seconds: along the heading for task x, otherwise over ground
    fell: bool


def after_cut(policy: Policy, before: Policy | None) -> Walked:
    """The page's robot walks three seconds, loses what the policy is for, and goes on by it half a second later.

    Args:
        policy: for its damage.
        before: of the healthy robot, from which it takes over in mid-stride; None: pi_B, and the robot stands for a
            second in between.
    """
    walk = Walk(
        by_policy(policy),
        policy.about["damage"],
        HEALTHY,
        before=before and by_policy(before),
        unaware=UNAWARE,
        rest=0 if before else STAND,
        model=damaged_model,
    )
    moments = list(walk.until(HEALTHY + UNAWARE + STAND + AFTER))
    path = np.array([moment.qpos[:2] for moment in moments[-LAST - 1 :: 20]])  # from second to second
    come = np.diff(path, axis=0)
    ahead = np.array([np.cos(walk.heading), np.sin(walk.heading)])
    each = come @ ahead if policy.about["task"] == "x" else np.linalg.norm(come, axis=1)
    return Walked(float(np.mean(each)), moments[-1].fell)


def said(policies: Sequence[Policy], before: Policy | None) -> str:
    """How many of them walk on, how fast, and which do not; `before` as in `after_cut`."""
    each = [after_cut(policy, before) for policy in policies]
    failed = [
        f"{policy.about['method']} for {policy.about['damage']}"
        for policy, walked in zip(policies, each, strict=True)
        if walked.fell or walked.speed < SLOW
    ]
    missed = f", not so {', '.join(failed)}" if failed else ""
    median = np.median([walked.speed for walked in each])
    return (
        f"{len(policies) - len(failed)} of {len(policies)} policies walk on for 15 s after a cut in mid-walk "
        f"(median {median:.2f} m/s{missed})."
    )
