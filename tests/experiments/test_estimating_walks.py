"""Walks to learn from: who goes through what, and that both physics change the same in other worlds."""

import numpy as np
import pytest

from experiments.estimating import simulated_walks, walks
from srl_jax.atlas.robots import CRobot
from srl_jax.env import damage as damages
from srl_jax.env.damage_names import canonical, lost, parse

pytestmark = pytest.mark.slow  # of an experiment that nothing else depends on


@pytest.fixture(scope="module")
def lots(atlas):
    return walks.lots(atlas, 5, each=2, healthy=3, none=2)


def test_lots_are_of_all_classes_and_always_the_same(atlas, lots):
    assert [lot.label for lot in lots] == [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    again = walks.lots(atlas, 5, each=2, healthy=3, none=2)
    assert [(lot.damage, lot.world, lot.seed) for lot in lots] == [(lot.damage, lot.world, lot.seed) for lot in again]
    assert len({lot.world for lot in lots}) == len(lots)
    for lot in lots:
        aware = lot.strike + walks.UNAWARE
        assert np.all(lot.policy[: lot.strike] == 0), "as the healthy do"
        assert lot.label in (0, 4) or lot.label in lot.policy[lot.strike :] or np.ptp(lot.policy[aware:]) > 0


def test_what_nobody_foresaw_is_none_of_the_names():
    random, names = np.random.default_rng(0), ("healthy", *lost(1))
    found = [walks.unforeseen(names, random) for _ in range(60)]
    assert not set(found) & set(names) and all(canonical(name) == name for name in found)
    assert {loss.kind for name in found for loss in parse(name)} == set(walks.KINDS)
    assert {len({loss.leg for loss in parse(name)}) for name in found} == {1, 2, 3}


@pytest.mark.parametrize("source", ["c", "star"])
def test_robots_walk_and_lose_their_servos_when_the_damage_strikes(atlas, lots, source):
    if source == "c":
        found = walks.walked(atlas, lots)
    else:
        found = simulated_walks.walked(atlas, lots, frictions=(0.8,), abreast=len(lots))
    assert found.felt.shape == (len(lots), walks.STEPS, 24) and np.isfinite(found.felt).all()
    assert np.abs(found.action).max() <= 1.0 and np.ptp(found.action, axis=1).min() > 0.0
    for i, lot in enumerate(lots):
        struck = np.arange(walks.STEPS) >= lot.strike
        there = np.asarray(damages.present(damages.build(lot.damage)))
        np.testing.assert_array_equal(found.answering[i], ~struck[:, None] | there)
        assert np.all(found.felt[i, :, :18][~found.answering[i]] == 0.0)
        np.testing.assert_array_equal(found.label[i], np.where(struck, lot.label, 0))
        assert np.all(found.felt[i, : lot.strike, 23] < -0.7), "upright before"


def test_both_physics_change_the_same_in_other_worlds(lots):
    robots, body = simulated_walks._robots(lots), CRobot(lots[4].damage, 0, 0, lots[4].world)
    for name in ("body_mass", "body_inertia", "actuator_gainprm", "actuator_biasprm"):
        for own, model in zip((robots.healthy, robots.damage), body._models, strict=True):
            np.testing.assert_allclose(getattr(own, name)[4], getattr(model, name), rtol=1e-5, atol=1e-12)
