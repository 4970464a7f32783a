"""The machine as its files describe it: containers of both kinds, other systems, and nothing to read at all."""

import math
import os
import resource
import sys
from types import SimpleNamespace

import pytest

from srl_jax import machine


def groups(tmp_path, own, files):
    """A made-up /sys/fs/cgroup and /proc/self/cgroup."""
    root, named = tmp_path / "cgroup", tmp_path / "own"
    named.write_text(own)
    for path, text in files.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text + "\n")
    return root, named


QUOTAS = {
    "version 2, its own group": ("0::/job\n", {"job/cpu.max": "150000 100000"}, 1.5),
    "version 2, no limit": ("0::/job\n", {"job/cpu.max": "max 100000"}, math.inf),
    "version 2, seen from inside": ("0::/docker/abc\n", {"cpu.max": "300000 100000"}, 3),
    "version 2, a group above is tighter": (
        "0::/slice/job\n",
        {"slice/job/cpu.max": "400000 100000", "slice/cpu.max": "200000 100000"},
        2,
    ),
    "version 1": (
        "4:memory:/job\n3:cpu,cpuacct:/job\n",
        {"cpu,cpuacct/job/cpu.cfs_quota_us": "50000", "cpu,cpuacct/job/cpu.cfs_period_us": "100000"},
        0.5,
    ),
    "version 1, no limit": (
        "3:cpu:/\n2:cpuset:/\n",
        {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"},
        math.inf,
    ),
    "both versions": (
        "1:cpu:/\n0::/\n",
        {"cpu/cpu.cfs_quota_us": "200000", "cpu/cpu.cfs_period_us": "100000", "unified/cpu.max": "max 100000"},
        2,
    ),
    "nothing to read": ("", {}, math.inf),
}


@pytest.mark.parametrize("case", QUOTAS)
def test_a_containers_quota(case, tmp_path):
    own, files, cores = QUOTAS[case]
    assert machine.cpu_quota(*groups(tmp_path, own, files)) == cores


def test_a_quota_caps_the_cores_and_leaves_at_least_one(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(8), raising=False)
    for quota, cores in (("150000", 2), ("20000", 1), ("max", 8)):
        root, own = groups(tmp_path, "0::/\n", {"cpu.max": f"{quota} 100000"})
        monkeypatch.setattr(machine, "CGROUPS", root)
        monkeypatch.setattr(machine, "OWN_CGROUPS", own)
        assert machine.cores() == cores


def test_cores_where_the_system_has_no_affinity(monkeypatch, tmp_path):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(machine, "OWN_CGROUPS", tmp_path / "missing")
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert machine.cores() == 6
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert machine.cores() == 1


@pytest.mark.parametrize(("platform", "counted"), [("linux", 3 * 2**20), ("darwin", 3 * 2**30)])
def test_peak_memory_is_in_gib_on_every_system(platform, counted, monkeypatch):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(resource, "getrusage", lambda who: SimpleNamespace(ru_maxrss=counted))
    assert machine.peak_memory_gib() == 3.0


def test_peak_memory_where_the_system_does_not_say(monkeypatch):
    monkeypatch.setitem(sys.modules, "resource", None)
    assert machine.peak_memory_gib() is None


def test_versions_are_of_what_is_installed(monkeypatch):
    monkeypatch.setattr(machine, "PACKAGES", ("jax", "not-installed-anywhere"))
    assert list(machine.versions()) == ["jax"]


@pytest.mark.parametrize(("given", "cores"), [("1", 1), ("3", 3), ("64", 4), ("", 4), ("0", 4), ("many", 4)])
def test_a_slurm_task_has_the_cores_that_it_was_given(given, cores, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(4)))
    monkeypatch.setattr(machine, "cpu_quota", lambda root, own: math.inf)
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", given)
    assert machine.cores() == cores
