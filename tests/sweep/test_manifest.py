"""A sweep's packs: every lane in one of them, all of equal shape, and a manifest that is written once."""

import dataclasses
import json

import pytest

from srl_jax.agents.settings import DDPG, SRLConfig
from srl_jax.config import Config, preset
from srl_jax.job import plan
from srl_jax.program import lanes as tables
from srl_jax.sweep import manifest
from srl_jax.sweep.manifest import Point, Sweep

CONFIG = Config(seeds="7", damage="leg_rm,leg_lf", srl=SRLConfig(guidance_weight=(1.0, 4.0)))  # 14 DDPG, 28 SRL


def sweep_of(directory, pack_lanes=10, **changes):
    config = dataclasses.replace(CONFIG, **changes)
    return Sweep(directory, manifest.split((Point("", ("--seeds", "7"), config),), pack_lanes))


@pytest.mark.parametrize("pack_lanes", [3, 4, 10, 41, 42, 1000])
def test_every_lane_is_in_one_pack_as_in_the_whole_run(pack_lanes, tmp_path):
    whole = plan.make(CONFIG).lanes
    sweep = sweep_of(tmp_path, pack_lanes)
    packs = [plan.make(pack.config).lanes for pack in sweep.packs()]
    assert sorted((lane for pack in packs for lane in pack), key=lambda lane: lane.index) == list(whole)
    assert max(map(len, packs)) <= pack_lanes + 1  # two algorithms, each rounded up


def test_packs_have_one_shape(tmp_path):
    plans = [plan.make(pack.config) for pack in sweep_of(tmp_path, 9).packs()]
    assert len({len(found.lanes) for found in plans}) > 1, "42 lanes do not divide by 5"
    for devices in (1, 2, 3):
        assert len({tables.lay_out(found.lanes, devices, found.room).counts for found in plans}) == 1


def test_packs_of_several_points_are_numbered_on(tmp_path):
    config = preset("smoke")
    other = dataclasses.replace(config, ddpg=dataclasses.replace(DDPG, hidden=(16,)))
    points = (Point("a", ("--x", "1"), config, 2), Point("b", ("--x", "2"), other, 1))
    sweep = Sweep(tmp_path, points)
    assert len(sweep) == 3 and [sweep.point_of(number) for number in range(3)] == [0, 0, 1]
    assert [pack.config.part for pack in sweep.packs()] == ["1/2", "2/2", "1/1"]
    assert sweep.pack(2).config.ddpg.hidden == (16,)
    assert sweep.pack(1).command == f"srl-jax run --x 1 --part 2/2 --out {tmp_path}/packs/00001"
    for number in (-1, 3):
        with pytest.raises(ValueError, match=rf"run-pack is {number}: this sweep has the packs 0 to 2"):
            sweep.pack(number)


def test_a_million_lanes_are_counted_and_none_is_made(monkeypatch, tmp_path):
    made = []
    monkeypatch.setattr(plan, "Lane", lambda *fields: made.append(fields) or tables.Lane(*fields))
    sweep = sweep_of(tmp_path, 64, seeds="20000", damage="losses21")
    assert sum(sweep.points[0].lanes.values()) == 20_000 * 21 * 3 and len(sweep) > 19_000
    assert not made
    assert len(plan.make(sweep.pack(10_000).config).lanes) <= 65 and len(made) <= 65


def test_the_manifest_says_what_each_pack_is_and_is_read_back(tmp_path):
    sweep = sweep_of(tmp_path / "new")
    manifest.write(sweep)
    stored = json.loads((tmp_path / "new" / "sweep.json").read_text())
    assert stored["packs"]["00003"] == f"srl-jax run --seeds 7 --part 4/5 --out {tmp_path}/new/packs/00003"
    again = manifest.read(tmp_path / "new")
    assert again.points[0].config == sweep.points[0].config and len(again) == len(sweep)
    assert list(again.packs()) == list(sweep.packs())
    before = (tmp_path / "new" / "sweep.json").stat().st_mtime_ns
    manifest.write(sweep)
    assert (tmp_path / "new" / "sweep.json").stat().st_mtime_ns == before, "the same sweep is not written twice"


@pytest.mark.parametrize(
    ("changes", "pack_lanes", "named"),
    [
        ({"steps": 100_000}, 10, "steps"),
        ({"srl": SRLConfig(guidance_weight=(1.0, 5.0))}, 10, "srl.guidance_weight"),
        ({}, 20, "pack_lanes"),
    ],
)
def test_another_sweep_in_the_same_directory_is_refused_by_name(changes, pack_lanes, named, tmp_path):
    manifest.write(sweep_of(tmp_path / "there"))
    with pytest.raises(ValueError, match=rf"holds another sweep, which differs in {named};"):
        manifest.write(sweep_of(tmp_path / "there", pack_lanes, **changes))


def test_a_directory_with_other_files_is_refused(tmp_path):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(ValueError, match="it is not empty"):
        manifest.write(sweep_of(tmp_path))


def test_what_is_no_sweep(tmp_path):
    with pytest.raises(ValueError, match=r"is not the directory of a sweep: it has no sweep.json"):
        manifest.read(tmp_path)
    (tmp_path / "sweep.json").write_text("{}")
    with pytest.raises(ValueError, match=r"sweep.json cannot be read as a sweep of this version"):
        manifest.read(tmp_path)


def test_packs_that_would_lack_an_algorithm(tmp_path):
    with pytest.raises(ValueError, match=r"pack_lanes is 2: that makes 21 packs, but ddpg has 14 .* at least 3"):
        sweep_of(tmp_path, 2)
    with pytest.raises(ValueError, match="pack_lanes is 0"):
        sweep_of(tmp_path, 0)


@pytest.mark.parametrize("part", ["3", "0/2", "3/2", "a/b", "1/", "1/2/3", "-1/2"])
def test_parts_that_are_none(part):
    with pytest.raises(ValueError, match=r"part is .*: give k/n with k from 1 to n"):
        plan.make(dataclasses.replace(CONFIG, part=part))


def test_more_parts_than_lanes():
    with pytest.raises(ValueError, match="part is '1/15': ddpg has 14 lanes"):
        plan.make(dataclasses.replace(CONFIG, part="1/15"))
