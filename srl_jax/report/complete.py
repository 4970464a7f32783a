"""What of a run can stand in a table while some of its lanes are missing."""

import dataclasses

from srl_jax.report.data import RunData
from srl_jax.report.files import Lane


def complete(run: RunData) -> tuple[RunData, list[str]]:
    """The run without the lanes that would leave a method's table of seeds x damages with holes.

    Of each method either the seeds stay that have every damage or the damages that have every seed, whichever keeps
    more lanes; a method of which nothing stays is left out.

    Returns:
        The run that can be summed up, and a sentence for every method of which lanes were left out.
    """
    kept: list[Lane] = []
    said = []
    for group, lanes in run.groups.items():
        own = _rectangle(lanes)
        kept += own
        if len(own) < len(lanes):
            said.append(f"{group.label}: {len(own)} of the {len(lanes)} lanes that there are fill a table.")
    chosen = sorted(kept, key=lambda lane: lane["lane"])
    if len(chosen) == len(run.lanes):
        return run, said
    columns = [run.columns[lane["lane"]] for lane in chosen]
    metrics = {
        name: rows._replace(values=rows.values[:, columns], written=rows.written[:, columns])
        for name, rows in run.metrics.items()
    }
    return dataclasses.replace(run, lanes=chosen, metrics=metrics), said


def _rectangle(lanes: list[Lane]) -> list[Lane]:
    there = {(lane["seed"], lane["damage"]) for lane in lanes}
    seeds, damages = ({place[k] for place in there} for k in (0, 1))
    whole_seeds = {seed for seed in seeds if all((seed, damage) in there for damage in damages)}
    whole_damages = {damage for damage in damages if all((seed, damage) in there for seed in seeds)}
    options = (
        [lane for lane in lanes if lane["seed"] in whole_seeds],
        [lane for lane in lanes if lane["damage"] in whole_damages],
    )
    return max(options, key=len)
