"""``jshape sweep``: a problem's uncertainty, plant by plant."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from jshape.cli import _shared


@_shared.explained()
def sweep(
    problem: _shared.ProblemFile,
    out: _shared.Out = None,
    metric: Annotated[list[str], typer.Option(help="What to compute; may be given several times.")] = [  # noqa: B006
        "residual_vibration"
    ],
    shaper: Annotated[
        list[Path],
        typer.Option(
            help="A shaper of yours (JSON, CSV), or a folder of jshape tune, beside the closed forms; several times."
        ),
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
    draft, folder = _shared.checked(problem, out)
    if not draft.over:
        raise ValueError(f"{problem}: nothing is uncertain; it needs an [uncertainty] table")
    _shared.check_store(store, folder)
    read = _shared.made(draft)
    from jshape._files import printable
    from jshape.design.closed_forms import closed_forms
    from jshape.export import read_shaper, read_tuned
    from jshape.reports.report import placed, split_between
    from jshape.reports.results import write_sweep
    from jshape.reports.tables import show_sweep
    from jshape.sweeps.sweep import sweep as sweep_plants

    over: dict[str, Any] = dict(read.over)
    if samples is not None:
        for name, values in read.over.items():
            low, high = float(min(values)), float(max(values))
            over[name] = ((low + high) / 2, (high - low) / 4) if sampling == "normal" else (low, high)
    with _shared.progress_line() as (step, progress):
        step("closed-form shapers")
        closed, left_out = closed_forms(read.plant, read.distance)
        shapers: dict[str, Any] = dict(closed)
        for path in shaper:
            name = printable(path.stem)
            if name in shapers:
                raise ValueError(f"--shaper {path}: there is a shaper of that name already, {name!r}")
            shapers[name] = read_tuned(path) if path.is_dir() else read_shaper(path)
        split = split_between(shapers, read.design.sample_time)
        shapers = {name: placed(read, split.get(name, one)) for name, one in shapers.items()}
        plants = samples or math.prod(len(values) for values in over.values())
        _shared.announced(read.distance, plants, len(shapers), "shapers", _shared.most_impulses(shapers.values()))
        step("sweep")
        try:
            found = sweep_plants(
                read.plant,
                shapers,
                read.distance,
                over,
                metric,
                samples=samples,
                sampling=sampling,
                seed=seed,
                store=store,
                progress=progress,
            )
        except KeyboardInterrupt:
            again = f"finished chunks are in {store}; the same command resumes the sweep"
            alone = "nothing is kept; with --store DIR the sweep can be resumed after Ctrl-C"
            _shared.say(again if store else alone, err=True)
            raise
        step("files")
        files = write_sweep(read, found, folder)
    show_sweep(read, found, left_out, bool(split))
    _shared.say(f"results in {folder}: {', '.join(files)}")
