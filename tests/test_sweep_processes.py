"""Sweeps on several devices, on a cluster, and over the death of a process: always the same bits."""

import os
import re
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from experiments.reliability import cluster

SETUP = """
import sys, time
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import jshape as js
from jshape.sweeps import chunks

chunks.CHUNK = 64
three = js.Shaper([0.25, 0.5, 0.25], [0.0, 0.8214899715396663, 1.6429799430793326])


def sweep(**given):
    # The cubic damper's powers and the second shaper's closed form are among what must not differ by a bit.
    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0), damper=js.plants.PowerDamper(0.1))
    shapers = {"bare": None, "three": three}
    over = {"spring.k1": (0.9, 1.1), "m2": (0.6, 1.4)}
    return js.sweep(
        plant, shapers, 1.0, over, "residual_energy", samples=500, derivatives=True, estimate_error=False, **given
    )
"""


def command(code: str, *arguments: str) -> list[str]:
    return [sys.executable, "-W", "error", "-c", SETUP + code, *arguments]


def run(code: str, *arguments: str, **environment: str) -> None:
    subprocess.run(command(code, *arguments), env=os.environ | environment, check=True, timeout=300)


def values(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as found:
        return dict(found)


SAVE = """
ds = sweep(**({"store": sys.argv[2]} if len(sys.argv) > 2 else {}))
np.savez(sys.argv[1], **{name: ds[name].values for name in ds.data_vars})
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The uninterrupted sweep, on one device of a process of its own."""
    path = tmp_path_factory.mktemp("whole") / "values.npz"
    run(SAVE, str(path))
    return values(path)


@pytest.mark.slow
def test_killed_half_way_and_gone_on_with(whole, tmp_path):
    slow = """
report = lambda stage, done, total, best: (print(done, flush=True), time.sleep(60 * (done == 3)))
sweep(store=sys.argv[1], progress=report)
"""
    with subprocess.Popen(command(slow, str(tmp_path / "store")), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "3\n" in process.stdout
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    kept = sorted((tmp_path / "store").glob("*.npz"))
    assert [path.name for path in kept] == [f"chunk_{i:06d}.npz" for i in range(3)]
    before = [path.stat().st_mtime_ns for path in kept]
    run(SAVE, str(tmp_path / "values.npz"), str(tmp_path / "store"))
    assert [path.stat().st_mtime_ns for path in kept] == before
    for name, found in values(tmp_path / "values.npz").items():
        np.testing.assert_array_equal(found, whole[name])


@pytest.mark.slow
def test_four_devices_share_the_plants(whole, tmp_path):
    code = """
js.keep_programs()
from jshape.sweeps import evaluate
seen = []
plain = evaluate._many
evaluate._many = lambda *given: seen.append(plain(*given)) or seen[-1]
""" + SAVE + """
assert len(jax.devices()) == 4
for array in seen:
    assert len(array.sharding.device_set) == 4
    places = sorted(shard.index[2].start for shard in array.addressable_shards)
    assert places == [i * array.shape[2] // 4 for i in range(4)], places
# Where such a plant comes to rest is found by Newton's method.
forced, masses = js.plants.ForcedMass(1.0, js.plants.Duffing(10.0, 100.0)), [0.8, 0.9, 1.0, 1.1, 1.2]
found = js.sweep(forced, three, 1.0, {"mass": masses}, "residual_energy").residual_energy.values[0]
alone = [js.residual_energy(js.plants.ForcedMass(m, js.plants.Duffing(10.0, 100.0)), three, 1.0) for m in masses]
np.testing.assert_allclose(found, alone, rtol=1e-8)
"""  # fmt: skip
    flags = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=4"
    # Programs for several devices are not kept, and do not stumble over that.
    run(code, str(tmp_path / "values.npz"), XLA_FLAGS=flags, JAX_COMPILATION_CACHE_DIR=str(tmp_path / "cache"))
    # Other plants side by side take other numbers of steps: the same to the tolerance that a sweep meets, 1e-11 of the
    # greatest energy.
    greatest = np.abs(whole["residual_energy"]).max()
    for name, found in values(tmp_path / "values.npz").items():
        np.testing.assert_allclose(found, whole[name], rtol=0, atol=1e-11 * greatest)


CLUSTER = """
import os, signal, warnings
warnings.simplefilter("default")  # the cluster's own do not matter here
from distributed import Client, LocalCluster

if __name__ == "__main__":
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, local_directory=sys.argv[2]
    ) as cluster, Client(cluster, set_as_default=False) as client:
        workers = client.run(os.getpid)
        killed = []

        def kill(stage, done, total, best):
            # One that has chunks to compute, so that some are lost with it: with each of the first two results another
            # chunk has just been sent out.
            busy = [] if killed else [worker for worker, tasks in client.processing().items() if tasks]
            if busy:
                killed.append(workers[busy[0]])
                os.kill(killed[0], signal.SIGKILL)

        ds = sweep(client=client, store=sys.argv[3], progress=kill)
        assert killed and workers and os.getpid() not in workers.values()
        assert killed[0] not in client.run(os.getpid).values()
        np.savez(sys.argv[1], **{name: ds[name].values for name in ds.data_vars})
"""


@pytest.mark.slow
def test_a_cluster_loses_a_worker_half_way(whole, tmp_path):
    pytest.importorskip("distributed")
    program = tmp_path / "cluster.py"
    program.write_text(SETUP + CLUSTER, encoding="utf-8")
    store = tmp_path / "store"
    arguments = [str(tmp_path / "values.npz"), str(tmp_path), str(store)]
    subprocess.run([sys.executable, str(program), *arguments], check=True, timeout=300)
    assert len(list(store.glob("chunk_*.npz"))) == 16
    for name, found in values(tmp_path / "values.npz").items():
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, whole[name])


FAULTS = {
    "both workers are killed": r"client: the cluster tcp://\S+ has had no workers for 10 s; .*",
    "the scheduler falls silent": r"client: the scheduler tcp://\S+ has not answered for 12 s; .*",
    "the scheduler is killed": r"client: the connection to the scheduler tcp://\S+ is broken; .* the same call resumes",
    "the sweep's connections are dropped, and come back": "",
}
"""Fault → the line with which the sweep ends; none where it ends as if nothing had happened."""


@pytest.fixture(scope="module")
def disturbed(tmp_path_factory):
    """The experiment's sweep with every fault; two at a time, for most of it is waiting."""
    pytest.importorskip("distributed")
    place = tmp_path_factory.mktemp("faults")
    expected = cluster.undisturbed(place / "alone")
    with ThreadPoolExecutor(2) as pool:
        cases = [pool.submit(cluster.disturbed, place / name, name, 3, expected, anew=False) for name in FAULTS]
    return {name: case.result() for name, case in zip(FAULTS, cases, strict=True)}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_cluster_is_lost_half_way(fault, disturbed):
    """It ends with one line and resumes, or, where the connections come back, as if nothing had happened."""
    assert not disturbed[fault].wrong
    assert re.fullmatch(FAULTS[fault], disturbed[fault].line)
