"""The constrained acceleration: MuJoCo's convex problem, by Newton's method from its warm start as in `mjx.step`.

It minimises ``(a - a_smooth)' M (a - a_smooth) / 2 + sum_i D_i min(r_i, 0)^2 / 2`` with ``r = J a - a_ref``
(Todorov 2014, "Convex and analytically-invertible dynamics with contacts and constraints").
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.env.star import arrow
from srl_jax.env.star import rows as constraints
from srl_jax.env.star.algebra import ENTRIES, PLACE, Scalar, Symmetric, Vector, add, cross, dot, gathered, symvec, total
from srl_jax.env.star.arrow import Arrow, Motion
from srl_jax.env.star.constants import Star
from srl_jax.env.star.rows import Contact, Rows, Values
from srl_jax.env.star.search import line_search
from srl_jax.seam import Seam


class Problem(NamedTuple):
    """What is minimised."""

    mass: Arrow
    force: Motion  # of all but constraints
    smooth: Motion  # acceleration by it
    rows: Rows
    reference: Values  # minus a_ref


class Iterate(NamedTuple):
    """An acceleration and what follows from it."""

    acceleration: Motion
    momentum: Motion  # M a
    residual: Values
    inertial: Scalar  # the first part of the cost [B]
    cost: Scalar  # both parts
    before: Scalar  # cost of the iterate before


def accelerate(star: Star, problem: Problem, warm: Motion, seam: Seam) -> Motion:
    """The acceleration after `star.iterations` of Newton's method."""
    start = first(problem, warm, seam)
    if star.iterations == 1:
        return iterate(star, problem, start, None, seam).acceleration

    def body(_, carry):
        now, live = carry
        after = iterate(star, problem, now, live, seam)
        return after, live & (improvement(problem, after) >= star.tolerance)

    live = jnp.ones_like(start.cost, bool)
    return jax.lax.fori_loop(0, star.iterations, body, (start, live))[0].acceleration


def improvement(problem: Problem, now: Iterate) -> Scalar:
    return (now.before - now.cost) / _trace(problem.mass)


def first(problem: Problem, warm: Motion, seam: Seam) -> Iterate:
    """The warm start, or the smooth acceleration where that costs less."""
    residuals = [
        seam(constraints.combined(constraints.along(problem.rows, x, seam), problem.reference))
        for x in (warm, problem.smooth)
    ]
    momentum = seam(arrow.times(problem.mass, warm))
    inertial = _inertial(problem, warm, momentum)
    cost_warm = constraints.cost(problem.rows, residuals[0]) + inertial
    cost_smooth = constraints.cost(problem.rows, residuals[1])
    warmer, inertial, cost_warm, cost_smooth = seam((cost_warm < cost_smooth, inertial, cost_warm, cost_smooth))
    pick = lambda x, y: jax.tree.map(lambda u, v: jnp.where(warmer, u, v), x, y)  # noqa: E731
    best = Iterate(
        acceleration=pick(warm, problem.smooth),
        momentum=pick(momentum, problem.force),
        residual=pick(residuals[0], residuals[1]),
        inertial=jnp.where(warmer, inertial, 0.0),
        cost=jnp.where(warmer, cost_warm, cost_smooth),
        before=jnp.full_like(inertial, jnp.inf),
    )
    return seam(best)


def _inertial(problem: Problem, acceleration: Motion, momentum: Motion) -> Scalar:
    left, right = arrow.difference(momentum, problem.force), arrow.difference(acceleration, problem.smooth)
    return 0.5 * arrow.inner(left, right)


def _trace(mass: Arrow) -> Scalar:
    return add(total(mass.base[i][i] for i in range(6)), gathered(total(row[-1] for row in mass.legs)))


def iterate(star: Star, problem: Problem, now: Iterate, live: jax.Array | None, seam: Seam) -> Iterate:
    """One step of Newton's method; robots that are not `live` stay, as do those whose gradient is small enough.

    With a single iteration (`live` None) what would only serve the next one is left out.
    """
    gradient, hessian = derivatives(problem, now, seam)
    search = arrow.solve(hessian, Motion(*([-x for x in part] for part in gradient)), seam)
    along = seam(constraints.along(problem.rows, search, seam))
    pushed = seam(arrow.times(problem.mass, search))
    trace = _trace(problem.mass)
    norm = jnp.sqrt(arrow.inner(search, search))
    slope = arrow.inner(search, arrow.difference(now.momentum, problem.force))
    curve = 0.5 * arrow.inner(search, pushed)
    enough, slope, curve = seam((star.search_tolerance * norm * trace, slope, curve))
    step = line_search(
        problem.rows, now.residual, along, (now.inertial, slope, curve), enough, star.search_iterations, seam
    )
    if live is not None:
        steep = jnp.sqrt(arrow.inner(gradient, gradient)) / trace >= star.tolerance
        step = jnp.where(live & steep, step, 0.0)
    step, search = seam((step, search))
    acceleration = arrow.moved(now.acceleration, step, search)
    if live is None:
        return now._replace(acceleration=acceleration)
    momentum = arrow.moved(now.momentum, step, pushed)
    residual = jax.tree.map(lambda r, j: r + step * j, now.residual, along)
    acceleration, momentum, residual = seam((acceleration, momentum, residual))
    inertial = _inertial(problem, acceleration, momentum)
    cost = inertial + constraints.cost(problem.rows, residual)
    return seam(Iterate(acceleration, momentum, residual, inertial, cost, now.cost))


def derivatives(problem: Problem, now: Iterate, seam: Seam) -> tuple[Motion, Arrow]:
    """Gradient ``M a - f - J'f_c`` and Hessian ``H = M + J' D J`` over the rows that are active."""
    rows, mass = problem.rows, problem.mass
    links = range(len(mass.legs))
    pushes = seam([
        _contact(rows, contact, residual, seam)
        for contact, residual in zip(rows.contacts, now.residual.contacts, strict=True)
    ])  # fmt: skip
    lifted = seam([_lifted(contact, stiff) for contact, (_, stiff) in zip(rows.contacts, pushes, strict=True)])

    base = [list(row) for row in mass.base]
    for (_, stiff), (turned, twice, _) in zip(pushes, lifted, strict=True):
        for i in range(3):
            for j in range(i + 1):
                base[i][j] = add(base[i][j], gathered(stiff[PLACE[i][j]]))
                base[3 + i][3 + j] = add(base[3 + i][3 + j], gathered(twice[PLACE[i][j]]))
            for j in range(3):
                base[3 + i][j] = add(base[3 + i][j], gathered(turned[i][j]))
    active = [jnp.where(r < 0, w, 0.0) for r, w in zip(now.residual.limits, rows.limits.weight, strict=True)]
    coupling, legs = [list(row) for row in mass.coupling], [list(row) for row in mass.legs]
    gradient = arrow.difference(now.momentum, problem.force)
    down, torque = list(gradient.base), list(gradient.legs)
    for contact, (force, _), (_, _, springs) in zip(rows.contacts, pushes, lifted, strict=True):
        wrench = [*force, *cross(contact.point, force)]
        down = [x - gathered(f) for x, f in zip(down, wrench, strict=True)]
        if contact.levers is None or springs is None:
            continue
        for k in links:
            arm = [*springs[k], *cross(contact.point, springs[k])]
            for i in range(6):
                coupling[i][k] = add(coupling[i][k], arm[i])
            for j in range(k + 1):
                legs[k][j] = add(legs[k][j], dot(contact.levers[k], springs[j]))
            torque[k] = torque[k] - dot(contact.levers[k], force)
    for k in links:
        legs[k][k] = legs[k][k] + active[k]
        torque[k] = torque[k] + rows.limits.sign[k] * active[k] * now.residual.limits[k]
    base, down = seam((base, down))
    coupling, legs, torque = seam((coupling, legs, torque))
    return Motion(down, torque), Arrow(base, coupling, legs)


def _contact(rows: Rows, contact: Contact, residual: Vector, seam: Seam) -> tuple[Vector, Symmetric]:
    """A contact's force, and how stiffly it answers to a motion of its point: ``sum_edges D e e'``."""
    edges = constraints.edges(residual)
    on = [jnp.where(edge < 0, contact.weight, 0.0) for edge in edges]
    on, force = seam((on, [-weight * edge for weight, edge in zip(on, edges, strict=True)]))
    mu, frame = rows.friction, rows.frame
    normal = (force[0] + force[1]) + (force[2] + force[3])
    pull = [normal, mu * (force[0] - force[1]), mu * (force[2] - force[3])]
    nn, n1, n2 = (on[0] + on[1]) + (on[2] + on[3]), mu * (on[0] - on[1]), mu * (on[2] - on[3])
    tt1, tt2 = mu * mu * (on[0] + on[1]), mu * mu * (on[2] + on[3])
    cartesian = [total(frame[c][i] * pull[c] for c in range(3)) for i in range(3)]
    n, t1, t2 = frame
    half = [[n[i] * nn + t1[i] * n1 + t2[i] * n2, n[i] * n1 + t1[i] * tt1, n[i] * n2 + t2[i] * tt2] for i in range(3)]
    stiff = [total(half[i][c] * frame[c][j] for c in range(3)) for i, j in ENTRIES]
    return cartesian, stiff


def _lifted(contact: Contact, stiff: Symmetric) -> tuple[list[Vector], Symmetric, list[Vector] | None]:
    """A point's stiffness K as the base's rotation meets it, ``[p] K``, ``[p] K [p]'``, and its joints, ``K lever``."""
    columns = [[stiff[PLACE[i][j]] for i in range(3)] for j in range(3)]
    crossed = [cross(contact.point, column) for column in columns]
    turned = [[crossed[j][i] for j in range(3)] for i in range(3)]
    both = [cross(contact.point, turned[i]) for i in range(3)]
    springs = None if contact.levers is None else [symvec(stiff, lever) for lever in contact.levers]
    return turned, [both[i][j] for i, j in ENTRIES], springs
