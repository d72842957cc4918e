"""A marked formula can be called by compiled code, whenever the compiler came."""

import numba

from glider.compiled import kernel
from glider.physics import formulas
from glider.physics.formulas import connect_compiler, scalar


def test_a_compiler_hears_of_formulas_before_and_after_it_came(monkeypatch):
    monkeypatch.setattr(formulas, "_MARKED", [])
    monkeypatch.setattr(formulas, "_COMPILERS", [])
    heard = []
    first = scalar(lambda x: x)
    connect_compiler(heard.append)
    second = scalar(lambda x: 2.0 * x)
    assert heard == [first, second]


def test_numba_compiles_a_call_of_a_formula():
    assert kernel.FAST  # What compiles imports numba.

    @scalar
    def twice(x):
        return 2.0 * x

    assert twice(3.0) == 6.0
    assert numba.njit(lambda x: twice(x) + 1.0)(3.0) == 7.0
