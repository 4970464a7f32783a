"""How a command ends: its exit code, the one sentence of bad input, and a pipe that nobody reads any more."""

import os
import sys
from collections.abc import Callable
from typing import Any, NoReturn

EXIT_USAGE = 2
EXIT_PIPE = 128 + 13  # as a shell reports what SIGPIPE ended


def leave(program: Callable[..., int | None], *arguments: Any) -> NoReturn:
    """Exits with what a program of these arguments returns; with 2, after one sentence, where its input was bad.

    A program whose output is no longer read (``| head``) ends silently with 141.
    """
    try:
        sys.exit(_end(program, arguments))
    except BrokenPipeError:
        # Python flushes once more when it exits, and would complain.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        sys.exit(EXIT_PIPE)


def _end(program: Callable[..., int | None], arguments: tuple[Any, ...]) -> int | None:
    try:
        return program(*arguments)
    except BrokenPipeError:
        raise
    except ValueError as error:
        said = str(error)
    except OSError as error:
        said = f"{error.strerror or error}: {error.filename or 'while writing results'}."
    finally:
        sys.stdout.flush()  # here, where a closed pipe is still an exception
    print(f"srl_jax: {said}", file=sys.stderr, flush=True)
    return EXIT_USAGE
