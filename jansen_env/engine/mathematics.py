"""Elementary functions with defined rounding, which return the same bits on every processor.

The mathematical libraries of operating systems differ in the last digits of their results, and so
do their variants for different processors. The functions of this module use only + - * / and sqrt,
whose rounding IEEE 754 defines, and integers that hold the bits of a number. The methods and
coefficients of sin, cos, atan2, log and exp are those of fdlibm (Sun Microsystems, 1993), as in
FreeBSD's msun and in musl. Errors are given in units in the last place (ulp); the tests check them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.engine.kernel import Floats1, Floats2, Kernel, kernel, stage

ROUNDER = 1.5 * 2.0**52  # adding and subtracting this number rounds |x| < 2^51 to a whole number
SPLITTER = 2.0**27 + 1.0  # Veltkamp's constant: splits numbers into halves with exact products

TWO_OVER_PI = 6.36619772367581382433e-01
# pi / 2 in parts of 33 bits, so that a multiple of each part is exact. The names that end with T
# hold the remainder after this part.
PIO2_1, PIO2_1T = 1.57079632673412561417e00, 6.07710050650619224932e-11
PIO2_2 = 6.07710050630396597660e-11
PIO2_3, PIO2_3T = 2.02226624871116645580e-21, 8.47842766036889956997e-32

S1, S2, S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S4, S5, S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C1, C2, C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C4, C5, C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11

# pi = math.pi + PI_LOW, and likewise atan(0.5), atan(1), atan(1.5) and atan(infinity) below.
PI_LOW = 1.2246467991473531772e-16
ATAN_HALF, ATAN_HALF_LOW = 4.63647609000806093515e-01, 2.26987774529616870924e-17
ATAN_ONE, ATAN_ONE_LOW = 7.85398163397448278999e-01, 3.06161699786838301793e-17
ATAN_MORE, ATAN_MORE_LOW = 9.82793723247329054082e-01, 1.39033110312309984516e-17
ATAN_ALL, ATAN_ALL_LOW = 1.57079632679489655800e00, 6.12323399573676603587e-17
A0, A1, A2 = 3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01
A3, A4, A5 = -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02
A6, A7, A8 = 6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02
A9, A10 = -3.65315727442169155270e-02, 1.62858201153657823623e-02

LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
ONE_OVER_LN2 = 1.44269504088896338700e00
L1, L2, L3 = 6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01
L4, L5, L6 = 2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01
L7 = 1.479819860511658591e-01
P1, P2, P3 = 1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05
P4, P5 = -1.65339022054652515390e-06, 4.13813679705723846039e-08

MANTISSA = 2**52 - 1  # mask for the bits of the fraction of a float
BIAS = 1023  # bias of the exponent of a float
SQRT_HALF_BITS = 0x3FE6A09E << 32  # bits of approximately sqrt(1/2)
LARGEST_EXPONENT = 800.0  # the exponential function of larger numbers is infinite


@stage
def nearest(x):
    """Return the whole number nearest to x, |x| < 2^51; halves are rounded to even numbers."""
    return (x + ROUNDER) - ROUNDER


@stage
def floor(x):
    """Return the largest whole number that is not above x, |x| < 2^51."""
    whole = (x + ROUNDER) - ROUNDER
    return whole - 1.0 if whole > x else whole


@stage
def modulo(x, period):
    """Return ``x`` modulo a positive ``period``, from 0 to ``period``, as NumPy's ``%`` does.

    The remainder is exact, because only multiples of ``period`` times a power of two are
    subtracted from larger numbers of at most twice their size.
    """
    rest = abs(x)
    if not rest < math.inf:
        return math.nan
    while rest >= period:
        step = period
        while 2.0 * step <= rest:
            step *= 2.0
        rest -= step
    return period - rest if x < 0.0 and rest > 0.0 else rest


@stage
def hypot(x, y):
    """Return sqrt(x^2 + y^2) with an error of 1 ulp; the squares must not overflow."""
    return math.sqrt(x * x + y * y)


@stage
def _reduced(x):
    """Reduce an angle x (rad) by whole quarter turns.

    Returns:
        The quadrant, from -2 to 2; the reduced angle; and the rounding error of this angle.
    """
    count = nearest(x * TWO_OVER_PI)
    first = x - count * PIO2_1
    second = count * PIO2_1T
    angle = first - second
    rest = (first - angle) - second
    if abs(angle) < 2e-5 * abs(x):  # so near a multiple of pi / 2, more digits of pi are needed
        second = count * PIO2_2
        both = first - second
        third = count * PIO2_3
        angle = both - third
        lost = ((both - angle) - third) + ((first - both) - second)
        rest = lost - count * PIO2_3T
        whole = angle + rest
        angle, rest = whole, (angle - whole) + rest
    return count - 4.0 * nearest(0.25 * count), angle, rest


@stage
def _sine(x, rest):
    """Return sin(x + rest) for |x| <= pi / 4."""
    z = x * x
    w = z * z
    r = S2 + z * (S3 + z * S4) + z * w * (S5 + z * S6)
    v = z * x
    return x - ((z * (0.5 * rest - v * r) - rest) - v * S1)


@stage
def _cosine(x, rest):
    """Return cos(x + rest) for |x| <= pi / 4."""
    z = x * x
    w = z * z
    r = z * (C1 + z * (C2 + z * C3)) + w * w * (C4 + z * (C5 + z * C6))
    half = 0.5 * z
    whole = 1.0 - half
    return whole + (((1.0 - whole) - half) + (z * r - x * rest))


@stage
def sin(x):
    """Return the sine of x (rad) with an error of 1 ulp.

    For |x| > 1e6 rad, the error grows with |x|.
    """
    quadrant, angle, rest = _reduced(x)
    value = _cosine(angle, rest) if abs(quadrant) == 1.0 else _sine(angle, rest)
    return -value if quadrant == -1.0 or abs(quadrant) == 2.0 else value


@stage
def cos(x):
    """Return the cosine of x (rad), as accurately as :func:`sin`."""
    quadrant, angle, rest = _reduced(x)
    value = _sine(angle, rest) if abs(quadrant) == 1.0 else _cosine(angle, rest)
    return -value if quadrant > 0.5 or quadrant == -2.0 else value


@stage
def atan2(y, x):
    """Return the angle of the vector (x, y), in rad, in (-pi, pi], with an error of 2 ulp.

    The angle of (0, 0) is 0, whatever the signs of the zeros are. Both x and y must be finite, and
    their squares must not overflow.
    """
    up, side = abs(y), abs(x)
    # Take the angle of the nearest of five rays, and the tangent t of the angle to this ray.
    if 16.0 * up < 7.0 * side or up + side == 0.0:
        high, low, t = 0.0, 0.0, up / side if side > 0.0 else 0.0
    elif 16.0 * up < 11.0 * side:
        high, low, t = ATAN_HALF, ATAN_HALF_LOW, (2.0 * up - side) / (2.0 * side + up)
    elif 16.0 * up < 19.0 * side:
        high, low, t = ATAN_ONE, ATAN_ONE_LOW, (up - side) / (side + up)
    elif 16.0 * up < 39.0 * side:
        high, low, t = ATAN_MORE, ATAN_MORE_LOW, (up - 1.5 * side) / (side + 1.5 * up)
    else:
        high, low, t = ATAN_ALL, ATAN_ALL_LOW, -side / up
    z = t * t
    w = z * z
    even = z * (A0 + w * (A2 + w * (A4 + w * (A6 + w * (A8 + w * A10)))))
    odd = w * (A1 + w * (A3 + w * (A5 + w * (A7 + w * A9))))
    angle = high - ((t * (even + odd) - low) - t)
    if x < 0.0:
        angle = math.pi - (angle - PI_LOW)
    return -angle if y < 0.0 else angle


@stage
def acos(x):
    """Return the angle whose cosine is x, |x| <= 1, in rad, with an error of 3 ulp."""
    return atan2(math.sqrt((1.0 - x) * (1.0 + x)), x)


@stage
def tan(x):
    """Return the tangent of x (rad), with an error of 3 ulp for |x| <= 1e6 rad."""
    return sin(x) / cos(x)


@stage
def _parts(x):
    """Split 0 < x < infinity into (k, f) with x = 2^k (1 + f).

    f lies approximately in [sqrt(1/2) - 1, sqrt(2) - 1].
    """
    down = 0
    if x < 2.0**-1022:
        x, down = x * 2.0**54, 54
    bits = np.int64(np.float64(x).view(np.int64)) + ((BIAS << 52) - SQRT_HALF_BITS)
    fraction = np.int64((bits & MANTISSA) + SQRT_HALF_BITS)
    return float((bits >> 52) - (BIAS + down)), float(fraction.view(np.float64)) - 1.0


@stage
def _two_to(k):
    """Return 2^k for a whole number -1022 <= k <= 1023.

    The sum of k and ``ROUNDER`` has the bits of k at its end. They are shifted to the exponent.
    """
    bits = np.int64(np.float64(k + ROUNDER).view(np.int64)) << 52
    return float(np.int64(bits + (BIAS << 52)).view(np.float64))


@stage
def _log_rest(s):
    """Return (log(1 + f) - 2 s) / s for s = f / (2 + f)."""
    z = s * s
    w = z * z
    return w * (L2 + w * (L4 + w * L6)) + z * (L1 + w * (L3 + w * (L5 + w * L7)))


@stage
def log(x):
    """Return the natural logarithm of x, with an error of 1 ulp."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else math.nan if x < 0.0 else x
    k, f = _parts(x)
    square = 0.5 * f * f
    s = f / (2.0 + f)
    return s * (square + _log_rest(s)) + k * LN2_LOW - square + f + k * LN2_HIGH


@stage
def _exp_parts(x, rest):
    """Return (k, y) with exp(x + rest) = 2^k (1 + y); |rest| must be much smaller than 1."""
    k = nearest(x * ONE_OVER_LN2)
    high, low = x - k * LN2_HIGH, k * LN2_LOW - rest
    x = high - low
    z = x * x
    c = x - z * (P1 + z * (P2 + z * (P3 + z * (P4 + z * P5))))
    return k, x * c / (2.0 - c) - low + high


@stage
def _exp(x, rest):
    """Return exp(x + rest)."""
    if not abs(x) < LARGEST_EXPONENT:
        return 0.0 if x < 0.0 else x
    k, y = _exp_parts(x, rest)
    half = floor(0.5 * k)  # two factors, because 2^k alone may overflow or underflow
    return (1.0 + y) * _two_to(half) * _two_to(k - half)


@stage
def exp(x):
    """Return the exponential function of x, with an error of 1 ulp."""
    return _exp(x, 0.0)


@stage
def _expm1(x):
    """Return exp(x) - 1 for |x| <= 100."""
    k, y = _exp_parts(x, 0.0)
    scale = _two_to(k)
    return scale * y + (scale - 1.0)


@stage
def expm1(x):
    """Return exp(x) - 1, with an error of 2 ulp."""
    return _expm1(x) if abs(x) < 100.0 else _exp(x, 0.0) - 1.0


@stage
def tanh(x):
    """Return the hyperbolic tangent of x, with an error of 3 ulp."""
    t = _expm1(50.0 if abs(x) > 25.0 else 2.0 * abs(x))
    return -t / (t + 2.0) if x < 0.0 else t / (t + 2.0)


@stage
def _product(x, y):
    """Return the rounded product x y and its rounding error, by Dekker's method."""
    product = x * y
    a, b = SPLITTER * x, SPLITTER * y
    x_high, y_high = a - (a - x), b - (b - y)
    x_low, y_low = x - x_high, y - y_high
    return product, ((x_high * y_high - product) + x_high * y_low + x_low * y_high) + x_low * y_low


@stage
def power(x, y):
    """Return x^y for 0 < x < infinity, with an error of 2 ulp for results from 1e-9 to 1e9."""
    k, f = _parts(x)
    d = 2.0 + f
    s = f / d
    product, left = _product(s, d)
    s_rest = ((f - product) - left - s * (f - (d - 2.0))) / d
    whole = k * LN2_HIGH + 2.0 * s
    rest = (k * LN2_HIGH - whole) + 2.0 * s + (2.0 * s_rest + (s * _log_rest(s) + k * LN2_LOW))
    high = whole + rest
    low = (whole - high) + rest
    exponent, left = _product(y, high)
    return _exp(exponent, left + y * low)


@kernel
def _put_directions(angles: Floats1, out: Floats2) -> None:
    for i in range(len(angles)):
        out[i, 0], out[i, 1] = cos(angles[i]), sin(angles[i])


@kernel
def _put_angles(vectors: Floats2, out: Floats1) -> None:
    for i in range(len(out)):
        out[i] = atan2(vectors[i, 1], vectors[i, 0])


@functools.cache
def _bound(kernel: Kernel) -> Callable[..., Any]:
    return kernel.bound()


def directions(angles: ArrayLike) -> NDArray[np.float64]:
    """Return the unit vectors at angles.

    Args:
        angles: Angles, in rad, of any shape.

    Returns:
        Cosines and sines along an additional last axis of length 2, as a NumPy array.
    """
    given = np.asarray(angles, np.float64)
    out = np.empty((given.size, 2))
    _bound(_put_directions)(given.ravel(), out)
    return out.reshape(*given.shape, 2)


def angles_of(vectors: ArrayLike) -> NDArray[np.float64]:
    """Return the angles of vectors, in rad, in (-pi, pi].

    Args:
        vectors: Vectors, shape (..., 2).

    Returns:
        The angles as a NumPy array, in the shape of ``vectors`` without the last axis.
    """
    given = np.asarray(vectors, np.float64)
    out = np.empty(given.size // 2)
    _bound(_put_angles)(given.reshape(-1, 2), out)
    return out.reshape(given.shape[:-1])


def lengths_of(vectors: ArrayLike) -> NDArray[np.float64]:
    """Return the lengths of vectors.

    Args:
        vectors: Vectors, shape (..., 2).

    Returns:
        The lengths as a NumPy array, in the shape of ``vectors`` without the last axis.
    """
    x, y = np.moveaxis(np.asarray(vectors, np.float64), -1, 0)
    return np.asarray(np.sqrt(x * x + y * y))
