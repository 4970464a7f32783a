"""The first signal asks a job to stop, the second ends it."""

import signal
import subprocess
import sys

import pytest

JOB = """
import sys, time
from srl_jax.cli.signals import StopSignals
stop = StopSignals()
assert not stop.requested()
print("ready", flush=True)
while not stop.requested():
    time.sleep(0.01)
print("asked", flush=True)
if "waits" in sys.argv:
    time.sleep(60)
sys.exit(stop.number)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("waits", [False, True])
def test_signals(number, waits):
    command = [sys.executable, "-c", JOB, *(["waits"] if waits else [])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout and process.stdout.readline() == "ready\n"
        process.send_signal(number)
        assert process.stdout.readline() == "asked\n"
        if waits:
            process.send_signal(number)
    assert process.returncode == (-number if waits else number)
