"""What policies are worth: the normal prior of the belief, and trials, against the same sums written out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.atlas import trials as trial
from srl_jax.atlas.trials import Prior, Trials

# Two policies that do as well as each other everywhere, one that does well where they do not.
MATRIX = jnp.array([[1.0, 0.2, 0.6], [0.9, 0.1, 0.7], [0.1, 0.9, 0.3]])
STRANGE = jnp.log(jnp.array([0.15, 0.1, 0.05, 0.7]))
PRIOR = Prior(memory=4.0)


def written_out(seen, prior=PRIOR):
    """Mean and covariance of the posterior by the textbook's formulae."""
    worth = trial.expect(STRANGE, MATRIX, prior, learned=1)
    mean, factor, own = (np.asarray(x, np.float64) for x in worth)
    np.testing.assert_allclose(own, [prior.own, prior.own, prior.learned], rtol=1e-6)
    covariance = factor @ factor.T + np.diag(own**2)
    who = [policy for policy, _ in seen]
    noise = np.diag([prior.noise**2 * 2.0 ** (age / prior.memory) for age in range(len(seen))][::-1])
    gain = covariance[:, who] @ np.linalg.inv(covariance[np.ix_(who, who)] + noise)
    return mean + gain @ (np.array([y for _, y in seen]) - mean[who]), covariance - gain @ covariance[who]


def recorded(seen, room=6):
    trials = trial.none(room)
    for policy, worth in seen:
        trials = trial.record(trials, jnp.int32(policy), jnp.float32(worth))
    return trials


def test_what_is_expected_is_the_beliefs_where_a_damage_is_known():
    known = trial.expect(jnp.log(jnp.array([1e-9, 1.0, 1e-9, 1e-9])), MATRIX)
    np.testing.assert_allclose(known.mean, MATRIX[:, 1], atol=1e-4)
    assert np.abs(known.factor).max() < 1e-3, "nothing is left to find out but each policy's own"
    strange = trial.expect(STRANGE, MATRIX)
    assert np.all(np.linalg.norm(strange.factor, axis=1) > 0.1)


@pytest.mark.parametrize("seen", [[(0, 0.1)], [(0, 0.1), (2, 0.8), (0, 0.3), (1, 0.2)]])
def test_the_mean_is_the_textbooks(seen):
    worth = trial.expect(STRANGE, MATRIX, PRIOR, learned=1)
    np.testing.assert_allclose(trial.mean(worth, recorded(seen), PRIOR), written_out(seen)[0], atol=1e-4)


@pytest.mark.parametrize("seen", [[], [(0, 0.1), (2, 0.8), (0, 0.3)]])
def test_the_deviation_of_what_comes_next_is_the_textbooks_with_noise(seen):
    worth = trial.expect(STRANGE, MATRIX, PRIOR, learned=1)
    covariance = written_out(seen)[1]
    for policy in range(3):
        expected = np.sqrt(covariance[policy, policy] + PRIOR.noise**2)
        found = trial.deviation(worth, recorded(seen), jnp.int32(policy), PRIOR)
        np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_a_trial_speaks_of_those_that_are_alike():
    worth = trial.expect(STRANGE, MATRIX, PRIOR, learned=1)
    bad = trial.mean(worth, recorded([(0, -0.3)]), PRIOR) - worth.mean
    assert bad[0] < -0.3 and bad[1] < -0.3 and bad[2] > 0.0


def test_draws_have_the_posteriors_mean_and_covariance():
    seen = [(0, 0.1), (1, 0.3)]
    worth = trial.expect(STRANGE, MATRIX, PRIOR, learned=1)
    keys = jax.random.split(jax.random.key(0), 20_000)
    draws = np.asarray(jax.vmap(lambda key: trial.draw(worth, recorded(seen), key, PRIOR))(keys))
    mean, covariance = written_out(seen)
    np.testing.assert_allclose(draws.mean(axis=0), mean, atol=0.01)
    np.testing.assert_allclose(np.cov(draws.T), covariance, atol=0.005)


def test_there_is_room_for_the_latest_alone():
    trials = recorded([(0, 0.0), (1, 0.1), (2, 0.2)], room=2)
    assert trials.policy.tolist() == [1, 2] and int(trials.count) == 2
    np.testing.assert_allclose(trials.worth, [0.1, 0.2])


def test_without_trials_nothing_is_changed():
    worth = trial.expect(STRANGE, MATRIX)
    empty = Trials(jnp.array([2, 1]), jnp.array([9.0, 9.0]), jnp.int32(0))
    np.testing.assert_array_equal(trial.mean(worth, empty), worth.mean)
