"""A robot walks, its damage strikes in mid-stride, and another policy walks on."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from srl_jax.env.damage import damaged_model
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.show.walk import STANDS, Walk
from srl_jax.show.walker import Walker, by_policy, tripod
from tests.portable.made import policy

CLOCK = tripod("x").clock_hz


def still(task, seen):
    """Somebody who stands, and writes down what it sees."""

    def act(observation):
        seen.append(observation)
        return np.zeros(18)

    return Walker("nobody", act, task, "onboard", CLOCK)


def test_the_tripod_walks_until_the_strike_and_the_policy_after_it():
    seen = []
    moments = list(Walk(still("x", seen), "leg_rm", strike=40).until(60))
    assert [m.walker for m in moments] == ["tripod"] * 40 + ["nobody"] * 20
    assert [m.damage for m in moments] == ["healthy"] * 40 + ["leg_rm"] * 20
    path = np.array([m.qpos[0] for m in moments])
    assert 0.6 < path[39] < 1.4 and abs(path[59] - path[49]) < 0.05
    assert len(seen) == 20 and seen[0].shape == (25,)
    joints = np.stack(seen)[1:, 7:].reshape(-1, 6, 3)
    assert (joints[:, 1] == 0.0).all() and np.abs(joints[:, 0]).min() > 0.0  # the lost leg's encoders are silent


def test_physics_is_that_of_a_robot_with_a_missing_leg():
    lame = list(Walk(tripod("x"), "leg_rm", strike=0).until(60))
    whole = list(Walk(tripod("x"), "healthy", strike=0).until(60))
    assert lame[-1].qpos[0] < 0.7 * whole[-1].qpos[0]
    assert whole[-1].walker == "tripod" and not whole[-1].fell


def test_goals_follow_one_another():
    walk = Walk(tripod("p2p"), "healthy", strike=0, seed=1)
    moments = list(walk.until(round(12 * CONTROL_HZ)))
    goals = np.unique(np.stack([m.goal for m in moments]), axis=0)
    assert moments[-1].reached >= 2 and len(goals) == moments[-1].reached + 1
    for before, after in pairwise(moments):
        if after.reached > before.reached:
            assert np.linalg.norm(after.goal - after.qpos[:2]) < 0.15
            following = next(m.goal for m in moments if m.reached == after.reached and (m.goal != after.goal).any())
            assert 1.49 < np.linalg.norm(following - after.qpos[:2]) < 1.91


def test_a_walk_ends_with_the_fall():
    walk = Walk(still("x", []), "leg_rm", strike=0)
    walk.step()
    walk.data.qpos[3:7] = [np.cos(0.8), np.sin(0.8), 0.0, 0.0]  # on its side
    assert [moment.fell for moment in walk.until(200)] == [True]


def test_the_same_seed_is_the_same_walk():
    ends = [list(Walk(tripod("p2p"), "leg_rm", 0, seed).until(10))[-1] for seed in (3, 3, 4)]
    np.testing.assert_array_equal(ends[0].qpos, ends[1].qpos)
    assert not np.array_equal(ends[0].goal, ends[2].goal)


def test_who_walked_before_goes_on_for_a_while_then_the_robot_stands_and_the_policy_starts_anew():
    seen = []
    walk = Walk(still("x", seen), "leg_rm", strike=30, unaware=15, rest=10)
    moments = list(walk.until(57))
    assert [m.walker for m in moments[28:]] == ["tripod"] * 17 + [STANDS] * 10 + ["nobody"] * 2
    assert [m.damage for m in moments[28:32]] == ["healthy"] * 2 + ["leg_rm"] * 2
    np.testing.assert_allclose(seen[0][:4], [0.0, 1.0, 1.0, 0.0], atol=1e-6)  # its clock begins, straight ahead
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, moments[54].qpos[3:7])
    assert walk.heading == pytest.approx(np.arctan2(frame[3], frame[0]), abs=1e-5) and abs(walk.heading) > 0.02


def test_another_may_walk_before_in_other_physics():
    seen = []
    walk = Walk(tripod("x"), "leg_rm", strike=5, before=still("x", seen), model=damaged_model)
    assert [m.walker for m in walk.until(7)] == ["nobody"] * 5 + ["tripod"] * 2
    assert len(seen) == 5 and walk.heading == 0.0


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"task": "swim", "kind": "full"}, "policy is for task 'swim' by the observation 'full'"),
        ({"task": "x", "kind": "camera"}, "by the observation 'camera': this robot has x, xy, p2p and gives onboard, "),
        ({"task": "x", "kind": "onboard"}, "policy reads 7 numbers: this robot's observation onboard for x has 25"),
    ],
)
def test_a_policy_for_another_robot_is_refused(about, message):
    with pytest.raises(ValueError, match=message):
        by_policy(policy(**about))
