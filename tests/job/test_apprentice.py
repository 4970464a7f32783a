"""SRL in the twin: what is learned starts from a policy of the atlas, and one program serves all damages."""

import jax
import numpy as np
import pytest

from srl_jax.config import preset
from srl_jax.job.apprentice import Apprentice, configured


@pytest.fixture(scope="module")
def apprentice(atlas):
    return Apprentice(atlas, preset("smoke"))


def policy(atlas, index):
    return jax.tree.map(lambda leaf: leaf[index], atlas.actors)


def distance(x, y):
    return max(float(np.abs(a - b).max()) for a, b in zip(jax.tree.leaves(x), jax.tree.leaves(y), strict=True))


def test_a_lesson_is_srl_on_what_the_atlas_is_for(atlas):
    config = configured(atlas)
    assert (config.task, config.algos, config.env.observation) == ("x", "srl", "onboard")
    assert config.srl.hidden == (8, 8) and config.env.stride_starts > 0.0


@pytest.mark.slow
def test_stages_come_one_after_the_other_from_the_policy_that_was_given(atlas, apprentice):
    first = policy(atlas, 1)
    early, late = apprentice.learn("leg_rm+leg_lf", first, (400, 800))  # the actor is frozen for 400 steps
    assert distance(early, first) < 1e-3 < distance(late, first)
    assert jax.tree.structure(late) == jax.tree.structure(first)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(late))


@pytest.mark.slow
def test_the_same_is_learned_again_and_other_damage_asks_for_no_other_program(atlas, apprentice):
    taught = [
        next(iter(apprentice.learn(name, policy(atlas, 0), (800,)))) for name in ("leg_rf", "leg_rf", "femur_lm:limp")
    ]
    compiled = apprentice.engine._compiled
    assert distance(taught[0], taught[1]) == 0.0 and distance(taught[0], taught[2]) > 1e-4
    list(apprentice.learn("leg_lr", policy(atlas, 2), (200,)))
    assert apprentice.engine._compiled is compiled
