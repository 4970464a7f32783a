"""What the doctor finds out and advises, its measurements replaced by known ones; and that those measure something."""

import json
from types import SimpleNamespace

import pytest

from srl_jax import machine
from srl_jax.cli import checkup
from srl_jax.cli import doctor as verb
from srl_jax.config import Config
from srl_jax.job import speed
from srl_jax.sweep.cost import OF_RATES

OURS = {
    "sgemm_gflops": 2 * OF_RATES.sgemm / 1e9,
    "physics_steps_per_second_one_device": OF_RATES.physics,
    "c_mujoco_steps_per_second": 121_000.0,
}
HOST = checkup.Host(
    python="3.11.7",
    system="Linux x86_64",
    cores=2,
    machine_cores=2,
    load=0.5,
    memory_gib=16.0,
    backend="cpu",
    devices=["cpu", "cpu"],
    threads=2,
    cache="/home/me/.cache/srl_jax",
    cache_writable=True,
    opengl="egl",
    gpu=False,
    variables={},
)


@pytest.fixture
def known(asked, monkeypatch):
    """A machine as fast as ours, on which nothing is measured."""
    monkeypatch.setattr(checkup, "speeds", lambda *_: OURS)
    monkeypatch.setattr(verb, "use_devices", lambda *_, **__: 2)
    monkeypatch.setattr(checkup, "host", lambda: HOST)


def test_it_is_told_in_words(asked, known):
    code, said = asked()
    assert code == 0
    for part in (
        "Python 3.11.7",
        "gymnasium",
        "2 of 2, load 0.5, 16.0 GiB",
        "196 GFLOP/s",
        "120 lanes of 50,000 steps",
    ):
        assert part in said.out
    assert "about 12 minutes" in said.out and said.out.rstrip().endswith("Nothing to change.")


def test_and_as_json_for_programs(asked, known):
    code, said = asked("--json")
    found = json.loads(said.out)
    assert code == 0 and found["advice"] == []
    assert found["host"]["cores"] == 2 and found["installed"]["jax"] == machine.versions()["jax"]
    assert found["make_run"]["minutes"] == pytest.approx(12.0, abs=0.2)


def test_nonsense_is_one_sentence(asked):
    code, said = asked("--repeats", "0")
    assert code == 2 and "repeats is 0: at least 1 is needed" in said.err


@pytest.mark.parametrize(
    ("changed", "advised"),
    [
        ({"gpu": True}, "a NVIDIA GPU that jax does not use"),
        ({"variables": {"NPROC": "16"}}, "NPROC is 16: unset it"),
        ({"cores": 1}, "may use 1 of 2 cores"),
        ({"load": 3.0}, "load 3.0 on 2 cores"),
        ({"variables": {"XLA_FLAGS": "--xla_backend_optimization_level=0"}}, "XLA_FLAGS asks for unoptimised programs"),
        ({"variables": {"JAX_DISABLE_JIT": "1"}}, "nothing is compiled"),
        ({"variables": {"JAX_ENABLE_COMPILATION_CACHE": "false"}}, "every start compiles anew: unset it"),
        ({"cache_writable": False}, "cannot be written, so every start compiles anew"),
        ({"memory_gib": 2.0}, "make run needs 5.2 GiB and 2.0 are free: give it ARGS='--memory-gb 1'"),
        ({"opengl": None}, "No OpenGL works here"),
        ({"cores": 4, "machine_cores": 4}, "A core multiplies matrices at 49% of the speed of ours"),
    ],
)
def test_what_is_to_be_changed_is_a_sentence_each(changed, advised):
    found = {"speed": OURS | {"sgemm_gflops": 192.0}, "make_run": {"memory_gib": 5.2}}
    assert list(checkup.advice(HOST, found)) == []
    said = list(checkup.advice(HOST._replace(**changed), found))
    assert len(said) == 1 and advised.replace("a NVIDIA", "an NVIDIA") in said[0]


def test_a_slower_machine_takes_longer(monkeypatch):
    half = {name: value / 2 for name, value in OURS.items()}
    minutes = [checkup.forecast(Config(), 2, 2, speeds)["minutes"] for speeds in (OURS, half)]
    assert minutes[0] - 1.0 == pytest.approx((minutes[1] - 1.0) / 2, abs=0.1), "but for the minute it takes to start"
    faster = OURS | {"sgemm_gflops": 2.0 * OURS["sgemm_gflops"]}
    assert checkup.forecast(Config(), 2, 2, faster)["minutes"] == minutes[0], "its small matrices may be no faster"
    monkeypatch.setattr("srl_jax.sweep.cost.jax.default_backend", lambda: "gpu")
    assert checkup.forecast(Config(), 2, 2, OURS)["minutes"] is None


def test_free_memory_is_read_where_the_system_says_it(tmp_path):
    info = tmp_path / "meminfo"
    assert checkup.free_memory(info) is None
    info.write_text("MemTotal: 8388608 kB\nMemAvailable:    6291456 kB\n")
    assert checkup.free_memory(info) == 6.0


def test_this_machine_is_looked_at():
    found = checkup.host()
    assert found.cores == machine.cores() and found.devices and found.backend == "cpu"
    assert set(found.variables) <= set(checkup.VARIABLES)
    assert checkup.installed()["jax"] and set(checkup.EXTRAS) <= set(checkup.installed())


def test_speeds_are_measured(monkeypatch):
    monkeypatch.setattr(speed, "time_step", lambda star, model, robots, repeats: 0.5)  # which compiles for long
    found = checkup.speeds(1, 1, size=16, robots=100)
    assert found["physics_steps_per_second_one_device"] == 10 * 100 / 0.5
    assert found["sgemm_gflops"] >= 0.0 and found["c_mujoco_steps_per_second"] > 100
    calls = SimpleNamespace(count=0)
    assert speed.best(lambda: setattr(calls, "count", calls.count + 1), 3) >= 0.0 and calls.count == 4
