"""What every command shares: the problem and its folder, JAX's settings, errors in a line, progress.

Nothing here imports JAX before a command runs, so that help comes at once.
"""

import atexit
import gc
import importlib.util
import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from jshape.problems.problem import Problem

ProblemFile = Annotated[str, typer.Argument(help="A problem file (TOML), or the name of one that comes with jshape.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results; NAME-results unless given.")]


def begin(name: str, out: Path | None) -> tuple["Problem", Path]:
    from jshape._files import check_writable
    from jshape.problems.problem import find, load

    path = find(name)
    folder = out or Path(f"{path.stem}-results")
    check_writable(folder)
    problem = load(name)
    if problem.foreign:
        typer.echo(f"{path}: runs code of its own, the plant {problem.foreign}", err=True)
    return problem, folder


def prepare_jax() -> None:
    import jax

    from jshape.compilation_cache import keep_programs

    jax.config.update("jax_enable_x64", True)
    keep_programs()
    # Traces are hundreds of thousands of small objects; by default the collector would walk through all of JAX for
    # every few hundred of them, which takes a tenth of a command's time.
    gc.set_threshold(100_000, 50, 50)
    # The same at the end, where everything goes anyway.
    atexit.register(gc.freeze)
    # Figures are written, never shown.
    os.environ["MPLBACKEND"] = "Agg"


def need_environments() -> None:
    """*Raises* ``ValueError`` where Gymnasium, which the environments need, is not installed."""
    if importlib.util.find_spec("gymnasium") is None:
        raise ValueError("this command needs the environments: pip install 'jshape[envs]'")


@contextmanager
def explained() -> Any:
    """What the user did wrong is told in a line, without a traceback; an interrupt ends quietly."""
    try:
        yield
    except ValueError as error:
        typer.echo(f"jshape: {error}", err=True)
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        typer.echo("jshape: interrupted", err=True)
        raise typer.Exit(130) from None


@contextmanager
def progress() -> Any:
    """A line on the error stream that says what is being done, how far it is and the best value so far."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(20), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)

        def step(words: str) -> None:
            bar.update(task, description=words, total=None)

        def progress(stage: str, done: int, total: int, best: float) -> None:
            words = f"{stage} {done}/{total}" + (f", best {best:.6g} J" if best < float("inf") else "")
            bar.update(task, description=words, total=total, completed=done)

        yield step, progress
