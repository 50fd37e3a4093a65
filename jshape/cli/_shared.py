"""Functions that all commands share: the problem and its folder, JAX's settings, errors in a line, progress.

Nothing here imports JAX before a command runs, so that help comes at once.
"""

import atexit
import gc
import importlib.util
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jshape.cli._interrupt import prompt_interrupts, raise_interrupts

if TYPE_CHECKING:
    from jshape._types import Progress
    from jshape.problems.problem import Problem
    from jshape.problems.reading import Draft
    from jshape.shaper import Shaper

ProblemFile = Annotated[str, typer.Argument(help="A problem file (TOML), or the name of one that comes with jshape.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results; NAME-results unless given.")]

Environment = Annotated[str, typer.Argument(help="DuffingPayload, CranePayload, FlexibleLinkPayload, HoistingCrane.")]
Preset = Annotated[str, typer.Option(help="easy, paper, hard or out-of-distribution.")]
Context = Annotated[str, typer.Option(help="Is the payload hidden, observed or noisy?")]


def checked(name: str, out: Path | None) -> tuple["Draft", Path]:
    """The problem file of that name and the folder for its results, checked before JAX is loaded."""
    from jshape._files import check_unedited
    from jshape.problems.reading import read

    draft = read(name)
    folder = results_folder(out, results_name(draft.path))
    check_unedited(folder, draft.text, draft.files)
    return draft, folder


def made(draft: "Draft") -> "Problem":
    """The plant and the command of a problem file; its own code is named before it runs, odd numbers are reported."""
    if draft.foreign:
        say(f"{draft.path}: runs code of its own, the plant {draft.foreign}", err=True)
    prepare_jax()
    from jshape.problems.problem import load

    problem = load(draft)
    # What looks absolute has been questioned in the file's own words.
    warnings.filterwarnings("ignore", r"over\[.* are multiples of the nominal")
    for question in problem.questions:
        say(f"warning: {question}", err=True)
    return problem


def results_folder(out: Path | None, name: str, checkpoint: str = "") -> Path:
    """The folder asked for, or the one of that name.

    Args:
        out: as asked for.
        name: of the folder, unless one is asked for.
        checkpoint: the file in it from which a command resumes: where there is one, nothing is overwritten.

    Raises:
        ValueError: if it holds files that are not jshape's, or cannot be written to.
    """
    from jshape._files import check_writable

    folder = out or Path(name)
    check_writable(folder)
    resumed = checkpoint and (folder / checkpoint).exists()
    if (folder / "results.json").exists() and not resumed:
        say(f"{folder}: holds an earlier result, which a new one replaces", err=True)
    return folder


def results_name(problem: Path) -> str:
    """The folder for the results of a problem file, NAME-results; X-problem-results for the one that ``identify`` wrote
    into X-results, so that those of two axes do not meet."""
    identified = problem.stem == "problem" and problem.parent.name.endswith("-results")
    before = problem.parent.name.removesuffix("results") if identified else ""
    return f"{before}{problem.stem}-results"


def plants_of(problem: "Problem") -> int:
    """The number of plants in the uncertain set of a problem; one where there is none."""
    return math.prod(len(values) for values in problem.over.values())


def check_new(force: bool, *paths: Path) -> None:
    """Check that no file is written over that is not meant to be.

    Raises:
        ValueError: for one that exists, unless that is forced.
    """
    for path in paths:
        if path.exists() and not force:
            raise ValueError(f"{path}: exists already, and is left as it is; --force writes over it")


def check_store(store: Path | None, folder: Path) -> None:
    """Check that a store lies beside the results: in their folder it would be taken for files that are not jshape's.

    Raises:
        ValueError: for one in the folder of the results.
    """
    if store is None:
        return
    # Not Path.resolve(), which raises where links lead in a circle: what opens them says so.
    place, within = (Path(os.path.realpath(each)) for each in (store, folder))
    if within in (place, *place.parents):
        raise ValueError(f"--store {store}: must not lie in the folder of the results, {folder}")


def prepare_jax() -> None:
    """64-bit arithmetic, kept programs, and a process that ends quickly."""
    import jax

    from jshape.compilation_cache import keep_programs

    jax.config.update("jax_enable_x64", True)
    keep_programs()
    raise_interrupts()
    # Traces are hundreds of thousands of small objects; by default the collector would walk through all of JAX for
    # every few hundred of them, which takes a tenth of a command's time.
    gc.set_threshold(100_000, 50, 50)
    # The same at the end, where everything goes anyway.
    atexit.register(gc.freeze)
    # Figures are written, never shown.
    os.environ["MPLBACKEND"] = "Agg"


def need_environments() -> None:
    """Check that Gymnasium, which the environments need, is installed.

    Raises:
        ValueError: if it is not.
    """
    if importlib.util.find_spec("gymnasium") is None:
        raise ValueError("this command needs the environments: pip install 'jshape[envs]'")


LONGEST = 3000
"""Characters of an error's line."""

FULL = ("RESOURCE_EXHAUSTED", "Out of memory")

PLAIN = 5.0
"""Seconds between lines of progress where the stream is no terminal."""


@contextmanager
def explained() -> Iterator[None]:
    """Report what the user did wrong, and a file that cannot be written, in a line; an interrupt ends within seconds.

    What cannot be printed, such as a file's name that is no UTF-8, is printed as escapes.
    """
    for stream in (sys.stdout, sys.stderr):
        # Not every stream can: a test's, say, or none where it was closed.
        if reconfigure := getattr(stream, "reconfigure", None):
            reconfigure(errors="backslashreplace")
    try:
        with prompt_interrupts():
            yield
    except (ValueError, OSError, MemoryError, RuntimeError) as error:
        # JAX's own error where the memory is full says so in one way or another.
        full = isinstance(error, MemoryError)
        full |= isinstance(error, RuntimeError) and any(words in str(error) for words in FULL)
        if isinstance(error, BrokenPipeError) or (isinstance(error, RuntimeError) and not full):
            raise
        words = "the memory is full" if full else str(error)
        if isinstance(error, OSError) and error.strerror and error.filename is not None:
            words = f"{error.filename}: {error.strerror}"
        from jshape._files import in_a_line

        # A message may quote what was given, which may be anything, of any length.
        say(f"jshape: {in_a_line(words, LONGEST)}", err=True)
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        say("jshape: interrupted", err=True)
        raise typer.Exit(130) from None


def say(words: str, *, err: bool = False) -> None:
    """Print a text, or on the error stream; what a terminal would obey in a file's name stands there as an escape."""
    from jshape._files import escaped

    typer.echo("\n".join(map(escaped, words.split("\n"))), err=err)


@contextmanager
def progress_line() -> Iterator[tuple[Callable[[str], None], "Progress"]]:
    """A line on the error stream: what is being done, how far it is, the time left and the best value so far.

    Where the stream is no terminal, a plain line at once and then every ``PLAIN`` seconds.

    Yields:
        ``step(stage)`` for what has no end in sight, and ``progress(stage, done, total, best)``.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, markup=False, emoji=False)
    began: dict[str, float] = {}
    printed = -math.inf

    def described(stage: str, done: int, total: int, best: float) -> str:
        elapsed = time.monotonic() - began.setdefault(stage, time.monotonic())
        words = f"{stage} {done}/{total}" if total else stage
        if 0 < done < total and elapsed > 0.5:
            words += f" ({done / total:.0%}), about {elapsed * (total - done) / done:.0f} s left"
        return words + (f", best {best:.6g}" if best < math.inf else "")

    if not console.is_terminal:

        def plain(stage: str, done: int, total: int, best: float) -> None:
            nonlocal printed
            words = described(stage, done, total, best)
            if time.monotonic() - printed >= PLAIN:
                printed = time.monotonic()
                say(words, err=True)

        yield lambda stage: plain(stage, 0, 0, math.inf), plain
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(20), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)

        def progress(stage: str, done: int, total: int, best: float) -> None:
            bar.update(task, description=described(stage, done, total, best), total=total or None, completed=done)

        yield lambda stage: progress(stage, 0, 0, math.inf), progress


def announced(command: Any, plants: int, rows: int, what: str, impulses: int) -> None:
    """Say on the error stream how much work there is.

    Args:
        command: of the move.
        plants: how many there are.
        rows: how many of what each of them meets.
        what: starts or shapers, in the plural.
        impulses: of a shaper, at most.
    """
    import jax

    from jshape.command import as_command

    segments = jax.eval_shape(as_command(command).pieces)[0].shape[0] * impulses - 1
    words = f"{plants:,} plants × {rows:,} {what} × {segments} segments of a move, each in the steps that it needs"
    say(f"work: {words}", err=True)


def most_impulses(shapers: Iterable["Shaper | dict[str, Shaper]"]) -> int:
    """The number of impulses of the shaper that has most."""
    each = [one for shaper in shapers for one in (shaper.values() if isinstance(shaper, dict) else [shaper])]
    return max(len(shaper.times) for shaper in each)
