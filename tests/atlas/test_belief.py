"""The posterior over damages: Bayes' rule under a hazard, what is left out, and 'none of these'."""

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.atlas import belief as beliefs
from srl_jax.atlas.belief import Belief, Likelihood
from srl_jax.env.senses import SIZE

ALL = jnp.ones(3, bool)
LIKELIHOOD = Likelihood(jnp.eye(SIZE))


def test_it_is_bayes_rule_where_damage_cannot_change():
    start, likelihoods = np.array([0.5, 0.2, 0.2, 0.1]), np.array([0.1, 0.4, 0.3, 0.2])
    after = beliefs.update(Belief(jnp.log(start)), jnp.log(likelihoods), beliefs.even(ALL), 0.0)
    np.testing.assert_allclose(np.exp(after.log), start * likelihoods / np.sum(start * likelihoods), rtol=1e-5)


def test_a_hazard_lets_certainty_go():
    certain = Belief(jnp.array([0.0, -80.0, -80.0, -80.0]))
    evidence = jnp.log(jnp.array([1e-6, 1.0, 1e-6, 1e-6]))
    stubborn = beliefs.update(certain, evidence, beliefs.even(ALL), 0.0)
    moved = beliefs.update(certain, evidence, beliefs.even(ALL), 0.01)
    assert stubborn.log[1] < -60.0
    np.testing.assert_allclose(np.exp(moved.log[1]), 0.0025 / (0.0025 + 1e-6), atol=1e-3)


def test_what_is_not_admitted_never_gains_belief():
    even = beliefs.even(jnp.array([True, False, True]))
    belief = beliefs.prior(even)
    for _ in range(5):
        belief = beliefs.update(belief, jnp.array([-9.0, 0.0, -5.0, -9.0]), even, 0.01)
    np.testing.assert_allclose(np.exp(belief.log).sum(), 1.0, rtol=1e-5)
    assert belief.log[1] == -np.inf and np.argmax(belief.log) == 2


def test_the_prior_is_healthy():
    belief = beliefs.prior(beliefs.even(ALL), healthy=0.9)
    np.testing.assert_allclose(np.exp(belief.log), [0.925, 0.025, 0.025, 0.025], rtol=1e-5)


def test_the_smaller_residual_is_likelier_and_none_of_these_wins_when_all_are_far_off():
    silent = jnp.zeros(3, jnp.int32)
    size = lambda *norms: jnp.array(norms)[:, None] * jnp.ones((1, SIZE)) / jnp.sqrt(SIZE)  # noqa: E731  |error|
    near = beliefs.log_likelihood(size(5.0, 6.0, 9.0), silent, ALL, LIKELIHOOD)
    assert np.argmax(near) == 0 and near[1] > near[2]
    far = beliefs.log_likelihood(size(9.0, 12.0, 15.0), silent, ALL, LIKELIHOOD)
    assert np.argmax(far) == 3
    assert far[0] == far[2], "beyond what a reading may say, all are alike"
    # Half the variance of a residual of this size pays for 24 log 2: there both are as likely.
    even = beliefs.log_likelihood(size(np.sqrt(2 * 24 * np.log(2) / 0.75), 20.0, 20.0), silent, ALL, LIKELIHOOD)
    np.testing.assert_allclose(even[0], even[3], atol=1e-3)


def test_none_of_these_borrows_from_no_hypothesis_that_is_left_out():
    errors = jnp.array([9.0, 0.0, 9.0])[:, None] * jnp.ones((1, SIZE))
    kept = jnp.array([True, False, True])
    with_it, without = (beliefs.log_likelihood(errors, jnp.zeros(3), who, LIKELIHOOD)[-1] for who in (ALL, kept))
    assert without < with_it


def test_servos_that_should_be_silent_are_evidence():
    errors = jnp.zeros((3, SIZE))
    seen = beliefs.log_likelihood(errors, jnp.array([0, 3, 1]), ALL, LIKELIHOOD)
    assert seen[0] > seen[2] > seen[1]
    odds = np.log(0.95 / 0.05)
    np.testing.assert_allclose(seen[0] - seen[:3], [0.0, 3 * odds, odds], rtol=1e-5)
    all_off = beliefs.log_likelihood(errors, jnp.array([3, 3, 4]), ALL, LIKELIHOOD)
    assert np.argmax(all_off) == 3, "a pattern of silence that no hypothesis has speaks for none of these"


def test_one_bad_reading_does_not_decide():
    wild = jnp.concatenate([jnp.full((1, SIZE), 1e3), jnp.zeros((2, SIZE))])
    seen = beliefs.log_likelihood(wild, jnp.zeros(3), ALL, LIKELIHOOD)
    np.testing.assert_allclose(seen[1] - seen[0], 0.5 * LIKELIHOOD.most / LIKELIHOOD.tempering, rtol=1e-5)
    assert jnp.isfinite(jax.grad(lambda e: beliefs.log_likelihood(e, jnp.zeros(3), ALL, LIKELIHOOD)[0])(wild)).all()
