"""``jshape animate``: a film of a problem's machine, unshaped beside shaped."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jshape.cli import _shared

if TYPE_CHECKING:
    from jshape.problems.problem import Problem
    from jshape.shaper import Shaping


@_shared.explained()
def animate(
    problem: _shared.ProblemFile,
    out: Annotated[Path | None, typer.Option(help="The film, .gif or .mp4 (by ffmpeg); NAME.gif unless given.")] = None,
    shaper: Annotated[
        Path | None,
        typer.Option(
            help="A shaper file (JSON, CSV or npz), or a folder of jshape tune; unless given, the one in NAME-results "
            "if it is of this problem, or else the best closed form."
        ),
    ] = None,
    policy: Annotated[
        str | None,
        typer.Option(
            help="PROBLEM is then an environment: a baseline's name, 'trained' (the policy that comes with jshape), "
            "'guarded' (the same with a guard) or a policy's file (.npz), which chooses the shapers of the moves."
        ),
    ] = None,
    moves: Annotated[int, typer.Option(help="Of the episode, with --policy.")] = 6,
    payload: Annotated[
        list[float],
        typer.Option(
            help="With --policy: payloads that follow one another, unannounced, each for as many moves; several times, "
            "--payload 0.1 --payload 0.3. Drawn by chance unless given."
        ),
    ] = [],  # noqa: B006
    speed: Annotated[float, typer.Option(help="At which it is played: 1 is true time, 0.1 ten times slower.")] = 1.0,
    force: Annotated[bool, typer.Option("--force", help="Write over a film that exists.")] = False,
) -> None:
    """Write a film (GIF or MP4) of the machine's move, unshaped beside shaped, in true time."""
    from jshape.problems.reading import read

    if policy is not None:
        if shaper is not None or speed != 1:
            raise ValueError("--policy: takes neither --shaper nor --speed")
        _episode(str(problem), _free(out or Path(f"{problem}.gif"), force), policy, moves, payload)
        return
    if payload:
        raise ValueError("--payload: is for the moves of an episode, with --policy")
    draft = read(problem)
    path = _free(out or Path(f"{draft.path.stem}.gif"), force)
    loaded = _shared.made(draft)
    from jshape.command import as_command
    from jshape.problems.catalogue import READERS
    from jshape.problems.machine_files import beside
    from jshape.reports.film import check_film, film, save_film
    from jshape.reports.responses import shown_until
    from jshape.simulation.simulate import simulate
    from jshape.sweeps.evaluate import alike_shapers

    check_film(path)
    with _shared.progress_line() as (step, progress):
        name, chosen = _chosen(loaded, shaper, Path(_shared.results_name(draft.path)), step)
        step("responses")
        move = as_command(loaded.distance)
        bare, alike = alike_shapers([None, chosen], loaded.plant.axes)
        longest = max(float(each.duration) for each in (alike.values() if isinstance(alike, dict) else [alike]))
        horizon = shown_until(loaded.plant, longest + float(move.duration))
        runs = {
            label: simulate(loaded.plant, move, each, horizon=horizon, samples=2001, method="fixed")
            for label, each in (("unshaped", bare), (name, alike))
        }
        for label, run in runs.items():
            if not run.converged:
                raise ValueError(f"{label}: {run.message}")
        model = beside(draft.lines, draft.plant.values["file"]) if draft.plant.kind in READERS else None
        pictures = film(loaded.plant, runs, speed, model=model)
        save_film(pictures, path, progress)
    _shared.say(f"{path}: {name} beside the bare command, {horizon:.4g} s")


def _free(path: Path, force: bool) -> Path:
    """The film's path, where no other film is written over."""
    if path.is_dir():
        raise ValueError(f"{path}: is a folder, not a film")
    _shared.check_new(force, path)
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.parent}")
    return path


def _episode(environment: str, path: Path, policy: str, moves: int, payloads: list[float]) -> None:
    """Write the film of an episode."""
    _shared.need_environments()
    _shared.prepare_jax()
    from jshape_envs.evaluate import named_policy
    from jshape_envs.film import episode_film
    from jshape_envs.parameters import parameters
    from jshape_envs.strategies import strategy

    from jshape.reports.film import check_film, save_film

    check_film(path)
    params = parameters(environment)
    with _shared.progress_line() as (step, progress):
        step("episode")
        from_file = policy.endswith(".npz")
        chosen = named_policy(policy, params) if from_file else strategy(policy, environment, params)
        film = episode_film(params, chosen, Path(policy).stem, moves, payloads=payloads)
        save_film(film, path, progress)
    _shared.say(f"{path}: {moves} moves of {environment} by {policy}, beside the same ones without a shaper")


def _chosen(
    problem: "Problem", given: Path | None, results: Path, step: Callable[[str], None]
) -> tuple[str, "Shaping"]:
    """The shaper to show, or one for each axis, and what it is called.

    Args:
        problem: the problem.
        given: a shaper file or a folder of results, if one is asked for.
        results: the folder that is looked into otherwise.
        step: called with what is being done.

    Raises:
        ValueError: for a folder that is given and holds no tuned shaper of this problem.
    """
    from jshape.export import read_shaper, read_tuned
    from jshape.reports import report

    if given is not None and not given.is_dir():
        shaper = read_shaper(given)
        split = report.split_between({"": shaper}, problem.design.sample_time)
        return given.stem, report.placed(problem, split.get("", shaper))
    folder = results if given is None else given
    wrong = _not_of(problem, folder)
    if wrong is None:
        return "tuned", read_tuned(folder)
    if given is not None:
        raise ValueError(f"--shaper {wrong}")
    if folder.exists():
        _shared.say(f"{wrong}; the best closed form is shown", err=True)
    row = report.best(report.build(problem, None, step))
    return row.name, report.placed(problem, row.played or row.shaper)


def _not_of(problem: "Problem", folder: Path) -> str | None:
    """The reason for which a folder's tuned shaper is not of this problem; ``None`` if it is."""
    from jshape._files import digest, read_text
    from jshape.export import read_tuned

    try:
        record = json.loads(read_text(folder / "results.json"))
        same = record["problem_digest"] == digest(problem.text)
        same = same and record.get("file_digests", {}) == {name: digest(each) for name, each in problem.files.items()}
    except (ValueError, KeyError, TypeError, RecursionError):
        return f"{folder}: holds no results of jshape tune"
    try:
        read_tuned(folder)
    except ValueError as error:
        return str(error)
    return None if same else f"{folder}: holds the results of another problem file, or of an earlier text of this one"
