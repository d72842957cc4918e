"""Whether two runs gave the same answer."""

import math

import pytest

from glider.physics.effects import KINDS
from glider.sysid.result import Report


def assert_same_answer(found: Report, expected: Report, share: float = 0.1) -> None:
    """Asserts equal effects, to a share of their standard errors, and equal errors."""
    assert found.verdict == expected.verdict
    assert [e.kind for e in found.effects] == [e.kind for e in expected.effects]
    for own, other in zip(found.effects, expected.effects, strict=True):
        assert abs(own.evidence - other.evidence) < max(1.0, 0.01 * other.evidence)
        for name, value in other.coefficients.items():
            have = own.coefficients[name]
            assert abs(have.value - value.value) < share * value.std, f"{name}: {have}"
            assert abs(have.std - value.std) < share * value.std
    assert found.candidates.keys() == expected.candidates.keys()
    for kind, evidence in expected.candidates.items():
        # The late ones are compared about what was found; JSON has no infinity.
        is_late = kind in KINDS and KINDS[kind].is_rare
        if not is_late and math.isfinite(evidence):
            assert found.candidates[kind] == pytest.approx(evidence, rel=0.01, abs=1.0)
    corrected, same = found.errors["corrected"], expected.errors["corrected"]
    assert abs(corrected.position_rms_m / same.position_rms_m - 1.0) < 0.02
