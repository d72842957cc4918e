"""The option --cluster: the workers of another process find what threads find."""

import json
import warnings

import pytest

from glider.__main__ import main
from tests.helpers.campaigns import campaign_path, first_flights

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def address():
    """Of a scheduler with two workers, each a process of this computer."""
    pytest.importorskip("distributed", reason="Dask's cluster is an extra: [cluster]")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask's own, at import and at closing.
        from dask.distributed import LocalCluster

        with LocalCluster(
            processes=True, n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster:
            yield cluster.scheduler_address


def test_a_report_by_a_cluster_is_that_of_one_computer(address, tmp_path):
    campaign = str(campaign_path("attached_lift"))
    flights = ",".join(first_flights(6))
    common = ["close-the-loop", campaign, "--flights", flights]
    common += ["--effects", "attached_lift,wind"]
    reports = []
    for name, more in (("here", []), ("there", ["--cluster", address])):
        assert main([*common, "--out", str(tmp_path / name), *more]) == 0
        text = (tmp_path / name / "report.json").read_text(encoding="utf-8")
        reports.append(json.loads(text))
    here, there = reports
    assert there["verdict"] == here["verdict"]
    [effect], [other] = here["effects"], there["effects"]
    assert list(effect["coefficients"]) == list(other["coefficients"])
    for name, one in effect["coefficients"].items():
        same = other["coefficients"][name]
        assert same["value"] == pytest.approx(one["value"], rel=1e-6)
        assert same["std"] == pytest.approx(one["std"], rel=1e-4)
