"""``jshape studio``: the page in the browser."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from jshape.cli._shared import explained, prepare_jax, say


@explained()
def studio(
    problem: Annotated[
        str | None,
        typer.Argument(help="A problem file (TOML), one that comes with jshape, or a studio's link."),
    ] = None,
    port: Annotated[int, typer.Option(help="On this machine; a free one unless given.")] = 0,
    show: Annotated[bool, typer.Option(help="Open the browser.")] = True,
    code: Annotated[
        bool, typer.Option("--allow-code", help="Run the code that a problem file names as module:Class.")
    ] = False,
) -> None:
    """Open a page in the browser, on this machine alone: move a slider, see the swing."""
    if importlib.util.find_spec("nicegui") is None:
        raise ValueError("the studio needs its page's library: pip install 'jshape[studio]'")
    if not 0 <= port <= 65535:
        raise ValueError(f"--port must lie between 0 and 65535, not {port}")
    from jshape.problems.reading import read
    from jshape.studio.own_code import allow_code
    from jshape.studio.state import begin, from_draft, left_out

    if code:
        allow_code(Path.cwd())
    if problem is None:
        state = begin("TwoMass")
    elif problem.startswith("http"):
        from jshape.studio.link import from_address

        state = from_address(problem)
    else:
        draft = read(problem)
        if code:
            # Its plant's class is made with the precision of every other command.
            prepare_jax()
            allow_code(draft.path.resolve().parent)
        state = from_draft(draft)
        if tables := left_out(draft):
            say(f"{draft.path}: {', '.join(tables)} is not on the page, nor in its problem file", err=True)
    from jshape.studio.server import serve

    serve(state, port, show, _say, prepare_jax)


def _say(address: str) -> None:
    say(f"the studio is at {address}\nCtrl-C ends it")
