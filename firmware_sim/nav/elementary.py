"""The elementary functions: reciprocal, roots, sine and cosine, arctangent, hypotenuse, in one and in two words.

One source serves both machines: Newton's steps and the series converge to float64, and each sum is
arranged so that the rounding of a C3x single (24 bits) happens once, at the end. Ranges and worst
errors are tabled in docs/elementary-functions.md; tests/nav/test_elementary.py holds them.

A *two-word* value is the unevaluated sum of a high and a low single, the low one at most about half a
unit in the last place of the high one: 48 bits. A single holds a longitude to 0.6 m only.

Constants are split into two words here, because a machine rounds each constant to one of its singles:
a constant written as one number would keep 24 bits on the C3x. The high word has 24 bits in float64
too, so the products that must be exact on the C3x are exact in both.

Sources: Newton's iterations and compensated sums as in J.-M. Muller et al., Handbook of Floating-Point
Arithmetic, chapters 4 and 5; table reduction as in P. T. P. Tang, ACM Trans. Math. Software 15 (1989).
"""

from __future__ import annotations

import math

from firmware_sim.kernels.language import ash, exponent, kernel, power_of_two

LARGEST_SINGLE = (2.0 - 2.0**-23) * 2.0**127


def split_two_word(value: float) -> tuple[float, float]:
    """``value`` as a high word of 24 bits and the rest, exactly: high + low == value."""
    mantissa, e = math.frexp(value)
    high = math.ldexp(round(math.ldexp(mantissa, 24)), e - 24)
    return high, value - high


# -- Reciprocal and roots

# p(m) = (32 m^2 - 144 m + 210) / 99 is the best quadratic for 1/m on [1, 2]: m p(m) - 1 = T3(2m - 3) / 99,
# with T3 the third Chebyshev polynomial. Newton squares the error: 1/99, 1e-4, 1e-8, 1e-16.
_RECIPROCAL_0, _RECIPROCAL_1, _RECIPROCAL_2 = 210.0 / 99.0, -144.0 / 99.0, 32.0 / 99.0

# The best cubic for m^(-1/2) on [1, 4), by Remez's algorithm on the relative error: 7.04e-3.
# Newton makes 3/2 of the square of it: 7.4e-5, 8.3e-9, 1e-16.
ROOT_0, ROOT_1, ROOT_2, ROOT_3 = 1.556187102, -0.738863007, 0.1946857036, -0.01905041395


@kernel
def reciprocal(x: float) -> float:
    """1/x, where that is representable. reciprocal(0) is LARGEST_SINGLE, so that 0 * reciprocal(0) is 0."""
    result = LARGEST_SINGLE
    if x != 0.0:
        size = abs(x)
        scale = power_of_two(-exponent(size))
        m = size * scale
        r = _RECIPROCAL_0 + m * (_RECIPROCAL_1 + m * _RECIPROCAL_2)
        r = r + r * (1.0 - m * r)
        r = r + r * (1.0 - m * r)
        r = r + r * (1.0 - m * r)
        result = r * scale if x > 0.0 else -r * scale
    return result


@kernel
def _reciprocal_root_seed(m: float) -> float:
    """1/sqrt(m) for 1 <= m < 4, within 1e-8 (or a unit and a half of a single): one Newton step is left to do."""
    half_m = 0.5 * m
    y = ROOT_0 + m * (ROOT_1 + m * (ROOT_2 + m * ROOT_3))
    y = y + y * (0.5 - half_m * y * y)
    return y + y * (0.5 - half_m * y * y)


@kernel
def square_root(x: float) -> float:
    """The square root of x; 0 where x <= 0."""
    result = 0.0
    if x > 0.0:
        half_exponent = ash(exponent(x), -1)
        scale = power_of_two(-half_exponent)
        m = x * scale * scale
        y = _reciprocal_root_seed(m)
        root = m * y
        root = root + (m - root * root) * (0.5 * y)
        result = root * power_of_two(half_exponent)
    return result


@kernel
def reciprocal_square_root(x: float) -> float:
    """1/sqrt(x); LARGEST_SINGLE where x <= 0, so that 0 * reciprocal_square_root(0) is 0."""
    result = LARGEST_SINGLE
    if x > 0.0:
        scale = power_of_two(-ash(exponent(x), -1))
        m = x * scale * scale
        y = _reciprocal_root_seed(m)
        # m y as two words: a single would lose in the residual what the step is to gain.
        root = m * y
        root_low = m * y - root
        y = y + 0.5 * y * ((1.0 - root * y) - root_low * y)
        result = y * scale
    return result


# -- Two-word sums


@kernel
def add_two_word(high: float, low: float, increment: float) -> tuple[float, float]:
    """(high, low) + increment: compensated accumulation, the building block of compensated states.

    Loses only the rounding of the low word, at most 2^-50 of ``high`` on the C3x, as long as |increment| < |high|;
    while ``high`` passes through zero, 2^-31 of the increment.
    """
    total = high + (low + increment)
    rest = (high - total) + (low + increment)
    return total, rest


@kernel
def _sum_two_word(a_high: float, a_low: float, b_high: float, b_low: float) -> tuple[float, float]:
    """a + b, where |a| >= |b| or a = 0."""
    high = a_high + (b_high + (a_low + b_low))
    low = ((a_high - high) + b_high) + (a_low + b_low)
    return high, low


# -- Sine and cosine

_TWO_OVER_PI = 2.0 / math.pi
# pi/2 in three parts of 24 bits. The third is below the resolution of float64 and is taken from the digits of pi:
# pi/2 = 1.57079632679489661923 13216916397514420985846996876.
_HALF_PI_HIGH, _HALF_PI_LOW = split_two_word(math.pi / 2.0)
_HALF_PI_MIDDLE, _half_pi_rest = split_two_word(_HALF_PI_LOW)
_HALF_PI_TAIL = _half_pi_rest + 6.123233995736766e-17
PI_HIGH, _PI_LOW = 2.0 * _HALF_PI_HIGH, 2.0 * _HALF_PI_LOW
TWO_PI_HIGH, TWO_PI_LOW = 2.0 * PI_HIGH, 2.0 * _PI_LOW

# Sine and cosine of k/8. The index is k & 15, so that negative k count from the end and no index leaves the table.
_ANGLES = tuple((k if k < 8 else k - 16) / 8.0 for k in range(16))
_SINE_HIGH, _SINE_LOW = zip(*(split_two_word(math.sin(angle)) for angle in _ANGLES), strict=True)
_COSINE_HIGH, _COSINE_LOW = zip(*(split_two_word(math.cos(angle)) for angle in _ANGLES), strict=True)

_SINE_3, _SINE_5, _SINE_7 = -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0
_COSINE_4, _COSINE_6, _COSINE_8 = 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0


@kernel
def _sine_cosine_octant(high: float, low: float) -> tuple[float, float, float, float]:
    """(sin_high, sin_low, cos_high, cos_low) of an angle within +-pi/4.

    With A = k/8 the nearest eighth and d the distance to it, |d| <= 1/16:
    sin(A + d) = sin A + (cos A sin d + sin A (cos d - 1)), cos(A + d) = cos A + (cos A (cos d - 1) - sin A sin d).
    """
    k = int(8.0 * high + 0.5)
    sin_a = _SINE_HIGH[k & 15]
    sin_a_low = _SINE_LOW[k & 15]
    cos_a = _COSINE_HIGH[k & 15]
    cos_a_low = _COSINE_LOW[k & 15]
    step = high - 0.125 * float(k)
    d = step + low
    d_low = (step - d) + low

    # sin d = d + sine_rest, cos d = 1 + cosine_rest; half of d squared is kept to 32 bits.
    square = d * d
    sine_rest = d_low + d * square * (_SINE_3 + square * (_SINE_5 + square * _SINE_7))
    cosine_rest = square * square * (_COSINE_4 + square * (_COSINE_6 + square * _COSINE_8)) - 0.5 * d * d
    sine_d = d + sine_rest
    cosine_d = 1.0 + cosine_rest

    # The great terms, table and product with d, stay apart from the small ones: these then round far below a unit.
    small = sin_a_low * cosine_d + cos_a_low * sine_d + cos_a * sine_rest
    small = small + sin_a * cosine_rest
    sin_high = sin_a + (cos_a * d + small)
    sin_low = ((sin_a - sin_high) + cos_a * d) + small

    small = cos_a_low * cosine_d - sin_a_low * sine_d - sin_a * sine_rest
    small = small + cos_a * cosine_rest
    cos_high = cos_a + (small - sin_a * d)
    cos_low = ((cos_a - cos_high) - sin_a * d) + small
    return sin_high, sin_low, cos_high, cos_low


@kernel
def sine_cosine_two_word(high: float, low: float) -> tuple[float, float, float, float]:
    """(sin_high, sin_low, cos_high, cos_low) of the angle high + low, rad, for |high| <= 100 pi.

    Up to 256 quadrants the product of their number with the first part of pi/2 is exact (8 + 24 bits), and so is
    the difference to ``high``. Beyond, the result means nothing, but no index leaves its table.
    """
    quadrants = int(high * _TWO_OVER_PI + 0.5)
    n = float(quadrants)
    angle = high - n * _HALF_PI_HIGH
    angle_low = low - n * _HALF_PI_MIDDLE - n * _HALF_PI_TAIL
    s_high, s_low, c_high, c_low = _sine_cosine_octant(angle, angle_low)
    sin_high = s_high
    sin_low = s_low
    cos_high = c_high
    cos_low = c_low
    if (quadrants & 1) == 1:
        sin_high = c_high
        sin_low = c_low
        cos_high = -s_high
        cos_low = -s_low
    if (quadrants & 2) == 2:
        sin_high = -sin_high
        sin_low = -sin_low
        cos_high = -cos_high
        cos_low = -cos_low
    return sin_high, sin_low, cos_high, cos_low


@kernel
def sine(x: float) -> float:
    """sin x, for |x| <= 100 pi rad."""
    sin_high, _sin_low, _cos_high, _cos_low = sine_cosine_two_word(x, 0.0)
    return sin_high


@kernel
def cosine(x: float) -> float:
    """cos x, for |x| <= 100 pi rad."""
    _sin_high, _sin_low, cos_high, _cos_low = sine_cosine_two_word(x, 0.0)
    return cos_high


# -- Arctangent, arcsine, hypotenuse

_ARCTANGENT_HIGH, _ARCTANGENT_LOW = zip(*(split_two_word(math.atan(k / 8.0)) for k in range(9)), strict=True)
_ARCTANGENT_3, _ARCTANGENT_5, _ARCTANGENT_7 = -1.0 / 3.0, 1.0 / 5.0, -1.0 / 7.0
_ARCTANGENT_9, _ARCTANGENT_11 = 1.0 / 9.0, -1.0 / 11.0


@kernel
def _arctangent_octant(a_high: float, a_low: float, b_high: float, b_low: float) -> tuple[float, float]:
    """arctan(a / b) for 0 <= a <= b, as two words, rad.

    The vector (b, a) turned back by arctan t, t = k/8 the eighth nearest to a/b, is (u, v) = (b + a t, a - b t),
    and arctan(a/b) = arctan t + arctan(v/u). Products of a word with t are exact (24 + 4 bits).
    """
    k = int(8.0 * a_high * reciprocal(b_high) + 0.5)
    # In range for every pair of numbers; a solution that has broken down must not leave the table.
    if k < 0 or k > 8:
        k = 0
    t = 0.125 * float(k)
    v_high = (a_high - b_high * t) + (a_low - b_low * t)
    v_low = ((a_high - b_high * t) - v_high) + (a_low - b_low * t)
    u_high = b_high + a_high * t
    u_low = ((b_high - u_high) + a_high * t) + (b_low + a_low * t)

    r = reciprocal(u_high)
    d = v_high * r
    residual = (v_high - d * u_high) + (v_low - d * u_low)
    square = d * d
    series = _ARCTANGENT_7 + square * (_ARCTANGENT_9 + square * _ARCTANGENT_11)
    d_rest = residual * r + d * square * (_ARCTANGENT_3 + square * (_ARCTANGENT_5 + square * series))
    high, low = _sum_two_word(_ARCTANGENT_HIGH[k], _ARCTANGENT_LOW[k], d, d_rest)
    return high, low


@kernel
def _magnitude_two_word(high: float, low: float) -> tuple[float, float]:
    """|high + low|, the sign taken from the high word."""
    magnitude_high = -high if high < 0.0 else high
    magnitude_low = -low if high < 0.0 else low
    return magnitude_high, magnitude_low


@kernel
def arctangent2_two_word(y_high: float, y_low: float, x_high: float, x_low: float) -> tuple[float, float]:
    """The angle of (x, y) from the x axis in (-pi, pi], rad, as two words; (0, 0) gives 0, y = 0 > x gives pi.

    For the larger of |x|, |y| from 2^-80 (below, the residual underflows) to 2^120.
    """
    a_high, a_low = _magnitude_two_word(y_high, y_low)
    b_high, b_low = _magnitude_two_word(x_high, x_low)
    base_high = 0.0
    base_low = 0.0
    turn = 1.0
    if x_high < 0.0:
        base_high = PI_HIGH
        base_low = _PI_LOW
        turn = -1.0
    if a_high <= b_high:
        angle_high, angle_low = _arctangent_octant(a_high, a_low, b_high, b_low)
    else:
        angle_high, angle_low = _arctangent_octant(b_high, b_low, a_high, a_low)
        base_high = _HALF_PI_HIGH
        base_low = _HALF_PI_LOW
        turn = -turn
    high, low = _sum_two_word(base_high, base_low, turn * angle_high, turn * angle_low)
    if y_high < 0.0:
        high = -high
        low = -low
    return high, low


@kernel
def arctangent2(y: float, x: float) -> float:
    """The angle of (x, y) from the x axis, rad, in [-pi, pi] as a single rounds pi; (0, 0) gives 0."""
    high, _low = arctangent2_two_word(y, 0.0, x, 0.0)
    return high


@kernel
def arcsine(x: float) -> float:
    """arcsin x, rad; +-pi/2 outside [-1, 1], where the square root of the negative product is 0."""
    below = 1.0 - x
    above = 1.0 + x
    return arctangent2(x, square_root(below * above))


@kernel
def hypotenuse_two_word(x_high: float, x_low: float, y_high: float, y_low: float) -> tuple[float, float]:
    """sqrt(x^2 + y^2) as two words; (0, 0) gives 0. For the larger of |x|, |y| from 2^-40 to 2^62, where squares fit.

    One Newton step from the root h of the sum in one word: x^2 + y^2 - h^2, with the cross terms of the low words,
    times 1/(2 h).
    """
    square = x_high * x_high + y_high * y_high
    r = reciprocal_square_root(square)
    root = square * r
    cross = x_high * x_low + y_high * y_low
    residual = ((x_high * x_high - root * root) + y_high * y_high) + 2.0 * cross
    high, low = add_two_word(root, 0.0, 0.5 * r * residual)
    return high, low
