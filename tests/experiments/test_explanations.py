"""Explanations are weighed in one air, small ones kept, and room is left for others."""

import dataclasses

import numpy as np
import pytest

from glider.experiments.explanations import (
    UNKNOWN,
    Findings,
    explain,
    with_probabilities,
)
from tests.helpers.late import LATE


def test_all_explanations_share_the_air_and_the_sensors(late):
    scales = [e.model.scales for e in late[3]]
    assert len(scales) > 1
    assert all(own == scales[0] for own in scales)


def test_small_probabilities_are_kept_and_hopeless_ones_are_not(late):
    first = late[3][0]
    weighed = [
        dataclasses.replace(first, log_evidence=value) for value in (-7.0, 0.0, -40.0)
    ]
    kept = with_probabilities(weighed, 0.1)
    assert [e.log_evidence for e in kept] == [0.0, -7.0]
    assert kept[1].probability == pytest.approx(0.9 * np.exp(-7.0), rel=1e-2)
    assert sum(e.probability for e in kept) == pytest.approx(0.9)


def test_sets_that_were_not_fitted_count_as_missing(late, monkeypatch):
    """By what a closed form says of them."""
    _, task, noise, _ = late
    monkeypatch.setattr("glider.experiments.explanations._NEAR", 30.0)
    monkeypatch.setattr("glider.experiments.explanations._MOST", 1)
    findings = Findings(model=LATE, kinds=("servo_lag",))
    [alone] = explain(task, noise, findings)
    assert 0.5 < alone.probability < 1.0 - UNKNOWN - 1e-3
