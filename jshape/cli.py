"""The command line: ``jshape tune``, ``jshape compare``, ``jshape sweep``, ``jshape pareto``, ``jshape new``.

Nothing here imports JAX before a command runs, so that help comes at once. Every command turns on 64-bit arithmetic
and keeps compiled programs in the user's cache folder for the next time.
"""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
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
        from jshape.tables import show_report

        read, folder = _begin(problem, out)
        design = read.design
        first = None if start is None else read_shaper(start)
        # The closed forms are compiled beside the search: with two cores that saves some seconds of a first run.
        with _progress() as (step, progress), ThreadPoolExecutor(1) as beside:
            closed = beside.submit(report.closed_forms, read)
            step("tuning")
            given = design.model_dump(exclude={"objective", "starts", "seed"})
            solution = tune_shaper(
                read.plant,
                read.distance,
                over=read.over or None,
                objective=read.objective,
                starts=starts or design.starts,
                seed=design.seed if seed is None else seed,
                start=first,
                progress=progress,
                **given,
            )
            result = report.build(read, solution, step, closed.result())
            figures = report.write(result, folder, step)
        show_report(result, folder, figures)


@app.command()
def compare(problem: ProblemFile, out: Out = None) -> None:
    """Set the closed-form shapers that apply to a problem side by side, without tuning."""
    with _explained():
        _prepare_jax()
        from jshape import report
        from jshape.tables import show_report

        read, folder = _begin(problem, out)
        with _progress() as (step, _):
            result = report.build(read, None, step)
            figures = report.write(result, folder, step)
        show_report(result, folder, figures)


@app.command()
def sweep(
    problem: ProblemFile,
    out: Out = None,
    metric: Annotated[list[str], typer.Option(help="What to compute; may be given several times.")] = [  # noqa: B006
        "residual_vibration"
    ],
    shaper: Annotated[
        list[Path], typer.Option(help="A shaper of yours (JSON or CSV) beside the closed forms; several times.")
    ] = [],  # noqa: B006
    samples: Annotated[int | None, typer.Option(help="Draw so many plants; all combinations unless given.")] = None,
    sampling: Annotated[
        str,
        typer.Option(help="sobol, latin hypercube, uniform or normal (the range is then four standard deviations)."),
    ] = "sobol",
    seed: Annotated[int, typer.Option(help="Of the samples.")] = 0,
    store: Annotated[Path | None, typer.Option(help="Folder that keeps what is done, to go on after Ctrl-C.")] = None,
) -> None:
    """Sweep a problem's uncertainty: every closed form that applies and shapers of yours, on every plant."""
    with _explained():
        _prepare_jax()
        from jshape import robustness
        from jshape.export import read_shaper
        from jshape.report import closed_forms
        from jshape.results import write_sweep
        from jshape.tables import show_sweep

        read, folder = _begin(problem, out)
        if not read.over:
            raise ValueError(f"{problem}: nothing is uncertain; it needs an [uncertainty] table")
        if store is not None and folder.resolve() in (store.resolve(), *store.resolve().parents):
            raise ValueError(f"--store {store}: must not lie in the folder of the results, {folder}")
        over: dict[str, Any] = dict(read.over)
        if samples is not None:
            ends = {name: (float(min(values)), float(max(values))) for name, values in read.over.items()}
            spread = lambda low, high: ((low + high) / 2, (high - low) / 4) if sampling == "normal" else (low, high)
            over = {name: spread(*pair) for name, pair in ends.items()}
        with _progress() as (step, progress):
            step("closed-form shapers")
            shapers, left_out = closed_forms(read)
            for path in shaper:
                if path.stem in shapers:
                    raise ValueError(f"--shaper {path}: there is a shaper of that name already, {path.stem!r}")
                shapers[path.stem] = read_shaper(path)
            step("sweep")
            try:
                found = robustness.sweep(
                    read.plant,
                    shapers,
                    read.distance,
                    over,
                    metric,
                    samples=samples,
                    sampling=sampling,
                    seed=seed,
                    store=store,
                    progress=lambda done, pieces: progress("sweep, piece", done, pieces, float("inf")),
                )
            except KeyboardInterrupt:
                again = f"what is done lies in {store}; the same command goes on from there"
                typer.echo(again if store else "nothing is kept; with --store DIR it goes on after Ctrl-C", err=True)
                raise
            step("files")
            files = write_sweep(read, found, folder)
        show_sweep(read, found, left_out)
        typer.echo(f"results in {folder}: {', '.join(files)}")


@app.command()
def pareto(
    problem: ProblemFile,
    out: Out = None,
    store: Annotated[
        Path | None, typer.Option(help="Folder that keeps finished fronts, to go on after Ctrl-C.")
    ] = None,
) -> None:
    """How much residual a shaper's duration buys: the front for each number of impulses, the closed forms beside it."""
    with _explained():
        _prepare_jax()
        from jshape.pareto import pareto as front_of
        from jshape.results import write_front
        from jshape.tables import show_front

        read, folder = _begin(problem, out)
        with _progress() as (step, progress):
            step("closed-form shapers")
            front = front_of(
                read.plant,
                read.distance,
                over=read.over or None,
                objective=read.objective,
                store=store,
                progress=progress,
                **read.front.model_dump(),
            )
            step("files")
            files = write_front(read, front, folder)
        show_front(read, front)
        typer.echo(f"results in {folder}: {', '.join(files)}")


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
