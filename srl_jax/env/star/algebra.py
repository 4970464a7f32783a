"""Small vectors and matrices whose entries are arrays over robots, or plain numbers.

Written out entry by entry, since XLA gives every 3 x 3 product of many robots a loop over robots of its own. Plain
zeros and ones vanish while tracing: most constants of a robot (an axis, an offset along one) are one or the other.
"""

from collections.abc import Iterable
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp

Scalar = Any  # jax.Array with robots along its last axis, np.ndarray [L, 1] that differs between legs, or a number
Vector = list[Scalar]  # x, y, z
Matrix = list[Vector]
Symmetric = list[Scalar]  # xx, yy, zz, xy, xz, yz

ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # of a `Symmetric`
PLACE = ((0, 3, 4), (3, 1, 5), (4, 5, 2))  # where entry (i, j) of one is


def is_number(x: Scalar) -> bool:
    """Whether an entry is a plain number rather than an array."""
    return isinstance(x, int | float)


def mul(a: Scalar, b: Scalar) -> Scalar:
    for x, y in ((a, b), (b, a)):
        if is_number(x) and x in (0, 1, -1):
            return 0.0 if x == 0 else y if x == 1 else -y
    return a * b


def add(a: Scalar, b: Scalar) -> Scalar:
    return b if is_number(a) and a == 0 else a if is_number(b) and b == 0 else a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    return -b if is_number(a) and a == 0 else a if is_number(b) and b == 0 else a - b


def total(terms: Iterable[Scalar]) -> Scalar:
    return reduce(add, terms, 0.0)


def gathered(x: Scalar, axis: int = 0) -> Scalar:
    """The sum over the legs' or points' axis, as a tree of slices: they fuse, where a reduction would not."""
    if is_number(x) and x == 0:  # by the shape of every leg
        return x
    parts = [jax.lax.index_in_dim(x, i, axis, keepdims=False) for i in range(x.shape[axis])]
    while len(parts) > 1:
        parts = [total(parts[i : i + 2]) for i in range(0, len(parts), 2)]
    return parts[0]


def dot(u: Vector, v: Vector) -> Scalar:
    return total(mul(a, b) for a, b in zip(u, v, strict=True))


def cross(u: Vector, v: Vector) -> Vector:
    return [sub(mul(u[i], v[j]), mul(u[j], v[i])) for i, j in ((1, 2), (2, 0), (0, 1))]


def plus(*vectors: Vector) -> Vector:
    return [total(entries) for entries in zip(*vectors, strict=True)]


def minus(u: Vector, v: Vector) -> Vector:
    return [sub(a, b) for a, b in zip(u, v, strict=True)]


def scale(s: Scalar, v: Vector) -> Vector:
    return [mul(s, a) for a in v]


def matvec(m: Matrix, v: Vector) -> Vector:
    return [dot(row, v) for row in m]


def matmul(a: Matrix, b: Matrix) -> Matrix:
    return [[dot(row, [b[k][j] for k in range(3)]) for j in range(3)] for row in a]


def symvec(s: Symmetric, v: Vector) -> Vector:
    """A symmetric matrix times a vector."""
    return [dot([s[PLACE[i][j]] for j in range(3)], v) for i in range(3)]


def similar(a: Matrix, diagonal: Vector) -> Symmetric:
    """``a diag(d) a'``."""
    scaled = [[mul(a[i][j], diagonal[j]) for j in range(3)] for i in range(3)]
    return [dot(scaled[i], a[j]) for i, j in ENTRIES]


def steiner(mass: Scalar, com: Vector) -> Symmetric:
    """What a point mass adds to an inertia about the origin: ``m (c'c 1 - c c')``."""
    h = scale(mass, com)
    xx, yy, zz = (mul(h[i], com[i]) for i in range(3))
    off = [sub(0.0, mul(h[i], com[j])) for i, j in ENTRIES[3:]]
    return [add(yy, zz), add(xx, zz), add(xx, yy), *off]


def about_axis(axis: Vector, sine: Scalar, cosine: Scalar) -> Matrix:
    """Rodrigues' rotation about a constant unit axis; the identity about one of zeros at angle 0."""
    x, y, z = axis
    rest = sub(1.0, cosine)

    def diagonal(p: Scalar) -> Scalar:
        if is_number(p) and abs(p) in (0, 1):
            return cosine if p == 0 else 1.0
        return add(mul(mul(p, p), rest), cosine)

    def off(p: Scalar, q: Scalar, turn: Scalar) -> Scalar:
        return add(mul(mul(p, q), rest), turn)

    sx, sy, sz = (mul(p, sine) for p in axis)
    return [
        [diagonal(x), off(x, y, sub(0.0, sz)), off(x, z, sy)],
        [off(x, y, sz), diagonal(y), off(y, z, sub(0.0, sx))],
        [off(x, z, sub(0.0, sy)), off(y, z, sx), diagonal(z)],
    ]


def sincos(x: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Sine and cosine; in f32 to about 1 ulp for ``|x| < 1e4`` and by arithmetic alone: a library call would not fuse.

    Cody and Waite's reduction by multiples of pi/2 in three parts, and the minimax polynomials of Cephes.
    """
    if x.dtype != jnp.float32:
        return jnp.sin(x), jnp.cos(x)
    quarter = jnp.round(x * 0.63661977236758134308)
    r = ((x - quarter * 1.5703125) - quarter * 4.837512969970703e-4) - quarter * 7.549789948768648e-8
    z = r * r
    sine = r + r * z * (-1.6666654611e-1 + z * (8.3321608736e-3 + z * -1.9515295891e-4))
    tail = 4.166664568298827e-2 + z * (-1.388731625493765e-3 + z * 2.443315711809948e-5)
    cosine = 1.0 - 0.5 * z + z * z * tail
    n = quarter.astype(jnp.int32)
    odd = (n & 1) == 1
    s, c = jnp.where(odd, cosine, sine), jnp.where(odd, sine, cosine)
    return jnp.where((n & 2) == 2, -s, s), jnp.where(((n + 1) & 2) == 2, -c, c)
