"""Long computations in pieces that are kept on disk, so that an interrupted one goes on where it stopped."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

MARKER = "jshape-pieces"


def in_pieces(
    compute: Callable[[int], np.ndarray],
    pieces: int,
    folder: Path | None,
    fingerprint: bytes,
    progress: Callable[[int, int], None] | None,
) -> list[np.ndarray]:
    """``compute(0) … compute(pieces − 1)``, each kept in the folder (if there is one) as soon as it is done.

    ``fingerprint``: of everything that the results depend on; a folder that holds the pieces of another computation is
    refused with a ``ValueError``. ``progress(done, pieces)`` is called before each piece and at the end.
    """
    if folder is not None:
        _claim(folder, hashlib.sha256(fingerprint).hexdigest(), pieces)
    results = []
    for index in range(pieces):
        if progress is not None:
            progress(index, pieces)
        path = None if folder is None else folder / f"piece_{index:06d}.npy"
        if path is not None and path.exists():
            results.append(np.load(path, allow_pickle=False))
            continue
        result = compute(index)
        if path is not None:
            # Under another name first: what bears the right name is whole.
            partial = path.with_suffix(".partial")
            with partial.open("wb") as file:
                np.save(file, result, allow_pickle=False)
            os.replace(partial, path)
        results.append(result)
    if progress is not None:
        progress(pieces, pieces)
    return results


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
