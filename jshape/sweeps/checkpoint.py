"""Checkpoints of long computations: finished chunks are kept on disk, so that an interrupted computation resumes."""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from jshape._files import whole
from jshape._types import Progress

MARKER = "jshape-checkpoint"


def in_chunks(
    compute: Callable[[list[int]], Iterable[tuple[int, np.ndarray]]],
    count: int,
    folder: Path | None,
    fingerprint: Callable[[], bytes],
    progress: Progress | None = None,
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index and result of every chunk: those in the checkpoint first, then those that are computed.

    Args:
        compute: yields (index, result) of the missing chunks, whose indices it is given, in any order; each is written
            to the folder as soon as it comes.
        count: number of chunks.
        folder: of the checkpoint, if there is one.
        fingerprint: gives bytes of everything that the results depend on.
        progress: called before the first missing chunk and after each, with the stage ``"chunk"``.

    Raises:
        ValueError: for a folder that holds the chunks of another computation, or other files.
    """
    missing = list(range(count))
    if folder is not None:
        _claim(folder, hashlib.sha256(fingerprint()).hexdigest(), count)
        finished = [index for index in missing if _path(folder, index).exists()]
        missing = sorted({*missing} - {*finished})
        for index in finished:
            yield index, np.load(_path(folder, index), allow_pickle=False)

    def report(done: int) -> None:
        if progress is not None:
            progress("chunk", done, count, math.inf)

    done = count - len(missing)
    report(done)
    for index, result in compute(missing) if missing else ():
        if folder is not None:
            with whole(_path(folder, index)) as file:
                np.save(file, result, allow_pickle=False)
        yield index, result
        done += 1
        report(done)


def _path(folder: Path, index: int) -> Path:
    return folder / f"chunk_{index:06d}.npy"


def _claim(folder: Path, digest: str, count: int) -> None:
    """Write the folder's manifest, or compare it with the one that is there."""
    manifest = folder / "checkpoint.json"
    record = {"format": MARKER, "version": 1, "digest": digest, "chunks": count}
    if manifest.exists():
        try:
            found = json.loads(manifest.read_text(encoding="utf-8"))
        except ValueError:
            found = None
        if found != record:
            raise ValueError(f"store: {folder} holds the chunks of another computation; name another folder")
        return
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"store: {folder} holds files that are not jshape's; name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    manifest.write_text(json.dumps(record) + "\n", encoding="utf-8")
