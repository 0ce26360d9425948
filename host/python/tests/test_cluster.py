"""A measurement that is assembled by a cluster, of which a worker dies on the way, is to the bit what one process makes."""

import importlib
import os
import shutil
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest

HOST = Path(__file__).parents[2]
PARTS = 6


def command() -> str:
    """The command of the build that the tests are of."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", HOST.parent / "target"))
    found = os.environ.get("RCG") or shutil.which("rcg", path=target / "debug")
    if not found:
        pytest.skip("no target/debug/rcg: build it first")
    return found


@pytest.fixture
def example(monkeypatch):
    """The example as a module; processes that are begun find it on the same path."""
    pytest.importorskip("distributed")
    monkeypatch.syspath_prepend(HOST / "examples")
    return importlib.import_module("collection_on_dask")


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_dies_changes_nothing(tmp_path, example):
    import dask
    import distributed

    rcg = command()
    measured = tmp_path / "collection" / "brass"
    words = ["measure", "--out", measured, "--rig", "rcg-1-16bit", "--step", "15", "--image-size", "16", "--exposure-ms", "4"]
    subprocess.run([rcg, *words, "-q"], check=True, capture_output=True, env={**os.environ, "RCG_CALIBRATION": "none"})
    expected = content(measured / "brdf.zarr")
    shutil.rmtree(measured / "brdf.zarr")

    killed = []
    # On a machine that does other things too.
    patient = {"distributed.comm.timeouts.connect": "120s", "distributed.comm.timeouts.tcp": "120s"}
    with (
        dask.config.set(patient),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1") as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        parts = Path(f"{measured / 'brdf.zarr'}.parts")

        def kill_one():
            # Once a part is being made, and before all are.
            while not parts.exists():
                time.sleep(0.002)
            os.kill(pids[0], signal.SIGKILL)
            killed.append(pids[0])

        killer = threading.Thread(target=kill_one, daemon=True)
        killer.start()
        measurements = example.measurements_of(tmp_path / "collection")
        done = example.run(client, measurements, PARTS, rcg, progress=lambda line: None)
        killer.join(10)
        # The client forgets them in a thread of its own.
        patience = time.monotonic() + 30
        while client.futures and time.monotonic() < patience:
            time.sleep(0.01)
        assert not client.futures, "futures are released"
    assert killed == pids[:1], "a worker was killed on the way"
    assert done == measurements == [str(measured)]
    assert content(measured / "brdf.zarr") == expected
    assert not parts.exists()


def test_what_a_task_cannot_do_is_told_in_its_sentence(tmp_path, example):
    with pytest.raises(RuntimeError, match="expected a measurement .* found none"):
        example.assemble(str(tmp_path), "--part", "1/2", rcg=command())
