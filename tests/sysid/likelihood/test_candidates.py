"""What a set of effects leaves free, and which of two sets is the better one."""

import types

import numpy as np
import pytest

from glider.sysid.fit.output_error import Fit
from glider.sysid.replay.theta import LIBRARY_LAYOUT
from glider.sysid.search.candidates import Fitted, Search, ranked


@pytest.mark.parametrize(
    ("unknown", "kinds", "slot"),
    [
        ("wing_offset", ("center_of_pressure",), ("center_of_pressure", "shift")),
        ("pitch_inertia", ("added_mass",), ("added_mass", "inertia")),
        (None, ("added_mass", "inertia"), ("added_mass", "inertia")),
    ],
)
def test_what_is_one_with_another_unknown_is_not_fitted(unknown, kinds, slot):
    index = LIBRARY_LAYOUT.index
    nuisance = () if unknown is None else (index["parameters", unknown],)

    def free(kinds, nuisance):
        problem = types.SimpleNamespace(layout=LIBRARY_LAYOUT)
        search = Search(problem=problem, theta=np.zeros(0), nuisance=nuisance)
        return search.free(kinds)

    assert index[slot] in free(kinds[:1], ())
    together = free(kinds, nuisance)
    assert index[slot] not in together
    everything = {i for kind in kinds for i in LIBRARY_LAYOUT.slots_of(kind)}
    assert set(together) == (everything | set(nuisance)) - {index[slot]}


def fitted(kind, cost, coefficients):
    information = np.zeros((1, coefficients + 1, coefficients + 1))
    information[0, -1, -1] = cost
    fit = Fit(
        theta=np.zeros(0),
        free=tuple(range(coefficients)),
        information=information,
        degrees=np.array([1000]),
    )
    return Fitted(kinds=(kind,), fit=fit)


@pytest.mark.parametrize("dispersion", [1.0, 50.0])
@pytest.mark.parametrize(("gain", "best"), [(5.0, "inertia"), (10.0, "added_mass")])
def test_a_kind_that_holds_another_must_fit_clearly_better(dispersion, gain, best):
    small = fitted("inertia", 1000.0 * dispersion, 1)
    large = fitted("added_mass", (1000.0 - gain) * dispersion, 2)
    assert ranked([small, large])[0].kinds == (best,)
    assert ranked([large, small])[0].kinds == (best,)
    assert ranked([]) == []
