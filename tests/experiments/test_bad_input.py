"""Experiments refuse bad input in one sentence, before anything is simulated."""

from importlib import import_module
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("experiment", "settings", "message"),
    [
        ("tune_gait", {"population": 8}, "population is 8; at least 16"),
        ("tune_gait", {"goals": 0}, "goals is 0; at least 1"),
        ("tune_gait", {"robot": "spot"}, "robot is 'spot': choose one of phantomx, quadruped"),
        (
            "estimator",
            {"atlas": Path("nowhere"), "rows": ("holes",)},
            "rows has holes: choose from foreseen, catalogue",
        ),
        (
            "estimator",
            {"atlas": Path("nowhere"), "converged": 0},
            "converged, updates, robots are 0, .* give at least 1 of each",
        ),
        ("physics_error", {"episodes": 0}, "episodes is 0"),
        ("physics_error", {"noise": -0.1}, "noise -0.1"),
        ("healthy_value", {"masks": 0}, "masks is 0; at least 1"),
        ("healthy_value", {"noise": -1.0}, "noise is -1.0"),
        ("healthy_value", {"damage": ("knee_rm",)}, "unknown part 'knee_rm'"),
        ("self_model", {"probes": 17}, "probes is 17; accepted are 1 to motions, 16"),
        ("bandit_table", {"repetitions": 0}, "repetitions is 0 .* at least 1"),
        ("lqr", {"trajectories": (5, 0)}, r"trajectories \(5, 0\): give numbers of at least 1"),
        ("posterior_quality", {"members": 0}, "members is 0: give at least 1"),
        ("posterior_quality", {"rates": (0.1, 1.0)}, r"rates is \(0.1, 1.0\): give dropout rates between 0 and 1"),
        ("self_model", {"seeds": 0}, "seeds is 0"),
        ("peers", {"repeats": 0}, "repeats is 0, .* of at least 1"),
        ("peers", {"steps": 30}, "steps 30; .* a multiple of 20"),
        ("throughput", {"lanes": (1,)}, r"lanes is \(1,\), .* at least 2"),
        ("cross_check", {"run": Path("nowhere")}, "nowhere is not the directory of a run"),
        ("cross_check", {"run": Path("nowhere"), "episodes": 0}, "episodes is 0"),
        ("robot_posterior", {"run": Path("nowhere")}, "nowhere is not the directory of a run"),
        ("shipped", {"starts": 0}, "starts 0; both must be positive"),
        ("shipped", {"names": ("sarl",)}, "name is 'sarl': there are ddpg, srl, atlas"),
        ("shipped", {"tasks": ("xy",)}, "task is 'xy': ddpg has p2p, x"),
        ("changed_robots", {"runs": ()}, "runs is empty: give the directory of a finished run"),
        ("changed_robots", {"runs": (Path("nowhere"),), "walks": 0}, "walks 0; both must be positive"),
        ("changed_robots", {"runs": (Path("nowhere"),)}, "nowhere is not the directory of a run"),
        ("self_model", {"damages": "coxa_rm,leg_rm"}, "'leg_rm' more than once"),
    ],
)
def test_bad_input_is_refused(experiment, settings, message):
    module = import_module(f"experiments.{experiment}")
    arguments = getattr(module, "Args", None) or module.Arguments
    with pytest.raises(ValueError, match=message):
        module.main(arguments(**settings))
