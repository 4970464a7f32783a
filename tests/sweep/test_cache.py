"""Compiled programs that packs share: one compiles while the others wait, and what is damaged goes."""

import subprocess
import sys
import threading
import time
import zlib

from srl_jax.sweep import cache

INTEL = "model name\t: Intel(R) Xeon(R) Gold 6248\nflags\t\t: sse avx2 avx512f\n"

PROGRAM = """
import sys
from pathlib import Path
import jax
from srl_jax.cli import pack
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
pack._use_cache(Path(sys.argv[1]))
print(jax.jit(lambda x: x * 2 + 1)(3.0))
"""  # what a task does with the cache, and a small program


def test_a_folder_for_each_kind_of_processor(tmp_path):
    names = set()
    for number, text in enumerate((INTEL, INTEL.replace("avx512f", ""), INTEL.replace("6248", "6130"))):
        info = tmp_path / str(number)
        info.write_text(text * 2)  # as many entries as cores
        names.add(cache.of_this_processor(tmp_path, info).name)
        assert cache.of_this_processor(tmp_path, info) == cache.of_this_processor(tmp_path, info)
    assert len(names) == 3 and all(name.startswith("intel-r-xeon-r-gold-6") for name in names)
    assert cache.of_this_processor(tmp_path, tmp_path / "missing") == tmp_path / "unknown"


def test_one_compiles_and_the_others_wait_until_it_has(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "POLL", 0.01)
    began, compiled, told = threading.Event(), [], []

    def work(first):
        with cache.warmed(tmp_path, "program") as chosen:
            told.append(chosen)
            if chosen:
                began.set()
                time.sleep(0.3)
                compiled.append(True)
            else:
                assert compiled, "it went on before the program was there"

    threads = [threading.Thread(target=work, args=(k == 0,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(told) == [False, False, False, True]
    with cache.warmed(tmp_path, "program") as chosen:
        assert not chosen
    with cache.warmed(tmp_path, "another") as chosen:
        assert chosen


def test_nobody_waits_for_ever(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "POLL", 0.01)
    with cache.warmed(tmp_path, "program") as first, cache.warmed(tmp_path, "program", wait=0.05) as second:
        assert first and not second


def test_entries_that_are_not_whole_are_removed(tmp_path):
    whole = zlib.compress(bytes(range(256)) * 50)
    entries = {"a-cache": whole, "b-cache": whole[: len(whole) // 2], "c-cache": b"", "d-atime": b"", "e-cache": b"no"}
    for name, data in entries.items():
        (tmp_path / name).write_bytes(data)
    assert cache.mend(tmp_path) == ["b-cache", "c-cache", "e-cache"]
    assert {path.name for path in tmp_path.iterdir()} == {"a-cache", "d-atime"}


def test_a_task_that_meets_damaged_entries_says_so_compiles_and_writes_them_anew(tmp_path):
    def work():
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True, check=True
        )
        assert done.stdout == "7.0\n", done.stderr
        return done.stderr

    assert "damaged" not in work()
    entries = {path: path.read_bytes() for path in tmp_path.glob("*-cache")}
    assert entries
    for number, (path, whole) in enumerate(entries.items()):
        path.write_bytes(whole[: len(whole) // 2] if number % 2 else b"")
    said = work()
    assert "srl_jax: removed damaged compiled programs: " in said and "UserWarning" not in said
    assert all(path.name in said and zlib.decompress(path.read_bytes()) for path in entries)
    assert "damaged" not in work()
