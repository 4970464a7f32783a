"""Block-arrow matrices: M, and H = M + J'DJ, couple every leg with the base and with itself, but no two legs.

So a factorisation is one of K x K for each leg and one of 6 x 6 for the base, its Schur complement, written out: no
LAPACK call, no small matrix product.
"""

from functools import reduce
from typing import NamedTuple

import jax.numpy as jnp

from srl_jax.env.star.algebra import Scalar, add, gathered, is_number, mul, sub, total
from srl_jax.seam import Seam


class Motion(NamedTuple):
    """A vector over the degrees of freedom: of velocity, acceleration or force."""

    base: list[Scalar]  # 6 of [B]: linear, then angular, in the torso's frame
    legs: list[Scalar]  # K of [L, B]


class Arrow(NamedTuple):
    """A symmetric matrix over the degrees of freedom, but for what is 0 by the robot's shape."""

    base: list[list[Scalar]]  # lower triangle of 6 x 6, entries [B]
    coupling: list[list[Scalar]]  # 6 x K, entries [L, B]
    legs: list[list[Scalar]]  # lower triangle of K x K, entries [L, B]


def times(a: Arrow, x: Motion) -> Motion:
    """``A x``."""
    links = range(len(x.legs))
    full = lambda m, r, c: m[max(r, c)][min(r, c)]  # noqa: E731
    base = [
        add(total(mul(full(a.base, r, c), x.base[c]) for c in range(6)), gathered(_row(a.coupling[r], x.legs)))
        for r in range(6)
    ]
    legs = [
        add(_row([full(a.legs, k, j) for j in links], x.legs), _row([a.coupling[r][k] for r in range(6)], x.base))
        for k in links
    ]
    return Motion(base, legs)


def _row(row: list[Scalar], x: list[Scalar]) -> Scalar:
    return total(mul(a, b) for a, b in zip(row, x, strict=True))


def inner(x: Motion, y: Motion) -> Scalar:
    """``x'y`` [B]."""
    return add(_row(x.base, y.base), gathered(_row(x.legs, y.legs)))


def difference(x: Motion, y: Motion) -> Motion:
    return Motion(*([sub(a, b) for a, b in zip(u, v, strict=True)] for u, v in zip(x, y, strict=True)))


def moved(x: Motion, step: Scalar, along: Motion) -> Motion:
    """``x + step along``; step [B]."""
    return Motion(*([a + step * b for a, b in zip(u, v, strict=True)] for u, v in zip(x, along, strict=True)))


def solve(a: Arrow, right: Motion, seam: Seam) -> Motion:
    """``A^-1 right`` by ``A = U'D U`` from the legs inwards.

    The right-hand side rides along as a seventh row of the coupling, so that elimination substitutes forwards too.
    """
    links = range(len(right.legs))
    coupling = [_stacked([*(row[k] for row in a.coupling), right.legs[k]]) for k in links]
    columns = [_stacked([*(a.base[r][c] for r in range(c, 6)), right.base[c]]) for c in range(6)]
    inverse, lower = _factor(a.legs)
    inverse, lower, coupling, columns = seam((inverse, lower, coupling, columns))

    reduced = []
    for k in links:  # leg by leg, forward substitution of its seven right-hand sides
        reduced.append(reduce(sub, [lower[k][j] * reduced[j] for j in range(k)], coupling[k]))
    reduced = seam(reduced)
    schur = []
    for c in range(6):
        eliminated = total(reduced[k][c:] * (reduced[k][c] * inverse[k]) for k in links)
        schur.append(columns[c] - gathered(eliminated, axis=1))
    base = _solve_base(seam(schur), seam)

    rest = [inverse[k] * (reduced[k][6] - total(reduced[k][r] * base[r] for r in range(6))) for k in links]
    legs: list[Scalar] = [0.0] * len(rest)
    for k in reversed(links):
        legs[k] = reduce(sub, [lower[j][k] * legs[j] for j in links if j > k], rest[k])
    return Motion(base, seam(legs))


def _stacked(entries: list[Scalar]) -> Scalar:
    shape = max((x for x in entries if not is_number(x)), key=lambda x: x.ndim)
    return jnp.stack([x + jnp.zeros_like(shape) if is_number(x) else x for x in entries])


def _factor(legs: list[list[Scalar]]) -> tuple[list[Scalar], list[list[Scalar]]]:
    """``L D L'`` of every leg's block: 1 / D, and the entries of L below its diagonal of ones."""
    inverse: list[Scalar] = []
    lower: list[list[Scalar]] = []
    for row in legs:
        entries: list[Scalar] = []  # of L D
        factors: list[Scalar] = []  # of L
        for c in range(len(row)):
            other = lower[c] if c < len(lower) else factors
            entry = reduce(sub, [mul(entries[i], other[i]) for i in range(c)], row[c])
            entries.append(entry)
            if c < len(row) - 1:
                factors.append(entry * inverse[c])
        lower.append(factors)
        inverse.append(1 / entries[-1])
    return inverse, lower


def _solve_base(columns: list[Scalar], seam: Seam) -> list[Scalar]:
    """The base's six unknowns from the columns of its lower triangle, each with the right-hand side as last entry."""
    factor, inverse = [], []
    for c in range(6):
        column = columns[c]
        for k in range(c):
            column = column - factor[k][c - k :] * (factor[k][c - k] * inverse[k])
        column, pivot = seam((column, 1 / column[0]))
        factor.append(column)
        inverse.append(pivot)
    x: list[Scalar] = [0.0] * 6
    for i in reversed(range(6)):
        later = [factor[i][k - i] * x[k] for k in range(i + 1, 6)]
        x[i] = inverse[i] * reduce(sub, later, factor[i][6 - i])
    return seam(x)
