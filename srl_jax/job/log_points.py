"""What logs are told: curves of methods or lanes, from a run's own files."""

from collections.abc import Iterator

import numpy as np

from srl_jax import statistics
from srl_jax.job.log_targets import Points
from srl_jax.report.data import Group, RunData

JUDGED = ("eval/", "teacher/", "healthy/", "reference/")  # in which a lane that exploded counts as failed


def by_method(run: RunData) -> Iterator[Points]:
    """The interquartile mean over the lanes of every method; a lane that exploded counts as in the run's summary."""
    for group in run.groups:
        for metric in run.metrics:
            yield from _of_method(run, group, metric)


def _of_method(run: RunData, group: Group, metric: str) -> Iterator[Points]:
    recorded, columns = run.metrics[metric], run.grid(group).ravel()
    if not recorded.written[:, columns].any():
        return  # of other methods
    if metric.startswith(JUDGED) and (judged := run.scores(metric, group)) is not None:
        steps, values = judged.steps, judged.values.reshape(len(judged.steps), -1)
    else:
        whole = recorded.written[:, columns].all(axis=1)
        steps, values = recorded.steps[whole].astype(float), recorded.values[whole][:, columns]
    rows = [row[np.isfinite(row)] for row in values]
    kept = [bool(row.size) for row in rows]
    yield Points(group.label, metric, steps[kept], np.array([statistics.iqm(row) for row in rows if row.size]))


def by_lane(run: RunData) -> Iterator[Points]:
    """Every lane, by its method, damage and seed."""
    for lane in run.lanes:
        name = f"{Group(lane['algo'], lane['variant']).label} {lane['damage']} seed {lane['seed']}"
        column = run.columns[lane["lane"]]
        for metric, rows in run.metrics.items():
            kept = rows.written[:, column]
            if kept.any():
                yield Points(name, metric, rows.steps[kept].astype(float), rows.values[kept, column])


BY = {"method": by_method, "lane": by_lane}
