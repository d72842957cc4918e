"""Work over flights gives the same by any workers."""

import dataclasses
import os
import pickle
import subprocess
import sys
import threading
import time
import warnings

import joblib
import numpy as np
import pytest

from glider.compiled.parallel import in_parallel
from glider.physics.effects import KINDS, NO_GAUSSIANS
from glider.sysid.fit.folds import hold_out
from glider.sysid.fit.prediction import RolloutModel
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.replay.log_space import LIBRARY_SPACE, log_space
from tests.helpers.known_truth import errors_of
from tests.helpers.tasks import begin, fly, task_of, typical


@pytest.mark.parametrize("count", [0, 1, 5, 23])
def test_order_and_number_are_kept(count):
    expected = [k * k for k in range(count)]
    assert in_parallel(lambda k: k * k, range(count)) == expected
    with joblib.parallel_config(backend="threading", n_jobs=3):
        assert in_parallel(lambda k: k * k, range(count)) == expected


def test_there_is_a_thread_for_each_core_that_the_process_may_use():
    """Not for each of the machine: a container or a batch job has fewer."""
    script = (
        "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});"
        "from glider.compiled.parallel import _THREADS; print(_THREADS._max_workers)"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", script]
    assert int(subprocess.check_output(command, env=environment)) == 1


def test_the_callers_choice_of_workers_is_kept():
    me = threading.get_ident()

    def work(_):
        time.sleep(0.02)  # No thread takes all items.
        return threading.get_ident()

    threads = set(in_parallel(work, range(20)))
    assert me in threads
    assert len(threads) == joblib.cpu_count()
    with joblib.parallel_config(n_jobs=1):
        assert set(in_parallel(work, range(5))) == {me}


def test_an_error_comes_out_as_it_is():
    def fail(_):
        raise ValueError("a flight diverges")

    with pytest.raises(ValueError, match="diverges"):
        in_parallel(fail, range(3))
    with (
        joblib.parallel_config(backend="threading", n_jobs=2),
        pytest.raises(ValueError, match="diverges"),
    ):
        in_parallel(fail, range(3))


def test_no_item_begins_after_an_error():
    begun = []

    def work(item):
        begun.append(item)
        if item == 3:
            raise ValueError("an error of the third")
        time.sleep(0.01)

    with pytest.raises(ValueError, match="of the third"):
        in_parallel(work, range(1000))
    time.sleep(0.05)
    assert len(begun) < 4 + 2 * joblib.cpu_count()


def test_what_is_sent_is_small_and_finds_its_layout_again():
    task, noise = task_of(fly(flights=1))
    [record] = task.records
    model = fit_model(task, begin(task, noise), iterations=0)
    assert model.cost
    sent = pickle.dumps(record)
    assert len(sent) < 2 * sum(
        value.nbytes
        for field in dataclasses.fields(record)
        if isinstance(value := getattr(record, field.name), np.ndarray)
    )
    again = pickle.loads(sent)
    assert again.space is LIBRARY_SPACE
    np.testing.assert_array_equal(again.nodes, record.nodes)
    own = dataclasses.replace(KINDS["profile_drag"], kind="my_drag")
    assert pickle.loads(pickle.dumps(log_space((own,)))) is log_space((own,))


@pytest.mark.nightly
def test_a_cluster_of_processes_finds_what_threads_find():
    """A local cluster; any other differs in its address."""
    pytest.importorskip("distributed", reason="Dask's cluster is an extra: [cluster]")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask's own, at import and at closing.
        from dask.distributed import Client, LocalCluster

        task, noise = task_of(fly(typical("profile_drag"), flights=4))
        start = begin(task, noise, ["profile_drag"])

        def traced():
            model = fit_model(task, start, iterations=1)
            known = uncertainty_of(task, model)
            held = hold_out(task, model, {}, np.random.default_rng(0))
            flown = RolloutModel(
                theta=model.theta,
                gaussians=NO_GAUSSIANS,
                scales=model.scales,
                per_flight_trims=False,
            )
            errors = errors_of(flown, task.records)
            support = held.inclusion("profile_drag")
            return model.theta, known.covariance[0], support, errors.position_rms_m

        found = traced()
        cluster = LocalCluster(
            processes=True, n_workers=2, threads_per_worker=1, dashboard_address=None
        )
        with cluster, Client(cluster), joblib.parallel_config(backend="dask"):
            elsewhere = traced()
    assert found[2] == 1.0
    for here, there in zip(found, elsewhere, strict=True):
        np.testing.assert_allclose(here, there, rtol=1e-9)
