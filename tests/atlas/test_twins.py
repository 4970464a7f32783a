"""Damages that a robot puts together from servos that fall silent."""

import numpy as np
import pytest

from srl_jax.atlas import recovery, twins
from srl_jax.atlas.robots import CRobot
from srl_jax.env import damage, damage_names
from srl_jax.env.damage_names import catalogue, lost

VALUE = np.array([[1.0, 0.2], [0.4, 0.6]], np.float32)
WORTH = np.array([0.1, 0.9], np.float32)


def answering(name):
    return np.asarray(damage.present(damage.build(name)))


@pytest.mark.parametrize("name", [*(n for n in catalogue()[1:] if ":" not in n), *lost(3), "tibia_rf+femur_lm+leg_rr"])
def test_a_loss_of_links_is_known_by_its_silence(name):
    assert twins.composed(answering(name)) == damage_names.canonical(name)


def test_no_silence_and_silence_that_no_loss_explains_are_nothing():
    assert twins.composed(np.ones(18, bool)) is None
    before_one_that_answers = np.ones(18, bool)
    before_one_that_answers[3] = False  # the coxa of the right middle leg, whose tibia answers
    assert twins.composed(before_one_that_answers) is None


def composer(robots=2):
    asked = []

    def imagine(own):
        asked.append(own)
        return WORTH

    made = twins.Composer(["healthy", "leg_rm"], imagine, [twins.nobody(VALUE) for _ in range(robots)])
    return made, asked


def test_nobody_says_nothing():
    none = twins.nobody(VALUE)
    assert not none.admitted.any()
    np.testing.assert_allclose(none.value, [[0.6, 0.6], [0.5, 0.5]])


def test_a_silence_that_lasts_becomes_a_hypothesis_once_for_all_robots():
    made, asked = composer()
    pattern, every = answering("leg_rm+leg_lf"), np.ones(2, bool)
    for robot in (0, 1):
        for _ in range(twins.PATIENCE - 1):
            made.watch(robot, pattern, every)
        assert made.added[robot] == []
        made.watch(robot, pattern, every)
        made.watch(robot, pattern, every)
        assert made.added[robot] == ["leg_rm+leg_lf"]
        assert made.twins[robot].admitted.tolist() == [True, False]
        np.testing.assert_array_equal(made.twins[robot].value[:, 0], WORTH)
    assert len(asked) == 1


def test_what_the_atlas_has_is_not_made_again_unless_it_was_left_out():
    made, asked = composer()
    for _ in range(twins.PATIENCE):
        made.watch(0, answering("leg_rm"), np.ones(2, bool))
        made.watch(1, answering("leg_rm"), np.array([True, False]))
    assert made.added == [[], ["leg_rm"]] and len(asked) == 1


def test_lost_packets_are_no_lost_legs_and_there_is_room_for_so_many():
    made, _ = composer(1)
    every = np.ones(2, bool)
    for name in ("leg_rf", "healthy", "leg_rf", "healthy"):
        for _ in range(twins.PATIENCE - 1):
            made.watch(0, answering(name), every)
    assert made.added == [[]]
    for name in ("leg_rf", "leg_rf+leg_lf", "leg_rf+leg_lf+leg_lm"):
        for _ in range(twins.PATIENCE):
            made.watch(0, answering(name), every)
    assert made.added == [["leg_rf", "leg_rf+leg_lf"]]
    assert made.twins[0].admitted.all()


def test_a_robot_names_what_its_atlas_lacks(atlas):
    """Three legs are lost, which no hypothesis has; as many robots as other tests have, whose program this shares."""
    bodies = [CRobot("leg_rf+leg_rm+leg_lr", 5, seed) for seed in range(6)]
    story = recovery.run(atlas, bodies, seconds=2.0)
    assert story.twins == [["leg_rf+leg_rm+leg_lr"]] * 6
    own = np.exp(story.log_belief[:, :, len(atlas.damages)])
    assert np.all(own[: 5 + twins.PATIENCE - 1] == 0.0) and np.all(own[-1] > 0.9)
