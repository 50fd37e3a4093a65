"""Work on a ``dask.distributed`` cluster: calls sent out as there is room, results as they complete.

The scheduler gives the calls of a worker that dies to the others; calls that were under way when a connection broke
are sent out again once it is back. A scheduler is given up when it has not answered for
``distributed.comm.timeouts.tcp`` (30 s; twice as long where a result was just being fetched), a cluster without workers
after ``distributed.scheduler.no-workers-timeout`` (where that is not set, 5 minutes). Workers that fall silent are up
to the scheduler (``distributed.scheduler.worker-ttl``). dask is imported here alone, when a client is given.
"""

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any

BEAT = 5.0
"""After so long the scheduler is asked whether it and its workers are there, s."""

DESERTED = "5 minutes"
"""So long a cluster may be without workers, unless dask's configuration says otherwise."""

POLL = 0.05
"""After so long it is looked whether calls have completed, s."""

TRIES = 4
"""So often a call is sent out, or its result fetched, before it is given up; as often dask lets workers die of one."""


def check_client(client: Any) -> None:
    """Check that ``client`` is a client of a ``dask.distributed`` cluster.

    Raises:
        ImportError: without dask.distributed.
        ValueError: if ``client`` is something else.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ImportError("client needs dask.distributed: pip install 'jshape[distributed]'") from None
    if not isinstance(client, Client):
        raise ValueError(f"client must be a dask.distributed.Client, not {client!r}")


def on_cluster(
    client: Any, function: Callable[..., Any], calls: Iterable[tuple[int, tuple[Any, ...]]]
) -> Iterator[tuple[int, Any]]:
    """Yield the index and result of each call, in the order in which the calls complete.

    No more are under way than keep every thread of the cluster busy; they are cancelled if the caller stops iterating.

    Args:
        client: of the cluster.
        function: what is called on the workers.
        calls: (index, arguments) of each call.

    Raises:
        ConnectionError: for a cluster that stays away.
    """
    from distributed.client import ClosedClientError

    watch = _Watch(client)
    waiting = (_Call(index, arguments, watch.silence) for index, arguments in calls)
    under_way: dict[Any, _Call] = {}

    def submit(some: Iterable[_Call]) -> None:
        for call in some:
            watch.look()
            # A name of its own for each: what another sweep computed under the same one must not stand in for it.
            under_way[client.submit(function, *call.arguments, pure=False)] = call

    def fill() -> None:
        submit(islice(waiting, max(watch.room - len(under_way), 0)))

    try:
        watch.ask()
        fill()
        while under_way:
            # One that the client forgot with its connection, just while it was sent out, would never be done.
            for future in [one for one in under_way if one.done() or one.key not in client.futures]:
                watch.look()
                call = under_way[future]
                if _fetched(future, call):
                    del under_way[future]
                    # What is here is kept before the cluster is asked for more, which may be lost meanwhile.
                    yield call.index, call.result
                    fill()
                elif future.key not in client.futures:
                    del under_way[future]
                    submit([call])
            watch.look()
            fill()
            time.sleep(POLL)
    except ClosedClientError:
        watch.look()
        raise
    finally:
        if client.status not in ("closing", "closed"):
            client.cancel(list(under_way))


@dataclasses.dataclass
class _Call:
    """A call and what became of it.

    Attributes:
        index: of the call.
        arguments: of the function.
        patience: so long its result may take to come from the cluster, s; next time twice as long.
        failures: how often it was sent out, or its result fetched, in vain.
        result: once it is here.
    """

    index: int
    arguments: tuple[Any, ...]
    patience: float
    failures: int = 0
    result: Any = None


def _fetched(future: Any, call: _Call) -> bool:
    """Whether the result of a call that completed is here; else it has to be fetched, or sent out, once more."""
    from distributed import CancelledError, KilledWorker
    from distributed.scheduler import NoValidWorkerError, NoWorkerError

    try:
        if future.key in future.client.futures:
            call.result = future.result(timeout=call.patience)
            return True
        reason = "the connection broke"
    except (KilledWorker, NoValidWorkerError, NoWorkerError) as problem:
        raise _lost(f"the scheduler gave chunk {call.index} up: {problem}") from None
    except (OSError, CancelledError) as problem:
        if future.status == "error":
            raise  # The function's own.
        reason = str(problem) or type(problem).__name__
    call.failures += 1
    call.patience *= 2
    if call.failures == TRIES:
        raise _lost(f"chunk {call.index} failed {TRIES} times: {reason}") from None
    return False


class _Watch:
    """Raises an error once the client, the scheduler or all workers are lost.

    Attributes:
        silence: so long a scheduler may leave a question unanswered, s.
        room: for so many calls: two for each thread of the workers that were there last, and two more.
    """

    def __init__(self, client: Any):
        from dask import config
        from dask.utils import parse_timedelta

        self.silence = parse_timedelta(config.get("distributed.comm.timeouts.tcp"))
        self.room = 2
        self._client, self._address = client, getattr(client.scheduler, "address", "")
        self._deserted = parse_timedelta(config.get("distributed.scheduler.no-workers-timeout") or DESERTED)
        self._asked = 0.0
        self._silent: float | None = None
        self._empty: float | None = None

    def look(self) -> None:
        """Look whether the client is open, and from time to time whether the others are there."""
        if self._client.status in ("closing", "closed"):
            raise _lost(f"the connection to the scheduler {self._address} is broken")
        if time.monotonic() - self._asked > BEAT:
            self.ask()

    def ask(self) -> None:
        """Ask the scheduler for its workers."""
        begun, scheduler = time.monotonic(), self._client.scheduler
        try:
            if scheduler is None or self._client.status != "running":
                raise ConnectionError
            threads = sum(self._client.sync(scheduler.ncores, callback_timeout=self.silence).values())
        except OSError:  # Perhaps the client connects again.
            self._silent = self._silent or begun
        else:
            self._silent, self.room = None, 2 + 2 * threads
            self._empty = None if threads else self._empty or begun
        self._asked = time.monotonic()
        if self._silent and self._asked - self._silent >= self.silence:
            raise _lost(f"the scheduler {self._address} has not answered for {self.silence:.0f} s")
        if self._empty and self._asked - self._empty >= self._deserted:
            raise _lost(f"the cluster {self._address} has had no workers for {self._deserted:.0f} s")


def _lost(what: str) -> ConnectionError:
    words = " ".join(what.split())
    return ConnectionError(
        f"client: {words}; finished chunks are in the store, if one was given: the same call resumes"
    )
