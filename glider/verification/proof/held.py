"""The proof that held commands are the funnel's feedback, but for its command error.

A command that is held acts as u₀ - K(t) e + eᵀ M(t) e + q (docs/certificate.md has q̇),
if u₀ is constant, K and M continuous, and M zero at its sample. The file's gains and M
make the linear and the quadratic part of q̇ vanish at its times (`funnel.clock`) and are
straight lines between; the proof follows the cubic polynomials with those slopes, and
adds what the two differ by. With e = B z, |z| <= 1 on the interval, all parts are
polynomials in z and time, exactly; norms of their Bernstein coefficients bound them.
Where |q̇| <= a + b |q|, |q| grows to (|q| + a t) exp(b t) at most in a time t. So |q| is
within the file's `rests`, and |eᵀ M e + q| within its `errors`, until a state leaves
the funnel, which none does.
"""

import dataclasses

import numpy as np

from glider.compiled.taylor import WIDER
from glider.progress import Shares, silent
from glider.verification.dynamics.defect import defect_bounds
from glider.verification.funnel.boundary import command_forms, pull_forms
from glider.verification.funnel.clock import form_size, hold_slopes
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.interval import (
    covers,
    exact_reach,
    gliders_defect,
    make_interval,
    tight_cover,
)
from glider.verification.proof.interval_growth import BALL_BITS
from glider.verification.sos.exact import (
    exact,
    hermite,
    is_positive_definite,
    line,
    rounded,
)
from glider.verification.sos.forms import gathered

_PERIOD_ROUNDING = 1e-9
"""Time by which the samples in a file may be off the clock's [s]."""


def held_faults(funnel: Funnel, progress: Shares = silent) -> list[str]:
    """Returns why held commands are not proven to be the feedback, a sentence each."""
    settings = funnel.settings
    nominal = funnel.nominal
    if np.any(np.minimum(funnel.errors, funnel.rests) < settings.command_error):
        return ["The command's error is smaller than the settings' somewhere."]
    if not settings.period:
        fault = "The command's error has a known part, but no command is held."
        return [fault] if nominal.bends.any() else []
    times = nominal.times
    starts = nominal.starts
    samples = nominal.samples
    clock = settings.period * np.arange(len(samples))
    off = np.abs(times[samples] - clock).max()
    if max(off, times[-1] - clock[-1] - settings.period) > _PERIOD_ROUNDING:
        return [f"The samples are not {settings.period:g} s apart."]
    if np.any(nominal.inputs != nominal.inputs[starts]):
        return ["The nominal's commands are not held."]
    for k in samples[1:] - 1:
        if not is_positive_definite(exact(funnel.S[k]) - exact(funnel.S[k + 1])):
            return [f"The set after the sample at {times[k]:.4f} s is not larger."]
    if nominal.bends[starts].any():
        return ["A command is not linear when it is computed."]
    for k in samples:
        if not _keeps_rate(funnel, k):
            return [f"The servo would meet its limit of rate at {times[k]:.4f} s."]
    error = settings.command_error
    for k in nominal.flows:
        progress(k / len(times))
        before = settings.command_error if starts[k] == k else error
        ends = [k, k + 1]
        error, apart, known = _error_after(funnel.between(*ends), before)
        rests = np.array([before, error]) + apart
        pairs = (funnel.rests[ends], rests), (funnel.errors[ends], rests + known)
        for allowed, found in pairs:
            # The worse end is the one to name; what is not bounded is infinite.
            worst = int(np.argmax(found - allowed))
            when = f"at {times[ends[worst]]:.4f} s"
            if not np.all(np.isfinite(found)):
                return [
                    f"The error of the held command is not bounded {when}: a weight is "
                    "zero, its numbers are too large, or its sets too flat."
                ]
            if not np.all(found <= allowed):
                return [
                    f"The held command may be {found[worst]:.3g} rad/s off the "
                    f"feedback {when}; the funnel allows {allowed[worst]:.3g} rad/s."
                ]
    return []


def _keeps_rate(funnel, k):
    """Returns whether commands that are computed at a time keep the rate's limit."""
    limit = exact(funnel.nominal.model.parameters.servo.rate)
    gains = exact(funnel.nominal.gains[k])
    left = limit - exact(abs(funnel.nominal.inputs[k])) - exact(funnel.errors[k])
    commands = exact(funnel.gliders.commands[k])
    left = left - exact(exact_reach(funnel.allowed, commands))
    form = left * left * exact(funnel.S[k]) - gains[:, None] @ gains[None]
    return bool(left.numbers[0] > 0) and is_positive_definite(form)


@np.errstate(all="ignore")
def _error_after(piece: Funnel, before: float) -> tuple[float, float, np.ndarray]:
    """Returns bounds of |q| at the end, and of what polynomials and lines differ.

    Both are infinite where nothing is proven. The third (2,) is of |eᵀ M e|.
    """
    try:
        return _bounded_after(piece, before)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        return np.inf, np.inf, np.zeros(2)


def _bounded_after(piece, before):
    """Returns the same; raises ValueError and others where numbers do not allow it."""
    nominal = piece.nominal
    n = piece.num_states
    interval = make_interval(piece)
    B = _ball_of_states(interval, n)
    if B is None:
        return np.inf, np.inf, np.zeros(2)
    gain_slopes, bend_slopes = hold_slopes(nominal)
    K, K_rise = hermite(nominal.gains, gain_slopes, interval.step)
    M, M_rise = hermite(nominal.bends, bend_slopes, interval.step)
    square_rise = gathered(B.T @ M_rise @ B, n)
    M = B.T @ M
    known = B.T @ interval.bends @ B
    first, second, third, fourth = command_forms(interval, B, K, M, known)

    # What the linear and the quadratic part of q̇ lack to vanish.
    step = np.diff(nominal.times)[0]
    lacking = _size(K_rise @ B + first * interval.step, n, 1)
    lacking += _size(second * interval.step - square_rise, n, 2)
    growth = lacking / step
    growth += _size(third, n, 3)
    growth += _size(fourth, n, 4)

    # (K - 2 eᵀ M)(R + d).
    focus = _norms(B.T @ interval.focus @ B).max()
    pull = np.abs(K.bernstein()).max(axis=0)
    pull += 2.0 * np.linalg.norm(M.bernstein(), axis=1).max(axis=0)
    off = piece.beta.max(axis=0) * (1.0 + focus)
    off += defect_bounds(nominal)[0] + gliders_defect(piece)
    growth += pull @ off

    # What the command and the wind do along G.
    apart = _size((K - line(nominal.gains)) @ B, n, 1)
    apart += _size(gathered(M @ B - known, n), n, 2)
    of_command, *of_wind = (
        _pull(interval.push_slopes[:, k], B, K, M) for k in range(3)
    )
    growth += of_command * apart
    growth += piece.settings.wind * np.linalg.norm(of_wind)
    after = (before + step * growth) * np.exp(step * of_command) * WIDER
    return after, apart * WIDER, _norms(known) * WIDER


def _ball_of_states(interval, n):
    """Returns B (n, n) of a ball e = B z, |z| <= 1, that contains the sets.

    None is found where floating point proposes a ball that does not.
    """
    identity = exact(np.eye(n))
    states = dataclasses.replace(interval, outputs=identity, which=list(range(n)))
    basis, _ = tight_cover(states)
    B = rounded(basis * (1.0 + 2.0**-20), BALL_BITS)
    return B if covers(states, B.to_float()) else None


def _pull(slopes, B, K, M):
    """Returns a bound of |(K - 2 eᵀ M) G|, G of slopes (n, 1 + n) in (1, e)."""
    along, tilt, bent = pull_forms(slopes, B, K, M)
    size = np.abs(along.bernstein()).max()
    size += np.linalg.norm(tilt.bernstein(), axis=1).max()
    return size + _norms(bent).max()


def _norms(matrix):
    """Returns the largest singular value of each Bernstein coefficient."""
    return np.linalg.norm(matrix.bernstein(), 2, (1, 2))


def _size(form, n, degree):
    """Returns a bound of |form(z)| for |z| <= 1 at all times."""
    return form_size(form.bernstein(), n, degree).max()
