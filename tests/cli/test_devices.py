"""Devices: as many as cores, never more than lanes, and a cache that is found whenever jax was imported."""

import json
import os
import subprocess
import sys

import jax
import pytest

from srl_jax import machine
from srl_jax.cli.devices import use_devices
from srl_jax.config import preset
from srl_jax.job import files


@pytest.fixture
def computer(monkeypatch):
    """Pretends to have cores and accelerators; returns what jax was told."""

    def pretend(cores, accelerators=0):
        told = {}
        monkeypatch.setattr(machine, "cores", lambda: cores)
        monkeypatch.setattr(jax, "default_backend", lambda: "gpu" if accelerators else "cpu")
        monkeypatch.setattr(jax, "devices", lambda: ["device"] * accelerators)
        monkeypatch.setattr(jax.config, "update", told.__setitem__)
        monkeypatch.delenv("NPROC")
        return told

    monkeypatch.setenv("NPROC", "0")  # so that what the test leaves there is undone
    return pretend


CPU = [("auto", None, 4), ("auto", 120, 4), ("auto", 3, 3), ("2", 120, 2), ("8", 120, 8), ("8", 3, 3)]


@pytest.mark.parametrize(("wanted", "lanes", "count"), CPU)
def test_a_device_per_core_but_none_without_a_lane(wanted, lanes, count, computer):
    told = computer(cores=4)
    assert use_devices(wanted, lanes) == told["jax_num_cpu_devices"] == count
    assert int(os.environ["NPROC"]) > count  # LAPACK waits for a thread that is no device


@pytest.mark.parametrize(("wanted", "lanes", "count"), CPU)
def test_a_device_keeps_its_core_where_nothing_waits_for_threads(wanted, lanes, count, computer):
    computer(cores=4)
    assert use_devices(wanted, lanes, solves=False) == count
    assert int(os.environ["NPROC"]) == count == machine.xla_threads(count)


def test_a_device_alone_has_all_cores(computer):
    computer(cores=4)
    assert use_devices("1", 120, solves=False) == 1
    assert int(os.environ["NPROC"]) == 4


@pytest.mark.parametrize(("said", "threads"), [("", 4), ("3", 3), ("0", 4), ("many", 4), ("1", 2)])
def test_threads_of_a_pool(said, threads, computer, monkeypatch):
    """As XLA has it: never fewer than the (here two) devices."""
    computer(cores=4)
    monkeypatch.setenv("NPROC", said)
    assert machine.xla_threads(2) == threads


GPU = [("auto", 120, 8), ("auto", 3, 3), ("2", 120, 2), ("8", 120, 8), ("8", 1, 1)]


@pytest.mark.parametrize(("wanted", "lanes", "count"), GPU)
def test_accelerators_do_not_depend_on_cores(wanted, lanes, count, computer):
    computer(cores=1, accelerators=8)
    assert use_devices(wanted, lanes) == count


@pytest.mark.parametrize("wanted", ["", "0", "-1", "2.0", "all", "²"])
def test_what_is_no_number_of_devices(wanted):
    with pytest.raises(ValueError, match=r"devices is .* give auto or a positive number"):
        use_devices(wanted, 120)


def test_more_than_there_are(computer):
    computer(cores=2)
    with pytest.raises(ValueError, match="devices is 9: this machine has 2 cores"):
        use_devices("9", 120)
    computer(cores=2, accelerators=8)
    with pytest.raises(ValueError, match="devices is 9: this machine has 8 gpu devices"):
        use_devices("9", 120)


RESUMED = """
import json, os, sys
from srl_jax.cli import run
from srl_jax.job import plan
_, config = run.parse(["--resume", sys.argv[1]])
if "early" in sys.argv:
    import jax
count = run.use_devices(config.devices, len(plan.make(config).lanes))
import jax
print(json.dumps([count, len(jax.devices()), jax.config.jax_compilation_cache_dir]))
"""


@pytest.mark.parametrize("early", [[], ["early"]])
@pytest.mark.parametrize("own", ["", "elsewhere"])
def test_a_resumed_run_finds_the_cache_of_compiled_programs(early, own, tmp_path):
    files.write_config(tmp_path, preset("smoke"), 2)
    environment = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "home")} | ({"JAX_COMPILATION_CACHE_DIR": own} if own else {})
    command = [sys.executable, "-c", RESUMED, str(tmp_path), *early]
    printed = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    count = min(machine.cores(), 4)
    assert json.loads(printed) == [count, count, own or str(tmp_path / "home" / "srl_jax")]
