"""What a page is made from, of runs that never ran."""

from srl_jax.report.content import Asked, Change, Content, Source
from srl_jax.report.data import read_metrics
from srl_jax.report.summary import summarise
from tests.report.runs import write

COMMAND = "srl-jax run --preset smoke --seeds 3,4,5,6"
ASKED = Asked("", "smoke", [Change("seeds", "3,4,5,6", "2"), Change("srl.commit", False, True)], COMMAND)
PART = {"from_step": 0, "began": "2026-11-28T10:00:00+00:00", "devices": 2, "versions": {"jax": "0.10.2"}}
MACHINE = {
    "devices": 2,
    "lanes": 36,
    "training_seconds": 90.0,
    "compile_seconds": 30.0,
    "environment_steps_per_second": 6504,
    "peak_memory_gib": None,
}


def content(directory, *, name="legs", videos=(), finished=True, changes=None, **written) -> Content:
    """Of the run that `runs.write` makes; `changes` replace entries of its summary, None takes them out."""
    run = read_metrics(write(directory, **written))
    summary = summarise(run, 50) | (changes or {})
    summary = {entry: value for entry, value in summary.items() if value is not None}
    return Content(run, summary, [Source(name, [ASKED], [PART], MACHINE, list(videos))], finished)
