"""Which stepper a setting stands for, and how the faster one is found."""

import jax
import pytest

from srl_jax.env import physics
from srl_jax.env.model import load_model, put_model
from srl_jax.env.star.constants import Star
from srl_jax.env.star.refusals import NotAStarError
from tests.env.star.robots import hopper

SLIPPERY = ('name="hinge"', 'name="hinge" frictionloss="0.1"')


@pytest.fixture
def gpu(monkeypatch):
    """As if there were one; (seconds of the star stepper, of MJX) -> the models that were timed."""
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    physics._faster_for_shipped.cache_clear()

    def takes(star: float, mjx: float) -> list:
        def time_step(stepper, model):
            timed.append((stepper is not None, model.nv))
            return mjx if stepper is None else star

        timed: list = []
        monkeypatch.setattr(physics, "time_step", time_step)
        return timed

    yield takes
    physics._faster_for_shipped.cache_clear()


# The shipped robot


def test_mjx_is_mjx():
    assert physics.choose("mjx") is None and physics.choose("mjx", put_model(hopper())) is None


@pytest.mark.parametrize("setting", ["star", "auto"])
def test_on_a_cpu_the_shipped_robot_is_one_star(setting):
    star = physics.choose(setting)
    assert isinstance(star, Star) and star is physics.shipped_star()
    assert star.legs == 6


def test_another_word_is_refused():
    with pytest.raises(ValueError, match=r"^physics is 'warp': choose one of auto, star, mjx\.$"):
        physics.choose("warp")


def test_an_accelerator_takes_the_faster_one_and_measures_once(gpu):
    timed = gpu(star=1.0, mjx=2.0)
    assert physics.choose("auto") is physics.choose("auto") is physics.shipped_star()
    assert timed == [(True, 24), (False, 24)]


def test_an_accelerator_takes_mjx_where_that_is_faster(gpu):
    timed = gpu(star=2.0, mjx=1.0)
    assert physics.choose("auto") is None and physics.choose("auto") is None
    assert timed == [(True, 24), (False, 24)]


@pytest.mark.parametrize("setting", ["star", "mjx"])
def test_a_setting_without_choice_measures_nothing(gpu, setting):
    timed = gpu(star=2.0, mjx=1.0)
    assert physics.choose(setting) is (physics.shipped_star() if setting == "star" else None)
    assert timed == []


# Other robots


def test_another_robot_is_read():
    star = physics.choose("auto", put_model(hopper()))
    assert star is not None and star.legs == 1
    assert physics.choose("auto") is physics.shipped_star()


def test_a_robot_that_is_no_star_is_stepped_by_mjx_or_refused():
    model = put_model(hopper(SLIPPERY))
    assert physics.choose("auto", model) is None
    with pytest.raises(NotAStarError, match="joint 'hinge' has friction loss"):
        physics.choose("star", model)


def test_the_shipped_robot_may_be_edited_into_no_star(monkeypatch):
    edited = load_model()
    edited.dof_frictionloss[-1] = 0.1
    monkeypatch.setattr(physics, "load_model", lambda _: edited)
    physics._star.cache_clear()
    assert physics.choose("auto") is None
    with pytest.raises(NotAStarError, match="joint 'tibia_lr' has friction loss"):
        physics.choose("star")
    physics._star.cache_clear()


def test_an_accelerator_measures_the_robot_that_is_asked_for(gpu):
    timed = gpu(star=1.0, mjx=2.0)
    star = physics.choose("auto", put_model(hopper()))
    assert star is not None and star.legs == 1
    assert timed == [(True, 7), (False, 7)]


@pytest.mark.slow
def test_steps_of_both_steppers_are_timed():
    model = put_model(hopper())
    for star in (physics.choose("star", model), None):
        assert physics.time_step(star, model, robots=3, repeats=2) > 0
