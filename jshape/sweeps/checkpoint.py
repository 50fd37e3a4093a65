"""Checkpoints of long computations: finished chunks are kept on disk, so that an interrupted computation resumes.

Each chunk's file says which computation and which chunk it is of, and is verified when it is read; one that is damaged,
or another's, is computed again.
"""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from jshape._files import PARTIAL, read_arrays, read_text, write_arrays, write_text
from jshape._types import Progress

MARKER = "jshape-checkpoint"
_CHUNK = "jshape-chunk 1"


def in_chunks(
    compute: Callable[[list[int]], Iterable[tuple[int, np.ndarray]]],
    count: int,
    folder: Path | None,
    fingerprint: Callable[[], bytes],
    shape: Callable[[int], tuple[int, ...]],
    progress: Progress | None = None,
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index and result of every chunk: those in the checkpoint first, then those that are computed.

    Args:
        compute: yields (index, result) of the missing chunks, whose indices it is given, in any order; each is written
            to the folder as soon as it comes.
        count: number of chunks.
        folder: of the checkpoint, if there is one.
        fingerprint: gives bytes of everything that the results depend on.
        shape: that a chunk's result has.
        progress: called before the first missing chunk and after each, with the stage ``"chunk"``.

    Raises:
        ValueError: for a folder that holds the chunks of another computation, or other files.
    """
    missing, digest = list(range(count)), ""

    def is_result(arrays: dict[str, np.ndarray], index: int) -> bool:
        found = arrays.get("result")
        return found is not None and found.dtype.kind == "f" and found.shape == shape(index)

    if folder is not None:
        digest = hashlib.sha256(fingerprint()).hexdigest()
        _claim(folder, digest, count)
        for index in list(missing):
            try:
                about, arrays = read_arrays(_path(folder, index), _CHUNK)
            except ValueError:
                continue
            if about == _about(digest, index) and is_result(arrays, index):
                missing.remove(index)
                yield index, arrays["result"]

    def report(done: int) -> None:
        if progress is not None:
            progress("chunk", done, count, math.inf)

    done = count - len(missing)
    report(done)
    for index, result in compute(missing) if missing else ():
        if folder is not None:
            write_arrays(_path(folder, index), _CHUNK, _about(digest, index), {"result": result})
        yield index, result
        done += 1
        report(done)


def _path(folder: Path, index: int) -> Path:
    return folder / f"chunk_{index:06d}.npz"


def _about(digest: str, index: int) -> dict[str, str | int]:
    """The description of a chunk in its file."""
    return {"computation": digest, "index": index}


def _claim(folder: Path, digest: str, count: int) -> None:
    """Write the folder's manifest, or compare it with the one that is there."""
    manifest = folder / "checkpoint.json"
    record = {"format": MARKER, "version": 2, "digest": digest, "chunks": count}
    if manifest.exists():
        try:
            found = json.loads(read_text(manifest, 4096))
        except (ValueError, RecursionError):
            found = None
        if found != record:
            raise ValueError(f"store: {folder} holds the chunks of another computation; name another folder")
        return
    if folder.is_file() or (folder.exists() and any(path.suffix != PARTIAL for path in folder.iterdir())):
        raise ValueError(f"store: {folder} is a file, or holds files that are not jshape's; name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    write_text(manifest, json.dumps(record) + "\n")
