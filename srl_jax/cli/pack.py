"""What one task of a sweep does: it claims its pack, trains it from where it stands, and records how that ended."""

import contextlib
import sys
import threading
import warnings
from pathlib import Path

from srl_jax.cli.devices import use_devices
from srl_jax.cli.signals import StopSignals
from srl_jax.job import plan
from srl_jax.sweep import attempts, cache, lease
from srl_jax.sweep.local import IN_USE
from srl_jax.sweep.manifest import Pack, Sweep

COMPILED = ("training", "summary")  # phases of a run after it has compiled its program


def run_pack(sweep: Sweep, number: int) -> int:
    """Trains a pack; 0 when it is done, 75 where another process has it, else as `srl-jax run` ends."""
    pack, folder = sweep.pack(number), sweep.task_directory(number)
    if (pack.directory / "summary.json").exists():
        return 0
    try:
        with lease.held(folder / attempts.LEASE) as lost:
            attempts.begin(folder)
            return _recorded(sweep, pack, folder, lost)
    except lease.HeldError as error:
        print(f"srl_jax: {error}", file=sys.stderr)
        return IN_USE


def _recorded(sweep: Sweep, pack: Pack, folder: Path, lost: threading.Event) -> int:
    """Works on the pack and records how it ended; a machine's failure is 1, to be tried again, bad input is 2."""
    code, error = 1, "killed"
    try:
        code, error = _work(sweep, pack, lost)
    except OSError as problem:
        error = f"{problem.strerror or problem}: {problem.filename or 'while writing results'}."
        print(f"srl_jax: {error}", file=sys.stderr)
    except BaseException as problem:
        code, error = (2 if isinstance(problem, ValueError) else 1), str(problem) or type(problem).__name__
        raise
    finally:
        with contextlib.suppress(OSError):  # of a full disk, which the log tells anyway
            attempts.end(folder, code, error)
    return code


def _work(sweep: Sweep, pack: Pack, lost: threading.Event) -> tuple[int, str]:
    stop = StopSignals()
    devices = use_devices(pack.config.devices, len(plan.make(pack.config).lanes), solves=pack.config.solves)
    folder = cache.of_this_processor(sweep.directory / "cache")
    _use_cache(folder)

    from absl import logging

    from srl_jax.cli.progress import Display
    from srl_jax.job.run import run

    logging.set_verbosity(logging.FATAL)
    compiled = threading.Event()
    pack.directory.parent.mkdir(parents=True, exist_ok=True)
    begun = (pack.directory / "config.json").exists()
    with Display() as display, _Warming(folder, f"{point_of(sweep, pack)}-{devices}", compiled):

        def listen(status) -> None:
            if status.phase in COMPILED:
                compiled.set()
            display.update(status)

        try:
            summary = run(
                pack.config,
                pack.directory,
                devices,
                resume=begun,
                listener=listen,
                stopped=lambda: stop.requested() or lost.is_set(),
            )
        finally:
            compiled.set()
    if summary is not None:
        return 0, ""
    if lost.is_set():
        return IN_USE, "its lease was taken over"
    return 128 + stop.number, "stopped and saved"


def point_of(sweep: Sweep, pack: Pack) -> int:
    """The place of a pack's point in the grid; its packs share one program."""
    return next(place for place in range(len(sweep.points)) if pack.number in sweep.of_point(place))


class _Warming:
    """Waits for whoever compiles the program first, or is that one until it is compiled."""

    def __init__(self, folder: Path, name: str, compiled: threading.Event):
        self.folder, self.name, self.compiled = folder, name, compiled

    def __enter__(self) -> None:
        # In a thread, since the claim is held until the run says that it has compiled, in the midst of it.
        ready = threading.Event()

        def hold() -> None:
            with cache.warmed(self.folder, self.name) as first:
                ready.set()
                if first:
                    self.compiled.wait()

        self.thread = threading.Thread(target=hold, daemon=True)
        self.thread.start()
        ready.wait()

    def __exit__(self, *exception: object) -> None:
        self.compiled.set()
        self.thread.join()


def _use_cache(folder: Path) -> None:
    """jax keeps its compiled programs there; an entry of which it complains is removed, and so written anew."""
    import jax

    folder.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    shown = warnings.showwarning

    def show(message, category, *where, **options) -> None:
        if cache.COMPLAINT in str(message):
            names = ", ".join(cache.mend(folder)) or "none was found"
            print(f"srl_jax: removed damaged compiled programs: {names}", file=sys.stderr)
            return
        shown(message, category, *where, **options)

    warnings.showwarning = show
