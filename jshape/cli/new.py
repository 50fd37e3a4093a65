"""``jshape new``: a problem file to begin from."""

import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from jshape.cli._shared import explained, say

if TYPE_CHECKING:
    from jshape.problems.starters import Starter

T = TypeVar("T")


@explained()
def new(
    path: Annotated[Path | None, typer.Argument(help="Where to write the problem file; problem.toml.")] = None,
    plant: Annotated[
        str | None, typer.Option(help="A plant of jshape plants, or own: a file with all of its keys.")
    ] = None,
    like: Annotated[
        str | None, typer.Option(help="A shipped problem to begin from; paper_001 without a plant.")
    ] = None,
) -> None:
    """Write a commented problem file to begin from; on a terminal, without a plant, three questions are asked."""
    from jshape._files import write_text
    from jshape.problems import starters
    from jshape.problems.reading import shipped

    if plant is not None and like is not None:
        raise ValueError(f"--plant {plant}, --like {like}: give only one of them")
    unknown = plant is None and like is None
    asked = unknown and _on_terminal()
    path = path or Path("problem.toml")
    if path.exists():
        raise ValueError(f"{path}: exists already, and is left as it is")
    if not path.parent.is_dir():
        raise ValueError(f"{path.parent}: no such folder")
    starter = _asked() if asked else None
    if plant == "own" or (asked and starter is None):
        like = starters.OWN
    elif plant is not None:
        starter = starters.find(plant)
    if starter is not None:
        write_text(path, starters.text(starter))
    else:
        _copy(shipped(), like or "paper_001", path)
    if unknown and not asked:
        say("a two-mass pair (paper_001); --plant Crane, say, for another machine: jshape plants lists them")
    say(f"{path}: written. Next: jshape tune {path}")


def _copy(files: dict[str, Path], like: str, path: Path) -> None:
    """A shipped problem, and the code beside it, if it has some."""
    from jshape._files import write_text
    from jshape.problems.catalogue import suggestion

    if like not in files:
        raise ValueError(
            f"--like: there is no shipped problem {like!r}, only {', '.join(files)}{suggestion(like, files)}"
        )
    code = files[like].with_suffix(".py")
    for source, target in ((files[like], path), (code, path.parent / code.name)):
        if source.exists() and not target.exists():
            write_text(target, source.read_text(encoding="utf-8"))


def _on_terminal() -> bool:
    # There is none where it was closed.
    return sys.stdin is not None and sys.stdin.isatty()


def _ask(question: str, default: Any, read: Callable[[str], T]) -> T:
    """The answer to a question, which is asked again until it can be read."""
    while True:
        try:
            return read(str(typer.prompt(question, default=default)))
        except ValueError as error:
            say(f"  {error}")


def _asked() -> "Starter | None":
    """The machine, how far it moves and what is uncertain of it, as answered; ``None`` for a plant of one's own."""
    from jshape.problems import catalogue
    from jshape.problems.schema import Range
    from jshape.problems.starters import STARTERS, leaf_unit
    from jshape.problems.units import quantity

    for number, starter in enumerate(STARTERS, 1):
        say(f"{number:3}  {starter.title}")
    own = len(STARTERS) + 1
    say(f"{own:3}  a plant of your own, as a Python class")

    def machine(answer: str) -> int:
        if not answer.isdecimal() or not 1 <= int(answer) <= own:
            raise ValueError(f"must be a number from 1 to {own}, not {answer!r}")
        return int(answer)

    def distance(answer: str, unit: str) -> str:
        quantity(answer, unit)
        return answer

    def ends(answer: str) -> dict[str, str]:
        found = [part.strip() for part in re.split(r"\s+to\s+|\s*…\s*", answer)]
        if len(found) != 2:
            raise ValueError(f"must be two quantities such as {default!r}, not {answer!r}")
        Range(low=found[0], high=found[1]).read(leaf_unit(starter, leaf))
        return {"low": found[0], "high": found[1]}

    chosen = _ask("Which machine", 1, machine)
    if chosen == own:
        return None
    starter = STARTERS[chosen - 1]
    move, entry = dict(starter.move), catalogue.plants()[starter.plant]
    if "distance" in move:
        read = partial(distance, unit=entry.command_unit())
        move["distance"] = _ask("How far does it move", move["distance"], read)
    for axis, unit in entry.command_units().items():
        if isinstance(inner := move.get(axis), dict):
            far = _ask(f"How far: {axis}", inner["distance"], partial(distance, unit=unit))
            move[axis] = {**inner, "distance": far}
    leaf, spread = next(iter(starter.uncertain.items()))
    default = f"{spread['low']} to {spread['high']}"
    given = _ask(f"Between what does {leaf} lie", default, ends)
    return starter._replace(move=move, uncertain={leaf: {**spread, **given}})
