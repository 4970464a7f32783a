"""A disk that is soon full."""

import subprocess

import pytest

DISK = 64 * 1024  # bytes


@pytest.fixture(scope="session")
def small_disk(tmp_path_factory):
    """A file system of 64 kB."""
    where = tmp_path_factory.mktemp("disk")
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", str(where)]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("mounting needs more rights")
    yield where
    subprocess.run(["umount", str(where)], check=True)


@pytest.fixture
def disk(small_disk):
    """The same, empty."""
    for path in small_disk.iterdir():
        path.unlink()
    return small_disk
