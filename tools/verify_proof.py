#!/usr/bin/env python3
"""Verifies the proof of a funnel, independently of the program that made it.

    glider check-funnel FUNNEL --prove --write-proof proof.json.gz
    python tools/verify_proof.py proof.json.gz

This file needs python-flint and nothing else: not the package `glider`, not NumPy. It
has its own text of the physics, its own Taylor arithmetic (balls of Arb) and its own
covering, so that an error would have to be made twice, in different ways. The theorem
and its proof are in docs/certificate.md; the notation is the same. Checked are

 1. the ends: the flight starts at the launch, the last set lies in the goal, and the
    goal within the hook's reach of the wire;
 2. on each interval, in exact arithmetic: S is positive definite; the servo follows its
    command on E; each ball contains the deviations of E; what the nominal flight lacks
    in the linear rates is within the slack; V falls on V = 1, by the Gram matrices.
    The flight, S, the feedback and the bounds are polynomials between values at the
    knots, which the intervals share: they are continuous there;
 3. on each ball, with Arb: |R_k| <= beta_k (1 + e'F e). f - P is expanded to degree 8
    about the center of the ball, the rest is bounded. Boxes cover the ball; on each the
    polynomial is bounded. Where the rest is too large, as near the wire, where sets
    contain states in which the tail is at rest, this program leaves the interval open
    and says so: the rest of it is verified there, but not this.

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
from fractions import Fraction

from flint import arb, ctx, fmpq, fmpq_mpoly_ctx, fmpq_poly, fmpz_mat

FORMAT = "drake-glider proof 1"
ROUNDING = Fraction(1, 10**6)  # With which launch and wire are compared [m, ...].
GOAL_ROUNDING = Fraction(1, 10**9)  # Relative, of S at the end.
STOPPING_TIME = 0.005  # Of the servo before its stops [s].
SPEED_SMOOTHING = 1e-8  # In the physics: |v| is the root of v'v and this [m^2/s^2].
BASIS_BITS, GRAM_BITS = 30, 36  # Binary places of a file's integers.
LEFT = 16  # Units of these that may be left of a coefficient.
HALVINGS = 6  # Times that an interval is halved where a matrix is not seen definite.
ORDER = 8  # Degree of the expansions; time counts twice.
LARGEST_REST = 0.02  # Share of beta that the rest of an expansion may have.
SMALL = 5e-4  # Share of beta that terms have together which are only bounded.
MOST_BOXES = 60_000  # For one inequality.
BITS, GRID, MONOMIAL_BITS = 40, 8, 40  # Binary places in the covering.
MARGIN = 1e-6  # Share of beta left for doubles and the binary places in the covering.
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


# Taylor expansions: polynomials in v (M numbers) and time s, -1 to 1, and their rest.


class Space:
    """Monomials up to a degree, in which time counts twice; tables of products."""

    def __init__(self, order):
        """Makes the tables."""
        self.order = order
        self.exponents = [
            (*exponents, k)
            for degree in range(order + 1)
            for k in range(degree // 2 + 1)
            for exponents in exponents_of(degree - 2 * k)
        ]
        self.degrees = [sum(e) + e[M] for e in self.exponents]
        self.place = {e: i for i, e in enumerate(self.exponents)}
        self.products = [
            [
                (j, self.place[tuple(map(sum, zip(a, b, strict=True)))])
                for j, b in enumerate(self.exponents)
                if self.degrees[i] + self.degrees[j] <= order
            ]
            for i, a in enumerate(self.exponents)
        ]


def exponents_of(degree):
    """Returns exponents of the monomials of M variables, sorted by indices."""
    return [
        tuple(map(indices.count, range(M)))
        for indices in itertools.combinations_with_replacement(range(M), degree)
    ]


def bombieri(exponents):
    """Returns a factor: the root of the sum of c^2 times it bounds a form on a ball."""
    total = math.factorial(sum(exponents))
    return fmpq(math.prod(map(math.factorial, exponents)), total)


class Ball:
    """What Jets on |v| <= 1 share: their monomials and norms."""

    def __init__(self, space):
        """Makes the table of norms."""
        self.space = space
        self.kinds = [(sum(e[:M]), e[M]) for e in space.exponents]
        self.weights = [arb(bombieri(e[:M])) for e in space.exponents]

    def jet(self, terms):
        """Returns a Jet, given coefficients by exponents."""
        coefficients = [None] * len(self.space.exponents)
        for exponents, value in terms.items():
            coefficients[self.space.place[exponents]] = arb(value)
        return Jet(self, coefficients)

    def in_time(self, poly):
        """Returns the Jet of a polynomial in s."""
        return self.jet({(0,) * M + (k,): c for k, c in enumerate(poly.coeffs())})

    def linear(self, row):
        """Returns the Jet of a linear form of v."""
        return self.jet(
            {tuple(int(i == j) for j in range(M + 1)): c for i, c in enumerate(row)}
        )


def to_fmpq(value):
    """Returns a Fraction as FLINT has it."""
    return fmpq(value.numerator, value.denominator)


class Jet:
    """On a ball: |f - sum of coefficients times monomials| <= rest."""

    def __init__(self, ball, coefficients, rest=None):
        """Takes coefficients, None for zero, and a bound."""
        self.ball, self.coefficients = ball, coefficients
        self.rest = arb(0) if rest is None else arb(rest.abs_upper())

    def sizes(self):
        """Returns bounds of the parts of each degree."""
        squares = {}
        ball, degrees = self.ball, self.ball.space.degrees
        table = self.coefficients, ball.weights, ball.kinds, degrees
        for c, weight, kind, degree in zip(*table, strict=True):
            if c is not None:
                key = degree, kind
                squares[key] = squares.get(key, 0) + c * c * weight
        found = [arb(0)] * (self.ball.space.order + 1)
        for (degree, _), square in squares.items():
            found[degree] += arb(square.abs_upper()).sqrt()
        return found

    def size(self):
        """Returns a bound of |f|."""
        return sum(self.sizes(), self.rest)

    def __add__(self, other):
        """Adds a Jet or a number."""
        if not isinstance(other, Jet):
            coefficients = list(self.coefficients)
            coefficients[0] = (
                other if coefficients[0] is None else coefficients[0] + other
            )
            return Jet(self.ball, coefficients, self.rest)
        pairs = zip(self.coefficients, other.coefficients, strict=True)
        coefficients = [b if a is None else a if b is None else a + b for a, b in pairs]
        return Jet(self.ball, coefficients, self.rest + other.rest)

    def __sub__(self, other):
        """Subtracts a Jet."""
        return self + other * arb(-1)

    def __mul__(self, other):
        """Multiplies by a Jet or a number."""
        if not isinstance(other, Jet):
            coefficients = [c if c is None else c * other for c in self.coefficients]
            return Jet(self.ball, coefficients, self.rest * other)
        space = self.ball.space
        found = [None] * len(self.coefficients)
        for a, row in zip(self.coefficients, space.products, strict=True):
            if a is None:
                continue
            for j, k in row:
                b = other.coefficients[j]
                if b is not None:
                    found[k] = a * b if found[k] is None else found[k] + a * b
        mine, theirs = self.sizes(), other.sizes()
        rest = beyond(mine, theirs, space.order) + self.rest * other.rest
        rest += self.rest * sum(theirs) + other.rest * sum(mine)
        return Jet(self.ball, found, rest)


def beyond(mine, theirs, order):
    """Returns a bound of what a product has beyond the order."""
    pairs = itertools.product(enumerate(mine), enumerate(theirs))
    return sum((a * b for (i, a), (j, b) in pairs if i + j > order), arb(0))


def sine_and_cosine(jet):
    """Returns both, by Taylor's series about the center."""
    order, center = jet.ball.space.order, jet.coefficients[0]
    change = Jet(jet.ball, [None, *jet.coefficients[1:]], jet.rest)
    sine, cosine = center.sin(), center.cos()
    values = sine, cosine, -sine, -cosine
    power, found = change, [jet.ball.jet({}) + sine, jet.ball.jet({}) + cosine]
    for k in range(1, order + 1):
        for turn in (0, 1):
            found[turn] += power * (values[(k + turn) % 4] / math.factorial(k))
        power = power * change if k < order else power
    tail = change.size() ** (order + 1) / math.factorial(order + 1)
    return [Jet(jet.ball, part.coefficients, part.rest + tail) for part in found]


def length(x, z, smoothing):
    """Returns the root g of Q = x^2 + z^2 + smoothing.

    By degrees, g_d = (Q_d - sum of g_i g_(d - i)) / (2 g_0). With D = Q - (sum of g)^2
    and |v| >= low on the ball, |sqrt(Q) - sum of g| = |D| / (sqrt(Q) + sum of g)
    <= |D| / low, if |D| < low^2: the sum has no zero then. Else the rest is infinite.
    """
    square = x * x + z * z + smoothing
    space, ball = square.ball.space, square.ball
    found = [None] * len(square.coefficients)
    first = found[0] = square.coefficients[0].sqrt()
    places = [[] for _ in range(space.order + 1)]
    for i, degree in enumerate(space.degrees):
        places[degree].append(i)
    for degree in range(1, space.order + 1):
        missing = {i: square.coefficients[i] or arb(0) for i in places[degree]}
        for i in itertools.chain(*places[1:degree]):
            for j, k in space.products[i]:
                if k in missing and j and found[i] is not None and found[j] is not None:
                    missing[k] -= found[i] * found[j]
        for i, value in missing.items():
            found[i] = value / (2 * first)
    sizes = Jet(ball, found).sizes()
    lost = square.rest + beyond(sizes, sizes, space.order)
    along = x * (x.coefficients[0] / first) + z * (z.coefficients[0] / first)
    low = along.coefficients[0] - sum(along.sizes()[1:], along.rest)
    good = low > 0 and lost < low * low
    return Jet(ball, found, lost / low if good else arb("inf"))


def accelerations(glider, pitch, elevator, xdot, zdot, pitchdot, rate):
    """Returns the accelerations of x, z and pitch.

    Flat plates: the force is -rho S (n v) |v| along the normal n = (sin, cos) of a
    plate that moves with v through the air.
    """
    g = {name: arb(getattr(glider, name)) for name in NUMBERS}
    smoothing = arb(rational(SPEED_SMOOTHING))
    s, c = sine_and_cosine(pitch)
    s_tail, c_tail = sine_and_cosine(pitch + elevator)
    air = xdot + -arb(glider.wind[0]), zdot + -arb(glider.wind[1])

    def force(velocity, normal, area):
        across = velocity[0] * normal[0] + velocity[1] * normal[1]
        return across * length(*velocity, smoothing) * (-g["air_density"] * area)

    lift = pitchdot * -g["wing_offset"]
    wing_air = air[0] + lift * s, air[1] + lift * c
    wing = force(wing_air, (s, c), g["wing_area"])
    hinge, turn = pitchdot * g["hinge_offset"], (pitchdot + rate) * g["elevator_offset"]
    tail_air = air[0] + hinge * s + turn * s_tail, air[1] + hinge * c + turn * c_tail
    tail = force(tail_air, (s_tail, c_tail), g["elevator_area"])
    arm = (s * s_tail + c * c_tail) * g["hinge_offset"] + g["elevator_offset"]
    moment = arm * tail - wing * g["wing_offset"]
    return [
        (wing * s + tail * s_tail) * (1 / g["mass"]),
        (wing * c + tail * c_tail) * (1 / g["mass"]) + -g["gravity"],
        moment * (1 / g["pitch_inertia"]),
    ]


@functools.cache
def whole_ball():
    """Returns what the expansions share, made once."""
    return Ball(Space(ORDER))


def taylor_of(glider, state, command):
    """Returns coefficients of the accelerations at a point, of degree 1 to 3 in y.

    Any would do for P, as long as both the Gram matrices and R are of the same.
    """
    tiny = 40  # The expansion is of 2^-40 y, so that its rest is nothing.
    ball = Ball(Space(3))
    inputs = [
        ball.linear([fmpq(int(i == j), 1 << tiny) for j in range(M)]) + arb(value)
        for i, value in enumerate([*state[2:], command])
    ]
    found = []
    for jet in accelerations(glider, *inputs):
        row = []
        for degree in (1, 2, 3):
            for exponents in exponents_of(degree):
                c = jet.coefficients[ball.space.place[(*exponents, 0)]]
                row.append(
                    rational(float((c or arb(0)).mid()) * 2.0 ** (tiny * degree))
                )
        found.append(row)
    return found


def remainders(interval, glider, span, basis):
    """Returns R and its bound for each acceleration."""
    ball, middle, half = whole_ball(), (span[0] + span[1]) / 2, (span[1] - span[0]) / 2

    def timed(poly):
        return ball.in_time(poly(fmpq_poly([middle, half])))

    y = [ball.linear(row) for row in basis]
    center = [*map(timed, interval.x0[2:]), timed(interval.u0)]
    rates = accelerations(glider, *(a + b for a, b in zip(center, y, strict=True)))
    powers = monomials_of(y)
    factor = ball.jet({(0,) * (M + 1): 1})
    for i, j in itertools.product(range(5), repeat=2):
        F = interval.F[2 + i][2 + j]
        if F != 0:
            factor = factor + timed(F) * (y[i] * y[j])
    pairs = []
    s = ball.in_time(fmpq_poly([0, 1]))
    for k, rate in enumerate(rates):
        mean, change = ball.jet({}), ball.jet({})
        for (_, value), line_ in zip(powers, interval.P[k], strict=True):
            here = line_(fmpq_poly([middle, half]))
            mean = mean + value * arb(here[0])
            change = change + value * arb(here[1])
        slope = timed(interval.x0[4 + k].derivative() / interval.h)
        pairs.append(
            (rate - slope - mean - s * change, timed(interval.beta[4 + k]) * factor)
        )
    return pairs


# The covering.


class Shifts:
    """Tables of how a polynomial of M variables is shifted to another center."""

    def __init__(self):
        """Makes the tables."""
        self.exponents = [e for d in range(ORDER + 1) for e in exponents_of(d)]
        place = self.place = {e: i for i, e in enumerate(self.exponents)}
        self.degrees = list(map(sum, self.exponents))
        self.low = [i for i, d in enumerate(self.degrees) if d <= 3]
        self.fourth = [i for i, d in enumerate(self.degrees) if d == 4]
        self.parents = []
        for e in self.exponents[1:]:
            axis = next(i for i in range(M) if e[i])
            parent = tuple(p - (i == axis) for i, p in enumerate(e))
            self.parents.append((place[parent], axis))
        self.rows = [
            [
                (j, place[total], math.prod(map(math.comb, total, e)))
                for j, f in enumerate(self.exponents)
                for total in [tuple(map(sum, zip(e, f, strict=True)))]
                if total in place
            ]
            for e in self.exponents[: self.fourth[-1] + 1]
        ]
        self.weights = [float(arb(bombieri(e)).upper()) for e in self.exponents]
        self.axes = [[i for i in range(M) for _ in range(e[i])] for e in self.exponents]
        self.squares = [place[tuple(2 * (i == j) for j in range(M))] for i in range(M)]
        self.mixed = [
            i
            for i in self.low
            if self.degrees[i] == 3 or (self.degrees[i] == 2 and i not in self.squares)
        ]
        self.cubes = [i for i in self.low if self.degrees[i] == 3]

    def steps(self, used):
        """Returns (monomial, parent, axis), all that lead to some monomials."""
        needed = set(used)
        for i in reversed(range(1, len(self.exponents))):
            if i in needed:
                needed.add(self.parents[i - 1][0])
        return [(i, *self.parents[i - 1]) for i in sorted(needed) if i]


@functools.cache
def shifts():
    """Returns the tables, made once."""
    return Shifts()


class Positive:
    """The claim that polynomials in v are positive on the unit ball.

    On a box v = c + h x, |x_i| <= 1, each is shifted to c: degree 0 to 3
    exactly, the fourth and higher by a bound of its derivatives. For any number l >= 0
    it is at least p + l (|v|^2 - 1) in the ball, and that is bounded in two ways: each
    x_i apart, with what is mixed by its size; or as a convex function, by its tangent.
    """

    def __init__(self, polynomials):
        """Takes integer coefficients of BITS places."""
        parts = [
            [
                {j: p[k] * factor for j, k, factor in row if p[k]}
                for row in shifts().rows[: len(shifts().low)]
            ]
            for p in polynomials
        ]
        rows = [row for part in parts for row in part]
        used = sorted(set().union(*rows))
        table = [[row.get(j, 0) for row in rows] for j in used]
        self.used, self.table = used, fmpz_mat(table)
        self.steps = shifts().steps(used)
        self.fourth = [
            [self._derivative(p, i) for i in shifts().fourth] for p in polynomials
        ]
        self.count, self.cache = len(polynomials), {}

    def _derivative(self, p, row):
        squares = [0.0] * (ORDER - 3)
        for j, k, factor in shifts().rows[row]:
            value = p[k] * factor / 2**BITS
            squares[shifts().degrees[j]] += value * value * shifts().weights[j]
        return [math.sqrt(square) * (1 + 1e-9) for square in squares]

    def count_boxes(self):
        """Returns the number of boxes of a proof; Fault where there is none."""
        unit, boxes = 1 << GRID, 0
        stack = [((0,) * M, (unit,) * M)]
        while stack:
            batch, stack = stack[-128:], stack[:-128]
            boxes += len(batch)
            if boxes > MOST_BOXES:
                raise OpenFault(f"R was not bounded on {MOST_BOXES:,} boxes.")
            monomials = fmpz_mat([self._monomials(c) for c, _ in batch])
            table = (monomials * self.table).tolist()
            for (c, h), values in zip(batch, table, strict=True):
                blame = self._blame(c, h, values)
                if blame is None:
                    continue
                axis = max(range(M), key=lambda i: blame[i] if h[i] > 1 else -1.0)
                if h[axis] == 1:
                    raise OpenFault("R was not bounded on a small box.")
                half = tuple(v // 2 if i == axis else v for i, v in enumerate(h))
                for sign in (-1, 1):
                    moved = list(c)
                    moved[axis] += sign * half[axis]
                    near = (
                        max(abs(x) - y, 0) for x, y in zip(moved, half, strict=True)
                    )
                    if sum(x * x for x in near) <= unit * unit:
                        stack.append((tuple(moved), half))
        return boxes

    def _monomials(self, center):
        """Returns the monomials of integers of GRID places, of MONOMIAL_BITS places."""
        found = {0: 1}
        for i, parent, axis in self.steps:
            found[i] = found[parent] * center[axis]
        degrees = shifts().degrees
        places = (MONOMIAL_BITS - GRID * degrees[i] for i in self.used)
        return [
            found[i] << place if place >= 0 else found[i] >> -place
            for i, place in zip(self.used, places, strict=True)
        ]

    def _blame(self, c, h, values):
        """Returns how much each axis is to blame on a box; None if nothing is."""
        unit, low = 1 << GRID, len(shifts().low)
        if h not in self.cache:
            sizes = [
                math.prod((v / unit) ** p for v, p in zip(h, e, strict=True))
                for e in shifts().exponents[: shifts().fourth[-1] + 1]
            ]
            fourth = [
                [
                    sum(
                        sizes[i] * f[d]
                        for i, f in zip(shifts().fourth, all_, strict=True)
                    )
                    for d in range(ORDER - 3)
                ]
                for all_ in self.fourth
            ]
            scale = 2.0 ** -(BITS + MONOMIAL_BITS)
            self.cache[h] = [size * scale for size in sizes[:low]], fourth
        sizes, fourth = self.cache[h]
        w, step = [x / unit for x in c], [y / unit for y in h]
        out = sum(x * x for x in w) - 1.0
        reach = max(1.0, math.sqrt(out + 1.0))
        pull = [2.0 * a * b for a, b in zip(w, step, strict=True)]
        squares = [b * b for b in step]
        for k in range(self.count):
            own = values[k * low : (k + 1) * low]
            a = [float(v) * s for v, s in zip(own, sizes, strict=True)]
            rest = sum(f * reach**d for d, f in enumerate(fourth[k])) + MARGIN
            need(out > 0.0 or a[0] > 0.0, "R exceeds its bound.")
            if not _is_positive(a, rest, pull, squares, out):
                break
        else:
            return None
        blame = [
            0.2 * abs(a[1 + i]) + 0.6 * abs(a[shifts().squares[i]]) for i in range(M)
        ]
        for i in shifts().mixed:
            for axis in shifts().axes[i]:
                blame[axis] += abs(a[i])
        return blame


def _is_positive(a, rest, pull, squares, out):
    """Determines whether a polynomial is positive where a box meets the ball."""
    base = a[0] - sum(abs(a[i]) for i in shifts().mixed) - rest
    linear = a[1 : 1 + M]
    square = [a[i] for i in shifts().squares]

    def apart(factor):
        value = base + factor * out
        for first, p, second, q in zip(linear, pull, square, squares, strict=True):
            slope, bend = abs(first + factor * p), second + factor * q
            value += (
                bend - slope if 2.0 * bend <= slope else -slope * slope / (4.0 * bend)
            )
        return value

    low, high = 0.0, 4.0
    if apart(0.0) > 0.0:
        return True
    for _ in range(7):  # It is concave.
        x, y = low + 0.38 * (high - low), low + 0.62 * (high - low)
        at_x, at_y = apart(x), apart(y)
        if max(at_x, at_y) > 0.0:
            return True
        low, high = (low, y) if at_x > at_y else (x, high)
    base = a[0] - sum(abs(a[i]) for i in shifts().cubes) - rest
    A = [[0.0] * M for _ in range(M)]
    for i in shifts().mixed:
        if shifts().degrees[i] == 2:
            j, k = shifts().axes[i]
            A[j][k] = A[k][j] = 0.5 * a[i]
    for factor in (low, 1.2 * low, low + 0.3, low + 0.8):
        for i in range(M):
            A[i][i] = square[i] + factor * squares[i]
        g = [first + factor * p for first, p in zip(linear, pull, strict=True)]
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


def claim(bound, remainder, sign, scale):
    """Returns integer polynomials at both ends of the time, positive if R is bounded.

    Between the ends a polynomial differs from the straight line by its parts of s^2 and
    higher at most. The smallest terms are bounded by their sizes.
    """
    jet = (bound - remainder * arb(sign)) * (1 / scale)
    place, later = shifts().place, Jet(jet.ball, [None] * len(jet.coefficients))
    ends, lost = [[0] * len(place), [0] * len(place)], jet.rest
    for i, (c, e) in enumerate(
        zip(jet.coefficients, whole_ball().space.exponents, strict=True)
    ):
        if c is None:
            continue
        if e[M] > 1:
            later.coefficients[i] = c
        whole = int((c.mid() * 2**BITS).floor().unique_fmpz())
        lost += c.rad() + arb(2) ** -BITS
        for end, s in zip(ends, (-1, 1), strict=True):
            end[place[e[:M]]] += whole * s ** e[M]
    lost = (lost + later.size()) * 2**BITS
    lost = int(lost.upper().ceil().unique_fmpz())
    sizes = [max(map(abs, pair)) for pair in zip(*ends, strict=True)]
    left = int(SMALL * 2**BITS)
    for i in sorted(range(len(sizes)), key=sizes.__getitem__):
        left -= sizes[i]
        if left < 0:
            break
        lost += sizes[i]
        for end in ends:
            end[i] = 0
    for end in ends:
        end[0] -= lost
    return ends


def bound_remainder(interval, glider, span, basis):
    """Returns the number of boxes on which R was bounded; Fault where it was not."""
    middle = (span[0] + span[1]) / 2
    scales = [arb(beta(middle)) for beta in interval.beta[4:]]
    need(all(scale > 0 for scale in scales), "a bound of R is zero.")
    pairs = remainders(interval, glider, span, basis)
    for (r, _), scale in zip(pairs, scales, strict=True):
        if not r.rest <= LARGEST_REST * scale:
            raise OpenFault(
                "the sets are too wide for an expansion about their center."
            )
    return sum(
        Positive(claim(bound, r, sign, scale)).count_boxes()
        for (r, bound), scale in zip(pairs, scales, strict=True)
        for sign in (1, -1)
    )


def main():
    """Verifies a file; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("proof", help="file that --write-proof wrote")
    words = "verify only so many intervals, chosen at random (default: all)"
    parser.add_argument("--intervals", type=int, metavar="N", help=words)
    words = "of this choice (default: a new one, which is reported)"
    parser.add_argument("--seed", type=int, help=words)
    words = "choose among the intervals before number N (default: all)"
    parser.add_argument("--before", type=int, metavar="N", help=words)
    args = parser.parse_args()
    try:
        print(verify(args.proof, args.intervals, args.seed, args.before))
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
    return 0


def verify(path, count=None, seed=None, before=None):
    """Returns what is proven by a file, in sentences; Fault where nothing is."""
    header, knots, intervals = read_proof(path)
    glider, said = Glider(header), check_ends(header, knots)
    chosen = range(len(intervals) if before is None else min(before, len(intervals)))
    need(len(chosen) > 0, "there is no such interval.")
    if count is not None and count < len(chosen):
        seed = random.SystemRandom().randrange(10**6) if seed is None else seed
        chosen = sorted(random.Random(seed).sample(chosen, max(count, 1)))
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
        f"|R| <= beta is open on {len(left)} intervals, {left}; all else holds.",
    )
    if len(chosen) < len(intervals):
        return f"{said}\nVerified on {len(chosen)} intervals; the rest is not proven."
    return f"{said}\nProven: every flight that starts in the inlet stays in the funnel."


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
    rounding, relative = to_fmpq(ROUNDING), to_fmpq(GOAL_ROUNDING)
    starts = all(abs(a - b) <= rounding for a, b in zip(first, launch, strict=True))
    need(starts, "the flight does not start at the launch.")
    need(all(axis > 0 for axis in goal), "an axis of the goal is not positive.")
    left = [
        [
            entry - (1 - relative) / goal[i] ** 2 * (i == j)
            for j, entry in enumerate(row)
        ]
        for i, row in enumerate(knots["S"][-1])
    ]
    need(is_definite(left), "the last set is not within the goal.")
    room = reach + rounding - max(goal[:2])
    away = sum((a - b) ** 2 for a, b in zip(last[:2], wire, strict=True))
    near = room > 0 and away <= room**2
    need(near, "the goal is not within the hook's reach of the wire.")

    def show(names, values):
        pairs = zip(names, values, strict=True)
        return ", ".join(f"{name} {int(v.p) / int(v.q):.4g}" for name, v in pairs)

    inlet = [1 / knots["S"][0][i][i] for i in range(N)]
    widths = (fmpq(round(math.sqrt(int(v.p) / int(v.q)) * 1e6), 10**6) for v in inlet)
    given = header["parameters"]
    return "\n".join(
        [
            f"Glider: {show(NUMBERS, [rational(given[name]) for name in NUMBERS])};",
            f"  wind {show('xz', array(header['wind'], (2,)))}.",
            f"Launch: {show(STATES, launch)}.",
            f"Inlet, half-widths of states alone: {show(STATES, widths)}.",
            f"Goal, half-axes: {show(STATES, goal)}; about {show(STATES, last)}.",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
