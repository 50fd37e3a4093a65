"""Work on a ``dask.distributed`` cluster: calls sent out as there is room, results as they complete.

The scheduler gives the calls of a worker that dies to the others. dask is imported here alone, when a client is given.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any


def check_client(client: Any) -> None:
    """*Raises* ``ImportError`` without dask.distributed, ``ValueError`` if ``client`` is not one of its clients."""
    try:
        from distributed import Client
    except ImportError:
        raise ImportError("client needs dask.distributed: pip install 'jshape[distributed]'") from None
    if not isinstance(client, Client):
        raise ValueError(f"client must be a dask.distributed.Client, not {client!r}")


def on_cluster(
    client: Any, function: Callable[..., Any], calls: Iterable[tuple[int, tuple[Any, ...]]]
) -> Iterator[tuple[int, Any]]:
    """The index and result of each ``(index, arguments)`` of the calls, in the order in which they complete.

    No more are under way than keep every thread of the cluster busy, whatever the number of calls; they are called
    off if the caller stops listening.
    """
    from distributed import as_completed

    calls = iter(calls)
    indices: dict[Any, int] = {}

    def submit() -> Any:
        index, arguments = next(calls, (None, ()))
        if index is None:
            return None
        # A name of its own for each: what another sweep computed under the same one must not stand in for it.
        future = client.submit(function, *arguments, pure=False)
        indices[future] = index
        return future

    room = 2 + 2 * sum(client.nthreads().values())
    completed = as_completed([future for _ in range(room) if (future := submit()) is not None])
    try:
        for future in completed:
            result = future.result()
            more = submit()
            if more is not None:
                completed.add(more)
            yield indices.pop(future), result
    finally:
        client.cancel(list(indices))
