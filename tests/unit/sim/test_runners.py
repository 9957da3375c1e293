# SPDX-License-Identifier: Apache-2.0
"""A sweep in processes and on a cluster gives what it gives alone, also when a worker dies."""

import os
import signal
from contextlib import closing

import pytest

from cwmav_common.errors import InputError
from cwmav_sim import case as cases
from cwmav_sim.runners import Cluster, Processes
from cwmav_sim.store import ResultStore
from cwmav_sim.sweep import cases_of, sweep
from support import sweep_work

POINTS = [(8.0 + k, 5.0 * k, 3.0) for k in range(6)]


@pytest.fixture
def points():
    return cases_of(cases.preset("smoke"), POINTS)


def lifts(swept):
    assert not swept.failed
    return [result.mean_lift for result in swept.results]


def test_processes_keep_the_order_and_survive_a_death(tmp_path, points, monkeypatch):
    marker = tmp_path / "killed"
    monkeypatch.setenv(sweep_work.KILL_ONCE, str(marker))
    with closing(Processes(2, "cpu", sweep_work.in_process)) as runner:
        swept = sweep(points, ResultStore(tmp_path / "store"), runner)
    assert marker.exists()
    assert lifts(swept) == [sweep_work.lift_of(case) for case in points]


def test_what_one_worker_kept_no_other_computes_again(tmp_path, points):
    store = ResultStore(tmp_path / "store")
    with closing(Processes(2, "cpu", sweep_work.in_process)) as runner:
        first = sweep(points[:4], store, runner)
        second = sweep(points, store, runner)
    assert (first.computed, second.computed) == (4, 2)


@pytest.mark.filterwarnings("ignore")  # the cluster's own clean-up after a killed worker
def test_cluster_loses_a_worker_in_the_middle(tmp_path, points):
    distributed = pytest.importorskip("distributed")
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    )
    killed = []

    def kill_one(number, outcome):
        if not killed:
            with distributed.Client(local.scheduler_address, set_as_default=False) as client:
                killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    with local, closing(Cluster(local.scheduler_address, "cpu", sweep_work.on_cluster)) as runner:
        swept = sweep(points, ResultStore(tmp_path / "store"), runner, kill_one)
    assert killed
    assert lifts(swept) == [sweep_work.lift_of(case) for case in points]


def test_a_scheduler_that_is_not_there_is_named(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("cwmav_common.cluster._PATIENCE", 0.5)
    with pytest.raises(InputError, match="--cluster: no scheduler answers at tcp://127.0.0.1:9"):
        Cluster("tcp://127.0.0.1:9", "cpu")
