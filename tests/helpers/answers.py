"""Whether two runs gave the same answer."""

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
    corrected, same = found.errors["corrected"], expected.errors["corrected"]
    assert abs(corrected.position_rms_m / same.position_rms_m - 1.0) < 0.02
