"""Taylor models: polynomials on boxes and a proven bound of their remainder.

On a box c + h v, |v_i| <= 1, a Taylor model holds of what it stands for
    |f(c + h v) - p(v)| <= remainder,
with p the polynomial that its coefficients are. All of it is proven: what a product or
a function has beyond the degree goes into `remainder`, and so does the rounding of
every operation (Makino and Berz 2003).

A TaylorModel goes through the physics like a Jet does, but only records what is done: a
Recording then does it for many boxes at once, in `glider.compiled.taylor`.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from glider.compiled import taylor
from glider.compiled.taylor import CHANGE, FUNCTIONS, INPUT, PRODUCT, SUM, WIDER, WITHIN
from glider.verification.dynamics.jets import Monomials, Number

_RANGE = 1e-100, 1e100
"""Sizes of factors that are carried along, so that their products do not underflow."""


class Recording:
    """Operations on Taylor models of one table, each of which is carried out once."""

    def __init__(self, table: Monomials) -> None:
        """Starts with none."""
        self.table = table
        # What, of which operations, and plain numbers; the values are places.
        self._places: dict[tuple, int] = {}

    def add(
        self, what: int, *of: int, f: float = 1.0, g: float = 0.0, h: float = 0.0
    ) -> "TaylorModel":
        """Returns the result of an operation, which may be there already."""
        step = what, of, float(f), float(g), float(h)
        return TaylorModel(self, self._places.setdefault(step, len(self._places)))

    def program(self, results: list["TaylorModel"], present: np.ndarray) -> "_Program":
        """Returns what computes results, and nothing that they do not depend on.

        Args:
            results: R models of this recording.
            present: (I, M) which coefficients of each input may not be zero.
        """
        wanted = [result.exactly() for result in results]
        steps = list(self._places)
        order = dict[int, None]()

        def operands(place):
            return () if steps[place][0] == INPUT else steps[place][1]

        def visit(place):
            """Appends a place, after all that it depends on."""
            if place not in order:
                for i in operands(place):
                    visit(i)
                order[place] = None

        for place in wanted:
            visit(place)
        last = {i: place for place in order for i in operands(place)}
        last |= dict.fromkeys(wanted, -1)
        products = _Products(self.table)
        there = dict[int, np.ndarray]()
        slots = dict[int, int]()
        free = list[int]()
        count = 0
        code = []
        rows = []
        for place in order:
            what, of, *numbers = steps[place]
            if not free:
                free.append(count)
                count += 1
            slots[place], pattern = free.pop(), 0
            if what == INPUT:
                there[place] = present[of[0]]
            elif what == PRODUCT:
                there[place], pattern = products.add(*(there[i] for i in of))
            else:
                there[place] = _present(what, [there[i] for i in of], *numbers)
            code.append((what, slots[place], pattern))
            row = of if what == INPUT else tuple(slots[i] for i in of)
            rows.append(row + (self.table.degree + 1 - len(row)) * (0,))
            # Slots that nothing needs any more.
            free += [slots[i] for i in set(operands(place)) if last[i] == place]
        return _Program(
            code=np.array(code),
            of=np.array(rows),
            numbers=np.array([steps[place][2:] for place in order]),
            present=np.array([there[place] for place in order]),
            results=np.array([slots[place] for place in wanted]),
            slots=count,
            products=products.arrays(),
        )


def _present(what, parts, f, g, h):
    """Returns which coefficients (M,) a result has, given those of its operands."""
    constant = np.arange(len(parts[0])) == 0
    if what == CHANGE:
        return parts[0] & ~constant
    if what == WITHIN:
        return parts[0]
    if what == SUM:
        parts = parts[0] & (f != 0.0), parts[1] & (g != 0.0), constant & (h != 0.0)
        return np.any(parts, axis=0)
    return np.any(parts, axis=0) | constant


class _Products:
    """Lists of the products of two models of which some coefficients are zero."""

    def __init__(self, table):
        self._table = table
        self._known = {}
        self._starts = []
        self._used = []

    def add(self, a, b):
        """Returns which coefficients (M,) a product has, and where its starts are."""
        table = self._table
        key = a.tobytes() + b.tobytes()
        if key not in self._known:
            used = a[table.left] & b[table.right]
            counts = np.add.reduceat(used, table.starts, dtype=int)
            before = sum(map(len, self._used))
            self._known[key] = counts > 0, len(self._starts)
            self._starts.append(before + np.append(0, np.cumsum(counts)))
            self._used.append(np.flatnonzero(used))
        return self._known[key]

    def arrays(self):
        """Returns left, right, the degrees (M,) and starts (., M + 1)."""
        table = self._table
        used = np.concatenate([np.zeros(0, dtype=int), *self._used])
        starts = np.array(self._starts, dtype=int).reshape(-1, len(table.degrees) + 1)
        return table.left[used], table.right[used], table.degrees, starts


class _Program(NamedTuple):
    """Operations on Taylor models, in order; fields are as in `taylor.run`."""

    code: np.ndarray
    of: np.ndarray
    numbers: np.ndarray
    present: np.ndarray
    results: np.ndarray
    slots: int
    products: tuple[np.ndarray, ...]

    def run(
        self, coefficients: np.ndarray, remainders: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns coefficients (R, M, B) and remainders (R, B) of the results.

        Given are those of the inputs, (I, M, B) and (I, B).
        """
        return taylor.run(*self, coefficients, remainders)


@dataclasses.dataclass(frozen=True, eq=False)
class TaylorModel(Number):
    """A polynomial and a bound of its remainder: a factor times a result."""

    recording: Recording
    place: int  #: Which of its operations.
    factor: float = 1.0

    def plus(self, other: Any) -> "TaylorModel":
        if isinstance(other, TaylorModel):
            a, b = sorted([self, other], key=lambda model: model.place)
            return self.recording.add(SUM, a.place, b.place, f=a.factor, g=b.factor)
        if other == 0.0:
            return self
        return self._sum(self.factor, other)

    def times(self, other: Any) -> "TaylorModel":
        if isinstance(other, TaylorModel):
            places = sorted([self.place, other.place])
            product = self.recording.add(PRODUCT, *places)
            return product.times(self.factor).times(other.factor)
        factor = self.factor * float(other)
        if _RANGE[0] < abs(factor) < _RANGE[1]:
            return dataclasses.replace(self, factor=factor)
        return TaylorModel(self.recording, self.exactly())._sum(other, 0.0)

    def apply(self, function: np.ufunc) -> "TaylorModel":
        place = self.exactly()
        add = self.recording.add
        powers = [add(CHANGE, place).place]
        while len(powers) < self.recording.table.degree:
            powers.append(add(PRODUCT, powers[-1], powers[0]).place)
        return add(FUNCTIONS[function], place, *powers)

    def within(self, first: Any, second: Any) -> "TaylorModel":
        add = self.recording.add  # A constant is 0 of the first operation, and more.
        limits = (
            limit.exactly()
            if isinstance(limit, TaylorModel)
            else add(SUM, 0, 0, f=0.0, h=limit).place
            for limit in (first, second)
        )
        return add(WITHIN, self.exactly(), *limits)

    def exactly(self) -> int:
        """Returns the place of this model, its factor included."""
        if self.factor == 1.0:
            return self.place
        return self._sum(self.factor, 0.0).place

    def _sum(self, f, h):
        return self.recording.add(SUM, self.place, self.place, f=f, h=h)


def spread(coefficients: np.ndarray, remainders: np.ndarray) -> np.ndarray:
    """Returns how far values are from the polynomials' centers at most, (..., B).

    Given are coefficients (..., M, B) and remainders (..., B).
    """
    return (np.abs(coefficients[..., 1:, :]).sum(axis=-2) + remainders) * WIDER
