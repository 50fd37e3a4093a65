"""Files of their own, MJCF or URDF, in which problem files describe a plant: found, and taken along with a copy."""

import os
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from jshape._files import read_bytes
from jshape.problems.catalogue import READERS
from jshape.problems.lines import Lines

TAKEN = ("results.json", "problem.toml", "shapers", "figures", "table.tex", "sensitivity_*.csv")
"""Names, as patterns, of what stands in a folder of results."""


def units_of_file(lines: Lines, table: dict[str, Any]) -> dict[str, str]:
    """The units of the axes of a plant that is described in a file of its own: joints are slides or hinges."""
    from jshape.plants import mujoco_model

    try:
        model = mujoco_model.load(beside(lines, table.get("file")))
        return mujoco_model.command_units(model, mujoco_model.check_driven(model, table.get("driven")))
    except (ImportError, ValueError) as error:
        key = "driven" if str(error).startswith("driven") else "file"
        raise lines.error(["plant", key], str(error).removeprefix(key).lstrip(" :")) from None


def beside(lines: Lines, name: Any) -> Path:
    """The file of that name beside the problem file, or of those that come with jshape.

    Raises:
        ProblemError: if there is none.
    """
    if not isinstance(name, str) or not name:
        raise lines.error(["plant", "file"], f"must be the name of a file, not {name!r}")
    for folder in (lines.path.parent, Path(__file__).parent):
        if (folder / name).is_file():
            return folder / name
    raise lines.error(["plant", "file"], f"there is no file {name!r} beside the problem file")


def machine_files(lines: Lines, table: dict[str, Any]) -> tuple[dict[str, bytes], list[str]]:
    """The files in which a plant is described, with all that they include, and what is to be said of them.

    Args:
        lines: where keys of the problem file stand.
        table: the plant's, checked.

    Returns:
        The contents by the files' names beside a copy of the problem file, and a line for each that lies elsewhere.

    Raises:
        ProblemError: for a name that the results have.
    """
    if table.get("type") == "Linearised":
        return machine_files(lines, table["plant"])
    if table.get("type") not in READERS:
        return {}, []
    from jshape.plants.mujoco_model import dependencies

    name, found, outside = table["file"], {}, []
    main = beside(lines, name)
    for path in [main, *dependencies(main)]:
        # As the problem file names the first, so the first names the others.
        own = os.path.normpath(Path(name).parent / os.path.relpath(path, main.parent))
        if own.startswith("..") or os.path.isabs(own):
            words = f"{own} does not lie beside the problem file, and is not taken along with a copy of it"
            outside.append(str(lines.error(["plant", "file"], words)))
        elif any(fnmatch(Path(own).parts[0].lower(), taken) for taken in TAKEN):
            raise lines.error(
                ["plant", "file"], f"{own} is a name of the results, beside which it is written; rename it"
            )
        else:
            found[own] = read_bytes(path)
    return found, outside
