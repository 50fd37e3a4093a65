"""The drawing that moves: where the parts of a machine are in every frame, with and without a shaper."""

from typing import Any

import numpy as np

from jshape import plants
from jshape.plants import AbstractPlant
from jshape.reports.film import motion_of
from jshape.simulation.simulate import Response

FRAMES = 120
"""Of the drawing."""


def scene(plant: AbstractPlant, runs: dict[str, Response], horizon: float) -> dict[str, Any]:
    """Where the parts of the machine are in every frame.

    Args:
        plant: of the responses.
        runs: name → response.
        horizon: s, until when it is drawn.

    Returns:
        ``kind``, ``times`` (s) and for each name the ``places`` of its parts; of kind ``above`` positions in the
        horizontal plane, m.
    """
    times = np.linspace(0.0, horizon, FRAMES)
    if plant.axes:
        kind = "crane" if isinstance(plant, plants.HoistingCrane) else "above"
        places = {name: _of_axes(plant, run, times) for name, run in runs.items()}
        return {"kind": kind, "times": times, "places": places}
    motions = {name: motion_of(plant, run, times) for name, run in runs.items()}
    places = {name: motion.places for name, motion in motions.items()}
    return {"kind": motions["shaped"].kind, "times": times, "places": places}


def _of_axes(plant: AbstractPlant, run: Response, times: np.ndarray) -> np.ndarray:
    """The parts of a machine of several axes, shape (frames, parts, 2)."""
    at = np.asarray(run.times, float)
    sampled = lambda values: np.stack([np.interp(times, at, row) for row in np.asarray(values, float).T])
    payload, bent = sampled(run.payload), sampled(run.deflection)
    driven = payload - bent
    if isinstance(plant, plants.HoistingCrane):
        # From the side: the hoist lengthens the cable.
        low = -(float(plant.cable_length) + payload[1])
        return _parts((driven[0], 0 * low), (payload[0], low))
    if isinstance(plant, plants.TwoLinkArm):
        first, second = payload[0], payload[0] + payload[1] + float(plant.elbow_angle)
        upper, fore = float(plant.upper_length), float(plant.fore_length)
        elbow = upper * np.cos(first), upper * np.sin(first)
        tip = elbow[0] + fore * np.cos(second), elbow[1] + fore * np.sin(second)
        return _parts((0 * first, 0 * first), elbow, tip)
    if "slew" in plant.axes:
        around = lambda values: (values[1] * np.cos(values[0]), values[1] * np.sin(values[0]))
        return _parts((0 * times, 0 * times), around(driven), around(payload))
    return _parts((driven[0], driven[1]), (payload[0], payload[1]))


def _parts(*parts: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Parts in the order in which they hang on each other."""
    return np.stack([np.stack(part, axis=-1) for part in parts], axis=1)
