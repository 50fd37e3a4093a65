"""Tables in Markdown, for everything that experiments write down."""

import inspect
from collections.abc import Iterable, Sequence
from pathlib import Path


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """The lines of a table; bars and line breaks inside a cell are made harmless."""

    def line(cells: Sequence[object]) -> str:
        return "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"

    return [line(head), line(["---"] * len(head)), *map(line, rows)]


def explained(doc: str | None) -> list[str]:
    """What a script's docstring says after its first line and the command: how its page is to be read."""
    return ["\n\n".join(inspect.cleandoc(doc or "").split("\n\n")[2:]), ""]


def write_beside(script: str, title: str, command: str, lines: Iterable[str]) -> None:
    """Write a script's page beside it, title and command first, and print it."""
    text = "\n".join([f"# {title}", "", f"`{command}`", "", *lines]) + "\n"
    Path(script).with_suffix(".md").write_text(text, encoding="utf-8")
    print(text)
