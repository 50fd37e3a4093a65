"""Folders and files of results: which may be written to, and how nothing in them is ever half written."""

import json
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

MARKER = "jshape-results"
"""What results.json says it is; a folder that holds another one's files is not written to."""


def check_writable(folder: Path) -> None:
    """*Raises* ``ValueError`` unless a folder is empty, new, or holds an earlier result of jshape's."""
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


@contextmanager
def whole(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, under another name until the block ends: what bears the right name is whole.

    Others may write the same file meanwhile; the last one stands.
    """
    partial = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.partial")
    try:
        with partial.open("wb") as file:
            yield file
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
