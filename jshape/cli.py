"""The command line: ``jshape tune``, ``jshape compare``, ``jshape sweep``, ``jshape pareto``, ``jshape new``.

Nothing here imports JAX before a command runs, so that help comes at once. Every command turns on 64-bit arithmetic
and keeps compiled programs in the user's cache folder for the next time.
"""

import math
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
            files = _write_sweep(read, found, folder)
        _show_sweep(read, found, left_out)
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
        import matplotlib.pyplot as plt

        from jshape import plot
        from jshape.pareto import pareto as front_of

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
            folder.mkdir(parents=True, exist_ok=True)
            record = {"format": "jshape-results", "version": 1, "problem": read.name, "pareto": front.to_dict()}
            (folder / "results.json").write_text(_json(record), encoding="utf-8")
            front.to_netcdf(folder / "pareto.nc", engine="scipy")
            figure = plot.pareto(front)
            figure.savefig(folder / "pareto.png", dpi=300)
            figure.savefig(folder / "pareto.pdf")
            plt.close(figure)
        _show_front(read, front)
        typer.echo(f"results in {folder}: results.json, pareto.nc, pareto.png, pareto.pdf")


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


def _write_sweep(problem: "Problem", found: Any, folder: Path) -> list[str]:
    """The dataset, for one leaf as a table, too, the summary as plain numbers, and a figure for each metric."""
    import json

    import matplotlib.pyplot as plt

    from jshape import plot
    from jshape.report import MARKER
    from jshape.robustness import summary

    folder.mkdir(parents=True, exist_ok=True)
    rows = {
        str(metric): {
            str(name): {word: _plain(float(part[word].sel(shaper=name))) for word in part.data_vars}
            for name in part["shaper"].values
        }
        for metric in found.data_vars
        for part in [summary(found[metric])]
    }
    about = {name: _plain(value) if isinstance(value, float) else value for name, value in found.attrs.items()}
    record = {"format": MARKER, "version": 1, "problem": problem.name, "sweep": about, "metrics": rows}
    (folder / "results.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    found.to_netcdf(folder / "sweep.nc", engine="scipy")
    files = ["results.json", "sweep.nc"]
    leaves = [name for name in found.dims if name not in ("shaper", "sample")]
    if len(leaves) == 1:
        found.to_dataframe().to_csv(folder / "sweep.csv")
        files.append("sweep.csv")
    for metric in found.data_vars:
        # The six shapers that are best at their worst; of three leaves and more, the last at their middle.
        best = sorted(summary(found[metric])["worst"].values.argsort()[:6].tolist())
        shown = found.isel({name: found.sizes[name] // 2 for name in leaves[2:]}).isel(shaper=best)
        figure = plot.sweep(shown, str(metric))
        figure.savefig(folder / f"sweep_{metric}.png", dpi=300)
        plt.close(figure)
        files.append(f"sweep_{metric}.png")
    return files


def _show_sweep(problem: "Problem", found: Any, left_out: dict[str, str]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from jshape.robustness import summary

    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    for metric in found.data_vars:
        data = found[metric]
        unit = "" if data.attrs["units"] == "1" else f" ({data.attrs['units']})"
        title = f"{problem.title}: {data.attrs['long_name']}{unit}, {data.size // data.sizes['shaper']} plants"
        table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
        table.add_column("shaper", min_width=12)
        for heading in ("mean", "95 % quantile", "worst"):
            table.add_column(heading, justify="right", no_wrap=True)
        part = summary(data)
        for name in part["shaper"].values:
            cells = [_number(float(part[word].sel(shaper=name))) for word in ("mean", "quantile_95", "worst")]
            table.add_row(str(name), *cells)
        console.print(table)
        if "error" in data.attrs:
            console.print(f"finer steps change this by at most {data.attrs['error']:.1e}", highlight=False)
    for name, reason in left_out.items():
        console.print(f"left out: {name}: {reason}", style="dim", highlight=False)


def _plain(value: float) -> float | str:
    return value if abs(value) < float("inf") else "lost"


def _json(record: Any) -> str:
    """Plain JSON: what is not finite becomes null."""
    import json

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [plain(inner) for inner in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps(plain(record), indent=2) + "\n"


def _show_front(problem: "Problem", front: Any) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    title = f"{problem.title}: {front['objective'].attrs['long_name']} (J) for each duration"
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    table.add_column("duration (s)", justify="right")
    for name in front["design"].values:
        table.add_column(str(name), justify="right")
    for time in front["duration"].values:
        table.add_row(f"{time:.4f}", *[_number(float(v)) for v in front["objective"].sel(duration=time).values])
    console.print(table)
    for name in front["closed_form"].values:
        value, time = (float(front[key].sel(closed_form=name)) for key in ("closed_objective", "closed_duration"))
        console.print(f"{name}: {_number(value)} J in {time:.4f} s", highlight=False)


def _number(value: float) -> str:
    if value != value or value == float("inf"):
        return "lost"
    # The optimisers' stand-in for a plant that is lost.
    if abs(value) >= 1e29:
        return "lost"
    return "0" if abs(value) < 1e-18 else f"{value:.4g}"
