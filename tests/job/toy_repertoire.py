"""The command line of `srl_jax.repertoire` over a toy instead of physics, so that searching takes milliseconds."""

import sys

import jax.numpy as jnp

from srl_jax.cli import repertoire
from srl_jax.ite import walk as evaluate
from srl_jax.ite.walk import Walk


def make(mesh, clock_hz):
    """As `evaluate.make`: a gait's duty factors are its first genes, its distance depends on all of them."""

    def walk(damage, gaits):
        contacts = jnp.round(100 * gaits[:, :6]).astype(jnp.int32)
        fitness = jnp.where(gaits[:, 6] < 0.2, -jnp.inf, clock_hz * jnp.mean(gaits[:, 7:], axis=1) - 0.4)
        return Walk(fitness, contacts, contacts / 100)

    return walk


if __name__ == "__main__":
    evaluate.make = make
    repertoire.main(sys.argv[1:])
