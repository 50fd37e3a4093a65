"""The tasks of the panel Learn: an episode of an environment under two strategies, and the leaderboard."""

import importlib.util
from typing import TYPE_CHECKING, Any

import numpy as np

from jshape._types import Progress

if TYPE_CHECKING:
    from jshape.moves import Params

FRAMES = 20
"""Pictures a second."""

LONGEST = 12
"""Moves of an episode that is watched."""

MOST = (64, 5)
"""Episodes of a seed, and seeds, over which a strategy is judged."""

SCORES = {"residual": 100.0, "move_time": 1.0, "recovery": 1.0, "recovered": 100.0, "regret": 1000.0}
"""Of the leaderboard, with what they are multiplied by."""


def episode(asked: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """Watch the first moves of an episode under two strategies, with the same payloads and distances.

    Args:
        asked: ``environment``, ``preset``, two ``strategies``, the number of ``moves`` and the ``seed``.
        progress: of ``jshape.tune``.

    Returns:
        The ``kind`` of drawing, the ``times`` of its frames (s), when each move ``begins`` (s), and for both, as lists,
        the ``places`` of the machine's parts; ``moves``, rows with ``payload``, ``distance`` and both ``residuals``.
        Where a strategy's move takes longer, the other waits for it.
    """
    moves, seed = _count(asked["moves"], "moves", LONGEST), _count(asked["seed"], "seed", 10**6, 0)
    if len(asked["strategies"]) != 2:
        raise ValueError(f"strategies must be two, not {len(asked['strategies'])}")
    params = _params(asked)
    from jshape_envs.film import watched_moves
    from jshape_envs.strategies import strategy

    from jshape.reports.places import motion_of

    watched: list[list[Any]] = []
    for done, name in enumerate(asked["strategies"]):
        progress(f"{name}: designed", done, 2, np.inf)
        chosen = strategy(name, asked["environment"], params)
        progress(f"{name}: moves", done, 2, np.inf)
        watched.append(list(watched_moves(params, chosen, moves, seed)))
    times, begins, places, rows = [], [], [[], []], []
    kind, now = "", 0.0
    for number, both in enumerate(zip(*watched, strict=False), 1):
        until = max(float(each.shaped.times[-1]) for each in both)
        frames = np.arange(0.0, until, 1 / FRAMES)
        for shown, each in zip(places, both, strict=True):
            motion = motion_of(each.plant, each.shaped, frames)
            kind = motion.kind
            shown.append(np.round(motion.places, 4))
        times.append(now + frames)
        begins.append(round(now, 3))
        now += until
        residuals = [each.residual for each in both]
        rows.append(dict(move=number, payload=both[0].payload, distance=both[0].distance, residuals=residuals))
    if not rows or not all(np.all(np.isfinite(part)) for shown in places for part in shown):
        raise ValueError("the plant diverged in this episode; choose another seed or preset")
    joined = [np.concatenate(shown).tolist() for shown in places]
    return {"kind": kind, "times": np.concatenate(times).round(3).tolist(), "begins": begins, "places": joined,
            "moves": rows}  # fmt: skip


def leaderboard(asked: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """Judge all strategies of an environment on the same episodes, as ``jshape evaluate`` does.

    Args:
        asked: ``environment``, ``preset``, the number of ``episodes`` and of ``seeds``.
        progress: with the least regret so far, 1000 ×.

    Returns:
        What was ``asked``; ``rows``: for each strategy its ``policy`` and, by the names of ``SCORES``, interquartile
        means over the seeds, after an interrupt those that were judged until then; and a ``message``.
    """
    episodes, seeds = (_count(asked[key], key, most) for key, most in zip(("episodes", "seeds"), MOST, strict=True))
    params = _params(asked)
    from jshape_envs.evaluate import evaluate, interquartile_mean
    from jshape_envs.families import informed
    from jshape_envs.strategies import strategies, strategy

    rows: list[dict[str, Any]] = []
    names = strategies(asked["environment"], params)
    try:
        for done, name in enumerate(names):
            progress(name, done, len(names), min((row["regret"] for row in rows), default=np.inf))
            made = strategy(name, asked["environment"], params)
            found = evaluate(informed(made, params), params, episodes, seeds)._asdict()
            means = {key: factor * float(interquartile_mean(found[key])) for key, factor in SCORES.items()}
            rows.append({"policy": name} | {key: x if np.isfinite(x) else None for key, x in means.items()})
    except KeyboardInterrupt:
        if not rows:
            raise
    return {"asked": asked, "rows": rows, "message": f"{len(rows)} of {len(names)} strategies judged"}


def _params(asked: dict[str, Any]) -> "Params":
    """The environment that is asked for.

    Raises:
        ValueError: where Gymnasium, which the environments need, is missing, and for unknown names.
    """
    if importlib.util.find_spec("gymnasium") is None:
        raise ValueError("this needs the environments: pip install 'jshape[envs]'")
    from jshape_envs.parameters import parameters

    return parameters(asked["environment"], asked["preset"])


def _count(given: Any, name: str, most: int, least: int = 1) -> int:
    if not isinstance(given, int | float) or given != int(given) or not least <= given <= most:
        raise ValueError(f"{name} must be a whole number from {least} to {most}, not {given!r}")
    return int(given)
