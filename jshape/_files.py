"""Files of results: which folders may be written to, and how nothing in them is ever half written."""

import json
import math
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

MARKER = "jshape-results"
"""The format that results.json names; a folder that holds another program's files is not written to."""


def check_writable(folder: Path) -> None:
    """Check that a folder is empty, new, or holds an earlier result of jshape's.

    Raises:
        ValueError: for a file, and for a folder with anything else in it.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ValueError(f"{folder}: is a file, not a folder")
    if not any(folder.iterdir()):
        return
    try:
        ours = json.loads((folder / "results.json").read_text(encoding="utf-8"))["format"] == MARKER
    except (OSError, ValueError, KeyError, TypeError):
        ours = False
    if not ours:
        raise ValueError(f"{folder}: holds files that are not jshape's results; name another folder")


def write_results(folder: Path, record: Mapping[str, Any]) -> None:
    """Write ``results.json``, the mark of a result folder, and make the folder where there is none.

    Args:
        folder: of the results.
        record: plain data. JSON has no infinity and no NaN: an infinite number becomes ``"diverged"``, NaN ``null``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_plain({"format": MARKER, "version": 1, **record}), indent=2, allow_nan=False)
    with whole(folder / "results.json") as file:
        file.write(f"{text}\n".encode())


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else "diverged"
    return value


@contextmanager
def whole(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, under another name until the block ends: a file of the right name is complete.

    Others may write the same file meanwhile; the last one stands.
    """
    partial = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.partial")
    try:
        with partial.open("wb") as file:
            yield file
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
