"""The learned estimator: what it is shown, what it says of damages that are not admitted, and that it learns."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import estimator
from experiments.estimating import network, training, walks
from experiments.estimating.network import Estimator, Network
from srl_jax.env.damage_names import parse
from srl_jax.env.senses import SIZE

CLASSES = 5  # four damages, and none of these
LESSONS = training.Course(updates=150, batch=64, block=50)


pytestmark = pytest.mark.slow  # of an experiment that nothing else depends on


@pytest.fixture(scope="module")
def walked(atlas):
    """Few robots of every class, and others of the same."""
    lots = [walks.lots(atlas, seed, each=each, healthy=each, none=each) for seed, each in ((0, 6), (1, 2))]
    return [walks.walked(atlas, own) for own in lots]


@pytest.fixture(scope="module")
def learned(walked):
    return training.calibrated(training.learn(walked[0], CLASSES, 0, LESSONS), walked[1], 0, 500)


@pytest.fixture(scope="module")
def fresh():
    """Of three damages, the second of which it has never seen."""
    params = Network(4).init(jax.random.key(0), network.standing())
    return Estimator(params, jnp.log(jnp.array([0.5, 0.0, 0.3, 0.2])), jnp.float32(1.0))


def test_a_robot_that_stands_and_is_whole_is_nothing_new():
    felt = jnp.zeros(SIZE).at[-1].set(-1.0)
    np.testing.assert_array_equal(network.row(jnp.zeros(18), felt, jnp.ones(18, bool)), network.standing()[0])
    silent = network.row(jnp.zeros(18), felt, jnp.ones(18, bool).at[3].set(False))
    assert np.flatnonzero(silent).tolist() == [SIZE + 18 + 3]


def test_the_window_is_of_the_last_second(walked):
    each = training.every_window(walked[1])
    rows = network.row(*(jnp.asarray(part[3]) for part in walked[1][:3]))
    np.testing.assert_allclose(each[3, 24], rows[5:25], atol=1e-6)
    np.testing.assert_allclose(each[3, 2], np.concatenate([network.standing()[3:], rows[:3]]), atol=1e-6)


def test_probabilities_are_normalised_and_none_is_of_what_was_never_seen(fresh):
    windows = jax.random.normal(jax.random.key(1), (3, 2, network.WINDOW, network.FEATURES))
    found = jnp.exp(network.log_probabilities(fresh, windows))
    assert found.shape == (3, 2, 4)
    np.testing.assert_allclose(found.sum(-1), 1.0, rtol=1e-5)
    assert np.all(found[..., 1] == 0.0) and np.all(found[..., [0, 2, 3]] > 0.0)


def test_what_is_not_admitted_or_was_never_seen_is_none_of_these(fresh):
    window = jax.random.normal(jax.random.key(2), network.standing().shape)
    found, share = np.exp(network.log_probabilities(fresh, window)), np.array([0.5, 0.0, 0.3, 0.2])
    likely = (1 - network.DOUBT) * found + network.DOUBT * share
    said = np.exp(network.log_likelihood(fresh, window, jnp.ones(3, bool)))
    np.testing.assert_allclose(said, likely[[0, 3, 2, 3]], rtol=1e-5)
    without = np.exp(network.log_likelihood(fresh, window, jnp.array([True, True, False])))
    np.testing.assert_allclose(without[[0, 1, 3]], [likely[0], *[likely[2] + likely[3]] * 2], rtol=1e-5)


def test_it_learns_to_tell_damages_apart(walked, learned):
    windows, label = training.every_window(walked[1]), walked[1].label
    found = np.asarray(jnp.argmax(network.log_probabilities(learned, windows), axis=-1))
    right, last = (found == label)[:, -20:], label[:, -1]
    assert right[(last == 1) | (last == 3)].mean() > 0.9, "lost legs, a second and more after they went"
    assert right[last < CLASSES - 1].mean() > 0.5, "any of the four; by chance .2"
    assert np.mean((found == label)[:, :5]) > 0.9, "all are healthy before it"
    assert sum(leaf.size for leaf in jax.tree.leaves(learned.params)) < 200_000


def test_the_temperature_is_that_of_held_out_walks(walked, learned):
    layers = learned.params["params"]
    head = {name: 0.5 * leaf for name, leaf in layers["Dense_0"].items()}
    unsure = learned._replace(params={"params": layers | {"Dense_0": head}})
    again = training.calibrated(unsure, walked[1], 0, 500)
    np.testing.assert_allclose(again.temperature, 0.5 * learned.temperature, rtol=0.04)  # a step of those tried


def test_who_has_seen_no_damage_learns_nothing(walked):
    healthy = walked[0]._replace(label=np.zeros_like(walked[0].label))
    with pytest.raises(ValueError, match="walks must be of healthy robots and of damaged ones"):
        training.learn(healthy, CLASSES, 0, LESSONS)


def test_a_second_network_never_sees_what_is_gone(atlas, monkeypatch):
    lots = walks.lots(atlas, 0, each=2, healthy=2, none=30)
    index = np.arange(len(lots))[:, None]
    drawn = [training.Drawn(lots, walks.Walks(*[index] * 4))] * 2
    monkeypatch.setattr(training, "taught", lambda *shown: shown)
    args = estimator.Args(Path(), updates=3)
    learned_from, held_out, classes, course = estimator.taught(atlas, drawn, args, ["leg_rm"])
    kept = [lots[i] for i in learned_from.label[:, 0]]
    assert [lot.label for lot in kept[:6]] == [0, 0, 2, 2, 3, 3] and len(kept) > 10
    assert {loss.kind for lot in kept for loss in parse(lot.damage)} == {"removed", "limp", "locked"}
    np.testing.assert_array_equal(held_out.felt, learned_from.felt)
    assert (classes, course.updates, course.block) == (5, 3, 3)
    assert len(estimator.taught(atlas, drawn, args)[0].label) == len(lots)
