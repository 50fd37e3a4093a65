"""Files: written whole or not at all, verified when they are read, and which folders may be written to.

What a program reads back is a text of limited size, or arrays in NumPy's npz with a header (JSON) and a digest: what
``write_arrays`` writes, ``read_arrays`` reads, or says in a line what is wrong.
"""

import csv
import hashlib
import io
import json
import math
import os
import tempfile
import threading
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO
from unicodedata import category

import numpy as np

MARKER = "jshape-results"
"""The format that results.json names; a folder that holds another program's files is not written to."""

PARTIAL = ".partial"
"""How the name of a file ends that is being written; a process that is killed may leave one."""

LARGEST = 2**30
"""Bytes of arrays in a file that is read; a small archive may unpack to anything."""


def check_writable(folder: Path) -> None:
    """Check that a folder is empty, new, or holds an earlier result of jshape's, and that it can be written to.

    A new one is made to try, and removed again.

    Raises:
        ValueError: for a file, a folder with anything else in it, and one that cannot be written to.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise ValueError(f"{folder}: is a file, not a folder")
        if folder.exists() and any(path.suffix != PARTIAL for path in folder.iterdir()) and not results_of(folder):
            raise ValueError(f"{folder}: holds files that are not jshape's results; name another folder")
        made = [each for each in (folder, *folder.parents) if not each.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder) as file:
                file.write(bytes(4096))
        finally:
            # Not what another process has written into meanwhile.
            with suppress(OSError):
                for each in made:
                    each.rmdir()
    except OSError as error:
        raise ValueError(f"{folder}: cannot be written to: {_reason(error)}") from None


def check_unedited(folder: Path, text: str | None = None, files: Mapping[str, bytes] | None = None) -> None:
    """Check that a folder's problem file and those beside it, if any, are as jshape wrote them, or have that content.

    Args:
        folder: of the results.
        text: of the problem file.
        files: those that describe its plant, by their names beside it.

    Raises:
        ValueError: for one that its user may have edited.
    """
    record = results_of(folder)
    digests = record.get("file_digests")
    digests = digests if isinstance(digests, dict) else {}
    path = folder / "problem.toml"
    copies = [(path, read_text(path), text, record.get("problem_digest"))] if path.exists() else []
    for name, content in (files or {}).items():
        path = folder / name
        copies += [(path, read_bytes(path), content, digests.get(name))] if path.exists() else []
    for path, found, wanted, written in copies:
        if found != wanted and digest(found) != written:
            raise ValueError(f"{path}: has been edited, and is left as it is; name another folder")


def results_of(folder: Path) -> dict[str, Any]:
    """The content of a folder's ``results.json``; nothing where it is not jshape's."""
    try:
        found = json.loads(read_text(folder / "results.json"))
        return found if found["format"] == MARKER else {}
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}


def digest(content: str | bytes) -> str:
    """The SHA-256 digest of a text, or of bytes."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def sealed(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record of plain data with a digest of all the rest, which does not depend on how its JSON is laid out."""
    return {**record, "digest": _digest_of_record(json.loads(json.dumps(record)))}


def check_seal(record: Mapping[str, Any]) -> None:
    """Raises ``ValueError`` where a record has a digest that is not its own: it was damaged, or edited."""
    if "digest" in record and record["digest"] != _digest_of_record(record):
        raise ValueError(
            "its digest is not that of its content: it was damaged, or edited; without a digest it is read"
        )


def _digest_of_record(record: Mapping[str, Any]) -> str:
    return digest(json.dumps({key: value for key, value in record.items() if key != "digest"}, sort_keys=True))


def printable(name: str) -> str:
    """A name as data: control characters and bytes that are no UTF-8, which a file's name may hold, are replaced."""
    # Of the spaces, Python counts that of ASCII alone as printable.
    return "".join(each if each.isprintable() or category(each) == "Zs" else "\ufffd" for each in name)


def escaped(words: str) -> str:
    """A text in which control characters, which a terminal would obey, and bytes that are no UTF-8 are escapes."""
    return "".join(each if printable(each) == each else ascii(each)[1:-1] for each in words)


def write_results(folder: Path, record: Mapping[str, Any]) -> None:
    """Write ``results.json``, the mark of a result folder, and make the folder where there is none.

    Args:
        folder: of the results.
        record: plain data. JSON has no infinity and no NaN: an infinite number becomes ``"diverged"``, NaN ``null``.
            A digest of it all is added.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(sealed(_plain({"format": MARKER, "version": 1, **record})), indent=2, allow_nan=False)
    write_text(folder / "results.json", f"{text}\n")


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

    Others may write the same file meanwhile; the last one stands. A device or a pipe is written to as it is: a file in
    its place would be none.

    Raises:
        OSError: that names the path, where it cannot be written; what stood there before still stands.
    """
    partial = path.with_name(f".{os.getpid()}-{threading.get_ident()}{PARTIAL}")
    try:
        if path.exists() and not path.is_file():
            with path.open("wb") as file:
                yield file
            return
        # A new file, whatever others have put there under its name: a link of theirs may lead anywhere.
        partial.unlink(missing_ok=True)
        try:
            with partial.open("xb") as file:
                yield file
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8, whole."""
    with whole(path) as file:
        file.write(text.encode())


def as_csv(head: Iterable[str], rows: Iterable[Iterable[Any]], ending: str = "\n") -> str:
    """A table as CSV: its head, then its rows, each with that ending of lines."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator=ending)
    table.writerow(head)
    table.writerows(rows)
    return file.getvalue()


def read_bytes(path: Path, most: int = 2**28) -> bytes:
    """A file's content.

    Args:
        path: of the file.
        most: bytes that are read.

    Raises:
        ValueError: that names the file, if it cannot be read, or is longer.
    """
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {_reason(error)}") from None
    if len(content) > most:
        raise ValueError(f"{path}: cannot be read: it has more than {most} bytes")
    return content


def read_text(path: Path, most: int = 2**26) -> str:
    """A text in UTF-8, with or without a byte-order mark.

    Raises:
        ValueError: as ``read_bytes`` does, and that names the file if it is no such text.
    """
    content = read_bytes(path, most)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: cannot be read as text: {error}") from None


def write_arrays(path: Path, kind: str, about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays as npz, with a header and a digest.

    Args:
        path: of the file.
        kind: format and version.
        about: plain data for the header.
        arrays: by name.
    """
    header = json.dumps({"format": kind, "about": dict(about), "arrays": described(arrays)})
    with whole(path) as file:
        np.savez_compressed(file, allow_pickle=False, header=header, digest=digest_of_arrays(header, arrays), **arrays)


def read_arrays(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The header and the arrays of a file of ``write_arrays``.

    Raises:
        ValueError: that names the file, if any of it is missing or changed, or it is of another format or version.
    """
    arrays = read_npz(path)
    try:
        text, digest = str(arrays.pop("header")), str(arrays.pop("digest"))
        header = json.loads(text)
        if header["format"] != kind:
            raise ValueError(f"its format is {header['format']!r}, not {kind!r}")
        if header["arrays"] != described(arrays) or digest != digest_of_arrays(text, arrays):
            raise ValueError("it is damaged: what it holds is not what was written")
        return dict(header["about"]), arrays
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: cannot be read: {_reason(error)}") from None


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an npz file, by name.

    Raises:
        ValueError: that names the file, if it is none, or holds more than ``LARGEST`` bytes.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > LARGEST:
                raise ValueError(f"it holds {size} bytes, more than {LARGEST}")
            found = {}
            for name in archive.namelist():
                with archive.open(name) as member:
                    found[name.removesuffix(".npy")] = np.lib.format.read_array(member, allow_pickle=False)
            return found
    except Exception as error:
        # A damaged file raises whatever zipfile, zlib and NumPy have.
        raise ValueError(f"{path}: cannot be read: {_reason(error)}") from None


def described(arrays: Mapping[str, np.ndarray]) -> dict[str, list]:
    """Type and shape of each array, as JSON has them."""
    return {name: [value.dtype.str, list(value.shape)] for name, value in sorted(arrays.items())}


def digest_of_arrays(header: str, arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256(header.encode())
    for _, value in sorted(arrays.items()):
        digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


def _reason(error: BaseException) -> str:
    """The message of an error, in one line."""
    if isinstance(error, KeyError):
        return f"it has no {error}"
    words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return in_a_line(words) or type(error).__name__


def in_a_line(words: str, most: int = 300) -> str:
    """A message without line breaks, and no longer than that: what it quotes may be anything."""
    words = " ".join(words.split())
    return words if len(words) <= most else f"{words[:most]} ..."
