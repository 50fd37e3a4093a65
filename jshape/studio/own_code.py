"""Code of the user's own that problem files may name as ``module:Class``: none, unless the command allowed it."""

import dataclasses
from pathlib import Path

from jshape.problems import catalogue
from jshape.problems.reading import Draft
from jshape.problems.starters import Starter


@dataclasses.dataclass
class Code:
    """Code of the user's own that problem files may name.

    Attributes:
        folder: in which it is looked for first; ``None`` where none is allowed.
        entries: what is known of its classes, by ``module:Class``.
    """

    folder: Path | None = None
    entries: dict[str, catalogue.Entry] = dataclasses.field(default_factory=dict)


CODE = Code()


def allow_code(folder: str | Path) -> None:
    """Let the problem files of this process name code of the user's own, ``module:Class``, which then runs.

    Args:
        folder: in which it is looked for first.
    """
    CODE.folder = Path(folder)


def allowed() -> str | None:
    """The folder of code that problem files may name, if they may."""
    return None if CODE.folder is None else str(CODE.folder)


def entry(starter: Starter) -> catalogue.Entry:
    """What is known of a machine's class."""
    return CODE.entries.get(starter.plant) or catalogue.plants()[starter.plant]


def understood(draft: Draft) -> Draft:
    """The draft of a problem file, the code of its plant run where that is its own.

    Raises:
        ValueError: where code is not allowed.
    """
    if draft.foreign is None:
        return draft
    if CODE.folder is None:
        raise ValueError(
            f"plant.type: the studio runs no code of a problem file's own, here {draft.foreign!r}, unless it is "
            "started with --allow-code"
        )
    from jshape.problems.problem import own_class

    read = own_class(draft)
    assert read.plant.entry is not None
    CODE.entries[read.plant.kind] = read.plant.entry
    return read
