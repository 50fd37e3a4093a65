"""Finished rows by their keys in a JSON file, from which an interrupted script resumes."""

import json
from pathlib import Path
from typing import Any

from jshape._files import whole


def read(path: Path) -> dict[str, Any]:
    """All rows; none where there is no file yet."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def keep(path: Path, key: str, row: Any, indent: int | None = 1) -> None:
    """Add a row. The file is read again first, since another process may have added one, and is never half written."""
    record = read(path) | {key: row}
    with whole(path) as file:
        file.write((json.dumps(record, indent=indent) + "\n").encode())
