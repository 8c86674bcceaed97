"""Computation of the periodic tables of a robot from the motion of a leg.

:mod:`jansen_env.dynamics.reduced` explains the tables.
"""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Floats1, Floats2, Floats3, Floats4, Ints2, kernel, stage
from jansen_env.engine.link_shapes import Links
from jansen_env.engine.series import analyse, expand, sample
from jansen_env.engine.sums import pairwise_sum

TURN = 2.0 * math.pi
LAST = 7, 8  # fraction 7/8 of the harmonics, after which the tail begins
# The tail of a function is relative to at least this fraction of the largest coefficient, because
# the coefficients of a body that does not turn are only rounding errors.
NEGLIGIBLE = 1e-3
ONE, SLOPE, WORK = range(3)  # indices of the factors for :func:`sample` and :func:`expand`
SAMPLES = 256  # crank angles at which the linkage is closed
HARMONICS = SAMPLES // 2  # the paper's linkage needs about 40 for an accuracy of 1e-14
# Polynomials per turn. The slopes for the holy numbers have errors of 1e-10 of the largest slope.
INTERVALS = 384
ORDER = 8  # coefficients of a polynomial; the code of the engine is written out for eight
BEARING_SAMPLES = 512  # crank angles at which the friction of bearings is sampled; it has kinks
BODY_SUMS, PAD_FUNCTIONS = 8, 3  # numbers of functions in the tables of the body and of a pad


@kernel
def put_turn(out: Floats2) -> None:
    """Compute the cosines and sines of the angles that divide a turn.

    Args:
        out: Output, shape (2, count).
    """
    count = out.shape[1]
    for part in range(count):
        # Measure the angle from the nearest quarter turn, so that it is small.
        quarter = mathematics.nearest(4.0 * part / count)
        angle = 0.5 * math.pi * (4.0 * part - quarter * count) / count
        cos, sin = mathematics.cos(angle), mathematics.sin(angle)
        for _ in range(int(quarter) % 4):
            cos, sin = -sin, cos
        out[0, part], out[1, part] = cos, sin


@kernel
def put_work_shapes(bodies: int, pads: int, bearings: int, shapes: Ints2) -> None:
    """Compute the shapes of the work space of :func:`compile_tables`, in argument order.

    Args:
        bodies: Number of bodies of a leg.
        pads: Number of pads of a leg.
        bearings: Number of bearings of a leg.
        shapes: Output, shape (18, 3). The row of an array with fewer than three axes ends with
            zeros.
    """
    shapes[:] = 0
    links, places, rates = 3 * bodies, PAD_FUNCTIONS * pads, bearings
    widest = SAMPLES * max(max(links, BODY_SUMS), max(places, rates))
    widest = max(widest, INTERVALS * max(BODY_SUMS, places))
    _put_shape(4, max(widest, BEARING_SAMPLES * rates), 0, shapes[0])
    _put_shape(3, 2, HARMONICS, shapes[1])
    _put_shape(bodies, 0, 0, shapes[2])
    _put_shape(SAMPLES, links, 0, shapes[3])
    _put_shape(2, HARMONICS, links, shapes[4])
    _put_shape(SAMPLES, links, 0, shapes[5])
    _put_shape(SAMPLES, BODY_SUMS, 0, shapes[6])
    _put_shape(2, HARMONICS, BODY_SUMS, shapes[7])
    _put_shape(2, HARMONICS, BODY_SUMS, shapes[8])
    _put_shape(SAMPLES, places, 0, shapes[9])
    _put_shape(2, HARMONICS, places, shapes[10])
    _put_shape(SAMPLES, rates, 0, shapes[11])
    _put_shape(2, HARMONICS, rates, shapes[12])
    _put_shape(2, HARMONICS, rates, shapes[13])
    _put_shape(BEARING_SAMPLES, rates, 0, shapes[14])
    _put_shape(SAMPLES, 1, 0, shapes[15])
    _put_shape(2, HARMONICS, 1, shapes[16])
    _put_shape(2, HARMONICS, 1, shapes[17])


@stage
def _put_shape(first, second, third, shape):
    """Store the shape of an array."""
    shape[0], shape[1], shape[2] = first, second, third


@kernel
def compile_tables(
    psi: Floats1,
    x: Floats3,
    places: Floats3,
    links: Links,
    damped: Ints2,
    damping: Floats1,
    bearings: Ints2,
    friction: Floats1,
    springs: Ints2,
    spring_values: Floats2,
    torsion: Ints2,
    torsion_values: Floats2,
    legs: Floats2,
    pads: Ints2,
    weights: Floats2,
    turn: Floats2,
    table_turn: Floats2,
    half_step: Floats2,
    bearing_turn: Floats2,
    work: Floats2,
    factors: Floats3,
    turns: Floats1,
    motion: Floats2,
    motion_series: Floats3,
    slope: Floats2,
    sums: Floats2,
    sum_series: Floats3,
    all_sums: Floats3,
    pad_motion: Floats2,
    pad_series: Floats3,
    rates: Floats2,
    rate_series: Floats3,
    leg_rates: Floats3,
    turning: Floats2,
    potential: Floats2,
    potential_series: Floats3,
    all_potentials: Floats3,
    body: Floats4,
    pad_tables: Floats4,
    bearing_table: Floats1,
    spring_table: Floats4,
) -> float:
    """Compile the tables of a robot.

    Args:
        psi: Crank angles, evenly spaced over a turn, in rad, shape (n,).
        x: Coordinates of the bodies of a fore leg: angle in rad, and position of the centre of mass
            in m, shape (n, bodies, 3).
        places: Positions of the joints of a fore leg, in m, shape (n, joints, 2).
        links: Links, of which only mass and inertia are used, shape (bodies,).
        damped: Pairs of bodies with viscous damping between them, shape (pairs, 2).
        damping: Damping between these bodies, in N m s, shape (pairs,).
        bearings: Pairs of bodies with a bearing between them, shape (bearings, 2).
        friction: Coulomb friction of these bearings, in N m, shape (bearings,).
        springs: Joints at the ends of each linear spring, shape (springs, 2). The second is -1 for
            a point of the chassis.
        spring_values: Stiffness (N/m) and rest length (m) of these springs, and the point of the
            chassis (x, y, m), shape (springs, 4).
        torsion: Bodies of each torsion spring, shape (torsion springs, 2).
        torsion_values: Stiffness (N m/rad) and rest angle (rad) of these springs, shape (torsion
            springs, 2).
        legs: Side of each leg (1 for fore, -1 for back) and its phase in rad, shape (legs, 2).
        pads: Joint and body of each pad of a leg, shape (pads, 2).
        weights: See :func:`jansen_env.engine.series.expand`.
        turn: Output of :func:`put_turn` for the n crank angles.
        table_turn: Output of :func:`put_turn` for the intervals.
        half_step: See :func:`jansen_env.engine.series.expand`.
        bearing_turn: Output of :func:`put_turn` for the samples of the bearings.
        work: Work space; :func:`put_work_shapes` computes the shapes of this and the following
            arrays up to ``all_potentials``.
        factors: Work space for the factors of the coefficients.
        turns: Work space for the number of turns of each body per turn of the crank.
        motion: Work space for the angles and positions of the bodies.
        motion_series: Work space for the series of these angles and positions.
        slope: Work space for the derivatives of these angles and positions.
        sums: Work space for the sums over the bodies of a fore leg.
        sum_series: Work space for the series of these sums.
        all_sums: Work space for the series of the sums over all legs.
        pad_motion: Work space for the positions and angles of the pads.
        pad_series: Work space for the series of these positions and angles.
        rates: Work space for the relative rates of the bodies at the bearings.
        rate_series: Work space for the series of these rates.
        leg_rates: Work space for the series of the rates in one leg.
        turning: Work space for the samples of these rates.
        potential: Work space for the energy of the springs of a fore leg.
        potential_series: Work space for the series of this energy.
        all_potentials: Work space for the series of the energy over all legs.
        body: Output, shape (1, intervals, order, functions).
        pad_tables: Output, shape (pads, intervals, order, functions).
        bearing_table: Output, Coulomb friction of all bearings on the crank, in N m, shape
            (samples,).
        spring_table: Output, energy of all springs, shape (1, intervals, order, 1).

    Returns:
        The tail of the series: the largest coefficient of the last harmonics, relative to the
        largest coefficient of the same function (see :func:`_tail`). It is infinite if a torsion
        spring is between two bodies that make whole turns relative to each other.
    """
    count, bodies = len(psi), len(links)
    for k in range(bodies):
        turns[k] = links[k].inertia
    inertia = pairwise_sum(turns)
    for n in range(factors.shape[2]):
        factors[ONE, 0, n], factors[ONE, 1, n] = 1.0, 0.0
        factors[SLOPE, 0, n], factors[SLOPE, 1, n] = 0.0, n
    for k in range(bodies):
        _unwrap(psi, x, k, turns, motion)
        for i in range(count):
            motion[i, bodies + k], motion[i, 2 * bodies + k] = x[i, k, 1], x[i, k, 2]
    analyse(motion, turn, work, motion_series)
    sample(motion_series, factors[SLOPE], turn, work, slope)
    for i in range(count):
        for k in range(bodies):
            slope[i, k] += turns[k]
        _add_up(x[i], slope[i], links, inertia, damped, damping, sums[i])
        for k in range(len(pads)):
            joint, link = pads[k]
            pad_motion[i, 3 * k], pad_motion[i, 3 * k + 1] = places[i, joint]
            pad_motion[i, 3 * k + 2] = motion[i, link]
        for k in range(len(bearings)):
            first, second = bearings[k]
            rates[i, k] = slope[i, second] - slope[i, first]
    analyse(sums, turn, work, sum_series)
    analyse(pad_motion, turn, work, pad_series)
    all_sums[:] = 0.0
    for side in (1.0, -1.0):
        _add_legs(sum_series, legs, side, 1, all_sums)
    expand(all_sums, weights, half_step, table_turn, work, factors[WORK], body)
    expand(pad_series, weights, half_step, table_turn, work, factors[WORK], pad_tables)
    for k in range(len(pads)):
        for row in range(pad_tables.shape[1]):
            pad_tables[k, row, 1, 2] += turns[pads[k, 1]]
    bearing_table[:] = 0.0
    largest = 0.0
    for k in range(len(friction)):
        largest = max(largest, friction[k])
    if largest > 0.0:
        analyse(rates, turn, work, rate_series)
        for leg in range(len(legs)):
            leg_rates[:] = 0.0
            _add_legs(rate_series, legs[leg : leg + 1], legs[leg, 0], 0, leg_rates)
            sample(leg_rates, factors[ONE], bearing_turn, work, turning)
            for i in range(len(bearing_table)):
                total = 0.0
                for k in range(len(friction)):
                    total += friction[k] * abs(turning[i, k])
                bearing_table[i] += total
    tail = max(_tail(motion_series), _tail(sum_series), _tail(pad_series))
    spring_table[:] = 0.0
    if len(springs) + len(torsion) > 0:
        for i in range(count):
            potential[i, 0] = _spring_potential(places[i], springs, spring_values)
        for k in range(len(torsion)):
            if turns[torsion[k, 0]] != turns[torsion[k, 1]]:
                return math.inf
            _add_torsion(motion, torsion[k], torsion_values[k], potential)
        analyse(potential, turn, work, potential_series)
        all_potentials[:] = 0.0
        for side in (1.0, -1.0):
            _add_legs(potential_series, legs, side, 0, all_potentials)
        expand(all_potentials, weights, half_step, table_turn, work, factors[WORK], spring_table)
        tail = max(tail, _tail(potential_series))
    return tail


@stage(inline=False)
def _spring_potential(places, springs, values):
    """Return the energy of the linear springs of a leg, in J.

    Args:
        places: Positions of the joints in the chassis frame, in m, shape (joints, 2).
        springs: Joints at the ends of the springs, shape (springs, 2).
        values: Stiffness, rest length, and position of the end on the chassis, shape (springs, 4).
    """
    energy = 0.0
    for k in range(len(springs)):
        start, end = springs[k]
        x, y = values[k, 2], values[k, 3]
        if end >= 0:
            x, y = places[end, 0], places[end, 1]
        stretch = mathematics.hypot(places[start, 0] - x, places[start, 1] - y) - values[k, 1]
        energy += 0.5 * values[k, 0] * stretch * stretch
    return energy


@stage(inline=False)
def _add_torsion(motion, pair, values, potential):
    """Add the energy of a torsion spring to that of the other springs.

    Args:
        motion: Angles of the bodies without whole turns, in rad, shape (samples, bodies or more).
        pair: Indices of the two bodies, shape (2,).
        values: Stiffness in N m/rad and rest angle in rad, shape (2,).
        potential: Energy in J, changed in place, shape (samples, 1).
    """
    first, second = pair
    total, count = 0.0, len(motion)
    for i in range(count):
        total += motion[i, second] - motion[i, first]
    mean = total / count - values[1]
    rest = values[1] + TURN * mathematics.nearest(mean / TURN)
    for i in range(count):
        deflection = motion[i, second] - motion[i, first] - rest
        potential[i, 0] += 0.5 * values[0] * deflection * deflection


@stage(inline=False)
def _unwrap(psi, x, k, turns, motion):
    """Compute the periodic part of the angle of body ``k``, and the whole turns that it makes.

    The angle is unwrapped as by ``numpy.unwrap``. ``turns[k]`` gets the number of whole turns of
    the body per turn of the crank, and ``motion[:, k]`` the angle without these turns, in rad.
    """
    correction = 0.0
    motion[0, k] = x[0, k, 0]
    for i in range(1, len(psi)):
        step = x[i, k, 0] - x[i - 1, k, 0]
        short = step + math.pi
        short = (
            short + TURN if short < 0.0 else short - TURN if short >= TURN else short
        ) - math.pi
        if short == -math.pi and step > 0.0:
            short = math.pi
        if abs(step) >= math.pi:
            correction += short - step
        motion[i, k] = x[i, k, 0] + correction
    turns[k] = mathematics.nearest((motion[len(psi) - 1, k] - motion[0, k]) / TURN)
    for i in range(len(psi)):
        motion[i, k] -= psi[i] * turns[k]


@stage(inline=False)
def _add_up(x, slope, links, inertia, damped, damping, sums):
    """Compute the contribution of a fore leg to the sums over the bodies at a crank angle.

    Args:
        x: Coordinates of the bodies, shape (bodies, 3).
        slope: Their derivatives with respect to the crank angle: all angles, then all x, then all
            y, shape (3 * bodies,).
        links: Links, of which only mass and inertia are used, shape (bodies,).
        inertia: Sum of the inertias of the links, in kg m^2.
        damped: Pairs of bodies with viscous damping between them, shape (pairs, 2).
        damping: Damping between these bodies, in N m s, shape (pairs,).
        sums: Output, shape (8,): c_x, c_y, I, b, k, f, and the parts of b and k that come from the
            inertias of the links.
    """
    bodies = len(links)
    sums[:] = 0.0
    for k in range(bodies):
        mass, centroidal = links[k].mass, links[k].inertia
        px, py = x[k, 1], x[k, 2]
        da, dx, dy = slope[k], slope[bodies + k], slope[2 * bodies + k]
        sums[0] += mass * px
        sums[1] += mass * py
        sums[2] += mass * (px * px + py * py)
        sums[3] += mass * (px * dy - py * dx)
        sums[4] += mass * (dx * dx + dy * dy)
        sums[6] += centroidal * da
        sums[7] += centroidal * (da * da)
    for k in range(len(damped)):
        first, second = damped[k]
        rate = slope[second] - slope[first]
        sums[5] += damping[k] * (rate * rate)
    sums[2] += inertia
    sums[3] += sums[6]
    sums[4] += sums[7]


@stage(inline=False)
def _add_legs(series, legs, side, mirrored, total):
    """Add the series of all legs on one side of the robot to a total.

    If g(psi) is a function of a fore leg of phase 0, the function of any fore leg is
    g(psi + phase), and that of a back leg g(pi - psi - phase). On back legs, the first ``mirrored``
    functions also change their sign.
    """
    for n in range(series.shape[1]):
        cos = sin = 0.0
        for k in range(len(legs)):
            if legs[k, 0] == side:
                cos += mathematics.cos(legs[k, 1] * n)
                sin += mathematics.sin(legs[k, 1] * n)
        for f in range(series.shape[2]):
            sign = -1.0 if side < 0.0 and (n % 2 == 1) != (f < mirrored) else 1.0
            real, imaginary = sign * series[0, n, f], sign * side * series[1, n, f]
            total[0, n, f] += cos * real - sin * imaginary
            total[1, n, f] += sin * real + cos * imaginary


@stage(inline=False)
def _tail(series):
    """Return the largest coefficient among the last harmonics.

    The coefficient is relative to the largest coefficient of the same function, or to a thousandth
    of the largest coefficient of all functions if this is more.
    """
    last = series.shape[1] * LAST[0] // LAST[1]
    largest = tail = 0.0
    for n in range(series.shape[1]):
        for f in range(series.shape[2]):
            largest = max(largest, mathematics.hypot(series[0, n, f], series[1, n, f]))
    for f in range(series.shape[2]):
        peak = end = 0.0
        for n in range(series.shape[1]):
            size = mathematics.hypot(series[0, n, f], series[1, n, f])
            peak = max(peak, size)
            end = max(end, size) if n >= last else end
        tail = max(tail, end / max(peak, NEGLIGIBLE * largest))
    return tail
