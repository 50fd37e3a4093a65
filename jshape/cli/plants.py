"""``jshape plants``: what a problem file may name, and the keys of each."""

from typing import TYPE_CHECKING, Annotated

import typer

from jshape.cli._shared import explained

if TYPE_CHECKING:
    from jshape.problems.catalogue import Entry, Key


@explained()
def plants(
    name: Annotated[str | None, typer.Argument(help="A plant, a part of one, or a command: its keys then.")] = None,
) -> None:
    """List the plants that a problem file may name; with a NAME its keys, units, defaults and meanings."""
    if name is None:
        _show_all()
    else:
        _show_one(name)


def _show_all() -> None:
    """Every plant in its group, in people's words; parts and commands below."""
    from jshape.problems import catalogue
    from jshape.problems.starters import STARTERS
    from jshape.reports.tables import new_console, say, show_table

    console = new_console()
    for group in catalogue.GROUPS:
        rows = [(starter.plant, [starter.title]) for starter in STARTERS if catalogue.group(starter.plant) == group]
        show_table(console, group, [""], rows, left=[""])
    parts = [(f"{base.removeprefix('Abstract').lower()}s", base) for base in dict.fromkeys(catalogue.PARTS.values())]
    for words, base in parts:
        if base != "AbstractPlant":
            say(console, f"{words}: {', '.join(catalogue.known(base))}")
    say(console, "a plant of your own: module:Class, as in jshape new --plant own")
    say(console, "\njshape plants NAME shows the equation and the keys of any of these")
    say(console, "jshape new --plant NAME FILE writes a file with all of them, to begin from")


def _show_one(name: str) -> None:
    """The keys of a class, and for a plant an example."""
    from jshape.problems import catalogue, starters
    from jshape.reports.tables import new_console, say, show_table

    known: dict[str, Entry] = {}
    for base in ["AbstractPlant", *catalogue.PARTS.values()]:
        known |= catalogue.known(base)
    if name not in known:
        names = list(known)
        near = catalogue.suggestion(name, names)
        raise ValueError(f"there is no plant, part or command {name!r}, only {', '.join(names)}{near}")
    console = new_console()
    say(console, f"{name}: {known[name].summary}")
    rows = [(key.name, _cells(key)) for key in known[name].keys.values()]
    if known[name].axes:
        axes = ", ".join(f"{axis} ({unit})" for axis, unit in known[name].command_units().items())
        say(console, f"axes, each with a table [command.AXIS]: {axes}")
    show_table(console, "key", ["unit", "default", "meaning"], rows, left=["meaning"])
    if name in catalogue.plants():
        say(console, f"as a problem file has it (jshape new --plant {name} FILE writes all of it):\n")
        say(console, starters.example(name))


def _cells(key: "Key") -> list[str]:
    """Unit, default and meaning of a key."""
    from jshape.problems import catalogue

    meaning = key.meaning
    if key.part is not None:
        meaning += f" A table: {', '.join(catalogue.known(key.part))}."
    default = "" if key.default is None else str(key.default)
    if isinstance(key.default, tuple):
        default = "a list"
    return [key.unit or "", default, meaning]
