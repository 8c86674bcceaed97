"""Fourier series of periodic functions: from samples, back to samples, and to polynomials.

A series is an array of shape (2, harmonics, functions). It holds the real and imaginary parts of
the coefficients c_n, n >= 0, of the real functions c_0 + 2 Re sum c_n exp(i n psi). Functions are
transformed in pairs, as the real and the imaginary part of one complex function. All sums have a
fixed order.
"""

from __future__ import annotations

import math

from jansen_env.engine.kernel import stage

SQRT_3_OVER_4 = math.sqrt(0.75)


@stage(inline=False)
def _transform(count, columns, turn, work):
    """Compute the inverse discrete Fourier transform of complex columns, without a factor.

    The method is that of Stockham, with radices 4, 3 and 2.

    Args:
        count: Number of samples.
        columns: Number of complex columns.
        turn: Cosines and sines of the angles that divide a turn, shape (2, count).
        work: Input, output and work space, shape (4, count * columns or more). Rows 0 and 1 hold
            the real and imaginary parts of the input, each of shape (count, columns).

    Returns:
        The row of ``work``, 0 or 2, that holds the real part of the result. The next row holds the
        imaginary part.
    """
    left, width, source = count, columns, 0
    while left > 1:
        x, y, u, v = work[source], work[source + 1], work[2 - source], work[3 - source]
        part = left // 4 if left % 4 == 0 else left // 3 if left % 3 == 0 else left // 2
        step = part * width
        for p in range(part):
            k = p * (count // left)
            c1, s1, a = turn[0, k], turn[1, k], p * width
            if left == 2 * part:
                b = 2 * a
                for i in range(width):
                    x0, x1, y0, y1 = x[a + i], x[a + step + i], y[a + i], y[a + step + i]
                    u[b + i], v[b + i] = x0 + x1, y0 + y1
                    dx, dy = x0 - x1, y0 - y1
                    u[b + width + i], v[b + width + i] = c1 * dx - s1 * dy, s1 * dx + c1 * dy
            elif left == 3 * part:
                c2, s2, b = turn[0, 2 * k], turn[1, 2 * k], 3 * a
                for i in range(width):
                    x0, x1, x2 = x[a + i], x[a + step + i], x[a + 2 * step + i]
                    y0, y1, y2 = y[a + i], y[a + step + i], y[a + 2 * step + i]
                    sx, sy, dx, dy = x1 + x2, y1 + y2, x1 - x2, y1 - y2
                    dx, dy = SQRT_3_OVER_4 * dx, SQRT_3_OVER_4 * dy
                    u[b + i], v[b + i] = x0 + sx, y0 + sy
                    mx, my = x0 - 0.5 * sx, y0 - 0.5 * sy
                    ax, ay, bx, by = mx - dy, my + dx, mx + dy, my - dx
                    u[b + width + i], v[b + width + i] = c1 * ax - s1 * ay, s1 * ax + c1 * ay
                    j = b + 2 * width + i
                    u[j], v[j] = c2 * bx - s2 * by, s2 * bx + c2 * by
            else:
                c2, s2, c3, s3 = turn[0, 2 * k], turn[1, 2 * k], turn[0, 3 * k], turn[1, 3 * k]
                b = 4 * a
                for i in range(width):
                    x0, x1, y0, y1 = x[a + i], x[a + step + i], y[a + i], y[a + step + i]
                    x2, x3 = x[a + 2 * step + i], x[a + 3 * step + i]
                    y2, y3 = y[a + 2 * step + i], y[a + 3 * step + i]
                    sx, sy, dx, dy = x0 + x2, y0 + y2, x0 - x2, y0 - y2
                    tx, ty, ex, ey = x1 + x3, y1 + y3, x1 - x3, y1 - y3
                    u[b + i], v[b + i] = sx + tx, sy + ty
                    ax, ay, bx, by = dx - ey, dy + ex, dx + ey, dy - ex
                    j = b + width + i
                    u[j], v[j] = c1 * ax - s1 * ay, s1 * ax + c1 * ay
                    sx, sy, j = sx - tx, sy - ty, j + width
                    u[j], v[j] = c2 * sx - s2 * sy, s2 * sx + c2 * sy
                    j += width
                    u[j], v[j] = c3 * bx - s3 * by, s3 * bx + c3 * by
        left, width, source = part, width * (left // part), 2 - source
    return source


@stage(inline=False)
def _sample(series, factor, odd, turn, work):
    """Compute samples of a series whose coefficients are multiplied by factors.

    The samples are evenly spaced over a turn. With ``pairs`` half the number of functions, rounded
    up, functions f and f + pairs are the real and the imaginary part of column f.

    Args:
        series: The series.
        factor: Real and imaginary part of the factor of each harmonic, shape (2, harmonics).
        odd: Whether the coefficients are also multiplied by i.
        turn: Cosines and sines of the angles that divide a turn, shape (2, samples).
        work: Work space and output, see :func:`_transform`.

    Returns:
        The row of ``work`` with the real part of the result, as :func:`_transform` does.
    """
    count, harmonics, functions = turn.shape[1], series.shape[1], series.shape[2]
    pairs = (functions + 1) // 2
    x, y = work[0], work[1]
    for j in range(harmonics * pairs, (count - harmonics + 1) * pairs):
        x[j] = y[j] = 0.0
    for n in range(harmonics):
        c, s = factor[0, n], factor[1, n]
        if odd:
            c, s = -s, c
        up, down = n * pairs, (count - n) * pairs
        for f in range(pairs):
            g = f + pairs
            a, b = series[0, n, f], series[1, n, f]
            a, b = c * a - s * b, s * a + c * b
            d = e = 0.0
            if g < functions:
                d, e = series[0, n, g], series[1, n, g]
                d, e = c * d - s * e, s * d + c * e
            if n == 0:  # the constant has no conjugate harmonic
                x[up + f], y[up + f] = a, d
            else:
                x[up + f], y[up + f] = a - e, b + d
                x[down + f], y[down + f] = a + e, d - b
    return _transform(count, pairs, turn, work)


@stage(inline=False)
def analyse(values, turn, work, series):
    """Compute the Fourier series of sampled functions.

    Args:
        values: Samples, evenly spaced over a turn, shape (count, functions).
        turn: Cosines and sines of the angles that divide the turn, shape (2, count).
        work: Work space, shape (4, count * pairs or more), where ``pairs`` is half the number of
            functions, rounded up.
        series: Output, shape (2, harmonics, functions).
    """
    count, functions, harmonics = values.shape[0], values.shape[1], series.shape[1]
    pairs = (functions + 1) // 2
    for k in range(count):
        for f in range(pairs):
            work[0, k * pairs + f] = values[k, f]
            work[1, k * pairs + f] = values[k, f + pairs] if f + pairs < functions else 0.0
    first = _transform(count, pairs, turn, work)
    x, y = work[first], work[first + 1]
    half = 0.5 / count
    for n in range(harmonics):
        up, down = n * pairs, (count - n) % count * pairs
        for f in range(pairs):
            a, b, c, d = x[up + f], y[up + f], x[down + f], y[down + f]
            series[0, n, f], series[1, n, f] = half * (a + c), half * (d - b)
            if f + pairs < functions:
                series[0, n, f + pairs], series[1, n, f + pairs] = half * (b + d), half * (a - c)


@stage(inline=False)
def sample(series, factor, turn, work, values):
    """Compute samples of a series, the inverse of :func:`analyse`.

    Args:
        series: The series, shape (2, harmonics, functions).
        factor: Real and imaginary part of the factor by which the coefficients of each harmonic are
            multiplied, shape (2, harmonics).
        turn: Cosines and sines of the angles that divide a turn, shape (2, count).
        work: Work space, see :func:`analyse`.
        values: Output, samples evenly spaced over a turn, shape (count, functions).
    """
    first = _sample(series, factor, False, turn, work)
    pairs = (series.shape[2] + 1) // 2
    for k in range(values.shape[0]):
        for f in range(series.shape[2]):
            place = k * pairs + f if f < pairs else (k - 1) * pairs + f
            values[k, f] = work[first if f < pairs else first + 1, place]


@stage(inline=False)
def expand(series, weights, half_step, turn, work, factor, out):
    """Compute the polynomials that approximate a series in the intervals of a turn.

    The functions of the series are split into groups of equal size, one group after the other.

    Args:
        series: The series, shape (2, harmonics, functions).
        weights: Coefficients of exp(i n psi) about 0, shape (order, harmonics): coefficient k is
            i^k weights[k, n].
        half_step: Cosine and sine of n times half an interval, shape (2, harmonics or more).
        turn: Cosines and sines of the angles that divide a turn into the intervals, shape
            (2, intervals).
        work: Work space, see :func:`analyse`, for as many samples as there are intervals.
        factor: Work space, shape (2, harmonics).
        out: Output, shape (groups, intervals, order, functions of a group).
    """
    pairs, members = (series.shape[2] + 1) // 2, out.shape[3]
    for k in range(weights.shape[0]):
        sign = 1.0 if k % 4 < 2 else -1.0
        for n in range(weights.shape[1]):
            factor[0, n] = sign * weights[k, n] * half_step[0, n]
            factor[1, n] = sign * weights[k, n] * half_step[1, n]
        first = _sample(series, factor, k % 2 == 1, turn, work)
        for group in range(out.shape[0]):
            for row in range(out.shape[1]):
                for member in range(members):
                    f = group * members + member
                    place = row * pairs + f if f < pairs else (row - 1) * pairs + f
                    out[group, row, k, member] = work[first if f < pairs else first + 1, place]
