"""Taylor models: polynomials on boxes and a proven bound of their remainder.

On a box c + h v, |v_i| <= 1, a Taylor model holds of what it stands for
    |f(c + h v) - p(v)| <= remainder,
with p the polynomial that its coefficients are. All of it is proven: what a product or
a function has beyond the degree goes into `remainder`, and so does the rounding of
every operation (Makino and Berz 2003). Where the remainders of the inputs are NaN, no
bound is asked for, and the polynomials are Taylor's.

A TaylorModel goes through the physics like a float does, but only records what is done:
a Recording then does it for many boxes at once, in `glider.compiled.taylor`.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from glider.compiled import taylor
from glider.compiled.taylor import CHANGE, FUNCTIONS, INPUT, PRODUCT, SUM, WIDER, WITHIN
from glider.verification.dynamics.numbers import Monomials, Number

_RANGE = 1e-100, 1e100
"""Sizes of factors that are carried along, so that their products do not underflow."""


class Recording:
    """Operations on Taylor models of one table, each of which is carried out once."""

    def __init__(self, table: Monomials, keeps_zeros: bool = False) -> None:
        """Starts with none; what is multiplied by zero counts as present or not."""
        self.table = table
        self._keeps_zeros = keeps_zeros
        # What, of which operations, and plain numbers; the values are places.
        self._places: dict[tuple, int] = {}

    def add(
        self, what: int, *of: int, f: float = 1.0, g: float = 0.0, h: float = 0.0
    ) -> "TaylorModel":
        """Returns the result of an operation, which may be there already."""
        step = what, of, float(f), float(g), float(h)
        return TaylorModel(self, self._places.setdefault(step, len(self._places)))

    def inputs(self, count: int) -> list["TaylorModel"]:
        """Returns the first inputs."""
        return [self.add(INPUT, i) for i in range(count)]

    def place_of(self, value: Any) -> int:
        """Returns the place of a model, its factor included, or of a plain number."""
        if not isinstance(value, TaylorModel):  # It needs some operation before it.
            return self.add(SUM, 0, 0, f=0.0, h=value).place
        if value.factor == 1.0:
            return value.place
        return self.add(SUM, value.place, value.place, f=value.factor).place

    def program(self, results: Sequence[Any], present: np.ndarray) -> "Program":
        """Returns what computes results, and nothing that they do not depend on.

        Args:
            results: R models of this recording, or plain numbers.
            present: (I, M) which coefficients of each input may not be zero.
        """
        wanted = [self.place_of(result) for result in results]
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
                shown = (1.0, 1.0, 1.0) if self._keeps_zeros else numbers
                there[place] = _present(what, [there[i] for i in of], *shown)
            code.append((what, slots[place], pattern))
            row = of if what == INPUT else tuple(slots[i] for i in of)
            rows.append(row + (self.table.degree + 1 - len(row)) * (0,))
            # Slots that nothing needs any more.
            free += [slots[i] for i in set(operands(place)) if last[i] == place]
        return Program(
            code=np.array(code),
            of=np.array(rows),
            numbers=np.array([steps[place][2:] for place in order]),
            present=np.array([there[place] for place in order]),
            results=np.array([slots[place] for place in wanted]),
            slots=count,
            products=products.arrays(),
            shown=np.array([there[place] for place in wanted]),
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


class Program(NamedTuple):
    """Operations on Taylor models, in order; fields are as in `taylor.run`."""

    code: np.ndarray
    of: np.ndarray
    numbers: np.ndarray
    present: np.ndarray
    results: np.ndarray
    slots: int
    products: tuple[np.ndarray, ...]
    shown: np.ndarray  #: (R, M) which coefficients of the results may not be zero.

    def run(
        self, coefficients: np.ndarray, remainders: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns coefficients (R, M, B) and remainders (R, B) of the results.

        Given are those of the inputs, (I, M, B) and (I, B).
        """
        return taylor.run(*self[:-1], coefficients, remainders)


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
        return TaylorModel(self.recording, self._exactly())._sum(other, 0.0)

    def apply(self, function: np.ufunc) -> "TaylorModel":
        place = self._exactly()
        add = self.recording.add
        powers = [add(CHANGE, place).place]
        while len(powers) < self.recording.table.degree:
            powers.append(add(PRODUCT, powers[-1], powers[0]).place)
        return add(FUNCTIONS[function], place, *powers)

    def within(self, first: Any, second: Any) -> "TaylorModel":
        places = map(self.recording.place_of, (self, first, second))
        return self.recording.add(WITHIN, *places)

    def _exactly(self):
        return self.recording.place_of(self)

    def _sum(self, f, h):
        return self.recording.add(SUM, self.place, self.place, f=f, h=h)


def spread(coefficients: np.ndarray, remainders: np.ndarray) -> np.ndarray:
    """Returns how far values are from the polynomials' centers at most, (..., B).

    Given are coefficients (..., M, B) and remainders (..., B).
    """
    return (np.abs(coefficients[..., 1:, :]).sum(axis=-2) + remainders) * WIDER
