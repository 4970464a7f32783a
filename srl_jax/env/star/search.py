"""Newton's line search, as MJX does it: a bracket whose ends step by their own derivatives, beside its midpoint."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.env.star.algebra import Scalar, gathered, total
from srl_jax.env.star.rows import TINY, Rows, Values, edges
from srl_jax.seam import Seam


class Point(NamedTuple):
    """A step size, the cost there and its derivatives; entries [B], or [A, B] of A sizes."""

    size: Scalar
    cost: Scalar
    slope: Scalar
    curve: Scalar


class Lines(NamedTuple):
    """Rows along the search direction, of one leading axis: r + size j, with weight D."""

    residual: list[Scalar]
    change: list[Scalar]
    weight: list[Scalar]


def line_search(
    rows: Rows,
    residual: Values,
    change: Values,
    inertial: tuple[Scalar, Scalar, Scalar],
    enough: Scalar,
    iterations: int,
    seam: Seam,
) -> Scalar:
    """How far to go along a direction, [B]; 0 where no size tried costs less.

    Args:
        rows: the constraints.
        residual: of the rows at size 0.
        change: of the rows per unit of size.
        inertial: coefficients of the rest of the cost, a polynomial of second degree.
        enough: slope that counts as none.
        iterations: of the bracket; leaving early gains nothing for many robots.
        seam: between stages.
    """
    lines = seam(_lines(rows, residual, change))
    at = lambda size: _points(lines, inertial, size, seam)  # noqa: E731
    start = _only(at(jnp.zeros_like(enough)[None]))
    active = jnp.maximum(start.cost - inertial[0], 0.0), jnp.maximum(0.5 * start.curve - inertial[2], 0.0)
    magnitude = 2 * jnp.sqrt(active[0] * active[1]) + jnp.abs(inertial[1])
    enough = jnp.maximum(enough, 8 * float(jnp.finfo(magnitude.dtype).eps) * magnitude)

    newton = _only(at((start.size - start.slope / start.curve)[None]))
    below = newton.slope < start.slope
    low, high = _where(below, newton, start), _where(below, start, newton)
    flat = lambda p: (jnp.abs(p.slope) < enough) & (p.cost < start.cost)  # noqa: E731
    live = ~(flat(low) | flat(high))

    def narrow(_, carry: tuple[Point, Point, jax.Array]) -> tuple[Point, Point, jax.Array]:
        low, high, live = carry
        sizes = [low.size - low.slope / low.curve, high.size - high.slope / high.curve, 0.5 * (low.size + high.size)]
        tried = at(jnp.stack(sizes))
        narrower = _narrowed(low, high, tried, flat)
        low, high = _where(live, narrower[0], low), _where(live, narrower[1], high)
        return low, high, live & narrower[2] & ~(flat(low) | flat(high))

    low, high, _ = jax.lax.fori_loop(0, iterations, narrow, (low, high, live))
    better = (low.cost < start.cost) | (high.cost < start.cost)
    return jnp.where(better, jnp.where(low.cost < high.cost, low.size, high.size), 0.0)


def _narrowed(low: Point, high: Point, tried: Point, flat) -> tuple[Point, Point, jax.Array]:
    """The bracket after three points were tried, and whether it goes on: it has moved and none of them is flat."""
    from_low, from_high, middle = (jax.tree.map(lambda x, i=i: x[i], tried) for i in range(3))
    moved = jnp.zeros_like(low.size, bool)
    for point in (from_low, middle, from_high):
        inside = _nearer(low, point)
        low, moved = _where(inside, point, low), moved | inside
    crossing = (high.slope < 0) & (from_high.slope > 0)
    for point, also in ((from_high, crossing), (middle, False), (from_low, False)):
        inside = _nearer(high, point) | also
        high, moved = _where(inside, point, high), moved | inside

    best, least, found = from_low, jnp.where(flat(from_low), from_low.cost, jnp.inf), flat(from_low)
    for point in (from_high, middle):
        cost = jnp.where(flat(point), point.cost, jnp.inf)
        best, least, found = _where(cost < least, point, best), jnp.minimum(cost, least), found | flat(point)
    return _where(found, best, low), _where(found, best, high), moved & ~found


def _nearer(end: Point, point: Point) -> jax.Array:
    """Whether a point lies on the same side of the minimum as an end of the bracket, and nearer."""
    return ((end.slope < point.slope) & (point.slope < 0)) | ((end.slope > point.slope) & (point.slope > 0))


def _where(condition: jax.Array, x: Point, y: Point) -> Point:
    return jax.tree.map(lambda u, v: jnp.where(condition, u, v), x, y)


def _only(point: Point) -> Point:
    return jax.tree.map(lambda x: x[0], point)


def _lines(rows: Rows, residual: Values, change: Values) -> list[Lines]:
    """The rows by their leading axis: those of the legs together, then those of the base's spheres."""
    legs = Lines(list(residual.limits), list(change.limits), list(rows.limits.weight))
    found = [legs]
    for contact, r, j in zip(rows.contacts, residual.contacts, change.contacts, strict=True):
        lines = Lines(edges(r), edges(j), [contact.weight] * 4)
        if contact.levers is None:
            found.append(lines)
        else:
            for own, new in zip(legs, lines, strict=True):
                own.extend(new)
    return found


def _points(lines: list[Lines], inertial: tuple, size: Scalar, seam: Seam) -> Point:
    """The cost at sizes [A, B]: rows that are active there add their parabolas."""
    sums = seam([_parabolas(own, size[:, None]) for own in lines])
    c0, c1, c2 = (total(gathered(x[i], axis=1) for x in sums) for i in range(3))
    c0, c1, c2 = inertial[0] + 0.5 * c0, inertial[1] + c1, inertial[2] + 0.5 * c2
    curve = 2 * c2 + jnp.where(c2 == 0, TINY, 0.0)
    return seam(Point(size, size * size * c2 + size * c1 + c0, 2 * size * c2 + c1, curve))


def _parabolas(lines: Lines, size: Scalar) -> list[Scalar]:
    triples = list(zip(*lines, strict=True))
    on = [jnp.where(r + size * j < 0, weight, 0.0) for r, j, weight in triples]
    return [
        total(active * (r * r) for active, (r, _, _) in zip(on, triples, strict=True)),
        total(active * (r * j) for active, (r, j, _) in zip(on, triples, strict=True)),
        total(active * (j * j) for active, (_, j, _) in zip(on, triples, strict=True)),
    ]
