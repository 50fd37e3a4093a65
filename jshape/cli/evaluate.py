"""``jshape evaluate``: fixed, adaptive and trained policies on the same moves of an environment."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jshape.cli._shared import explained, need_environments, prepare_jax, progress

if TYPE_CHECKING:
    from jshape_envs.evaluate import Interval

COLUMNS = {
    "residual": ("residual\n(%)", 100.0),
    "move_time": ("move time\n(s)", 1.0),
    "recovery": ("moves until\nrecovered", 1.0),
    "recovered": ("within two\nmoves (%)", 100.0),
    "regret": ("regret\n(1000 ×)", 1000.0),
}
"""Scores that are shown, with what they are multiplied by."""


def evaluate(
    environment: Annotated[
        str, typer.Argument(help="DuffingPayload, CranePayload, FlexibleLinkPayload, HoistingCrane.")
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; NAME-results unless given.")] = None,
    preset: Annotated[str, typer.Option(help="easy, paper, hard or out-of-distribution.")] = "paper",
    context: Annotated[str, typer.Option(help="Is the payload hidden, observed or noisy?")] = "hidden",
    policy: Annotated[
        list[str],
        typer.Option(
            help="A baseline's name, 'trained' (the policy that comes with jshape) or a policy's file (.npz); several "
            "times. All baselines and the trained policy unless given."
        ),
    ] = [],  # noqa: B006
    episodes: Annotated[int, typer.Option(help="Of 64 moves, for each seed.")] = 64,
    seeds: Annotated[int, typer.Option(help="Sets of episodes, which the intervals are over.")] = 5,
) -> None:
    """Judge policies on an environment: residual, move time, recovery from changes, regret against the oracle."""
    with explained():
        need_environments()
        prepare_jax()
        from jshape_envs.baselines import applicable
        from jshape_envs.evaluate import evaluate, named_policy, summary
        from jshape_envs.parameters import parameters
        from jshape_envs.policy import shipped_policy

        from jshape import _check
        from jshape._files import check_writable

        folder = out or Path(f"{environment}-results")
        check_writable(folder)
        # Wrong numbers are told before the first policy has been made.
        _check.count(episodes, "--episodes")
        _check.count(seeds, "--seeds")
        params = parameters(environment, preset, context=context)
        chosen = dict(environment=environment, preset=preset, context=context, episodes=episodes, seeds=seeds)
        shipped = shipped_policy(environment, context=context)
        files = {"trained": str(shipped)} if shipped else {}
        names = list(dict.fromkeys(policy)) or [*applicable(params), *files]
        if "trained" in names and not shipped:
            raise ValueError(f"--policy: no trained policy comes with jshape for {environment}, payload {context}")
        found: dict[str, dict[str, Interval]] = {}
        with progress() as (step, tell):
            for done, name in enumerate(names):
                tell(name, done, len(names), float("inf"))
                found[name] = summary(evaluate(named_policy(files.get(name, name), params), params, episodes, seeds))
                # What is judged is kept, whatever happens to the others.
                write(chosen, found, folder)
            step("figure")
            draw(found, folder)
        show(f"{environment}, {preset}, payload {context}: {seeds} seeds of {episodes} episodes", found)
        typer.echo(f"results in {folder}: results.json, regret.png, regret.pdf")


def write(chosen: dict[str, Any], found: dict[str, dict[str, "Interval"]], folder: Path) -> None:
    """The intervals of all scores of all policies, (middle, low, high)."""
    from jshape._files import MARKER

    folder.mkdir(parents=True, exist_ok=True)
    # JSON knows no NaN.
    plain = {n: {k: [None if x != x else x for x in v] for k, v in row.items()} for n, row in found.items()}
    record = {"format": MARKER, "version": 1, **chosen, "policies": plain}
    (folder / "results.json").write_text(json.dumps(record, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def draw(found: dict[str, dict[str, "Interval"]], folder: Path) -> None:
    """The regret of each policy, a point with its interval, the least at the top."""
    import matplotlib.pyplot as plt

    from jshape.reports.plot import COLOURS, STYLE, WIDTH, save

    names = sorted(found, key=lambda name: -found[name]["regret"].middle)
    with plt.style.context(STYLE):
        figure, axis = plt.subplots(figsize=(WIDTH, 0.6 + 0.18 * len(names)))
        for place, name in enumerate(names):
            middle, low, high = (1000 * x for x in found[name]["regret"])
            axis.plot([low, high], [place, place], color=COLOURS[0])
            axis.plot(middle, place, "o", color=COLOURS[0], markersize=4)
        axis.set_yticks(range(len(names)), [Path(name).stem if name.endswith(".npz") else name for name in names])
        axis.set_xlabel("regret against the oracle, 1000 × cost of a move")
        save(figure, folder / "regret.png")


def show(title: str, found: dict[str, dict[str, "Interval"]]) -> None:
    """A row a policy: interquartile mean over the seeds and half its 95 % interval's width."""
    from rich import box
    from rich.table import Table

    from jshape.reports.tables import new_console

    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    table.add_column("policy", min_width=12)
    for heading, _ in COLUMNS.values():
        table.add_column(heading, justify="right", no_wrap=True)
    for name, row in found.items():
        cells = [(row[score], factor) for score, (_, factor) in COLUMNS.items()]
        table.add_row(name, *(f"{f * v.middle:.2f} ± {f * (v.high - v.low) / 2:.2f}" for v, f in cells))
    new_console().print(table)
