"""Work on a ``dask.distributed`` cluster: calls sent out as there is room, results as they complete.

The scheduler gives the calls of a worker that dies to the others. dask is imported here alone, when a client is given.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any


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
    """
    from distributed import as_completed

    indices: dict[Any, int] = {}

    def submitted() -> Iterator[Any]:
        for index, arguments in calls:
            # A name of its own for each: what another sweep computed under the same one must not stand in for it.
            future = client.submit(function, *arguments, pure=False)
            indices[future] = index
            yield future

    futures = submitted()
    completed = as_completed(islice(futures, 2 + 2 * sum(client.nthreads().values())))
    try:
        for future in completed:
            result = future.result()
            completed.update(islice(futures, 1))
            yield indices.pop(future), result
    finally:
        client.cancel(list(indices))
