"""How a command ends: its own exit code, one sentence for bad input, and nothing at all where nobody reads on."""

import os
import subprocess
import sys

import pytest

from srl_jax.cli.ending import leave


def ended(capsys, program, *arguments):
    with pytest.raises(SystemExit) as caught:
        leave(program, *arguments)
    return caught.value.code, capsys.readouterr().err


def failing(error):
    raise error


@pytest.mark.parametrize("code", [None, 0, 143])
def test_a_programs_own_code(code, capsys):
    assert ended(capsys, lambda: code) == (code, "")


def test_bad_input_is_one_sentence(capsys):
    assert ended(capsys, failing, ValueError("steps is 0.")) == (2, "srl_jax: steps is 0.\n")
    missing = FileNotFoundError(2, "No such file or directory", "map.npz")
    assert ended(capsys, failing, missing) == (2, "srl_jax: No such file or directory: map.npz.\n")
    assert ended(capsys, failing, OSError("odd")) == (2, "srl_jax: odd: while writing results.\n")


def test_other_faults_are_not_hidden(capsys):
    with pytest.raises(ZeroDivisionError):
        leave(failing, ZeroDivisionError())


PRINTING = "from srl_jax.cli.ending import leave; leave(lambda: print('here'))"
DRAWING = """
from srl_jax.cli.ending import leave
from srl_jax.cli.progress import Terminal
leave(lambda: Terminal().print('here'))
"""
COMPLAINING = """
import os, sys
from srl_jax.cli.ending import leave
def complain():
    os.dup2(1, 2)  # 2>&1
    raise ValueError('steps is 0.')
leave(complain)
"""
COMMANDS = {
    "the list of verbs": ["-m", "srl_jax", "--help"],
    "a verb's options": ["-m", "srl_jax", "run", "--help"],
    "a door": ["-m", "srl_jax.run", "--help"],
    "the other door": ["-m", "srl_jax.repertoire", "--help"],
    "output that is still in the buffer": ["-c", PRINTING],
    "a display": ["-c", DRAWING],
    "a sentence": ["-c", COMPLAINING],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_pipe_that_nobody_reads_ends_a_command_silently(command):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write) as pipe:
        run = subprocess.run([sys.executable, *COMMANDS[command]], stdout=pipe, stderr=subprocess.PIPE, text=True)
    assert (run.returncode, run.stderr) == (141, "")
