"""Every experiment runs, in its smallest form, from its words on the command line to its figures."""

import dataclasses
from importlib import import_module
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tyro

from experiments import cross_check, estimator, recovery, robot_posterior, throughput
from srl_jax.atlas import file
from srl_jax.config import preset
from srl_jax.env.hexapod import observation_size
from tests.conftest import DEVICES
from tests.job.untrained import write

WORDS = {  # OUT is a file, RUN a finished run, ATLAS an atlas
    "bandit_table": "--repetitions 4 --samples 5 --out OUT",
    "cross_check": "RUN --algos srl --episodes 1 --seeds 1",
    "estimator": "ATLAS --converged 1 --simulated 0 --updates 2 --robots 6 --healthy 6 --healthy-seconds 0.5 --every 0 "
    "--seconds 0.05 --rows foreseen",
    "healthy_value": "--episodes 4 --seen 2 --whole 4 --damage healthy leg_rm --members 2 --masks 2 --updates 2",
    "lqr": "--repetitions 4 --trajectories 5 --critic-steps 100 --out OUT",
    "peers": "--sections job --contenders ours --preset smoke --seeds 1 --steps 20 --seconds 0.01 --repeats 1 "
    "--no-cold --out OUT",  # its other parts: test_contenders
    "pendulum": "--algo srl --seeds 2 --steps 8",
    "physics_error": "--episodes 1",
    "plain_loop": "--steps 8",
    "posterior_quality": "--problems 2 --members 2 --rates 0.1 --updates 4 --out OUT",
    "recovery": "ATLAS --rows pairs --methods posterior trials --robots 6 --seconds 2 --figure OUT",
    "render_robot": "--width 40 --height 30 --oversample 1 --painter plain --path OUT",
    "robot_bus": "--rows faults losses fuzz --seconds 1 --starts 1 --legs rm --packets 100",
    "robot_learning": "--minutes 0.02 --episodes 1 --updates 1 --figure OUT",
    "robot_posterior": "RUN --seeds 2 --robots 1 --visits 2 --horizon 4 --draws 20",
    "self_model": "--damages tibia_rm,leg_rm --motions 2 --probes 1 --steps 3 --seeds 2 --out OUT",
    "shipped": "--tasks x --names srl --seconds 0.1 --starts 1",
    "sweep_simulation": "--nodes 4 --lanes 64 --steps 1000 --pack-lanes 16 --intervals 60 --seeds 1",
    "teaching": "--tasks pendulum --methods ddpg --teachers good --seeds 2 --steps 4",
    "throughput": "--preset smoke --lanes 4 --vector-steps 2 --repeats 1",
    "tune_gait": "--population 16 --generations 1 --goals 1 --test 16 --steps 2 --out OUT",
}
SHOWN = {  # a part of what is printed
    "bandit_table": "Monte-Carlo",
    "cross_check": "leg_rm",
    "estimator": "both: expected calibration error",
    "healthy_value": "healthy episodes, 100% truncated at 2 steps",
    "lqr": "actor-critic, correlated",
    "peers": "| ours | ",
    "pendulum": "srl: -",
    "physics_error": "Coarse settings against converged physics",
    "plain_loop": "Returns of the episodes: -",
    "posterior_quality": "ensemble × dropout 0.1",
    "recovery": "thought of first / policy",
    "render_robot": ".png",
    "robot_bus": "refused, 0 packets sent",
    "robot_learning": "24 steps learned from, 0 updates",
    "robot_posterior": "all",
    "self_model": "2 damages, 2 seeds, truth in mjx",
    "shipped": "tibia_rf",
    "sweep_simulation": "64 lanes of 1,000 steps",
    "teaching": "| pendulum | good | ddpg | -",
    "throughput": f"{DEVICES} devices; C MuJoCo",
    "tune_gait": "x_in_fine_c",
}
SLOW = {
    *("cross_check", "estimator", "healthy_value", "lqr", "peers", "pendulum", "physics_error", "recovery"),
    *("plain_loop", "robot_learning", "robot_posterior", "self_model", "teaching", "throughput", "tune_gait"),
}
OBSERVATION = np.zeros(observation_size("p2p", preset("smoke").env), np.float32)
# On runs that are finished: see the tests of their names.
ELSEWHERE = {"atlases", "changed_robots", "figure3", "lone_robot", "losses21", "walking"}


def test_every_experiment_has_a_smallest_form():
    found = {path.stem for path in (Path(__file__).parents[2] / "experiments").glob("[!_]*.py")}
    assert found == {*WORDS, *ELSEWHERE} and set(SHOWN) == set(WORDS)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in WORDS])
def test_it_runs(name, request, tmp_path, capsys, monkeypatch):
    module, out = (
        import_module(f"experiments.{name}"),
        tmp_path / ("figure.png" if name != "tune_gait" else "gait.json"),
    )
    for asks in (throughput, recovery, estimator):
        monkeypatch.setattr(asks, "use_devices", lambda wanted, **_: DEVICES)  # jax has started
    words = WORDS[name].replace("OUT", str(out)).split()
    if "RUN" in words or name == "throughput":  # whose program is that of the smoke run, compiled once
        run = str(request.getfixturevalue("smoke_run")[0])
        words = [run if word == "RUN" else word for word in words]
    if "ATLAS" in words:
        file.save(tmp_path / "atlas.npz", request.getfixturevalue("atlas"))
        words = [str(tmp_path / "atlas.npz") if word == "ATLAS" else word for word in words]
    if name in ("pendulum", "plain_loop"):
        tyro.cli(module.main, args=words)
    else:
        module.main(tyro.cli(getattr(module, "Args", None) or module.Arguments, args=words))
    assert SHOWN[name] in capsys.readouterr().out
    assert out.exists() == ("OUT" in WORDS[name])


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """A run whose methods have little in common, in the middle of whose training the damage changed."""
    base = preset("smoke")
    config = dataclasses.replace(base, algos="tripod,bpg,acteach", damage_schedule="healthy@0,leg_rm@800")
    config = config.with_agents(acteach=dataclasses.replace(base.acteach, dropout=(0.1, 0.2), gamma=(0.9,)))
    directory = tmp_path_factory.mktemp("mixed") / "run"
    write(config, directory)
    return directory


def test_students_of_any_algorithm_are_checked_under_their_last_damage(mixed, capsys, monkeypatch):
    seen = []

    def rolled(run, lane, episodes):
        assert np.isfinite(run.policy(lane)(OBSERVATION)).all()
        seen.append((lane.method, run.damage(lane)))
        return np.full((3, episodes, 2), 0.25 * lane.seed)

    monkeypatch.setattr(cross_check, "roll", rolled)
    cross_check.main(cross_check.Arguments(mixed, episodes=1, seeds=2))
    methods = ["tripod", "bpg", "acteach dropout=0.1", "acteach dropout=0.2"]
    assert seen == [(method, "leg_rm") for method in methods for _ in range(2)]
    assert capsys.readouterr().out.count("0.12, 0.1") == 3 * 4
    with pytest.raises(ValueError, match=r"algo is 'srl': .* has tripod, bpg, acteach"):
        cross_check.main(cross_check.Arguments(mixed, algos="srl"))


def test_the_posterior_of_any_descendant_of_srl_is_judged_with_its_own_values(mixed, capsys, monkeypatch):
    def judged(robot, config, sizes, lane, damage, key):
        visits, _, draws = sizes
        assert lane.policy(OBSERVATION).shape == lane.teacher(OBSERVATION).shape == (18,)
        assert {leaf.shape[0] for leaf in jax.tree.leaves(lane.critic)} == {config.critics}
        own = 10.0 * lane.dropout + lane.gamma + 0.01 * jax.random.normal(key, (visits,))
        claimed = 10.0 * lane.dropout + 0.01 * jax.random.normal(key, (visits, draws, 2))
        came = jnp.stack([own, own + 1.0, own - 2.0, own + 3.0], axis=1)  # with pi_B for no step, one, a second, all
        return robot_posterior.Judged(jnp.full(visits, 0.6), claimed, came), jnp.ones(visits, bool)

    monkeypatch.setattr(robot_posterior, "judge", judged)
    robot_posterior.main(robot_posterior.Arguments(mixed, algo="acteach", seeds=2, robots=3, visits=4))
    verdicts, worths = capsys.readouterr().out.split("Q of")
    for name in ("leg_rm dropout=0.1", "leg_rm dropout=0.2", "all dropout=0.1", "all dropout=0.2"):
        verdict, worth = (next(x for x in text.splitlines() if name in x).split() for text in (verdicts, worths))
        assert verdict[2:5] == ["24", "1.00", "1.00"]  # pi_B's step is better everywhere, and is said to be
        assert [x for x in verdict if x in ("1.00", "0.00")] == ["1.00", "1.00", "0.00", "1.00"]  # not its second
        assert verdict[-1] == "0.40"  # where .6 was said
        assert worth[6] == "+0.90", "the student's return is gamma, .9, above what was claimed"
        assert worth[-2] == "+1.90", "and that of pi_B's step 1 more"


def test_following_is_judged_by_what_comes_of_it():
    rows = lambda *x: np.broadcast_to(np.float32(x), (1, 2, 6, len(x)))  # noqa: E731  [lane, robot, visit]
    draws = np.linspace(-1.0, 1.0, 24, dtype=np.float32)[:, None] + np.float32([0.0, 3.0])
    probability = np.tile(np.float32([0.0, 1.0]), 6).reshape(1, 2, 6)
    came = rows(0.0, 0.0, 1.0, 2.5) * np.where(probability > 0.5, 1.0, -1.0)[..., None]
    draws = np.broadcast_to(draws, (1, 2, 6, *draws.shape))
    judged = robot_posterior.Judged(probability, draws, came)
    alive = np.ones((1, 2, 6), bool)
    verdict = robot_posterior.verdict_row("all", judged, alive, claimed=3)
    assert verdict[1:] == ["12", "0.50", "0.00", "one outcome only", *("0.50", "1.00 [1.00, 1.00]") * 2, "0.00"]
    worth = robot_posterior.worth_row("all", judged, alive, claimed=3)
    assert worth[1] == "1.00 1.00 1.00" and worth[3] == "+0.00"
    assert worth[5] == "0.50 0.50 0.50" and worth[7] == "-3.00", "pi_B returns 2.5 or -2.5, and 3 was believed"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"algo": "tripod"}, r"algo is 'tripod', whose critic has no posterior: of .* choose acteach"),
        ({"algo": "srl"}, r"algo is 'srl': .* has tripod, bpg, acteach"),
        ({"draws": 19}, r"draws is 19; a multiple of the 1 critics, at least 20"),
        ({"visits": 40}, r"visits is 40; fewer than the 40 steps of an episode"),
        ({"robots": 0}, r"robots is 0; at least 1"),
    ],
)
def test_what_has_no_posterior_is_refused(mixed, changed, message):
    with pytest.raises(ValueError, match=message):
        robot_posterior.main(dataclasses.replace(robot_posterior.Arguments(mixed, algo="acteach"), **changed))
