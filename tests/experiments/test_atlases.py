"""Several atlases are pooled robot by robot."""

import json

import numpy as np
import pytest

from experiments import atlases


def written(path, shift, windows=((0.0, 1.0), (2.0, 7.0))):
    robots = np.linspace(0.0, 1.0, 8)
    kept = {"posterior": [robots + shift, robots + shift + 0.5], "oracle": [robots, robots]}
    retained = {"foreseen": {name: np.array(rows).tolist() for name, rows in kept.items()}}
    path.write_text(json.dumps({"windows": windows, "retained": retained}))
    return path


def test_the_pool_and_its_extremes_are_shown(tmp_path, capsys):
    files = tuple(written(tmp_path / f"{i}.json", shift) for i, shift in enumerate((0.0, 0.2, 0.1)))
    atlases.main(atlases.Args(files))
    said = capsys.readouterr().out
    assert "foreseen: 3 atlases" in said
    line = next(line for line in said.splitlines() if line.startswith("posterior"))
    assert "0.60 [" in line and "0.50 to 0.70" in line and "1.00 to 1.20" in line and line.endswith("1.00")
    better = [float(line.split()[3]) for line in said.splitlines() if "P(posterior > oracle)" in line]
    assert better == [1.0]


def test_what_does_not_belong_together_is_refused(tmp_path):
    one = written(tmp_path / "a.json", 0.0)
    with pytest.raises(ValueError, match="files has 1"):
        atlases.main(atlases.Args((one,)))
    other = written(tmp_path / "b.json", 0.0, windows=((0.0, 2.0), (2.0, 7.0)))
    with pytest.raises(ValueError, match=r"b\.json has windows"):
        atlases.main(atlases.Args((one, other)))
