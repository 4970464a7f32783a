"""What the page carries is the package's own robot, damages and policies; and its template is that of its sources."""

import base64
from pathlib import Path

import numpy as np
import pytest

from srl_jax.atlas import file
from srl_jax.atlas.stored import policies
from srl_jax.demo import page, payload
from srl_jax.env import damage
from srl_jax.env.damage import Damage
from srl_jax.portable import rounded
from tests.demo import pages

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["leg_rm", "tibia_lf", "femur_lf:locked", "leg_lm:limp+tibia_rr:short=0.6"])
def test_leaves_make_the_damaged_model(name):
    carried, model = payload.robot(1.5, [name])["damages"][name], damage.damaged_model("healthy")
    for field, leaf in carried["changed"].items():
        getattr(model, field).flat[leaf["at"]] = leaf["value"]
    wanted = damage.damaged_model(name)
    for field in Damage._fields:
        np.testing.assert_array_equal(getattr(model, field), getattr(wanted, field), err_msg=field)
    assert carried["silent"] == np.flatnonzero(~np.asarray(damage.present(damage.build(name)))).tolist()
    assert carried["changed"]


def test_policies_are_carried_at_half_precision():
    own = policies(file.load())["leg_rm"]
    for layer, kept in zip(payload.policy(own)["layers"], rounded(own).layers, strict=True):
        for name, value in layer.items():
            found = np.frombuffer(base64.b64decode(value), "<f2").astype(np.float32)
            np.testing.assert_array_equal(found, np.ravel(getattr(kept, name)))


def test_clicks_lead_to_named_damages():
    names = payload.reachable(["tibia_rm+leg_lf"])
    assert {"tibia_rm+leg_lf", "leg_rf+leg_rm+leg_rr", "femur_lm:locked", "leg_rr:limp", "leg_rf+tibia_lr"} <= set(
        names
    )
    assert len(names) == len(set(names))


def test_the_belief_is_over_the_damages_that_were_asked_for():
    atlas = file.load()
    known = payload.mind(atlas, ["healthy", "leg_rm", "tibia_lf"])
    assert np.shape(known["value"]) == (3, 3) and np.shape(known["whitening"]) == (24, 24)
    row, column = atlas.trained_for.index("leg_rm"), atlas.damages.index("tibia_lf")
    assert known["value"][1][2] == pytest.approx(atlas.value[row, column], abs=1e-4)


def test_a_page_is_written_whole(tmp_path):
    size = page.write(tmp_path / "demo.html", {"xml": "<mujoco/>", "sources": [1]})
    assert size == (tmp_path / "demo.html").stat().st_size > 1e6
    assert pages.read(tmp_path / "demo.html") == {"xml": "<mujoco/>", "sources": [1]}
    assert page.PLACE not in (tmp_path / "demo.html").read_text()


def test_the_template_was_built_from_these_sources():
    assert pages.made_of() == pages.fingerprint(ROOT / "web"), "run `make demo-template`"


def test_the_page_of_the_documentation_has_this_template_and_the_policies_that_it_speaks_of():
    ready = ROOT / "docs" / "demo.html"
    assert pages.made_of(ready) == pages.made_of(), "make it anew: srl-jax demo '' runs/p2p --out docs/demo.html"
    atlas, run = pages.read(ready)["sources"]
    assert atlas["finds_out"] and {"healthy", "leg_rm", "tibia_lf", "leg_rm+leg_lf"} <= set(atlas["sets"]["atlas"])
    assert run["task"] == "p2p" and [method["name"] for method in run["methods"]] == ["pi_B", "ddpg", "srl"]


def test_another_source_is_another_fingerprint(tmp_path):
    (tmp_path / "src").mkdir()
    for name in ("src/a.js", "build.mjs", "package.json"):
        (tmp_path / name).write_text("1")
    before = pages.fingerprint(tmp_path)
    (tmp_path / "src" / "a.js").write_text("2")
    assert pages.fingerprint(tmp_path) != before
