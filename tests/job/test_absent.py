"""What is switched off is not stored, at any depth, and is None again when the rest comes back."""

from typing import NamedTuple

from srl_jax.job import absent


class Inner(NamedTuple):
    here: int
    off: int | None = None


class Outer(NamedTuple):
    inner: Inner
    lost: Inner | None
    several: tuple = ()


def test_none_is_left_out_and_comes_back():
    whole = Outer(Inner(1), None, (2, 3))
    kept = absent.stored(whole)
    assert kept == {"inner": {"here": 1}, "several": (2, 3)}
    like = Outer(Inner(0), None)
    assert absent.restored(like, {"inner": {"here": 5}, "several": (6,)}) == Outer(Inner(5), None, (6,))
    assert absent.restored(like, kept) == whole and isinstance(absent.restored(like, kept).inner, Inner)
