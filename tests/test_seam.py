"""A seam changes nothing, and XLA leaves it where it is."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.seam import Seam, seam


def some(x: jax.Array) -> dict:
    """Values of every kind, several of which have one shape."""
    return {"a": [x, x + 1, 2 * x], "b": (x[:2], 3.0, x > 0), "c": np.ones((2, 1)), "d": (2 * x).astype(jnp.int32)}


def test_values_pass_through():
    never = jnp.zeros((), jnp.int32)
    x = jnp.array([-1.0, 0.5, 2.0])
    found = jax.jit(lambda x, never: Seam(never)(some(x)))(x, never)
    jax.tree.map(np.testing.assert_array_equal, found, some(x))
    alone = Seam(never)([x])
    np.testing.assert_array_equal(alone[0], x)


def test_numbers_pass_by():
    passed = Seam(jnp.zeros((), jnp.int32))([0.0, 1, jnp.ones(2)])
    assert passed[0] == 0.0 and passed[1] == 1 and isinstance(passed[0], float) and isinstance(passed[1], int)


def test_it_would_change_something_were_it_to_run():
    """So that no simplification may take the loop away."""
    for tree in ([jnp.arange(3.0)], [jnp.arange(3) > 1], [jnp.arange(3.0), jnp.ones(3)]):
        turned = Seam(jnp.ones((), jnp.int32))(tree)
        assert not all(np.array_equal(x, y) for x, y in zip(turned, tree, strict=True))


def test_xla_computes_what_is_shared_once():
    """It fuses sine and cosine into every consumer otherwise: the seam leans on how XLA is today."""

    def shared(x: jax.Array, never: jax.Array, seams: bool):
        sine, cosine = jnp.sin(x), jnp.cos(x)
        if seams:
            sine, cosine = Seam(never)((sine, cosine))
        return sine[:, None] * cosine[None], sine[::2] + 1, jnp.cumsum(sine * cosine)

    def times(seams: bool) -> int:
        program = jax.jit(partial(shared, seams=seams)).lower(jnp.ones(64), jnp.zeros((), jnp.int32)).compile()
        return program.as_text().count(" sine(")

    assert times(seams=False) == 3 and times(seams=True) == 1


def test_a_seam_of_its_own_gives_the_same_under_vmap():
    x = jnp.linspace(-1.0, 1.0, 12).reshape(4, 3)
    found = jax.jit(jax.vmap(lambda row: seam([row, 2 * row, row > 0])))(x)
    jax.tree.map(np.testing.assert_array_equal, found, [x, 2 * x, x > 0])
