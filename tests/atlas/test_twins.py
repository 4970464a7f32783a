"""Damages that a robot puts together: from servos that fall silent, and from what it felt."""

import numpy as np

from srl_jax.atlas import recovery, suspects, twins
from srl_jax.atlas.robots import CRobot
from srl_jax.env import damage
from srl_jax.env.senses import Senses

ACTORS = {"weight": np.arange(6.0).reshape(2, 3)}
VALUE = np.array([[1.0, 0.2], [0.4, 0.6]], np.float32)
WORTH = np.array([0.1, 0.9], np.float32)


def answering(name):
    return np.asarray(damage.present(damage.build(name)))


def composer(robots=2, explain=None):
    asked = []

    def imagine(own):
        asked.append(own)
        return WORTH

    made = twins.Composer(["healthy", "leg_rm"], imagine, explain, [twins.nobody(VALUE, ACTORS) for _ in range(robots)])
    return made, asked


def test_nobody_says_nothing():
    none = twins.nobody(VALUE, ACTORS)
    assert not none.admitted.any()
    np.testing.assert_allclose(none.value, [[0.6] * twins.ROOM, [0.5] * twins.ROOM])
    assert not none.graduated.any() and none.actors["weight"].shape == (twins.ROOM, 3)


def test_a_silence_that_lasts_becomes_a_hypothesis_once_for_all_robots():
    made, asked = composer()
    pattern, every = answering("leg_rm+leg_lf"), np.ones(2, bool)
    for robot in (0, 1):
        for _ in range(twins.PATIENCE - 1):
            made.listen(robot, pattern, every)
        assert made.added[robot] == []
        made.listen(robot, pattern, every)
        made.listen(robot, pattern, every)
        assert made.added[robot] == ["leg_rm+leg_lf"]
        assert made.twins[robot].admitted.tolist() == [True, False, False]
        np.testing.assert_array_equal(made.twins[robot].value[:, 0], WORTH)
    assert len(asked) == 1


def test_what_the_atlas_has_is_not_made_again_unless_it_was_left_out():
    made, asked = composer()
    for _ in range(twins.PATIENCE):
        made.listen(0, answering("leg_rm"), np.ones(2, bool))
        made.listen(1, answering("leg_rm"), np.array([True, False]))
    assert made.added == [[], ["leg_rm"]] and len(asked) == 1


def test_lost_packets_are_no_lost_legs_and_there_is_room_for_so_many():
    made, _ = composer(1)
    every = np.ones(2, bool)
    for name in ("leg_rf", "healthy", "leg_rf", "healthy"):
        for _ in range(twins.PATIENCE - 1):
            made.listen(0, answering(name), every)
    assert made.added == [[]]
    names = ["leg_rf", "leg_rf+leg_lf", "leg_rf+leg_lf+leg_lm", "leg_rf+leg_lf+leg_lr"]
    for name in names:
        for _ in range(twins.PATIENCE):
            made.listen(0, answering(name), every)
    assert made.added == [names[: twins.ROOM]]
    assert made.twins[0].admitted.all()


def test_a_robot_names_what_its_atlas_lacks(atlas):
    """Three legs are lost, which no hypothesis has; as many robots as other tests have, whose program this shares."""
    bodies = [CRobot("leg_rf+leg_rm+leg_lr", 5, seed) for seed in range(6)]
    story = recovery.run(atlas, bodies, seconds=2.0)
    assert story.twins == [["leg_rf+leg_rm+leg_lr"]] * 6
    own = np.exp(story.log_belief[:, :, len(atlas.damages)])
    assert np.all(own[: 5 + twins.PATIENCE - 1] == 0.0) and np.all(own[-1] > 0.9)


def felt(joints=0.0):
    return Senses(
        joints=np.full(18, joints, np.float32),
        speeds=np.zeros(18, np.float32),
        answering=np.ones(18, bool),
        gyroscope=np.zeros(3, np.float32),
        gravity=np.float32([0, 0, -1]),
        towards=np.float32([1, 0]),
        distance=np.float32(2),
        come=np.float32(0),
    )


def test_a_robot_that_is_none_of_these_searches_once_in_a_while_and_not_before():
    """Whoever judges holds any femur that is limp to be likely: it is found, once, for the robot that is strange."""
    searched = []
    limp = damage.build("femur_lm:limp").actuator_gainprm[:, 0]

    def explain(own, log):
        searched.append(log)
        return 20.0 * np.all(own.actuator_gainprm[:, :, 0] == limp, axis=1) - 100.0

    made, _ = composer(2, explain)
    every, still = np.ones(2, bool), np.zeros(18, np.float32)
    for step in range(suspects.STEPS + twins.AGAIN - 1):
        made.doubt(0, still, felt(), step != 5, every)
        made.doubt(1, still, felt(), False, every)
        assert (made.added == [["femur_lm:limp"], []]) == (step >= suspects.STEPS + 5)
    rounds = 3  # healthy, with one fault, with another that does not pay
    assert len(searched) == rounds and searched[0].action.shape == (suspects.STEPS, 18)
