"""Who walks: the rules against sums by hand, what is left out, and how long a choice is kept."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.atlas import choice as choices
from srl_jax.atlas.choice import Choice

# A specialist for each of two damages, and one who is fair under both.
MATRIX = jnp.array([[1.0, 0.0], [0.0, 1.0], [0.7, 0.6]])
EVERY = jnp.ones(3, bool)
KEY = jax.random.key(0)


def log(*belief):
    return jnp.log(jnp.array(belief))


def test_what_is_expected_leaves_none_of_these_out():
    np.testing.assert_allclose(choices.values(log(0.3, 0.1, 0.6), MATRIX), [0.75, 0.25, 0.675], rtol=1e-5)


@pytest.mark.parametrize(
    ("belief", "chosen"), [((0.98, 0.01, 0.01), 0), ((0.5, 0.49, 0.01), 2), ((0.01, 0.9, 0.09), 1)]
)
def test_greedy_is_the_best_of_the_expected(belief, chosen):
    assert choices.propose(log(*belief), MATRIX, EVERY, KEY, 0) == chosen


def test_thompson_draws_damages_and_likeliest_does_not():
    belief = log(0.6, 0.3, 0.1)
    draw = jax.vmap(lambda key: choices.propose(belief, MATRIX, EVERY, key, 1))
    drawn = np.bincount(draw(jax.random.split(KEY, 3_000)), minlength=3) / 3_000
    np.testing.assert_allclose(drawn, [2 / 3, 1 / 3, 0.0], atol=0.03)
    assert choices.propose(belief, MATRIX, EVERY, KEY, 2) == 0


def test_no_rule_takes_who_is_left_out():
    admitted = jnp.array([False, True, True])
    for rule in range(len(choices.RULES)):
        keys = jax.random.split(KEY, 50)
        assert 0 not in jax.vmap(lambda k, r=rule: choices.propose(log(0.9, 0.1, 0.0), MATRIX, admitted, k, r))(keys)


def test_an_unknown_rule_is_refused():
    with pytest.raises(ValueError, match="rule is 'best': choose one of greedy, thompson"):
        choices.number("best")


def test_a_choice_is_kept_until_it_is_old_or_clearly_worse():
    fresh, old = Choice(jnp.int32(0), jnp.int32(3)), Choice(jnp.int32(0), jnp.int32(20))
    commit = lambda choice, expected: choices.commit(  # noqa: E731
        choice, jnp.int32(1), jnp.array(expected), hold=20, margin=0.1
    )
    kept = commit(fresh, [0.5, 0.55])
    assert (kept.policy, kept.held) == (0, 4)
    for choice, expected in ((fresh, [0.5, 0.65]), (old, [0.5, 0.55])):
        taken = commit(choice, expected)
        assert (taken.policy, taken.held) == (1, 0)
    same = choices.commit(old, jnp.int32(0), jnp.array([0.5, 0.4]), hold=20, margin=0.1)
    assert (same.policy, same.held) == (0, 21)
