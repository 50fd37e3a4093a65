"""Faults of a cluster half way through a sweep: workers, scheduler and network are lost, for good or for a moment.

    python -m experiments.reliability.cluster      # writes cluster.md beside itself; a quarter of an hour

Scheduler, two workers and the sweep are processes of this machine; between them stand proxies that drop connections or
let nothing through. The sweep must end with the bits of one process, or with one line that says what was lost. Then
every finished chunk must be in the store, and the same call, without or with a new cluster, must end with those bits.
"""

import contextlib
import itertools
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments import markdown
from experiments.reliability.proxy import Proxy
from experiments.reliability.writes import whole

MOMENTS = (0, 3, 9)
"""How many of the 16 chunks are finished when it happens."""

AGAIN = 2.0
"""After so long what comes back is back, s."""

HANGS = 300.0
"""A sweep that has not ended so long after the fault hangs, s; one that resumes on a busy machine compiles first."""

LIMITS = {"COMM__TIMEOUTS__CONNECT": "5s", "COMM__TIMEOUTS__TCP": "12s", "SCHEDULER__WORKER_TTL": "10s"}
"""dask's limits, shortened: connecting, an answer, a worker's sign of life."""

DESERTED = {"SCHEDULER__NO_WORKERS_TIMEOUT": "10s"}
"""Of the sweep alone: dask's scheduler has no such limit unless it is given one."""

SWEEP = """\
import sys, time
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import jshape as js

def report(stage, done, total, best):
    print(done, flush=True)
    time.sleep(0.2)

def sweep(client=None):
    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0), damper=js.plants.PowerDamper(0.1))
    over = {"spring.k1": (0.9, 1.1), "m2": (0.6, 1.4)}
    given = dict(samples=500, derivatives=True, estimate_error=False, store="store", progress=report, client=client)
    ds = js.sweep(plant, {"bare": None}, 1.0, over, "residual_energy", **given)
    np.savez("values.npz", **{name: ds[name].values for name in ds.data_vars})

if __name__ == "__main__":
    if len(sys.argv) == 1:
        sweep()
    else:
        from distributed import Client
        with Client(sys.argv[1]) as client:
            try:
                sweep(client)
            except ConnectionError as problem:
                print("ended:", problem)
"""

WORKER = ["distributed.cli.dask_worker", "--no-nanny", "--no-dashboard", "--nthreads", "1", "--host", "127.0.0.1"]
SCHEDULER = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]


class Case(NamedTuple):
    """A sweep during which something was lost.

    Attributes:
        fault: what happened.
        line: what the sweep ended with; empty if it ended as if nothing had happened.
        seconds: from the fault to the end of the process.
        wrong: what was not as it should be; empty where all was.
    """

    fault: str
    line: str
    seconds: float
    wrong: str


class Cluster:
    """A scheduler, two workers, and a proxy on the way to the scheduler for the client and for the workers each."""

    def __init__(self, folder: Path):
        folder.mkdir(exist_ok=True)
        self.folder, about = folder, folder / "scheduler.json"
        about.unlink(missing_ok=True)
        self.scheduler = _start(folder, "-m", *SCHEDULER, "--scheduler-file", str(about))
        while not about.exists() or not (text := about.read_text(encoding="utf-8")).endswith("}"):
            assert self.scheduler.poll() is None
            time.sleep(0.1)
        port = int(text.partition('"address": "tcp://127.0.0.1:')[2].partition('"')[0])
        self.client, self.network = Proxy(port), Proxy(port)
        self.workers: list[subprocess.Popen] = []
        self.more_workers()

    def more_workers(self) -> None:
        self.workers += [_start(self.folder, "-m", *WORKER, self.network.address) for _ in range(2)]

    def stop(self, *processes: subprocess.Popen) -> None:
        """Let processes fall silent: they are there, and never answer."""
        for process in processes:
            process.send_signal(signal.SIGSTOP)

    def kill(self, *processes: subprocess.Popen) -> None:
        for process in processes:
            process.kill()
            process.wait()

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        self.kill(self.scheduler, *self.workers)
        self.client.end()
        self.network.end()


FAULTS: dict[str, Callable[[Cluster], object]] = {
    "one of two workers is killed": lambda on: on.kill(on.workers[0]),
    "one of two workers falls silent": lambda on: on.stop(on.workers[0]),
    "both workers are killed": lambda on: on.kill(*on.workers),
    "both workers are killed, two others come": lambda on: (on.kill(*on.workers), on.more_workers()),
    "both workers fall silent": lambda on: on.stop(*on.workers),
    "the scheduler is killed": lambda on: on.kill(on.scheduler),
    "the scheduler falls silent": lambda on: on.stop(on.scheduler),
    "the sweep's connections are dropped": lambda on: on.client.drop(),
    "the sweep's connections are dropped, and come back": lambda on: (on.client.drop(), on.client.mend(AGAIN)),
    "the sweep's connections fall silent": lambda on: on.client.silence(),
    "the sweep's connections fall silent, and come back": lambda on: (on.client.silence(), on.client.mend(AGAIN)),
    "the workers' connections are dropped": lambda on: on.network.drop(),
    "the workers' connections fall silent": lambda on: on.network.silence(),
    "the workers' connections fall silent, and come back": lambda on: (on.network.silence(), on.network.mend(AGAIN)),
}
"""What happens."""


def main() -> None:
    found = list(cases())
    rows = []
    for fault in FAULTS:
        chosen = [case for case in found if case.fault == fault]
        right = [case for case in chosen if not case.wrong]
        resumed = [case for case in right if case.line]
        wrong = "; ".join(case.wrong for case in chosen if case.wrong)
        longest = f"{max(case.seconds for case in chosen):.0f}"
        rows.append([fault, len(chosen), len(right) - len(resumed), len(resumed), wrong or "none", longest])
    head = ["fault", "times", "same bits at once", "one line, then resumed to the same bits", "others", "longest, s"]
    limits = ", ".join(
        f"`{name.lower().replace('__', '.').replace('_', '-')}` {value}" for name, value in (LIMITS | DESERTED).items()
    )
    lines = [
        f"dask's limits in these runs: {limits}. The longest time is from the fault to the end of the process.",
        "",
        *markdown.table(head, rows),
        "",
        "The lines:",
        "",
        *(f"- {line}" for line in sorted({_general(case.line) for case in found if case.line})),
    ]
    markdown.write_beside(__file__, "Faults of a cluster", "python -m experiments.reliability.cluster", lines)


def cases() -> Iterator[Case]:
    """Every fault at every moment, two at a time: most of it is waiting."""
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(2) as pool:
        expected = undisturbed(Path(place, "alone"))

        def tried(fault: str, number: int) -> Case:
            folder = Path(place, f"{fault} {number}")
            case = disturbed(folder, fault, MOMENTS[number], expected, anew=number % 2 == 1)
            print(case, flush=True)
            return case

        yield from pool.map(tried, *zip(*itertools.product(FAULTS, range(len(MOMENTS))), strict=True))


def undisturbed(folder: Path) -> dict[str, np.ndarray]:
    """The results of one process."""
    _start(folder, "-c", SWEEP).wait()
    return _values(folder)


def disturbed(folder: Path, fault: str, moment: int, expected: dict[str, np.ndarray], *, anew: bool) -> Case:
    """A fault during a sweep, which then resumes if it has to.

    Args:
        folder: a new one.
        fault: of ``FAULTS``.
        moment: how many chunks are finished when it happens.
        expected: what one process computes.
        anew: whether the sweep resumes on a new cluster, else on none.
    """
    with Cluster(folder) as cluster:
        sweep = _start(folder, "-c", SWEEP, cluster.client.address)
        while str(moment) not in _said(folder) and sweep.poll() is None:
            time.sleep(0.02)
        begun = time.monotonic()
        FAULTS[fault](cluster)
        wrong = _ended(sweep)
        seconds = time.monotonic() - begun
    said = _said(folder)
    line = next((one.removeprefix("ended: ") for one in said if one.startswith("ended: ")), "")
    done = max((int(one) for one in said if one.isdigit()), default=0)
    wrong += [f"more than a line: {said[-2:]}"] if line and said[-1] != f"ended: {line}" else []
    kept = {path: path.stat().st_mtime_ns for path in (folder / "store").glob("chunk_*.npz")}
    wrong += [f"kept {len(kept)} of {done} chunks"] if len(kept) < done else []
    wrong += [f"half {path.name}" for path in (folder / "store").glob("*") if not whole(path)]
    if line or wrong:
        with Cluster(folder) if anew else contextlib.nullcontext() as cluster:
            wrong += _ended(_start(folder, "-c", SWEEP, *([cluster.client.address] if cluster else [])))
        wrong += ["computed again"] if any(path.stat().st_mtime_ns != at for path, at in kept.items()) else []
    found = _values(folder)
    same = expected.keys() == found.keys() and all(np.array_equal(found[name], expected[name]) for name in expected)
    wrong += [] if same else ["other bits"]
    return Case(fault, line, seconds, f"after {moment} chunks: {', '.join(wrong)}" if wrong else "")


def _start(folder: Path, *arguments: str) -> subprocess.Popen:
    """Start Python in a folder, in a process group of its own; what a sweep prints is in ``said``."""
    folder.mkdir(exist_ok=True)
    root = str(Path(__file__).parents[2])
    limits = LIMITS | (DESERTED if SWEEP in arguments else {})
    environment = os.environ | {f"DASK_DISTRIBUTED__{name}": value for name, value in limits.items()}
    environment |= {
        "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")]),
        "JAX_COMPILATION_CACHE_DIR": str(folder.parent / "programs"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    }
    with open(folder / ("said" if SWEEP in arguments else "log"), "a") as out, open(folder / "log", "a") as log:
        return subprocess.Popen(
            [sys.executable, *arguments], cwd=folder, env=environment, stdout=out, stderr=log, start_new_session=True
        )


def _ended(sweep: subprocess.Popen) -> list[str]:
    """Wait for the end of a sweep; what is not as it should be then."""
    try:
        status = sweep.wait(HANGS)
    except subprocess.TimeoutExpired:
        sweep.kill()
        sweep.wait()
        return ["hangs"]
    wrong = [f"status {status}"] if status else []
    with contextlib.suppress(ProcessLookupError):
        os.killpg(sweep.pid, signal.SIGKILL)
        wrong.append("left a process")
    return wrong


def _said(folder: Path) -> list[str]:
    path = folder / "said"
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


def _values(folder: Path) -> dict[str, np.ndarray]:
    path = folder / "values.npz"
    if not path.exists():
        return {}
    with np.load(path) as found:
        return dict(found)


def _general(line: str) -> str:
    """A line without what is of one run only."""
    return re.sub(r"tcp://[\d.:]+", "tcp://…", line)


if __name__ == "__main__":
    main()
