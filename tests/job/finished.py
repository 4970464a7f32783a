"""What tests of whole runs compare: the numbers of their files."""

import csv
import json
from pathlib import Path


def results(directory: Path):
    """What must not depend on interruptions: the metrics, and the summary without what was timed."""
    summary = json.loads((directory / "summary.json").read_text())
    del summary["machine"]
    return (directory / "metrics.csv").read_text(), summary


def numbers(directory: Path) -> dict[tuple, float]:
    """metrics.csv as (step, lane, metric) -> value."""
    with (directory / "metrics.csv").open(newline="") as file:
        return {(r["step"], r["lane"], r["metric"]): float(r["value"]) for r in csv.DictReader(file)}
