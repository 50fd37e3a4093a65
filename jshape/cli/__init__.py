"""The command line.

One file a command. Nothing imports JAX before a command runs, so that help comes at once. Every command turns on
64-bit arithmetic and keeps compiled programs in the user's cache folder for the next time.
"""

import sys
from typing import Annotated

import typer

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


def main() -> None:
    """Entry point of the command line; without arguments it shows the help."""
    app(sys.argv[1:] or ["--help"])
