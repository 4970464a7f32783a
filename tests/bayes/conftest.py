"""What tests of several estimators share."""

import pytest


@pytest.fixture
def x64():
    """Double precision, in which equations can be compared to rounding."""
    import jax

    with jax.enable_x64(True):
        yield
