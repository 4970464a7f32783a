"""Who walks: whom the rules name, what a segment is, and when the policy in command is changed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.atlas import choice as choices
from srl_jax.atlas.choice import Choice, Pace

EVERY = jnp.ones(3, bool)
KEY = jax.random.key(0)
PACE = Pace(hold=5, settle=2, margin=0.1)
MEAN, DRAW, LIKELIEST = jnp.array([0.6, 0.5, 0.1]), jnp.array([0.3, 0.5, 0.1]), jnp.array([0.0, 0.2, 0.9])


def test_each_rule_names_its_best():
    assert choices.proposals(MEAN, DRAW, LIKELIEST, EVERY, KEY)[:3].tolist() == [0, 1, 2]
    keys = jax.random.split(KEY, 300)
    uniform = jax.vmap(lambda key: choices.proposals(MEAN, DRAW, LIKELIEST, EVERY, key)[3])(keys)
    assert np.bincount(uniform, minlength=3).min() > 60


def test_no_rule_takes_who_is_left_out():
    admitted = jnp.array([False, True, True])
    keys = jax.random.split(KEY, 50)
    named = jax.vmap(lambda key: choices.proposals(MEAN, DRAW, LIKELIEST, admitted, key))(keys)
    assert not np.any(named == 0) and np.all(named[:, 0] == 1)


def test_an_unknown_rule_is_refused():
    assert choices.number("thompson") == 1
    with pytest.raises(ValueError, match="rule is 'best': choose one of greedy, thompson"):
        choices.number("best")


def test_a_segment_counts_from_when_the_gait_has_settled():
    choice, seen = Choice(jnp.int32(1), jnp.int32(0), jnp.float32(jnp.nan)), []
    for come in (0.0, 0.1, 0.5, 0.9, 1.3):  # 0.4 m a step from the second on
        choice, over, walked = choices.segment(choice, jnp.float32(come), PACE)
        seen.append((bool(over), float(walked)))
    assert [over for over, _ in seen] == [False] * 4 + [True]
    assert np.isnan([walked for _, walked in seen[:-1]]).all() and seen[-1][1] == pytest.approx(0.4)
    _, _, untold = choices.segment(choice._replace(begun=jnp.float32(jnp.nan)), jnp.float32(jnp.nan), PACE)
    assert np.isnan(untold), "a robot that nobody tells how far it came tries nothing"


@pytest.mark.parametrize(
    ("over", "mean", "open_minded", "policy"),
    [
        (False, [0.5, 0.55, 0.0], True, 0),  # hardly better: kept
        (False, [0.5, 0.65, 0.0], True, 1),  # clearly better
        (False, [0.5, 0.65, 0.0], False, 0),  # but trials tell more than the belief
        (True, [0.5, 0.45, 0.0], True, 1),  # the segment is over: the proposed one
    ],
)
def test_when_the_policy_changes(over, mean, open_minded, policy):
    now = Choice(jnp.int32(0), jnp.int32(3), jnp.float32(0.1))
    new = choices.decide(now, jnp.bool_(over), jnp.int32(1), jnp.array(mean), EVERY, jnp.bool_(open_minded), PACE)
    changed = over or policy == 1
    assert (int(new.policy), int(new.held)) == (policy, 0 if changed else 3)
    assert bool(np.isnan(new.begun)) == changed
