"""The command line: ``jshape tune``, ``jshape compare``, ``jshape new``.

Nothing here imports JAX before a command runs, so that help comes at once. Every command turns on 64-bit arithmetic
and keeps compiled programs in the user's cache folder for the next time.
"""

import os
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from jshape.problem import Problem

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Design input shapers: tune them by gradients of the residual energy, compare them with the closed forms.",
)

ProblemFile = Annotated[str, typer.Argument(help="A problem file (TOML), or the name of one that comes with jshape.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results; NAME-results unless given.")]


@app.command()
def tune(
    problem: ProblemFile,
    out: Out = None,
    starts: Annotated[int | None, typer.Option(help="Starting points; the file's unless given.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of the random starting points; the file's unless given.")] = None,
    start: Annotated[Path | None, typer.Option(help="Go on from this shaper (JSON or CSV) alone.")] = None,
) -> None:
    """Tune a shaper for a problem and set it beside every closed form that applies."""
    with _explained():
        _prepare_jax()
        from jshape import report
        from jshape.design.tune import tune as tune_shaper
        from jshape.export import read_shaper

        read, folder = _begin(problem, out)
        design = read.design
        first = None if start is None else read_shaper(start)
        with _progress() as (step, progress):
            step("tuning")
            solution = tune_shaper(
                read.plant,
                read.distance,
                impulses=design.impulses,
                duration=design.duration,
                amplitudes=design.amplitudes,
                limit=design.limit,
                over=read.over or None,
                objective=read.objective,
                starts=starts or design.starts,
                seed=design.seed if seed is None else seed,
                start=first,
                progress=progress,
            )
            result = report.build(read, solution, step)
            figures = report.write(result, folder, step)
        _show(result, folder, figures)


@app.command()
def compare(problem: ProblemFile, out: Out = None) -> None:
    """Set the closed-form shapers that apply to a problem side by side, without tuning."""
    with _explained():
        _prepare_jax()
        from jshape import report

        read, folder = _begin(problem, out)
        with _progress() as (step, _):
            result = report.build(read, None, step)
            figures = report.write(result, folder, step)
        _show(result, folder, figures)


@app.command()
def new(
    path: Annotated[Path, typer.Argument(help="Where to write the problem file.")] = Path("problem.toml"),
    like: Annotated[str, typer.Option(help="The shipped problem to begin from.")] = "paper_001",
) -> None:
    """Write a commented problem file to begin from."""
    with _explained():
        folder = Path(__file__).parent / "problems"
        names = sorted(file.stem for file in folder.glob("*.toml"))
        if like not in names:
            raise ValueError(f"--like: there is no shipped problem {like!r}, only {', '.join(names)}")
        if path.exists():
            raise ValueError(f"{path}: exists already, and is left as it is")
        if not path.parent.is_dir():
            raise ValueError(f"{path.parent}: no such folder")
        files = {path: folder / f"{like}.toml"}
        code = folder / f"{like}.py"
        if code.exists():
            files[path.parent / code.name] = code
        for target, source in files.items():
            if not target.exists():
                target.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
        typer.echo(f"{path}: written. Next: jshape tune {path}")


def main() -> None:
    """Entry point of the command line."""
    app()


def _begin(name: str, out: Path | None) -> tuple["Problem", Path]:
    from jshape import report
    from jshape.problem import find, load

    path = find(name)
    folder = out or Path(f"{path.stem}-results")
    reason = report.writable(folder)
    if reason:
        raise ValueError(reason)
    problem = load(name)
    if problem.foreign:
        typer.echo(f"{path}: runs code of its own, the plant {problem.foreign}", err=True)
    return problem, folder


def _prepare_jax() -> None:
    import jax

    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        if sys.platform == "win32":
            base = os.environ.get("LOCALAPPDATA") or base
        jax.config.update("jax_compilation_cache_dir", str(Path(base) / "jshape"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    import matplotlib as mpl

    mpl.use("Agg")


@contextmanager
def _explained() -> Any:
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
def _progress() -> Any:
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


def _show(report: Any, folder: Path, figures: list[Path]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    table = Table(title=report.problem.title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    table.add_column("shaper", min_width=12)
    table.add_column("amplitudes\nat times (s)", min_width=28)
    uncertain = bool(report.problem.over)
    words = ["move\ntime (s)", "nominal\nenergy (J)"]
    for heading in words + (["worst\nenergy (J)", "worst vi-\nbration (%)"] if uncertain else []):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in report.rows:
        impulses = [" ".join(f"{v:6.4f}" for v in part.tolist()) for part in (row.shaper.amplitudes, row.shaper.times)]
        cells = [row.name, "\n".join(impulses), f"{report.move_time(row):.4f}", _number(row.nominal_energy)]
        if uncertain:
            cells += [_number(row.worst_energy), _number(100 * row.worst_vibration)]
        table.add_row(*cells, style="bold" if row.name == "tuned" else None)
    console.print(table)
    for name, reason in report.left_out.items():
        console.print(f"left out: {name}: {reason}", style="dim", highlight=False)
    if report.solution is not None:
        console.print(f"tuned: {report.solution.result}", highlight=False)
        for line in report.gains():
            console.print(line, highlight=False)
    if uncertain:
        names = ", ".join(f"{name} × {min(v):g} … {max(v):g}" for name, v in report.problem.over.items())
        console.print(f"uncertain: {names}", highlight=False)
    console.print(f"results in {folder}, figures {', '.join(path.name for path in figures)}", highlight=False)


def _number(value: float) -> str:
    if value != value or value == float("inf"):
        return "lost"
    return "0" if abs(value) < 1e-18 else f"{value:.4g}"
