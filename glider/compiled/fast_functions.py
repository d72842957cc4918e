"""Sine, cosine, root and exponential that compiled loops compute quickly, many at once.

The C library's would be two thirds of the time of a glider's step and keep the compiler
from treating several gliders, or basis functions, in one instruction. Here real numbers
take a series without a branch, within 4e-16 of NumPy's (for angles up to 1e6 rad).
"""

import math

import numba
import numpy as np
from numba.extending import overload

from glider.physics.formulas import cos, exp, sin, sqrt

# π in parts, so that subtracting multiples of it rounds only once: the first
# has few enough digits for its multiples to be exact (Cody and Waite 1980).
_PI = (3.1415926534682512, 1.2154201012607932e-10, 4.0445324975919012e-21)

_TAYLOR = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(11))
"""Coefficients of sin r / r in r²; at π/2 the next term is 1e-18."""

_TINY_SHARE = 1e-8
"""Imaginary parts below this share of the real one, as those of complex steps, change
the real part of a square root by nothing."""


@numba.njit(error_model="numpy", fastmath={"contract"})
def _signed_sine(angle, turns):
    """Returns sin(angle - turns π), which lies within ±π/2 of zero."""
    rest = ((angle - turns * _PI[0]) - turns * _PI[1]) - turns * _PI[2]
    square = rest * rest
    total = _TAYLOR[10]
    for k in range(9, -1, -1):
        total = total * square + _TAYLOR[k]
    return rest * total


@numba.njit(error_model="numpy")
def _sign(turns):
    """Returns (-1)^turns for an integer number of half turns, as a float."""
    return 1.0 - 2.0 * (turns - 2.0 * np.floor(0.5 * turns))


@overload(sin)
def _compiled_sin(angle):
    if isinstance(angle, numba.types.Complex):
        return lambda angle: complex(
            np.sin(angle.real) * np.cosh(angle.imag),
            np.cos(angle.real) * np.sinh(angle.imag),
        )

    def series(angle):
        turns = np.floor(angle * (1.0 / math.pi) + 0.5)
        return _sign(turns) * _signed_sine(angle, turns)

    return series


@overload(cos)
def _compiled_cos(angle):
    if isinstance(angle, numba.types.Complex):
        return lambda angle: complex(
            np.cos(angle.real) * np.cosh(angle.imag),
            -np.sin(angle.real) * np.sinh(angle.imag),
        )

    def series(angle):
        turns = np.floor(angle * (1.0 / math.pi))
        return -_sign(turns) * _signed_sine(angle, turns + 0.5)

    return series


@overload(sqrt)
def _compiled_sqrt(square):
    def of_real(square):
        return np.sqrt(square)

    def of_complex(square):
        real = square.real
        imaginary = square.imag
        if real > 0.0 and abs(imaginary) < _TINY_SHARE * real:
            root = np.sqrt(real)
            return complex(root, 0.5 * imaginary / root)
        return np.sqrt(square)

    return of_complex if isinstance(square, numba.types.Complex) else of_real


_LN_2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""ln 2 in parts, as π above."""

_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(14))
"""Coefficients of exp r; at ln 2 / 2 the next term is 4e-18."""

_LARGEST = 700.0
"""Beyond it, either way, an exponential is that of the bound, a normal number."""


@overload(exp)
def _compiled_exp(power):
    def of_complex(power):
        return np.exp(power)

    def series(power):
        bound = _LARGEST if power > _LARGEST else power  # NaN stays.
        bound = -_LARGEST if power < -_LARGEST else bound
        doublings = np.floor(bound * (1.0 / _LN_2[0]) + 0.5)
        rest = (bound - doublings * _LN_2[0]) - doublings * _LN_2[1]
        total = _EXPONENTIAL[13]
        for k in range(12, -1, -1):
            total = total * rest + _EXPONENTIAL[k]
        # The bits of 2^doublings, whose exponent counts from 1023.
        scale = np.int64((np.int64(doublings) + 1023) << 52).view(np.float64)
        return total * scale

    return of_complex if isinstance(power, numba.types.Complex) else series


OVERLOADS = (_compiled_sin, _compiled_cos, _compiled_sqrt, _compiled_exp)
"""What compiled code has in the place of functions of glider.physics.formulas."""
