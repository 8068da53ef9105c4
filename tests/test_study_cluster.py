"""A study on a cluster of real worker processes: one that is killed in the middle changes nothing."""

import os
import signal

import pytest
from studies import TOY, contents, rendered_twice, rows

from whitted.errors import UsageError
from whitted.studies.study import study

distributed = pytest.importorskip("distributed")
SPEC = TOY | {"replicates": 40, "timed": 2}


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as found:
        yield found


@pytest.mark.filterwarnings("ignore")  # of the cluster's own sockets
def test_a_killed_worker_has_its_cells_done_elsewhere(cluster, tmp_path):
    local = study(SPEC, tmp_path / "local")
    with distributed.Client(cluster) as client:
        pids = list(client.run(os.getpid).values())
        killed = []

        def kill(done, wanted, label):
            if done > wanted // 2 and not killed:
                killed.append(os.kill(pids[0], signal.SIGKILL))

        spread = study(SPEC, tmp_path / "spread", scheduler=client, progress=kill)
    assert killed
    assert spread.outcome.outcome == "done"
    assert contents(spread.folder) == contents(local.folder)
    assert not rendered_twice(spread.folder)
    assert len(rows(spread.folder, "SELECT DISTINCT worker FROM attempts")) >= 2
    assert len(rows(spread.folder, "SELECT DISTINCT probe FROM environments")) == 1
    timed = rows(spread.folder, "SELECT DISTINCT replicate FROM cells JOIN timings ON cell = key ORDER BY 1")
    assert timed == [(0,), (1,)]


@pytest.mark.filterwarnings("ignore")
def test_an_address_works_as_well(cluster, tmp_path):
    found = study(TOY, tmp_path / "study", scheduler=cluster.scheduler_address)
    assert found.outcome.outcome == "done"


@pytest.mark.filterwarnings("ignore")
def test_where_nobody_answers_it_is_one_line(tmp_path):
    with pytest.raises(UsageError, match="no Dask scheduler answers there"):
        study(TOY, tmp_path / "study", scheduler="tcp://127.0.0.1:9")
