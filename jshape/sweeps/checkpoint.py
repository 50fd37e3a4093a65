"""Long computations in pieces that are kept on disk, so that an interrupted one goes on where it stopped."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from jshape._files import whole

MARKER = "jshape-pieces"


def in_pieces(
    compute: Callable[[list[int]], Iterable[tuple[int, np.ndarray]]],
    pieces: int,
    folder: Path | None,
    fingerprint: Callable[[], bytes],
    progress: Callable[[int, int], None] | None,
) -> Iterator[tuple[int, np.ndarray]]:
    """Each piece's index and result: those in the folder (if there is one) first, then what ``compute`` yields.

    ``compute`` is given the indices that are missing and may yield them in any order; each is kept in the folder as
    soon as it comes. ``fingerprint()``: of everything that the results depend on; a folder that holds the pieces of
    another computation is refused with a ``ValueError``. ``progress(done, pieces)`` is called before the first piece is
    computed and after each.
    """
    missing = list(range(pieces))
    if folder is not None:
        _claim(folder, hashlib.sha256(fingerprint()).hexdigest(), pieces)
        kept = [index for index in missing if _path(folder, index).exists()]
        missing = [index for index in missing if index not in set(kept)]
        for index in kept:
            yield index, np.load(_path(folder, index), allow_pickle=False)
    done = pieces - len(missing)
    if progress is not None:
        progress(done, pieces)
    for index, result in compute(missing) if missing else ():
        if folder is not None:
            with whole(_path(folder, index)) as file:
                np.save(file, result, allow_pickle=False)
        yield index, result
        done += 1
        if progress is not None:
            progress(done, pieces)


def _path(folder: Path, index: int) -> Path:
    return folder / f"piece_{index:06d}.npy"


def _claim(folder: Path, digest: str, pieces: int) -> None:
    manifest = folder / "pieces.json"
    record = {"format": MARKER, "version": 1, "digest": digest, "pieces": pieces}
    if manifest.exists():
        try:
            found = json.loads(manifest.read_text(encoding="utf-8"))
        except ValueError:
            found = None
        if found != record:
            raise ValueError(f"store: {folder} holds the pieces of another computation; name another folder")
        return
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"store: {folder} holds files that are not jshape's; name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    manifest.write_text(json.dumps(record) + "\n", encoding="utf-8")
