"""The command line.

One file a command. Nothing imports JAX before a command runs, so that help comes at once. Every command turns on
64-bit arithmetic and keeps compiled programs in the user's cache folder for the next time.
"""

import typer

from jshape.cli.adapt import adapt
from jshape.cli.calibrate import calibrate
from jshape.cli.evaluate import evaluate
from jshape.cli.export import export
from jshape.cli.identify import identify
from jshape.cli.new import new
from jshape.cli.pareto import pareto
from jshape.cli.sweep import sweep
from jshape.cli.train import train
from jshape.cli.tune import compare, tune

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Design input shapers: tune them by gradients of the residual energy, compare them with the closed forms.",
)
for command in (tune, compare, sweep, pareto, adapt, identify, calibrate, export, train, evaluate, new):
    app.command()(command)


def main() -> None:
    """Entry point of the command line."""
    app()
