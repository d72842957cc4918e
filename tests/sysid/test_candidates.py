"""What a set of effects leaves free is what flights can tell apart."""

import types

import numpy as np
import pytest

from glider.sysid.replay.theta import LIBRARY_LAYOUT
from glider.sysid.search.candidates import Search


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
