"""Directories of runs that never ran, whose numbers are known."""

import csv
import json
from pathlib import Path

DAMAGES, SEEDS, STEPS = ("leg 0", "leg 1", "leg 2"), (3, 4, 5, 6), (0, 100, 200, 300)
METHODS = {("ddpg", ""): 0.2, ("srl", ""): 0.6, ("srl", "dropout=0.03"): 0.6}  # -> height of its success
HEALTHY = {"success": 0.9, "return": 49.5, "distance": 1.6}
REFERENCE = {"success": 1.0, "return": 60.0, "distance": 2.0}
CONFIG = {"steps": 300, "evaluation": {"episodes": 10}, "train": {"environments": 4}, "env": {"episode_steps": 100}}


def table(path, header, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header.split(), *rows])


def write(
    path: Path,
    *,
    methods=METHODS,
    seeds=SEEDS,
    damages=DAMAGES,
    task="p2p",
    first=0,
    config=CONFIG,
    edit=lambda rows: rows,
):
    """Lanes climb by `height` t / 3 plus .01 per seed: success; return is 100 and distance 2 times that."""
    keys = [(*method, seed, damage) for method in methods for seed in seeds for damage in damages]
    rows = []
    for lane, (algo, variant, seed, damage) in enumerate(keys, first):
        for t, step in enumerate(STEPS):
            success = methods[algo, variant] * t / 3 + 0.01 * seed
            values = {"success": success, "return": 100 * success, "distance": 2 * success, "fell": 0.25}
            rows += [(step, lane, f"eval/{name}", value) for name, value in values.items()]
            rows.append((step, lane, "train/chosen_teacher", 0.5))
        frozen = {"success": 0.1 + 0.1 * damages.index(damage), "return": 12.0, "distance": 0.4}
        for prefix, found in (("teacher", frozen), ("healthy", HEALTHY), ("reference", REFERENCE)):
            rows += [(0, lane, f"{prefix}/{name}", value) for name, value in found.items()]
    lanes = [(i, a, s, task, d, v) for i, (a, v, s, d) in enumerate(keys, first)]
    path.mkdir(exist_ok=True)
    table(path / "lanes.csv", "lane algo seed task damage variant", lanes)
    table(path / "metrics.csv", "step lane metric value", edit(rows))
    (path / "config.json").write_text(json.dumps({"config": {"task": task} | config}))
    return path


def failing(lanes, prefix="eval/", since=0):
    """An edit: what these lanes measured under the prefix from a step on is not finite."""

    def edit(rows):
        return [
            (s, i, m, float("nan") if i in lanes and s >= since and m.startswith(prefix) else x) for s, i, m, x in rows
        ]

    return edit


def scaled(factors):
    """An edit: lane -> metric -> factor of its values."""
    return lambda rows: [(s, i, m, x * factors.get(i, {}).get(m, 1.0)) for s, i, m, x in rows]
