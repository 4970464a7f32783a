"""What one task of a sweep does: it claims its pack, trains it from where it stands, and records how that ended."""

import contextlib
import sys
import threading
import warnings
from pathlib import Path

from srl_jax.cli.run import devices_of, quiet
from srl_jax.cli.signals import StopSignals
from srl_jax.sweep import attempts, cache, lease
from srl_jax.sweep.manifest import Pack, Sweep
from srl_jax.sweep.task import DONE, FAILED, IN_USE, USAGE, follow

COMPILED = ("training", "summary")  # phases of a run after it has compiled its program


def run_pack(sweep: Sweep, number: int) -> int:
    """Trains a pack; 0 when it is done, 75 where another process has it, else as `srl-jax run` ends."""
    follow()
    pack = sweep.pack(number)
    if pack.done:
        return DONE
    try:
        with lease.held(pack.task / attempts.LEASE) as lost:
            attempts.begin(pack.task)
            return _recorded(sweep, pack, lost)
    except lease.HeldError as error:
        print(f"srl_jax: {error}", file=sys.stderr)
        return IN_USE
    except OSError as problem:  # not even the attempt could be recorded
        print(f"srl_jax: {_sentence(problem)}", file=sys.stderr)
        return FAILED


def _recorded(sweep: Sweep, pack: Pack, lost: threading.Event) -> int:
    """Works on the pack and records how it ended; a machine's failure is 1, to be tried again, bad input is 2."""
    code, error = FAILED, "killed"
    try:
        code, error = _work(sweep, pack, lost)
    except OSError as problem:
        error = _sentence(problem)
        print(f"srl_jax: {error}", file=sys.stderr)
    except BaseException as problem:
        code, error = (USAGE if isinstance(problem, ValueError) else FAILED), str(problem) or type(problem).__name__
        raise
    finally:
        with contextlib.suppress(OSError):  # of a full disk, which the log tells anyway
            attempts.end(pack.task, code, error)
    return code


def _sentence(problem: OSError) -> str:
    return f"{problem.strerror or problem}: {problem.filename or 'while writing results'}."


def _work(sweep: Sweep, pack: Pack, lost: threading.Event) -> tuple[int, str]:
    stop, devices = StopSignals(), devices_of(pack.config)
    folder = cache.of_this_processor(sweep.directory / "cache")
    _use_cache(folder)
    quiet()

    from srl_jax.cli.progress import Display
    from srl_jax.job.run import run

    pack.directory.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as compiling, Display() as display:
        compiling.enter_context(cache.warmed(folder, f"{sweep.point_of(pack.number)}-{devices}"))

        def listen(status) -> None:
            if status.phase in COMPILED:
                compiling.close()  # now the others find the program
            display.update(status)

        summary = run(
            pack.config,
            pack.directory,
            devices,
            resume=pack.directory.exists(),  # be it without any file: whoever began it was killed at once
            listener=listen,
            stopped=lambda: stop.requested() or lost.is_set(),
        )
    if summary is not None:
        return DONE, ""
    if lost.is_set():
        return IN_USE, "its lease was taken over"
    return 128 + stop.number, "stopped and saved"


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
