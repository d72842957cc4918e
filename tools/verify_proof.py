#!/usr/bin/env python3
"""Verifies the proof of a funnel, independently of the program that made it.

    glider check-funnel FUNNEL --prove --write-proof proof.json.gz
    python tools/verify_proof.py proof.json.gz

This file needs python-flint and nothing else: not the package `glider`, not NumPy. It
has its own text of the physics, its own Taylor models and its own covering, so that an
error would have to be made twice, in different ways. The theorem and its proof are in
docs/certificate.md; the notation is the same. Checked are

 1. the ends: the flight starts at the launch, the last set lies in the goal, and the
    goal within the hook's reach of the wire;
 2. on each interval, in exact arithmetic: S is positive definite; the servo follows its
    command on E; each ball contains the deviations of E; what the nominal flight lacks
    in the linear rates is within the slack; V falls on V = 1, by the Gram matrices.
    The flight, S, the feedback and the bounds are polynomials between values at the
    knots, which the intervals share: they are continuous there;
 3. on each ball: |R_k| <= beta_k (1 + e'F e). Boxes cover it. On each, f is enclosed by
    a cubic polynomial and what it leaves out, in doubles with bounds of their rounding;
    P and the right side are polynomials already, and are shifted in integers. A box on
    which the bound is not seen to hold is halved, and what of each half is outside the
    ball is cut off; where boxes become too many or too
    small, this program names the interval and says that this is open there.

The file is JSON lines in gzip: a header, the knots, and a line for each interval. Of
the prover it takes Gram matrices and balls, which need not be trusted.
"""

import argparse
import functools
import gzip
import itertools
import json
import math
import random
import sys
import time
import zlib
from operator import add

from flint import arb, ctx, fmpq, fmpq_mpoly_ctx, fmpq_poly, fmpz_mat

FORMAT = "drake-glider proof 1"
ROUNDING = fmpq(1, 10**6)  # With which launch and wire are compared [m, ...].
GOAL_ROUNDING = fmpq(1, 10**9)  # Relative, of S at the end.
STOPPING_TIME = 0.005  # Of the servo before its stops [s].
SPEED_SMOOTHING = 1e-8  # In the physics: |v| is the root of v'v and this [m^2/s^2].
BASIS_BITS, GRAM_BITS = 30, 36  # Binary places of a file's integers.
LEFT = 16  # Units of these that may be left of a coefficient.
HALVINGS = 6  # Times that an interval is halved for a matrix, or for R.
# Degrees in v and in time that a Jet keeps.
KEPT = (0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (1, 1), (2, 1), (0, 2)
ROUNDOFF = 1e-13  # Bounds the rounding of a sum of 100 products, relative to its terms.
WIDER = 1.0 + 1e-12  # Covers the rounding of bounds, sums of what is not negative.
CLOSEST = 0.85  # Share of a speed that it may vary by for a power series.
MOST_BOXES = 200_000  # For one ball.
BITS, GRID = 40, 10  # Binary places of coefficients and of boxes.
LARGEST = 10**5  # Of what is subtracted from f, in units of beta: for the next number,
MARGIN = 1e-6  # the share of beta left for doubles in the lower bounds.
LEAST = fmpq(1, 10**12)  # Of numbers that are not zero, and of beta: none underflows.
N, M = 7, 6  # States; variables of f: pitch, elevator, their rates, speeds.
STATES = ("x", "z", "pitch", "elevator", "xdot", "zdot", "pitchdot")
NUMBERS = (
    "mass",
    "pitch_inertia",
    "wing_area",
    "elevator_area",
    "wing_offset",
    "hinge_offset",
    "elevator_offset",
    "air_density",
    "gravity",
)
KNOTS = {  # Shapes of one knot's values.
    "times": (),
    "states": (N,),
    "state_slopes": (N,),
    "inputs": (),
    "gains": (N,),
    "S": (N, N),
    "S_slopes": (N, N),
    "beta": (N,),
    "weights": (N,),
    "focus": (N, N),
}
ctx.prec = 120


class Fault(Exception):  # noqa: N818
    """What is not proven, a sentence."""


class OpenFault(Fault):
    """What this program cannot decide."""


def need(good, sentence):
    """Raises Fault unless something holds."""
    if not good:
        raise Fault(sentence)


# Reading. Floats become fractions without rounding.


def rational(value):
    """Returns a finite number of a file as a fraction."""
    good = isinstance(value, (int, float)) and not isinstance(value, bool)
    good = good and abs(value) <= sys.float_info.max
    need(good, f"{value!r:.40} is no finite number.")
    return fmpq(*value.as_integer_ratio())


def array(value, shape, convert=rational):
    """Returns nested lists of a known shape, converted."""
    if not shape:
        return convert(value)
    good = isinstance(value, list) and len(value) == shape[0]
    need(good, f"a list of {shape[0]} entries is missing.")
    return [array(part, shape[1:], convert) for part in value]


def scaled_by(bits):
    """Returns a reader of integers that count so many binary places."""

    def convert(value):
        need(isinstance(value, int), f"{value!r:.40} is no integer.")
        return fmpq(value, 1 << bits)

    return convert


def no_number(word):
    """Refuses NaN and Infinity, which JSON does not have."""
    raise Fault(f"{word} is no finite number.")


def read_lines(path):
    """Yields the objects of a file, one a line."""
    with gzip.open(path, "rt", encoding="utf-8") as stream:
        for line in stream:
            found = json.loads(line, parse_constant=no_number)
            need(isinstance(found, dict), "a line is no JSON object.")
            yield found


def read_proof(path):
    """Returns header, knots and intervals of a file; Fault where it is none."""
    try:
        header, knots, *intervals = read_lines(path)
    except OSError as error:
        raise Fault(f"the file cannot be read: {error}.") from None
    except (ValueError, EOFError, RecursionError, zlib.error) as error:
        raise Fault(f"the file is cut or damaged: {error!s:.80}.") from None
    need(header.get("format") == FORMAT, f"the file's format is not '{FORMAT}'.")
    need(not header.get("beyond"), f"this program knows no {header.get('beyond')!r}.")
    count = len(knots.get("times", [])) - 1
    need(count >= 1, "there are no knots.")
    knots = {
        name: array(knots.get(name), (count + 1, *shape))
        for name, shape in KNOTS.items()
    }
    found = [interval.get("interval") for interval in intervals]
    need(found == list(range(count)), f"not all {count} intervals are there, in order.")
    times = knots["times"]
    rises = all(a < b for a, b in itertools.pairwise(times))
    need(times[0] == 0 and rises, "the times do not increase from 0.")
    for name in ("S", "S_slopes", "focus"):
        for matrix in knots[name]:
            turned = [list(row) for row in zip(*matrix, strict=True)]
            need(matrix == turned, f"{name} is not symmetric.")
    return header, knots, intervals


class Glider:
    """The numbers of a flat-plate glider in a steady wind, as fractions."""

    def __init__(self, header):
        """Reads them."""
        given = header.get("parameters")
        need(isinstance(given, dict), "there are no parameters.")
        for name in NUMBERS:
            setattr(self, name, rational(given.get(name)))
        self.low, self.high = array(given.get("elevator_limits"), (2,))
        self.rate = rational(given.get("elevator_rate_limit"))
        self.wind = array(header.get("wind"), (2,))
        self.doubles = {name: to_float(getattr(self, name)) for name in NUMBERS}
        self.doubles |= {
            "wind_x": to_float(self.wind[0]),
            "wind_z": to_float(self.wind[1]),
        }
        numbers = [getattr(self, name) for name in NUMBERS]
        good = all(not v or LEAST < abs(v) < 1 / LEAST for v in numbers)
        need(good, "a parameter is too small or too large for doubles.")
        good = self.mass > 0 and self.pitch_inertia > 0
        need(good, "mass and inertia must be positive.")


# Exact polynomials in tau, 0 to 1 along an interval, and matrices of them.


def line(first, last):
    """Returns the straight line between two numbers."""
    return fmpq_poly([first, last - first])


def hermite(a, b, rise_a, rise_b):
    """Returns the cubic with these values and slopes (times the step) at both ends."""
    change = b - a
    return fmpq_poly(
        [a, rise_a, 3 * change - 2 * rise_a - rise_b, rise_a + rise_b - 2 * change]
    )


def each(function, *arrays):
    """Applies a function to the entries of nested lists."""
    if isinstance(arrays[0], list):
        return [each(function, *parts) for parts in zip(*arrays, strict=True)]
    return function(*arrays)


def on_span(values, span):
    """Returns polynomials of tau from 0 to 1 along a part of their interval."""
    first, last = span
    inner = fmpq_poly([first, last - first])
    return each(lambda p: p(inner), values)


def bernstein(poly, degree):
    """Returns p_j of p = sum p_j t^j (1 - t)^(d - j), j = 0 to d."""
    return [
        sum((poly[i] * math.comb(degree - i, j - i) for i in range(j + 1)), fmpq(0))
        for j in range(degree + 1)
    ]


def largest(poly):
    """Returns a bound of |p|: its largest coefficient in Bernstein's form."""
    d = max(poly.degree(), 0)
    return max(abs(p) / math.comb(d, j) for j, p in enumerate(bernstein(poly, d)))


def is_definite(matrix):
    """Determines whether a symmetric matrix of fractions is positive definite.

    By L D L' in Arb: where all of D is positive for certain, the matrix is definite.
    """
    rows = [[arb(value) for value in row] for row in matrix]
    for k, pivot in enumerate(rows):
        if not pivot[k] > 0:
            return False
        for row in rows[k + 1 :]:
            factor = row[k] / pivot[k]
            for j in range(k + 1, len(rows)):
                row[j] -= factor * pivot[j]
    return True


def stays_definite(matrix, halvings=HALVINGS):
    """Determines whether a matrix of polynomials is definite on all of its span."""
    degree = max(max(p.degree(), 0) for row in matrix for p in row)
    parts = each(lambda p: bernstein(p, degree), matrix)
    if all(
        is_definite([[entry[j] for entry in row] for row in parts])
        for j in range(degree + 1)
    ):
        return True
    halves = ((fmpq(0), fmpq(1, 2)), (fmpq(1, 2), fmpq(1)))
    return halvings > 0 and all(
        stays_definite(on_span(matrix, half), halvings - 1) for half in halves
    )


def tile(parts, what):
    """Yields spans and parts; Fault unless they follow each other from 0 to 1."""
    need(isinstance(parts, list) and parts, f"there are no {what}.")
    end = fmpq(0)
    for part in parts:
        first, last = array(part.get("span"), (2,))
        need(first == end and last > first, f"the {what} leave a hole at {end}.")
        end = last
        yield (first, last), part
    need(end == 1, f"the {what} end at {end} of the interval.")


class Interval:
    """The funnel between two knots: exact polynomials in tau."""

    def __init__(self, knots, k, taylor):
        """Takes the knots k and k + 1, and the Taylor polynomials of f there."""
        two = {name: (values[k], values[k + 1]) for name, values in knots.items()}
        self.h = h = two["times"][1] - two["times"][0]

        def curve(values, slopes):
            rises = [each(lambda slope: slope * h, part) for part in two[slopes]]
            return each(hermite, *two[values], *rises)

        self.x0, self.S = curve("states", "state_slopes"), curve("S", "S_slopes")
        self.K, F = each(line, *two["gains"]), each(line, *two["focus"])
        # Of the states that f depends on.
        self.F = [
            [p if min(i, j) > 1 else fmpq_poly(0) for j, p in enumerate(row)]
            for i, row in enumerate(F)
        ]
        self.u0, self.P = line(*two["inputs"]), each(line, *taylor)
        self.beta, self.weights = each(line, *two["beta"]), each(line, *two["weights"])
        ends = (
            each(mu_of, *end) for end in zip(two["beta"], two["weights"], strict=True)
        )
        self.mu = each(line, *ends)
        K = self.K
        unit = [[fmpq_poly([int(i == j)]) for j in range(N)] for i in range(N)]
        self.C = [*unit[2:N], [-gain for gain in K]]  # y of e.

    def check_sets(self, glider):
        """Checks that the sets are ellipsoids that keep the servo within its limits."""
        need(stays_definite(self.S), "a set is not an ellipsoid.")
        ahead = rational(STOPPING_TIME)
        K, reached = self.K, self.x0[3] + ahead * self.u0
        travel = [int(i == 3) - ahead * gain for i, gain in enumerate(K)]
        minus = [-entry for entry in travel]
        for a, b in (
            ([-gain for gain in K], glider.rate - self.u0),
            (K, glider.rate + self.u0),
            (travel, glider.high - reached),
            (minus, reached - glider.low),
        ):
            left = [
                [b * b * self.S[i][j] - a[i] * a[j] for j in range(N)] for i in range(N)
            ]
            good = stays_definite([[b]]) and stays_definite(left)
            need(good, "the servo would meet its limits.")

    def check_slack(self, slack):
        """Checks that the defect of the linear rates adds at most the slack to V'."""
        x0, h = self.x0, self.h
        rates = (x0[4], x0[5], x0[6], self.u0)
        delta = [
            largest(rate - x.derivative() / h)
            for rate, x in zip(rates, x0, strict=False)
        ]
        square = sum(
            delta[i] * delta[j] * largest(self.S[i][j])
            for i, j in itertools.product(range(4), repeat=2)
        )
        good = slack >= 0 and slack * slack >= 4 * square
        need(good, "the nominal flight's defect exceeds the slack.")

    def check_ball(self, span, basis):
        """Checks that all y of the sets are basis w with |w| <= 1."""
        S, C = on_span(self.S, span), on_span(self.C, span)
        ball = [
            [fmpq_poly([sum(a * b for a, b in zip(r, q, strict=True))]) for q in basis]
            for r in basis
        ]
        upper = [[*S[i], *(row[i] for row in C)] for i in range(N)]
        lower = [[*C[i], *ball[i]] for i in range(M)]
        need(stays_definite(upper + lower), "a ball does not contain the sets.")

    def check_growth(self, span, part, slack):
        """Checks the Gram matrices of minus h V' on V = 1."""
        basis = array(part.get("basis"), (N, N), scaled_by(BASIS_BITS))
        multiplier = array(part.get("multiplier"), (3, N, N), scaled_by(GRAM_BITS))
        count, size = len(part.get("grams") or []), N + N * (N + 1) // 2
        need(count >= 3, "there are no Gram matrices.")
        shape = (count, size - N, size)
        # Rows of products of two, columns of z and, up to the diagonal, of products.
        grams = [
            [
                array(row, (N + 1 + i,), scaled_by(GRAM_BITS))
                for i, row in enumerate(array(gram, shape[1:2], lambda row: row))
            ]
            for gram in part["grams"]
        ]
        z, t = RING.gens()[:N], RING.gens()[N]
        # From sum p_j t^j (1 - t)^(2 - j) to powers.
        power = (1 - t) ** 2, t * (1 - t), t**2
        Nz = sum(
            multiplier[j][i][k] * z[i] * z[k] * power[j]
            for j, i, k in itertools.product(range(3), range(N), range(N))
        )
        V, A, odd, even = self.forms(span, basis, slack)
        A, even = by_monomial(A - Nz), by_monomial(even + Nz * V)
        odd = by_monomial(odd)
        degree = count - 1
        for forms in (A, odd, even):
            high = max((p.degree() for p in forms.values()), default=0)
            need(high <= degree, "there are too few Gram matrices.")
        products = list(itertools.combinations_with_replacement(range(N), 2))
        zero = fmpq(0)
        for j, gram in enumerate(grams):
            here = {
                monomial: bernstein(p, degree)[j]
                for forms in (A, odd, even)
                for monomial, p in forms.items()
            }
            Q = [[zero] * size for _ in range(size)]
            for i, k in itertools.combinations_with_replacement(range(N), 2):
                share = 1 if i == k else 2
                Q[i][k] = Q[k][i] = here.get((i, k), zero) / share
            first = {}
            for r, (row, product) in enumerate(zip(gram, products, strict=True), N):
                for c, value in enumerate(row):
                    factor = (c,) if c < N else products[c - N]
                    monomial = tuple(sorted((*factor, *product)))
                    share = 1 if r == c else 2
                    here[monomial] = here.get(monomial, zero) - share * value
                    first.setdefault(monomial, (r, c))
                    Q[r][c] = Q[c][r] = value
            # What the rounding of the matrix left over goes where it can.
            for monomial, (r, c) in first.items():
                good = abs(here[monomial]) <= fmpq(LEFT, 1 << GRAM_BITS)
                need(good, "a Gram matrix is not that of V'.")
                left = here[monomial] / (1 if r == c else 2)
                Q[r][c] += left
                Q[c][r] = Q[r][c]
            need(is_definite(Q), "a Gram matrix does not prove that V falls.")

    def forms(self, span, basis, slack):
        """Returns V, A, c_3 and c_4 in z and t, e = basis z."""
        t = RING.gens()[N]

        def ring(poly):
            return sum((c * t**k for k, c in enumerate(poly.coeffs())), RING_ZERO)

        def here(values):
            return each(ring, on_span(values, span))

        z, h = RING.gens()[:N], self.h
        e = [sum(b * v for b, v in zip(row, z, strict=True)) for row in basis]
        S, F = here(self.S), here(self.F)
        rise = here(each(lambda p: p.derivative(), self.S))
        weights, mu, P = here(self.weights), here(self.mu), here(self.P)
        y = dot_rows(here(self.C), e)
        Se = dot_rows(S, e)
        V = dot(e, Se)
        linear = dot(e, dot_rows(rise, e))
        powers = monomials_of(y)
        rates = [y[2], y[3], y[4], y[5]]  # Of x, z, pitch and elevator.
        higher = {2: RING_ZERO, 3: RING_ZERO}
        for i, coefficients in enumerate(P, 4):
            parts = {1: RING_ZERO, 2: RING_ZERO, 3: RING_ZERO}
            for (indices, value), c in zip(powers, coefficients, strict=True):
                parts[len(indices)] += c * value
            rates.append(parts[1])
            for d in (2, 3):
                higher[d] += 2 * h * Se[i] * parts[d]
        linear += 2 * h * dot(Se, rates)
        disturbance = h * (
            sum(w * s * s for w, s in zip(weights, Se, strict=True)) + sum(mu) * V
        )
        quartic = higher[3] + disturbance * dot(e, dot_rows(F, e))
        return V, -(linear + disturbance + h * slack * V), -higher[2], -quartic


RING = fmpq_mpoly_ctx.get([*(f"z{i}" for i in range(N)), "t"])
RING_ZERO = RING.from_dict({})


def mu_of(beta, weight):
    """Returns beta^2 / lambda."""
    good = beta >= 0 and weight >= 0 and (beta == 0 or weight > 0)
    need(good, "a bound or a weight is negative, or a weight zero.")
    return beta * beta / weight if beta else fmpq(0)


def dot(first, second):
    """Returns the sum of products."""
    return sum(a * b for a, b in zip(first, second, strict=True))


def dot_rows(matrix, vector):
    """Returns a matrix times a vector."""
    return [dot(row, vector) for row in matrix]


def monomials_of(y):
    """Returns (indices, product) of degree 1 to 3 of y, in a fixed order."""
    found = []
    for degree in (1, 2, 3):
        known = dict(found)
        for indices in itertools.combinations_with_replacement(range(len(y)), degree):
            rest = known.get(indices[:-1])
            value = y[indices[-1]] if rest is None else rest * y[indices[-1]]
            found.append((indices, value))
    return found


def by_monomial(form):
    """Returns polynomials in t by sorted indices of z."""
    found = {}
    for exponents, c in form.to_dict().items():
        indices = tuple(i for i in range(N) for _ in range(exponents[i]))
        powers = found.setdefault(indices, {})
        powers[exponents[N]] = c
    return {
        indices: fmpq_poly([powers.get(k, 0) for k in range(max(powers) + 1)])
        for indices, powers in found.items()
    }


# Taylor models on boxes, in doubles: polynomials in v, |v_i| <= 1, and in time.


class Monomials:
    """The monomials of M variables and time that are kept, and their products."""

    def __init__(self):
        """Makes the tables."""
        self.exponents = [
            (*exponents, k) for degree, k in KEPT for exponents in exponents_of(degree)
        ]
        place = self.place = {e: i for i, e in enumerate(self.exponents)}
        grades = [(sum(e[:M]), e[M]) for e in self.exponents]
        self.slices = [
            slice(grades.index(g), grades.index(g) + grades.count(g)) for g in KEPT
        ]
        self.low = grades.index((0, 1))  # Those without time.
        self.axes = [[i for i in range(M) for _ in range(e[i])] for e in self.exponents]
        self.squares = [place[(*e, 0)] for e in exponents_of(2) if max(e) == 2]
        self.cubes = [i for i, g in enumerate(grades) if g == (3, 0)]
        self.mixed = [
            i
            for i, g in enumerate(grades)
            if g in ((2, 0), (3, 0)) and i not in self.squares
        ]
        self.multiply, self.dot = self._compile("ab"), self._compile("ab", "cd")

    def _compile(self, *pairs):
        """Returns a function of polynomials' coefficients: a sum of their products.

        It is written out, term by term, which takes a fifth of the time of a loop.
        """
        sums = [[] for _ in self.exponents]
        for (i, a), (j, b) in itertools.product(enumerate(self.exponents), repeat=2):
            total = tuple(map(sum, zip(a, b, strict=True)))
            if total in self.place:
                for x, y in pairs:
                    sums[self.place[total]].append(f"{x}{i}*{y}{j}")
        lines = [f"def compiled({', '.join(map(', '.join, pairs))}):"]
        for x in itertools.chain(*pairs):
            lines.append(" " + ",".join(f"{x}{i}" for i in range(len(sums))) + f"={x}")
        lines.append(" return [" + ",".join(map("+".join, sums)) + "]")
        found = {}
        exec("\n".join(lines), found)
        return found["compiled"]


def exponents_of(degree):
    """Returns exponents of the monomials of M variables, sorted by indices."""
    return [
        tuple(map(indices.count, range(M)))
        for indices in itertools.combinations_with_replacement(range(M), degree)
    ]


@functools.cache
def monomials():
    """Returns the tables, made once."""
    return Monomials()


BEYOND = [  # Pairs of grades whose products are not kept.
    (i, j)
    for (i, a), (j, b) in itertools.product(enumerate(KEPT), repeat=2)
    if (a[0] + b[0], a[1] + b[1]) not in KEPT
]
WITHIN = [  # Where those go that are.
    (i, j, KEPT.index((a[0] + b[0], a[1] + b[1])))
    for (i, a), (j, b) in itertools.product(enumerate(KEPT), repeat=2)
    if (a[0] + b[0], a[1] + b[1]) in KEPT
]


class Jet:
    """On a box: |f - sum of coefficients times monomials| <= rest.

    All of it is bounded: what a product has beyond the grades, and the rounding, which
    is below ROUNDOFF times the sum of the sizes of all terms.
    """

    __slots__ = ("_sizes", "coefficients", "rest", "scale")

    def __init__(self, coefficients, rest, scale):
        """Takes coefficients with a rounding of the scale, and the rest else."""
        self.coefficients, self.scale = coefficients, scale
        self.rest = (rest + ROUNDOFF * scale) * WIDER
        self._sizes = None

    def sizes(self):
        """Returns bounds of the parts of each grade."""
        if self._sizes is None:
            c = self.coefficients
            self._sizes = [sum(map(abs, c[s])) * WIDER for s in monomials().slices]
        return self._sizes

    def spread(self):
        """Returns how far f is from its value in the center at most."""
        return (sum(self.sizes()[1:]) + self.rest) * WIDER

    def __add__(self, other):
        """Adds a Jet or a number."""
        if isinstance(other, Jet):
            total = list(map(add, self.coefficients, other.coefficients))
            return Jet(total, self.rest + other.rest, self.scale + other.scale)
        total = self.coefficients.copy()
        total[0] += other
        return Jet(total, self.rest, self.scale + abs(other))

    def __mul__(self, other):
        """Multiplies by a Jet or a number."""
        if not isinstance(other, Jet):
            size = abs(other)
            product = [c * other for c in self.coefficients]
            return Jet(product, self.rest * size, self.scale * size)
        product = monomials().multiply(self.coefficients, other.coefficients)
        return Jet(product, lost_of(self, other), self.scale * other.scale)


def lost_of(a, b):
    """Returns a bound of what a product lacks."""
    mine, theirs = a.sizes(), b.sizes()
    rest = (sum(mine) + a.rest) * b.rest + a.rest * sum(theirs)
    for i, j in BEYOND:
        rest += mine[i] * theirs[j]
    return rest


def dot_jets(a, b, c, d):
    """Returns a b + c d."""
    coefficients = monomials().dot(*(jet.coefficients for jet in (a, b, c, d)))
    scale = a.scale * b.scale + c.scale * d.scale
    return Jet(coefficients, lost_of(a, b) + lost_of(c, d), scale)


def constant(value, rest=0.0):
    """Returns the Jet of a number that was computed."""
    coefficients = [0.0] * len(monomials().exponents)
    coefficients[0] = value
    return Jet(coefficients, rest, abs(value))


def sine_and_cosine(jet):
    """Returns both, by Taylor's series about the center."""
    center = jet.coefficients[0]
    change = Jet([0.0, *jet.coefficients[1:]], jet.rest, jet.scale)
    square = change * change
    cube, tail = square * change, change.spread() ** 4 / 24.0
    sine, cosine, found = math.sin(center), math.cos(center), []
    jets, scale = (change, square, cube), 1.0 + change.scale + square.scale + cube.scale
    for a, b in ((sine, cosine), (cosine, -sine)):
        half, sixth = -0.5 * a, b / -6.0
        rows = zip(*(jet.coefficients for jet in jets), strict=True)
        coefficients = [b * x + half * y + sixth * z for x, y, z in rows]
        coefficients[0] += a
        rest = abs(b) * change.rest + abs(half) * square.rest + abs(sixth) * cube.rest
        found.append(Jet(coefficients, rest + tail, scale))
    return found


def length(x, z, smoothing):
    """Returns the root of x^2 + z^2 + smoothing, the length of a vector a + u in space.

    It is a sum of forms of u, of degree k = 0, 1, ... each. In the plane of a and u it
    is |a| |1 + u / a| in complex numbers: with |u| <= r |a| the forms are at most those
    of |a| (2 - sqrt(1 - r))^2, and as many different vectors in place of u change
    nothing (Banach). So with r the sum of the bounds of the parts of u, this bounds
    what the grades that are kept, and those parts of it, leave out.
    """
    lost = math.hypot(x.rest, z.rest) * WIDER
    first = math.sqrt(x.coefficients[0] ** 2 + z.coefficients[0] ** 2 + smoothing)
    r = list(map(math.hypot, x.sizes(), z.sizes()))
    r[0], square = 0.0, dot_jets(x, x, z, z) + smoothing
    total = sum(r)
    if not total < CLOSEST * first:
        # Above its chord, of slope 1 / top, it is by a quarter of its top at most.
        top = (first + total + lost) * WIDER
        chord = square * (1.0 / top) + 0.125 * top
        return Jet(chord.coefficients, chord.rest + 0.125 * top, chord.scale)
    half = [c / (2.0 * first) for c in square.coefficients]
    half[0], multiply = 0.0, monomials().multiply
    second = multiply(half, half)
    third = multiply(second, half)
    a, b = 1.0 / (2.0 * first), 1.0 / (2.0 * first * first)
    rows = zip(half, second, third, strict=True)
    coefficients = [h - a * s + b * t for h, s, t in rows]
    coefficients[0] = first
    # 2 - sqrt(1 - r) = 1 + r/2 + r^2/8 + r^3/16 + ...
    r = [value / first for value in r]
    powers = r, graded(r, r), graded(graded(r, r), r)
    root = [x / 2 + y / 8 + z / 16 for x, y, z in zip(*powers, strict=True)]
    root[0] = 1.0
    whole = (2.0 - math.sqrt(1.0 - sum(r) * WIDER)) ** 2
    rest = first * max(whole - sum(graded(root, root)), 0.0) + lost
    return Jet(coefficients, rest, 8.0 * first * whole)


def graded(a, b):
    """Returns what the grades of a product are at most, given those of its factors."""
    found = [0.0] * len(KEPT)
    for i, j, k in WITHIN:
        found[k] += a[i] * b[j]
    return found


def accelerations(glider, pitch, elevator, xdot, zdot, pitchdot, rate):
    """Returns the accelerations of x, z and pitch.

    Flat plates: the force is -rho S (n v) |v| along the normal n = (sin, cos) of a
    plate that moves with v through the air.
    """
    g = glider.doubles
    s, c = sine_and_cosine(pitch)
    s_tail, c_tail = sine_and_cosine(pitch + elevator)
    air = xdot + -g["wind_x"], zdot + -g["wind_z"]

    def force(velocity, normal, area):
        across = dot_jets(velocity[0], normal[0], velocity[1], normal[1])
        return across * length(*velocity, SPEED_SMOOTHING) * (-g["air_density"] * area)

    wing_air, lift = air, pitchdot * -g["wing_offset"]
    if g["wing_offset"]:
        wing_air = air[0] + lift * s, air[1] + lift * c
    wing = force(wing_air, (s, c), g["wing_area"])
    hinge, turn = pitchdot * g["hinge_offset"], (pitchdot + rate) * g["elevator_offset"]
    tail_air = (
        air[0] + dot_jets(hinge, s, turn, s_tail),
        air[1] + dot_jets(hinge, c, turn, c_tail),
    )
    tail = force(tail_air, (s_tail, c_tail), g["elevator_area"])
    arm = dot_jets(s, s_tail, c, c_tail) * g["hinge_offset"] + g["elevator_offset"]
    moment = arm * tail + wing * -g["wing_offset"]
    return [
        dot_jets(wing, s, tail, s_tail) * (1.0 / g["mass"]),
        dot_jets(wing, c, tail, c_tail) * (1.0 / g["mass"]) + -g["gravity"],
        moment * (1.0 / g["pitch_inertia"]),
    ]


def taylor_of(glider, state, command):
    """Returns coefficients of the accelerations at a point, of degree 1 to 3 in y.

    Any would do for P, as long as both the Gram matrices and R are of the same.
    """
    inputs, tiny = [], 2.0**-30  # The expansion is of tiny y, so that it converges.
    for i, value in enumerate([*state[2:], command]):
        jet = constant(to_float(value))
        jet.coefficients[1 + i] = tiny
        inputs.append(jet)
    scales = [tiny ** len(axes) for axes in monomials().axes[: monomials().low]]
    return [
        [rational(jet.coefficients[i] / x) for i, x in enumerate(scales) if i]
        for jet in accelerations(glider, *inputs)
    ]


def to_float(value):
    """Returns a fraction rounded."""
    return int(value.p) / int(value.q)


class Remainder:
    """|R_k| <= beta_k (1 + e'F e), on a ball and for a part of an interval.

    A box is w = c + h v, |v_i| <= 1, at all times s of the part, -1 to 1. There f is a
    Jet. What is subtracted from it, x0' + P, and the right side are polynomials, which
    are shifted to c. Of these, terms that no Jet has are bounded.
    """

    def __init__(self, interval, glider, span, basis):
        """Expands what is a polynomial, in units of beta in the middle."""
        middle, half = (span[0] + span[1]) / 2, (span[1] - span[0]) / 2

        def timed(poly):
            return poly(fmpq_poly([middle, half]))

        def ring(poly):
            powers = enumerate(timed(poly).coeffs())
            return sum((c * s**k for k, c in powers), RING_ZERO)

        w, s = RING.gens()[:M], RING.gens()[N]
        y = [sum(b * v for b, v in zip(row, w, strict=True)) for row in basis]
        F = [[ring(p) for p in row[2:]] for row in interval.F[2:]]
        factor = 1 + dot(y[:-1], dot_rows(F, y[:-1]))
        powers = monomials_of(y)
        self.glider, self.boxes = glider, 0
        self.basis = each(to_float, basis)
        self.path = [
            [*map(to_float, timed(p).coeffs()), 0.0, 0.0, 0.0, 0.0][:4]
            for p in (*interval.x0[2:], interval.u0)
        ]
        self.units, polynomials = [], []
        for k, P in enumerate(interval.P, 4):
            unit = interval.beta[k](middle)
            need(unit > LEAST, "a bound of R is zero, or nearly.")
            known = ring(interval.x0[k].derivative() / interval.h)
            for (_, value), line_ in zip(powers, P, strict=True):
                known += ring(line_) * value
            self.units.append(1.0 / to_float(unit))
            polynomials += [known / unit, ring(interval.beta[k]) * factor / unit]
        self._tabulate(polynomials)

    def _tabulate(self, polynomials):
        """Makes the table of the shift, of integers of BITS places."""
        low, exponents = monomials().low, monomials().exponents
        columns, self.lost, self.squares, self.late = [], [], [], []
        for p in polynomials:
            parts, lost, square = [[fmpq(0)] * low, [fmpq(0)] * low], fmpq(0), fmpq(0)
            for e, c in p.to_dict().items():
                place, k = monomials().place[(*map(int, e[:M]), 0)], int(e[N])
                if k < 2:
                    parts[k][place] = c
                elif k == 2 and place == 0:
                    square = c
                else:
                    lost += abs(c)
            size = sum(map(abs, itertools.chain(*parts)), abs(square))
            need(size < LARGEST, "a bound of R is far too small.")
            self.lost.append(to_float(lost) + 2.0 * low * 2.0**-BITS)
            self.squares.append(to_float(square))
            whole = [[int((c * 2**BITS).floor()) for c in part] for part in parts]
            # For each v^e: the coefficients of the monomials of c.
            for part, stop in zip(whole, (low, len(exponents) - 1 - low), strict=True):
                for e in exponents[:stop]:
                    columns.append(self._shift(part, e))
            self.late.append([abs(whole[1][i]) * 2.0**-BITS for i in monomials().cubes])
        self.table = fmpz_mat([list(row) for row in zip(*columns, strict=True)])

    @staticmethod
    def _shift(part, e):
        """Returns the coefficients of c^f of the derivative by e, divided by e!."""
        low, exponents, place = (
            monomials().low,
            monomials().exponents,
            monomials().place,
        )
        found = [0] * low
        for j, f in enumerate(exponents[:low]):
            total = tuple(map(sum, zip(e, f, strict=True)))
            i = place.get(total)
            if i is not None and part[i]:
                found[j] = part[i] * math.prod(map(math.comb, total, e))
        return found

    def cover(self, stack):
        """Bounds R on boxes (c, h, claims); returns those where time is too long."""
        late = []
        while stack:
            batch, stack = stack[-64:], stack[:-64]
            self.boxes += len(batch)
            if self.boxes > MOST_BOXES:
                raise OpenFault(f"R was not bounded on {MOST_BOXES:,} boxes.")
            table = fmpz_mat([cubic_monomials(c) for c, _, _ in batch]) * self.table
            for (c, h, claims), values in zip(batch, table.tolist(), strict=True):
                left, blame = self._examine(c, h, claims, values)
                if not left:
                    continue
                axis = max(range(M + 1), key=blame.__getitem__)
                if axis == M:
                    late.append((c, h, left))
                    continue
                if h[axis] == 1:
                    raise OpenFault("R was not bounded on a small box.")
                half, moved = list(h), list(c)
                half[axis] = (h[axis] + 1) // 2
                for sign in (-1, 1):
                    moved[axis] = c[axis] + sign * (h[axis] - half[axis])
                    if box := in_ball(moved, half):
                        stack.append((*box, left))
        return late

    def _rates(self, w, step):
        """Returns the accelerations on a box."""
        inputs, low = [], monomials().low
        none = [0.0] * (len(monomials().exponents) - 1 - M)
        for row, (first, slope, bend, beyond) in zip(
            self.basis, self.path, strict=True
        ):
            parts = list(map(float.__mul__, row, w))
            own = list(map(float.__mul__, row, step))
            coefficients = [first + sum(parts), *own, *none]
            coefficients[low], coefficients[-1] = slope, bend
            size = abs(first) + abs(slope) + abs(bend)
            size += sum(map(abs, parts)) + sum(map(abs, own))
            inputs.append(Jet(coefficients, abs(beyond), size))
        return accelerations(self.glider, *inputs)

    def _examine(self, c, h, claims, values):
        """Returns which claims are left on a box, and how far axes are to blame."""
        unit = 1 << GRID
        w, step = [x / unit for x in c], [y / unit for y in h]
        out = sum(x * x for x in w) - 1.0
        pull = [2.0 * a * b for a, b in zip(w, step, strict=True)]
        bends = [b * b for b in step]
        sizes = step_sizes(h)
        rates, left, blame, known = self._rates(w, step), [], None, {}
        for k, sign in claims:
            if k not in known:
                known[k] = self._parts(k, rates[k], values, sizes)
            difference, rest, limit = known[k]
            a = [b - sign * d for b, d in zip(limit, difference, strict=True)]
            good = math.isfinite(rest) and all(map(math.isfinite, a))
            need(good, "a number is too large for doubles.")
            surely = a[0] + rest <= 0.0 >= out
            need(not surely, "R exceeds its bound.")
            if is_positive(a, rest, pull, bends, out):
                continue
            if not left:
                blame = blame_of(a, rest, rates[k].coefficients)
            left.append((k, sign))
        return left, blame

    def _parts(self, k, rate, values, sizes):
        """Returns R, what it may be off, and its bound, in units of beta."""
        width, cubes = len(sizes), monomials().cubes
        unit, found, rest = self.units[k], [], MARGIN + rate.rest * self.units[k]
        for p in (2 * k, 2 * k + 1):
            own = values[p * width : (p + 1) * width]
            own = [float(v) * x for v, x in zip(own, sizes, strict=True)]
            found.append([*own, self.squares[p]])
            rest += self.lost[p]
            for i, size in zip(cubes, self.late[p], strict=True):
                rest += size * sizes[i] * SCALE
        known, limit = found
        rates = rate.coefficients
        return [f * unit - d for f, d in zip(rates, known, strict=True)], rest, limit


SCALE = 2.0 ** (BITS + 3 * GRID)


def in_ball(center, half):
    """Returns a box about what of another is in the ball, both on the grid.

    There w_i^2 is at most 1 less the least squares of the others. None for nothing.
    """
    near = [max(abs(x) - y, 0) ** 2 for x, y in zip(center, half, strict=True)]
    room = (1 << 2 * GRID) - sum(near)
    if room < 0:
        return None
    centers, halves = [], []
    for x, y, own in zip(center, half, near, strict=True):
        reach = math.isqrt(room + own) + 1
        low, high = max(x - y, -reach), min(x + y, reach)
        halves.append(max((high - low + 1) // 2, 1))
        centers.append(low + halves[-1])
    return tuple(centers), tuple(halves)


def cubic_monomials(center):
    """Returns monomials of integers of GRID places, as integers of 3 GRID places."""
    found = [1 << 3 * GRID]
    for axes in monomials().axes[1 : monomials().low]:
        value = 1 << GRID * (3 - len(axes))
        for axis in axes:
            value *= center[axis]
        found.append(value)
    return found


@functools.lru_cache(maxsize=4096)
def step_sizes(h):
    """Returns the sizes of monomials of half-widths, in units of the table's."""
    exponents, low = monomials().exponents, monomials().low
    return [
        math.prod((v / (1 << GRID)) ** p for v, p in zip(h, e, strict=False)) / SCALE
        for e in (*exponents[:low], *exponents[low:-1])
    ]


def blame_of(a, rest, rate):
    """Returns how much axes and time are to blame that a bound is not seen to hold.

    What is beyond the degree varies as the highest degree does.
    """
    axes, squares, low = monomials().axes, monomials().squares, monomials().low
    blame = [0.4 * abs(a[1 + i]) + 0.6 * abs(a[squares[i]]) for i in range(M)]
    for i in monomials().mixed:
        for axis in axes[i]:
            blame[axis] += abs(a[i])
    blame.append(sum(map(abs, a[low:])))
    highest = [1e-300] * M
    for i in monomials().cubes:
        for axis in axes[i]:
            highest[axis] += abs(rate[i])
    highest.append(sum(map(abs, rate[low + 1 + M :])))
    share = 3.0 * rest / sum(highest)
    return [own + share * high for own, high in zip(blame, highest, strict=True)]


def is_positive(a, rest, pull, squares, out):
    """Determines whether a polynomial is positive where a box meets the ball."""
    low = monomials().low
    base = a[0] - rest - sum(map(abs, a[low:]))
    mixed = sum([abs(a[i]) for i in monomials().mixed])
    linear = a[1 : 1 + M]
    square = [a[i] for i in monomials().squares]

    def apart(factor):
        value = base - mixed + factor * out
        for first, p, second, q in zip(linear, pull, square, squares, strict=True):
            slope, bend = abs(first + factor * p), second + factor * q
            value += (
                bend - slope if 2.0 * bend <= slope else -slope * slope / (4.0 * bend)
            )
        return value

    if apart(0.0) > 0.0:
        return True
    first, last = 0.0, 4.0
    for _ in range(7):  # It is concave.
        x, y = first + 0.38 * (last - first), first + 0.62 * (last - first)
        at_x, at_y = apart(x), apart(y)
        if max(at_x, at_y) > 0.0:
            return True
        first, last = (first, y) if at_x > at_y else (x, last)
    cubic = sum([abs(a[i]) for i in monomials().cubes])
    if max(at_x, at_y) + mixed <= cubic:
        return False  # Hopeless, though all that is mixed and square were nothing.
    base -= cubic
    A = [[0.0] * M for _ in range(M)]
    for i in monomials().mixed:
        if len(monomials().axes[i]) == 2:
            j, k = monomials().axes[i]
            A[j][k] = A[k][j] = 0.5 * a[i]
    for factor in (first, first + 0.3):
        for i in range(M):
            A[i][i] = square[i] + factor * squares[i]
        g = [slope + factor * p for slope, p in zip(linear, pull, strict=True)]
        if base + factor * out + convex_bound(A, g) > 0.0:
            return True
    return False


def convex_bound(A, g):
    """Returns a bound from below of x'A x + g'x on |x_i| <= 1.

    With E >= 0 on the diagonal, A + E = L D L' is definite (Gill and Murray). There the
    function with A + E is above its tangent at any x, best near its minimum.
    """
    size = max(max(map(abs, row)) for row in A)
    least = 1e-3 * size + 1e-9
    most = max(*(A[i][i] for i in range(M)), size / M, 1e-9)
    L, D, lost = [[0.0] * M for _ in range(M)], [0.0] * M, 0.0
    B = [list(row) for row in A]
    for i in range(M):
        part = [L[i][k] * D[k] for k in range(i)]
        pivot = A[i][i] - sum(map(float.__mul__, L[i], part))
        column = [
            A[j][i] - sum(map(float.__mul__, L[j], part)) for j in range(i + 1, M)
        ]
        D[i] = max(pivot, least, max(map(abs, column), default=0.0) ** 2 / most)
        lost += D[i] - pivot
        B[i][i] += D[i] - pivot
        for j, value in enumerate(column, i + 1):
            L[j][i] = value / D[i]
    x = [0.0] * M
    for i in range(M):
        x[i] = -0.5 * g[i] - sum(map(float.__mul__, L[i], x[:i]))
    x = [value / d for value, d in zip(x, D, strict=True)]
    for i in reversed(range(M)):
        x[i] -= sum(L[k][i] * x[k] for k in range(i + 1, M))
    x = [max(-1.0, min(1.0, value)) for value in x]
    value = -lost
    for row, v, slope in zip(B, x, g, strict=True):
        Bx = dot(row, x)
        tangent = 2.0 * Bx + slope
        value += v * (Bx + slope) - abs(tangent) - tangent * v
    return value


def bound_remainder(interval, glider, span, basis, boxes=None, halvings=HALVINGS):
    """Returns the number of boxes on which R was bounded; Fault where it was not."""
    if boxes is None:
        claims = list(itertools.product(range(3), (1.0, -1.0)))
        boxes = [((0,) * M, (1 << GRID,) * M, claims)]
    remainder = Remainder(interval, glider, span, basis)
    late, count = remainder.cover(boxes), remainder.boxes
    if late and not halvings:
        raise OpenFault("R was not bounded on a short interval.")
    middle = (span[0] + span[1]) / 2
    for half in (span[0], middle), (middle, span[1]):
        if late:
            count += bound_remainder(interval, glider, half, basis, late, halvings - 1)
    return count


def main():
    """Verifies a file; returns the exit code, 0 only if all of it is verified."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("proof", help="file that --write-proof wrote")
    words = (
        "verify only so many intervals, chosen at random; exit code 2 (default: all)"
    )
    parser.add_argument("--intervals", type=int, metavar="N", help=words)
    words = "of this choice (default: a new one, which is reported)"
    parser.add_argument("--seed", type=int, help=words)
    words = "choose among the intervals before number N (default: all)"
    parser.add_argument("--before", type=int, metavar="N", help=words)
    args = parser.parse_args()
    try:
        said, is_whole = verify(args.proof, args.intervals, args.seed, args.before)
        print(said)
    except Fault as fault:
        print(f"Not proven: {fault}")
        return 1
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        TypeError,
        ValueError,
    ) as error:
        print(f"Not proven: the file is malformed: {error!s:.80}.")
        return 1
    return 0 if is_whole else 2


def verify(path, count=None, seed=None, before=None):
    """Returns what is verified of a file, in sentences, and whether all of it is.

    Raises Fault where anything is not.
    """
    header, knots, intervals = read_proof(path)
    glider, said = Glider(header), check_ends(header, knots)
    chosen = range(len(intervals) if before is None else min(before, len(intervals)))
    good = len(chosen) > 0 and (count is None or count > 0)
    need(good, "there is no such interval.")
    if count is not None and count < len(chosen):
        seed = random.SystemRandom().randrange(2**32) if seed is None else seed
        chosen = sorted(random.Random(seed).sample(chosen, count))
        print(f"seed {seed}: intervals {chosen}", file=sys.stderr)
    start = time.process_time()
    boxes, left = 0, []
    for k in chosen:
        try:
            boxes += verify_interval(knots, k, glider, intervals[k])
        except OpenFault as fault:
            left.append(k)
            print(f"interval {k}: |R| <= beta is open: {fault}", file=sys.stderr)
        except Fault as fault:
            raise Fault(f"interval {k}: {fault}") from None
        spent = time.process_time() - start
        print(f"interval {k}: {boxes:,} boxes, {spent:.0f} s in all", file=sys.stderr)
    need(
        not left,
        f"|R| <= beta is open on {len(left)} of {len(chosen)} intervals, {left}; "
        "all else holds on these.",
    )
    if len(chosen) < len(intervals):
        words = f"Verified on {len(chosen)} intervals; the rest is not proven."
    else:
        words = "Proven: every flight that starts in the inlet stays in the funnel."
    return f"{said}\n{words}", len(chosen) == len(intervals)


def verify_interval(knots, k, glider, given):
    """Verifies that no flight leaves the sets of an interval; returns boxes."""
    ends = [(knots["states"][j], knots["inputs"][j]) for j in (k, k + 1)]
    interval = Interval(knots, k, [taylor_of(glider, *end) for end in ends])
    slack = rational(given.get("slack"))
    parts = list(tile(given.get("parts"), "parts with Gram matrices"))
    balls = list(tile(given.get("balls"), "balls"))
    interval.check_sets(glider)
    interval.check_slack(slack)
    for span, part in parts:
        interval.check_growth(span, part, slack)
    boxes = 0
    bases = [array(ball.get("basis"), (M, M)) for _, ball in balls]
    for (span, _), basis in zip(balls, bases, strict=True):
        interval.check_ball(span, basis)
    for (span, _), basis in zip(balls, bases, strict=True):
        boxes += bound_remainder(interval, glider, span, basis)
    return boxes


def check_ends(header, knots):
    """Checks launch, goal and wire; returns what they are, in sentences."""
    launch, goal = (array(header.get(name), (N,)) for name in ("launch", "goal"))
    wire, reach = array(header.get("wire"), (2,)), rational(header.get("reach"))
    first, last = knots["states"][0], knots["states"][-1]
    starts = all(abs(a - b) <= ROUNDING for a, b in zip(first, launch, strict=True))
    need(starts, "the flight does not start at the launch.")
    need(all(axis > 0 for axis in goal), "an axis of the goal is not positive.")
    left = [
        [
            entry - (1 - GOAL_ROUNDING) / goal[i] ** 2 * (i == j)
            for j, entry in enumerate(row)
        ]
        for i, row in enumerate(knots["S"][-1])
    ]
    need(is_definite(left), "the last set is not within the goal.")
    room = reach + ROUNDING - max(goal[:2])
    away = sum((a - b) ** 2 for a, b in zip(last[:2], wire, strict=True))
    near = room > 0 and away <= room**2
    need(near, "the goal is not within the hook's reach of the wire.")

    def show(names, values):
        pairs = zip(names, values, strict=True)
        return ", ".join(f"{name} {to_float(v)}" for name, v in pairs)

    inlet = [1 / knots["S"][0][i][i] for i in range(N)]
    widths = (fmpq(round(math.sqrt(int(v.p) / int(v.q)) * 1e6), 10**6) for v in inlet)
    given = header["parameters"]
    servo = (
        *array(given["elevator_limits"], (2,)),
        rational(given["elevator_rate_limit"]),
    )
    return "\n".join(
        [
            f"Glider: {show(NUMBERS, [rational(given[name]) for name in NUMBERS])};",
            f"  elevator {show(('from', 'to', 'rate'), servo)};",
            f"  wind {show('xz', array(header['wind'], (2,)))}.",
            f"Launch: {show(STATES, launch)}.",
            f"Inlet, half-widths of states alone: {show(STATES, widths)}.",
            f"Goal, half-axes: {show(STATES, goal)}; about {show(STATES, last)}.",
            f"Wire: {show('xz', wire)}; reach {to_float(reach)}.",
            f"Time: {to_float(knots['times'][-1])} s.",
            f"Funnel: {header.get('funnel')!a:.66}",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
