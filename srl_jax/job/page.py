"""report.html: the directory of a run, or of several that are comparable, as one page."""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from srl_jax.job.command import asked
from srl_jax.job.files import read_json, replaced
from srl_jax.report.complete import complete
from srl_jax.report.content import Asked, Content, Source
from srl_jax.report.data import RunData, read_metrics
from srl_jax.report.files import read_settings
from srl_jax.report.join import join
from srl_jax.report.page import render
from srl_jax.report.summary import summarise

NAME = "report.html"
SUMMARY = "summary.json"


def leave(directory: Path, name: str = "", points: Sequence[Asked] = ()) -> str:
    """Writes the page of a run beside its files; a sentence where that fails, which does not undo the run.

    The arguments are those of `of_run`.
    """
    try:
        write(of_run(directory, name, points), directory / NAME)
    except Exception as error:  # whatever is wrong with its page, the run is finished
        return f"{NAME} could not be made: {error}"
    return ""


def write(content: Content, path: Path) -> None:
    """Writes all of the page or nothing of it."""
    text = render(content)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced(path) as file:
        file.write(text)


def of_run(directory: Path, name: str = "", points: Sequence[Asked] = ()) -> Content:
    """What the page of one run shows.

    Args:
        directory: of a run; one that is not finished is shown as far as it is.
        name: of the run; that of the directory if empty.
        points: what the runs were told that it was put together from; what its own config.json says if none.

    Raises:
        ValueError: the directory is no run's, or nothing of it can be shown yet.
    """
    notes, finished = [], (directory / SUMMARY).exists()
    whole = read_metrics(directory) if (directory / "metrics.csv").exists() else _waves(directory, notes)
    run, left_out = complete(whole)
    if not run.lanes:
        raise ValueError(f"{directory} has no lane of which anything can be shown yet: wait until one is done.")
    summary = json.loads((directory / SUMMARY).read_text()) if finished else summarise(run)
    sweep = summary.get("sweep", {})
    if sweep.get("missing"):
        notes.append(f"{sweep['merged']} of {sweep['packs']} packs are done; the others are missing here.")
    source = _source(directory, name or directory.resolve().name, points, summary)
    return Content(run, summary, [source], finished, [*notes, *left_out])


def of_runs(directories: Sequence[Path]) -> Content:
    """What a page shows of several finished runs, in one table.

    Raises:
        ValueError: a directory is no finished run's, or two are not comparable.
    """
    with tempfile.TemporaryDirectory() as folder:
        join(directories, Path(folder))
        run = read_metrics(folder)
    summaries = [_summary(directory) for directory in directories]
    names = [directory.resolve().name for directory in directories]
    if len(set(names)) < len(names):
        names = [str(directory) for directory in directories]
    told = zip(directories, names, summaries, strict=True)
    sources = [_source(directory, name, (), summary) for directory, name, summary in told]
    return Content(run, summarise(run), sources, finished=True)


def _summary(directory: Path) -> dict[str, Any]:
    path = directory / SUMMARY
    if not path.exists():
        raise ValueError(f"{directory} has no {SUMMARY}: it is not finished, and stands in no fair table.")
    return json.loads(path.read_text())


def _source(directory: Path, name: str, points: Sequence[Asked], summary: dict[str, Any]) -> Source:
    parts = read_json(directory).get("parts", [])
    videos = sorted(directory.glob("videos/*.mp4")) + sorted(directory.glob("wave-*/videos/*.mp4"))
    return Source(name, points or [asked(read_settings(directory))], parts, summary.get("machine", {}), videos)


def _waves(directory: Path, notes: list[str]) -> RunData:
    """Of a run in waves whose last is not done: those that are, else the one under way."""
    begun = sorted(path.parent for path in directory.glob("wave-*/metrics.csv"))
    shown = [folder for folder in begun if (folder / SUMMARY).exists()] or begun[:1]
    if not shown:
        return read_metrics(directory)  # which says what it lacks
    notes.append(f"Lanes are trained in waves; of {', '.join(folder.name for folder in shown)} there are numbers.")
    with tempfile.TemporaryDirectory() as folder:
        join(shown, Path(folder))
        return read_metrics(folder)
