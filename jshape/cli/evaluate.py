"""``jshape evaluate``: fixed, adaptive and trained policies on the same moves of an environment."""

import json
import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jshape.cli import _shared
from jshape.cli._shared import explained, progress_line, results_folder, say

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


@explained()
def evaluate(
    environment: _shared.Environment,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; NAME-results unless given.")] = None,
    preset: _shared.Preset = "paper",
    context: _shared.Context = "hidden",
    policy: Annotated[
        list[str],
        typer.Option(
            help="A baseline's name, 'trained' (the policy that comes with jshape), 'guarded' (the same with a guard) "
            "or a policy's file (.npz); several times. All baselines and the trained policy unless given."
        ),
    ] = [],  # noqa: B006
    family: Annotated[
        str, typer.Option(help="Of shift: the true environment differs from the declared one, 'heavier' for one.")
    ] = "none",
    episodes: Annotated[int, typer.Option(help="Of 64 moves, for each seed.")] = 64,
    seeds: Annotated[int, typer.Option(help="Sets of episodes, which the intervals are over.")] = 5,
) -> None:
    """Judge policies on an environment: residual, move time, recovery from changes, regret against the oracle."""
    _shared.need_environments()
    _shared.prepare_jax()
    from jshape_envs.baselines import applicable
    from jshape_envs.evaluate import evaluate, named_policy, summary
    from jshape_envs.families import FAMILIES, informed
    from jshape_envs.parameters import parameters
    from jshape_envs.policy import policy_file
    from jshape_envs.strategies import strategy

    from jshape import _check
    from jshape._files import digest, printable, read_bytes, write_results
    from jshape.reports import plot

    # Wrong numbers are reported before the first policy has been made.
    _check.count(episodes, "--episodes")
    _check.count(seeds, "--seeds")
    _check.one_of(family, "--family", tuple(FAMILIES))
    params = parameters(environment, preset, context=context)
    true = FAMILIES[family](params)
    chosen: dict[str, Any] = dict(
        environment=environment, preset=preset, context=context, family=family, episodes=episodes, seeds=seeds
    )
    shipped = policy_file(environment, context=context).exists()
    names = list(dict.fromkeys(policy)) or [*applicable(params), *(["trained"] if shipped else [])]
    _check_names(names)
    if not {"trained", "guarded"}.isdisjoint(names) and not shipped:
        raise ValueError(f"--policy: no trained policy comes with jshape for {environment}, payload {context}")
    chosen["files"] = {name: digest(read_bytes(Path(name))) for name in names if Path(name).is_file()}
    folder = out or Path(f"{environment}-results")
    found = _judged_before(folder, chosen)
    results_folder(folder, folder.name, checkpoint="results.json" if found else "")
    if found:
        say(f"{folder}: goes on after an interrupt; judged already: {', '.join(found)}", err=True)
    with progress_line() as (step, progress):
        for done, name in enumerate(names):
            progress(name, done, len(names), math.inf)
            if name in found:
                continue
            ours = name in ("trained", "guarded")
            made = strategy(name, environment, params) if ours else named_policy(name, params)
            found[name] = summary(evaluate(informed(made, params), true, episodes, seeds))
            # What is judged is kept, whatever happens to the others.
            finished = all(name in found for name in names)
            found = {name: found[name] for name in names if name in found}
            write_results(folder, {**chosen, "finished": finished, "policies": found})
        step("figure")
        short = {name: Path(name).stem if name.endswith(".npz") else name for name in found}
        # Every training calls its policy policy.npz.
        often = Counter(short.values())
        regrets = {
            printable(short[name] if often[short[name]] == 1 else name): row["regret"] for name, row in found.items()
        }
        plot.save(plot.regret(regrets), folder / "regret.png")
    shift = "" if family == "none" else f", family {family}"
    show(f"{environment}, {preset}{shift}, payload {context}: {seeds} seeds of {episodes} episodes", found)
    say(f"results in {folder}: results.json, regret.png, regret.pdf")


def _check_names(names: list[str]) -> None:
    """*Raises* ``ValueError`` for a name that is no policy's."""
    from jshape_envs.baselines import BASELINES

    from jshape.problems.catalogue import suggestion

    for name in names:
        if name not in (*BASELINES, "trained", "guarded") and not name.endswith(".npz"):
            near = suggestion(name, [*BASELINES, "trained", "guarded"])
            words = f"a policy's file (.npz), guarded, trained or one of {', '.join(BASELINES)}, not {name!r}{near}"
            raise ValueError(f"--policy must be {words}")


def _judged_before(folder: Path, chosen: dict[str, Any]) -> "dict[str, dict[str, Interval]]":
    """What an interrupted run of the same evaluation judged: the scores of each policy."""
    from jshape_envs.evaluate import Interval

    from jshape._files import check_seal, read_text

    try:
        record = json.loads(read_text(folder / "results.json"))
        check_seal(record)
        same = record["finished"] is False and all(record[key] == value for key, value in chosen.items())
        # What ``write_results`` makes of NaN, which a single seed's interval has for its ends, and of infinity.
        words: dict[Any, float] = {None: math.nan, "diverged": math.inf}
        return {
            name: {
                score: Interval(*(words[value] if value in words else float(value) for value in interval))
                for score, interval in row.items()
            }
            for name, row in record["policies"].items()
            if same
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def show(title: str, found: dict[str, dict[str, "Interval"]]) -> None:
    """A row a policy: interquartile mean over the seeds and half its 95 % interval's width, which one seed has not."""
    from jshape.reports.tables import new_console, say, show_table

    console, rows = new_console(), []
    for name, row in found.items():
        cells = [(row[score], factor) for score, (_, factor) in COLUMNS.items()]
        widths = ["" if math.isnan(v.low) else f" ± {f * (v.high - v.low) / 2:.2f}" for v, f in cells]
        rows.append((name, [f"{f * v.middle:.2f}{width}" for (v, f), width in zip(cells, widths, strict=True)]))
    show_table(console, "policy", [heading for heading, _ in COLUMNS.values()], rows, title)
    say(console, "regret: what a move costs beyond that of an oracle that knows the payload and begins at rest")
