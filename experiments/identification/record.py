"""What the scripts of this folder share: records, and the page that a twin's results are written to."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.markdown import table


class Record(NamedTuple):
    """A record of a benchmark, or of its twin.

    Attributes:
        times: s, from 0 on, shape (samples,).
        inputs: of the machine, shape (samples,).
        values: its measured output, shape (samples,).
    """

    times: np.ndarray
    inputs: np.ndarray
    values: np.ndarray


def write(script: str, about: str | None, rows: list[list[str]], measured: bool, note: str = "") -> None:
    """Print a table, and write a twin's beside its script; of measured data nothing is kept.

    Args:
        script: the script's file.
        about: its docstring.
        rows: of the table.
        measured: whether the records are.
        note: below the table.
    """
    head = ["", "found", "95 % interval", "true", "relative error"][: max(map(len, rows))]
    lines = [*table(head, rows), "", note]
    print("\n".join(lines))
    if not measured:
        about = (about or "").strip()
        title = about.partition("\n")[0].partition(":")[0]
        text = "\n".join([f"# {title}", "", about, "", *lines]).strip()
        Path(script).with_suffix(".md").write_text(f"{text}\n", encoding="utf-8")
