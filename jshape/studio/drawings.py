"""The drawings that move, as ``scene.js`` takes them: where a machine's parts are in every frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jshape.studio import words
from jshape.studio.results import Ends, Moves


def scene(moves: Moves, ends: Ends | None = None) -> dict[str, Any]:
    """The drawing that moves, with and without the shaper, and at both ends of what is uncertain."""
    kind, times, places = (moves.scene[key] for key in ("kind", "times", "places"))
    if ends is None:
        return drawing(kind, times, places)
    low, high = (f"{value:.4g}" for value in ends.at)
    # Behind the others what is large, before them what is small.
    ordered = {"high": ends.places["high"], **places, "low": ends.places["low"]}
    return drawing(kind, times, ordered) | {"note": words.BOTH_ENDS.format(leaf=ends.leaf, low=low, high=high)}


def episode(found: dict[str, Any], titles: Sequence[str]) -> dict[str, Any]:
    """The drawing of an episode under two strategies beside each other.

    Args:
        found: of ``episodes.episode``.
        titles: of both.
    """
    first, second = map(np.asarray, found["places"])
    places = {"unshaped": first, "shaped": second}
    return drawing(found["kind"], np.asarray(found["times"]), places) | {"titles": list(titles)}


def drawing(kind: str, times: np.ndarray, given: dict[str, np.ndarray]) -> dict[str, Any]:
    """Where the parts of a machine are in every frame, and what of the plane is seen.

    Args:
        kind: as of ``reports.places.Motion``.
        times: of the frames, s.
        given: name → places of the parts.
    """
    places = {name: np.round(values, 5) for name, values in given.items()}
    seen = np.concatenate([np.nan_to_num(values).reshape(-1, 2) for values in places.values()])
    (left, low), (right, top) = seen.min(axis=0).tolist(), seen.max(axis=0).tolist()
    wide, gap = max(right - left, 1e-6), 0.0
    if kind == "link":
        view = [-1.25, 1.25, -1.25, 1.25]
    elif kind == "masses":
        # Apart by more than the spring is ever compressed.
        gap = wide / 4 + max(float(np.max(values[:, 0, 0] - values[:, 1, 0])) for values in places.values())
        view = [left - 0.12 * wide, right + gap + 0.12 * wide, -0.05 * wide, 0.3 * wide]
    else:
        edge = 0.1 * max(wide, top - low)
        view = [left - edge, right + edge, low - edge, top + edge]
    frames = {name: np.nan_to_num(values).tolist() for name, values in places.items()}
    return {"kind": kind, "times": times.round(4).tolist(), "places": frames, "view": view, "gap": gap}
