"""Videos of what a run has learned: for every method the student of its median lane, in C MuJoCo."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

from srl_jax.evaluate import rollout_c
from srl_jax.program import mix
from srl_jax.program.lanes import MIX, Lane
from srl_jax.program.randomness import lane_keys
from srl_jax.program.state import LaneData, Program, TrainState, student
from srl_jax.report import video

SIZE = (480, 270)


def median_lanes(lanes: Sequence[Lane], returns: Mapping[int, float]) -> dict[str, Lane]:
    """Of every method the lane whose last return is the median, so that neither luck nor mishap is shown.

    Args:
        lanes: all lanes of a run.
        returns: lane index -> return; lanes that are missing or not finite are passed over.
    """
    chosen = {}
    own: dict[str, list[Lane]] = {}
    for lane in lanes:
        if np.isfinite(returns.get(lane.index, np.nan)):
            own.setdefault(lane.method, []).append(lane)
    for method, found in own.items():
        found.sort(key=lambda lane: (returns[lane.index], lane.index))
        chosen[method] = found[(len(found) - 1) // 2]
    return chosen


def save_videos(
    directory: Path,
    program: Program,
    state: TrainState,
    lanes: LaneData,
    chosen: Mapping[str, Lane],
    damages: Mapping[int, str],
) -> list[Path]:
    """Writes ``directory/<method>-<damage>-seed<n>.mp4`` for every chosen lane; returns the paths.

    Args:
        directory: is made where missing.
        program: the run's.
        state: whose students act.
        lanes: whose teachers they may ask.
        chosen: method -> lane, from `median_lanes`.
        damages: lane index -> the damage in force at the end; of a mix one is drawn.
    """
    directory.mkdir(exist_ok=True)
    paths = []
    for method, lane in chosen.items():
        row = program.layout.of(lane.algo).index(lane)
        index = program.layout.rows.index(lane)
        actor, params = jax.device_get(
            (
                jax.tree.map(lambda x, row=row: x[row], state.agents[lane.algo].actor),
                jax.tree.map(lambda x, index=index: x[index], lanes.teachers),
            )
        )
        policy = student(program, lane.algo, actor, params)
        damage, key = damages[lane.index], lane_keys([lane], "video")[0]
        if damage == MIX:
            damage = program.mix[int(mix.draw(len(program.mix), key))]
        rollout = rollout_c(program.robot, damage, policy, key, program.robot.config.episode_steps)
        robot = program.robot
        frames = video.render(rollout, damage, robot.anatomy, goal_radius=robot.config.goal_radius, size=SIZE)
        path = directory / f"{method.replace(' ', '-')}-{damage.replace(':', '-')}-seed{lane.seed}.mp4"
        video.save_video(path, frames)
        paths.append(path)
    return paths
