"""Learning on a simulated robot: in lock-step, beside the walk, after falls, and after kill -9."""

import contextlib
import dataclasses
import math
import multiprocessing
import os
import signal
import time

import numpy as np
import pytest

from srl_jax import portable
from srl_jax.agents import networks
from srl_jax.env.interface import ACTION_SIZE, facts, layout
from srl_jax.job import course as courses
from srl_jax.job.course import STATE, STUDENT, Course
from srl_jax.job.learner import Learner
from srl_jax.job.learning import Remote
from srl_jax.portable import Layer, Policy
from srl_jax.portable.policy import layers, parameters
from srl_jax.robot import outing
from srl_jax.robot.lessons import Lessons
from srl_jax.robot.odometer import Odometer
from srl_jax.robot.safety import StoppedError
from srl_jax.robot.simulate.wire import Overhead
from srl_jax.robot.student import Episode, Exploration, Step, Student
from tests.robot.made import standing

SIZE = sum(size for _, size in layout("x", "onboard"))
WIDTH = 8


@pytest.fixture
def policy():
    random = np.random.default_rng(0)
    draw = lambda *shape: random.normal(0.0, 0.2, shape).astype(np.float32)  # noqa: E731
    hidden = Layer(draw(SIZE, WIDTH), draw(WIDTH), np.ones(WIDTH, np.float32), draw(WIDTH))
    return Policy((hidden, Layer(0.1 * draw(WIDTH, ACTION_SIZE), 0.1 * draw(ACTION_SIZE))), about())


def about():
    return {"algo": "srl", "method": "srl", "damage": "healthy", "seed": 0} | facts("x", "onboard", 1.9)


@pytest.fixture
def quick(monkeypatch):
    """Courses learn from the 20th step, and save every 20."""
    whole = courses.settings

    def settings(course):
        agent, env, train = whole(course)
        agent = dataclasses.replace(agent, freeze=(0.0,), batch=16)
        return agent, env, dataclasses.replace(train, warmup=20, capacity=64)

    monkeypatch.setattr("srl_jax.job.learner.settings", settings)
    monkeypatch.setattr("srl_jax.job.learner.SAVE_EVERY", 20)


class Heard:
    """A learner that only listens."""

    def __init__(self):
        self.steps, self.taken, self.episodes = 0, [], []

    def take(self, step):
        self.taken.append(step)

    def ended(self, episode):
        self.episodes.append(episode)


def lessons(policy, learner, exploration=None, **more):
    own = standing()
    student = Student(policy, learner, Odometer(Overhead(own.clock), own.clock), exploration or Exploration())
    return own, Lessons(own.poses(), student, own.body.right, **more)


def steps(count, seed=0):
    random = np.random.default_rng(seed)
    draw = lambda size: random.normal(size=size).astype(np.float32)  # noqa: E731
    return [Step(draw(SIZE), np.tanh(draw(ACTION_SIZE)), float(draw(())) / 50, False, draw(SIZE)) for _ in range(count)]


def same(a, b):
    return all(np.array_equal(x, y) for one, two in zip(a, b, strict=True) for x, y in zip(one, two, strict=True))


def test_layers_are_parameters_and_back(policy):
    assert same(layers(parameters(policy.layers)), policy.layers)
    own = networks.Actor((WIDTH,), ACTION_SIZE, True)
    seen = np.linspace(-1.0, 1.0, SIZE, dtype=np.float32)
    assert np.asarray(own.apply(parameters(policy.layers), seen)) == pytest.approx(policy(seen), abs=1e-5)


def test_episodes_are_told_step_by_step_and_begin_in_the_stance(policy):
    heard = Heard()
    _, walk = lessons(policy, heard, episode=0.5)
    walk.run(1.2)
    assert [each.steps for each in heard.episodes] == [10, 20, 24] and len(heard.taken) == 24
    assert not any(each.fell for each in heard.episodes)
    for one, two in zip(heard.taken, heard.taken[1:10], strict=False):
        assert np.array_equal(one.next_observation, two.observation)
    begun = [heard.taken[place].observation for place in (0, 10, 20)]
    assert np.abs(begun[1][7:] - begun[0][7:]).max() < 0.1, "joints about the stance"
    assert heard.episodes[0].metres == pytest.approx(sum(step.progress for step in heard.taken[:10]))


def test_noise_is_that_of_the_exploration(policy):
    still, loud = Heard(), Heard()
    lessons(policy, still, exploration=Exploration(0.0))[1].run(1.0)
    lessons(policy, loud, exploration=Exploration(0.3))[1].run(1.0)
    off = lambda heard: np.array([x.action - policy(x.observation) for x in heard.taken])  # noqa: E731
    assert np.abs(off(still)).max() < 1e-6
    noise = off(loud)
    assert 0.2 < noise.std() < 0.4 and np.corrcoef(noise[1:].ravel(), noise[:-1].ravel())[0, 1] > 0.6


def test_a_fall_ends_an_episode_and_somebody_puts_it_right(policy):
    heard, told = Heard(), []
    own, walk = lessons(policy, heard, episode=1.0, told=told.append)

    def react(now, sensed):
        if now == pytest.approx(0.5):
            own.body.data.qpos[3:7] = 0.0, 1.0, 0.0, 0.0  # on its back

    walk.react = react
    assert outing.go(own.poses(), walk, 1.5) == ""
    assert [each.fell for each in told][:2] == [True, False] and heard.taken[told[0].steps - 1].fell
    assert sum(step.fell for step in heard.taken) == 1
    assert own.body.report()["upright"] > 0.98 and own.body.report()["torque"] == 0


def test_the_key_ends_an_episode_and_a_stop_all(policy):
    heard = Heard()
    own, walk = lessons(policy, heard, episode=5.0)
    until = own.clock.now() + 0.52
    walk.over = lambda: until < own.clock.now() < until + 0.06
    walk.poses.stop = lambda: own.clock.now() > until + 2.0
    walk.run(60.0)
    assert len(heard.episodes) == 2 and 8 <= heard.episodes[0].steps <= 11
    assert own.clock.now() < until + 2.2


def test_nobody_who_sees_it_is_no_step(policy):
    heard = Heard()
    _, walk = lessons(policy, heard, episode=0.5)
    walk.student.odometer.come = lambda: math.nan
    walk.run(0.5)
    assert heard.taken == []


def test_lock_step_is_the_same_every_time_and_moves_the_student(policy, quick, tmp_path):
    found = []
    for name in ("a", "b"):
        learner = Learner(Course(policy, tmp_path / name))
        _, walk = lessons(policy, learner, episode=1.0)
        walk.run(2.0)
        assert (learner.steps, learner.updates) == (40, 42)
        assert same(walk.student.policy.layers, learner.layers)
        found.append((learner.layers, [x.metres for x in learner.episodes]))
    assert same(found[0][0], found[1][0]) and found[0][1] == found[1][1]
    assert not same(found[0][0], policy.layers)


def test_a_course_goes_on_as_if_it_had_not_ended(policy, quick, tmp_path):
    whole, first = Learner(Course(policy, tmp_path / "a")), Learner(Course(policy, tmp_path / "b"))
    taken = steps(100)  # the replay has room for 64
    for step in taken:
        whole.take(step)
    for step in taken[:70]:  # saved after 60
        first.take(step)
    second = Learner(Course(policy, tmp_path / "b", resume=True))
    assert second.steps == 60
    for step in taken[60:]:
        second.take(step)
    assert same(whole.layers, second.layers) and whole.updates == second.updates
    second.save()
    assert same(portable.load(tmp_path / "b" / STUDENT)[0].layers, second.layers)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"algo": "ddpg_warm"}, "learned with algo srl, updates 2, seed 0 and this behaviour, not with algo ddpg_warm"),
        ({"policy": 1}, "and another behaviour"),
        ({"broken": True}, "cannot be read as what a robot has learned"),
    ],
)
def test_another_course_is_one_sentence(other, message, policy, quick, tmp_path):
    Learner(Course(policy, tmp_path)).save()
    if other.pop("broken", False):
        (tmp_path / STATE).write_bytes(b"PK")
    if other.pop("policy", None):
        other["policy"] = dataclasses.replace(policy, layers=tuple(x.map(lambda v: v + 1) for x in policy.layers))
    with pytest.raises(ValueError, match=message):
        Learner(dataclasses.replace(Course(policy, tmp_path, resume=True), **other))


@pytest.mark.slow
def test_a_learner_beside_the_walk_answers_and_goes_on_after_kill_9(policy, tmp_path):
    course = Course(policy, tmp_path)
    with contextlib.ExitStack() as stack:
        remote = stack.enter_context(Remote(course))
        assert same(remote.start, policy.layers)
        for step in steps(205):
            assert remote.take(step) is None or remote.updates
        remote.ended(Episode(205, 5.0, 0.5, False))
        until, newest = time.monotonic() + 60.0, None
        while newest is None and time.monotonic() < until:
            time.sleep(0.05)
            newest, remote._newest = remote._newest, None
        assert newest is not None and remote.updates > 0
        (child,) = multiprocessing.active_children()
        assert child.pid is not None
        os.kill(child.pid, signal.SIGKILL)
        child.join()
        with pytest.raises(StoppedError, match="the learner has gone"):
            for step in steps(3):
                remote.take(step)
    with Remote(dataclasses.replace(course, resume=True)) as again:
        assert again.steps == 200
        again.ended(Episode(205, 5.0, 0.5, False))
    ended = Learner(dataclasses.replace(course, resume=True))
    assert (ended.steps, len(ended.episodes)) == (200, 1)


def test_what_the_learner_refuses_is_one_sentence_here(policy, tmp_path):
    with pytest.raises(ValueError, match=r"cannot be read|does not exist"):
        Remote(Course(policy, tmp_path, resume=True))
