"""The command line.

Nothing imports JAX before a command runs, so that help comes at once. Every command turns on 64-bit arithmetic and
keeps compiled programs in the user's cache folder for the next time. One file a command:

- ``plants``: what a problem file may name.
- ``new``: a problem file to begin from.
- ``tune``: ``jshape tune`` and ``jshape compare``: a problem's shapers side by side.
- ``animate``: a film of a problem's machine.
- ``sweep``: a problem's uncertainty, plant by plant.
- ``pareto``: residual against duration.
- ``adapt``: strategies that learn while moving.
- ``identify``: modes from a CSV file.
- ``calibrate``: a printer's shaper.
- ``shape``: a sampled trajectory of joints.
- ``export``: a shaper file as a program or a line of configuration.
- ``train``: a policy trained through the physics.
- ``evaluate``: policies on the same moves.
- ``studio``: the page in the browser.

And what they share:

- ``_shared``: the problem and its folder, JAX's settings, errors in a line, progress.
- ``_artist``: figures drawn beside the computation.
- ``_interrupt``: Ctrl-C.
"""

import os
import sys
import threading
from typing import Annotated, Any, TextIO, cast

import typer

from jshape.cli._interrupt import end_at_interrupts, end_at_once
from jshape.cli.adapt import adapt
from jshape.cli.animate import animate
from jshape.cli.calibrate import calibrate
from jshape.cli.evaluate import evaluate
from jshape.cli.export import export
from jshape.cli.identify import identify
from jshape.cli.new import new
from jshape.cli.pareto import pareto
from jshape.cli.plants import plants
from jshape.cli.shape import shape
from jshape.cli.studio import studio
from jshape.cli.sweep import sweep
from jshape.cli.train import train
from jshape.cli.tune import compare, tune

app = typer.Typer(
    pretty_exceptions_enable=False,
    help="Design input shapers: tune them by gradients of the residual energy, compare them with the closed forms.",
)
COMMANDS = (
    *(plants, new, studio, tune, compare, animate, sweep, pareto, adapt),
    *(identify, calibrate, export, shape, train, evaluate),
)
for command in COMMANDS:
    app.command()(command)


def _version(asked: bool) -> bool:
    if asked:
        from jshape import __version__

        typer.echo(f"jshape {__version__}")
        raise typer.Exit
    return asked


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", help="The version.", callback=_version, is_eager=True)] = False,
) -> None:
    del version


class _Errors:
    """The error stream, of which what it does not take is dropped: a full disk for its messages ends no command."""

    def __init__(self, stream: TextIO):
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, words: str) -> int:
        try:
            return self._stream.write(words)
        except OSError:
            self._drop()
        return len(words)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            self._drop()

    def _drop(self) -> None:
        """All that is still to be said, too: at the end of the process Python would try once more."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


def main() -> None:
    """Entry point of the command line; without arguments it shows the help."""
    code: Any = None
    end_at_interrupts()
    if sys.stderr is not None:
        sys.stderr = cast(TextIO, _Errors(sys.stderr))
    try:
        app(sys.argv[1:] or ["--help"])
    except SystemExit as end:
        code = end.code
    _end_compiling(code if isinstance(code, int) else int(code is not None))
    sys.exit(code)


def _end_compiling(code: int) -> None:
    """End the process if something is being compiled, for which nobody waits, and around which it could crash."""
    module = sys.modules.get("jshape._compiling")
    if module is None or not any(thread.name == module.COMPILING for thread in threading.enumerate()):
        return
    sys.stdout.flush()
    sys.stderr.flush()
    end_at_once(code)
