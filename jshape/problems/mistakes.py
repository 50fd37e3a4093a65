"""Mistakes in the tables of a problem file that pydantic finds: where they stand, and in words."""

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel

from jshape.problems.catalogue import suggestion
from jshape.problems.schema import Adapt, Design, File, Front, Range

TABLES: dict[str, type[BaseModel]] = {"design": Design, "pareto": Front, "adapt": Adapt, "uncertainty": Range}


def first_of(errors: Sequence[Any]) -> Any:
    """The first of pydantic's complaints; of those about the branches of a union the one that came furthest."""
    branches = [error for error in errors if error["loc"][:2] == errors[0]["loc"][:2]]
    return max(branches, key=lambda error: len(error["loc"]))


def keys_of(raw: Any, place: tuple[int | str, ...]) -> list[str]:
    """The keys of the file among those of pydantic's place, which also names the branches of a union."""
    keys: list[str] = []
    node = raw
    for index, key in enumerate(place, start=1):
        # A key that is missing is the last one.
        if isinstance(node, dict) and (key in node or index == len(place)):
            keys.append(str(key))
            node = node.get(key)
        elif isinstance(node, list) and isinstance(key, int) and key < len(node):
            keys.append(str(key))
            node = node[key]
    return keys


def message_of(error: Any) -> str:
    """pydantic's complaint in this project's words."""
    given = error["input"]
    if error["type"] == "missing":
        return "is missing"
    if error["type"] == "extra_forbidden":
        table = TABLES.get(str(error["loc"][0]), File) if len(error["loc"]) > 1 else File
        names = list(table.model_fields)
        return f"unknown key; there are {', '.join(names)}{suggestion(str(error['loc'][-1]), names)}"
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    message = error["msg"][0].lower() + error["msg"][1:]
    return f"{message}, not {given!r}"
