"""report.html: the directory of a run, or of several that are comparable, as one page."""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from srl_jax.job.command import asked
from srl_jax.job.files import read_json, replaced
from srl_jax.report.complete import complete
from srl_jax.report.content import Content, Source
from srl_jax.report.data import RunData, read_metrics
from srl_jax.report.files import read_settings
from srl_jax.report.join import join
from srl_jax.report.page import render
from srl_jax.report.summary import summarise

NAME = "report.html"
SUMMARY = "summary.json"
MANIFEST = "sweep.json"  # of a sweep, beside the directory into which it is merged


def leave(directory: Path) -> str:
    """Writes the page of a run beside its files; a sentence where that fails, which does not undo the run."""
    try:
        write(of_run(directory), directory / NAME)
    except Exception as error:  # whatever is wrong with its page, the run is finished
        return f"{NAME} could not be made: {error}"
    return ""


def write(content: Content, path: Path) -> None:
    """Writes all of the page or nothing of it."""
    text = render(content)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced(path) as file:
        file.write(text)


def of_run(directory: Path) -> Content:
    """What the page of one run shows; of a run that is not finished, as far as it is.

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
    return Content(run, summary, [_source(directory, summary)], finished, [*notes, *left_out])


def of_runs(directories: Sequence[Path]) -> Content:
    """What a page shows of several finished runs, in one table.

    Raises:
        ValueError: a directory is no finished run's, or two are not comparable.
    """
    with tempfile.TemporaryDirectory() as folder:
        join(directories, Path(folder))
        run = read_metrics(folder)
    sources = [_source(directory, _summary(directory)) for directory in directories]
    if len({source.name for source in sources}) < len(sources):
        sources = [x._replace(name=str(directory)) for x, directory in zip(sources, directories, strict=True)]
    return Content(run, summarise(run), sources, finished=True)


def _summary(directory: Path) -> dict[str, Any]:
    path = directory / SUMMARY
    if not path.exists():
        raise ValueError(f"{directory} has no {SUMMARY}: it is not finished, and stands in no fair table.")
    return json.loads(path.read_text())


def _source(directory: Path, summary: dict[str, Any]) -> Source:
    home, told = directory.resolve(), [asked(read_settings(directory))]
    name, manifest = home.parent.name if "sweep" in summary else home.name, home.parent / MANIFEST
    if "sweep" in summary and manifest.exists():  # config.json has the settings of the first of its points alone
        told = [asked(point["config"], point["label"]) for point in json.loads(manifest.read_text())["points"]]
    parts = read_json(directory).get("parts", [])
    videos = sorted(directory.glob("videos/*.mp4")) + sorted(directory.glob("wave-*/videos/*.mp4"))
    return Source(name, told, parts, summary.get("machine", {}), videos)


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
