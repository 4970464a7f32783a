"""What every test needs, set before any test module imports jax.

Some tests run `python -m srl_jax.run` in a subprocess, which inherits the variables but not `jax.config`.
"""

import os

import pytest


def pytest_configure(config: pytest.Config) -> None:
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    # Physics takes 10-30 s to compile, so compiled programs are kept; `--cache-clear` drops them.
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(config.cache.mkdir("jax")))

    import jax

    # An axis added by broadcasting is the usual way for one lane to leak into another.
    jax.config.update("jax_numpy_rank_promotion", "raise")
