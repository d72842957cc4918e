"""Sine, cosine and square root of any kind of number.

In Python they are NumPy's; in compiled code those of `glider.compiled.trigonometry`.
"""

import numpy as np


def sin(angle):
    """Sine of a float, AutoDiffXd, Expression or complex number [rad]."""
    return np.sin(angle)


def cos(angle):
    """Cosine of a float, AutoDiffXd, Expression or complex number [rad]."""
    return np.cos(angle)


def sqrt(square):
    """Square root of a float, AutoDiffXd, Expression or complex number."""
    return np.sqrt(square)
