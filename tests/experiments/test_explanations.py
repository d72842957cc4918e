"""Explanations are weighed in one air, small ones kept, and room is left for others."""

import dataclasses

import numpy as np
import pytest

from glider.experiments.explanations import (
    UNKNOWN,
    Findings,
    _with_probabilities,
    explain,
    findings_of,
    load_findings,
)
from glider.physics.effects.free_functions import FreeFunction
from glider.report.folder import write_report
from glider.sysid.result import Alternative
from tests.helpers.late import DELAYED, LATE
from tests.report.results import make_result


def test_all_explanations_share_the_air_and_the_sensors(late):
    scales = [e.model.scales for e in late[3]]
    assert len(scales) > 1
    assert all(own == scales[0] for own in scales)


def test_the_order_of_the_rivals_decides_nothing(late):
    _, task, noise, explanations = late
    again = explain(task, noise, Findings(models=(DELAYED, LATE)))
    assert [e.model.kinds for e in again] == [e.model.kinds for e in explanations]
    for one, other in zip(again, explanations, strict=True):
        assert one.probability == pytest.approx(other.probability, abs=0.05)


def test_a_rival_with_another_free_function_is_left_out(late):
    _, task, noise, _ = late
    function = FreeFunction(
        kind="unexplained",
        variables=["alpha"],
        centers=[[0.0]],
        widths=[0.1],
        weights={"c_lift": [0.01]},
    )
    other = dataclasses.replace(DELAYED, free_functions=(function,))
    [only] = explain(task, noise, Findings(models=(LATE, other)))
    assert only.model.kinds == ("servo_lag",)


def test_small_probabilities_are_kept_and_hopeless_ones_are_not(late):
    first = late[3][0]
    weighed = [
        dataclasses.replace(first, log_evidence=value) for value in (-7.0, 0.0, -40.0)
    ]
    kept = _with_probabilities(weighed)
    assert [e.log_evidence for e in kept] == [0.0, -7.0]
    assert kept[1].probability == pytest.approx(
        (1.0 - UNKNOWN) * np.exp(-7.0), rel=1e-2
    )
    assert sum(e.probability for e in kept) == pytest.approx(1.0 - UNKNOWN)


@pytest.mark.filterwarnings("ignore:.*varies from flight to flight:UserWarning")
def test_the_folder_of_a_report_has_the_models_of_its_result(tmp_path):
    alternatives = [
        Alternative(probability=share, model=model, covariance=None)
        for share, model in ((0.7, LATE), (0.3, DELAYED))
    ]
    result = dataclasses.replace(
        make_result(), model=LATE, alternatives=tuple(alternatives)
    )
    write_report(result, tmp_path)
    found = load_findings(tmp_path)
    assert found == findings_of(result)
    assert found.models == (LATE, DELAYED)
