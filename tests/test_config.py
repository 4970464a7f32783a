"""Presets, and sweeps as they arrive from the command line."""

import dataclasses
import subprocess
import sys

import pytest
import tyro

from srl_jax.agents import hyper, registry
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.config import ACTOR_CRITICS, Config, preset
from srl_jax.env.settings import TASKS, EnvConfig


def test_unknown_preset_names_the_choices():
    with pytest.raises(ValueError, match="preset is 'papper': choose default, paper, robot or smoke"):
        preset("papper")


@pytest.mark.parametrize("name", ["default", "paper", "robot", "smoke"])
def test_presets_are_consistent(name):
    config = preset(name)
    assert set(config.algos.split(",")) <= set(registry.names()) and config.task in TASKS
    train = config.train
    assert train.capacity % train.environments == 0
    assert train.checkpoint_every % train.evaluate_every == 0
    assert config.steps % train.evaluate_every == 0
    for algo in ACTOR_CRITICS:
        agent = getattr(config, algo)
        assert len(list(hyper.variants(agent))) == 1, "a preset must not sweep"
        assert agent.batch <= train.capacity
        assert agent.freeze[0] < config.steps
        if isinstance(agent, SRLConfig):
            assert agent.draws % agent.critics == 0
    assert isinstance(config.srl, SRLConfig) and not isinstance(config.ddpg, SRLConfig)


def test_paper_preset_is_its_table():
    config = preset("paper")
    assert (config.train.capacity, config.env.episode_steps, config.steps) == (1600, 2500, 7000 * 2500)
    for algo in ACTOR_CRITICS:
        agent = getattr(config, algo)
        assert agent.hidden == (1200, 1200, 1200, 1200, 600) and agent.batch == 300
        assert (agent.critic_optimiser, agent.actor_optimiser) == ("adam", "rmsprop")
        assert agent.actor_lr == agent.critic_lr == (3e-2,)
        assert agent.noise_decay == (0.9999,)
    assert config.srl.dropout_update and config.srl.length_scale[0] > 0.0, "its dropout is variational"
    assert config.evaluation.episodes > 1, "one environment does not mean one episode of judgement"


def test_algorithms_differ_where_they_should():
    config = Config()
    rivals = {config.ddpg.init: config.ddpg, config.ddpg_warm.init: config.ddpg_warm, "posterior": config.srl}
    assert set(rivals) == {"random", "behaviour", "posterior"}
    for name in ("hidden", "layer_norm", "batch", "critics", "critic_updates", "gamma", "tau", "freeze"):
        assert len({getattr(agent, name) for agent in rivals.values()}) == 1, f"{name} makes the comparison unequal"
    assert config.acteach.guidance_weight == (0.0,) and config.acteach.critic_loss == "alpha"
    assert not config.acteach.shared_masks and config.acteach.noisy_proposals


def test_configs_cannot_be_changed_in_place():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Config().steps = 1  # type: ignore[misc]


@pytest.mark.parametrize(
    ("text", "values"), [("0.1", (0.1,)), ("1e-3,3e-4", (1e-3, 3e-4)), ("1,0.5,0", (1.0, 0.5, 0.0))]
)
def test_sweeps_are_parsed_from_commas(text, values):
    parsed = tyro.cli(SRLConfig, args=["--beta", text], default=SRLConfig())
    assert parsed == SRLConfig(beta=values)


def test_sweeps_are_parsed_inside_a_run():
    config = tyro.cli(Config, args=["--srl.actor-lr", "1e-3,1e-4", "--ddpg.tau", "0.02"], default=preset("smoke"))
    assert config.srl.actor_lr == (1e-3, 1e-4) and config.ddpg.tau == (0.02,)
    assert config.srl.hidden == (32, 32), "the preset's other values stay"


@pytest.mark.parametrize("text", ["fast", "0.1;0.2", ""])
def test_a_sweep_that_is_no_number_is_refused(text, capsys):
    with pytest.raises(SystemExit):
        tyro.cli(DDPGConfig, args=["--tau", text])
    assert "tau" in capsys.readouterr().err


def test_an_algorithm_is_asked_for_by_name_whether_it_ships_or_not():
    from srl_jax.agents.settings import FrozenConfig

    config = Config().with_agents(srl=SRLConfig(beta=(0.9,)), other=FrozenConfig())
    assert config.agent("srl") is config.srl and config.srl.beta == (0.9,)
    assert config.agent("other") == FrozenConfig() and dict(config.more) == {"other": FrozenConfig()}
    assert config.agent("ddpg") == registry.settings("ddpg")
    with pytest.raises(ValueError, match="algos has 'nobody': choose from ddpg, srl"):
        config.agent("nobody")


def test_config_answers_without_jax():
    code = "import sys, srl_jax.config; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("changes", "solves"),
    [
        ({}, False),
        ({"algos": "ddpg, srl,ddpg_warm,acteach,tripod,pi_b"}, False),
        ({"algos": "srl,bac"}, True),
        ({"algos": "ite"}, True),
        ({"behaviour": "gait,repertoire"}, True),
        ({"env": EnvConfig(physics="mjx")}, True),
    ],
)
def test_which_programs_solve_linear_systems(changes, solves):
    assert dataclasses.replace(Config(), **changes).solves is solves
