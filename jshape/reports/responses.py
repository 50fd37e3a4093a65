"""The responses of a problem's machine to its shapers, as they are drawn: a figure for each axis that moves."""

import math
from collections.abc import Iterator, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.axes import moving
from jshape.command import as_command
from jshape.plants import AbstractCrane, AbstractPlant, FlexibleJoint, FlexibleLink, SloshingTank
from jshape.plants.slewing import AbstractSlewingCrane
from jshape.problems.problem import Problem
from jshape.reports.limits_kept import limits_of
from jshape.reports.places import bent_along
from jshape.shaper import Shaping
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import natural_frequencies, prepared, simulate_fixed, steps_between
from jshape.sweeps.leaves import leaf, with_leaves

SAMPLES = 600
"""Points of a curve."""


def responses(
    problem: Problem, shapers: Mapping[str, Shaping], bare: Shaping, duration: float
) -> Iterator[tuple[str, tuple]]:
    """Name and numbers of each figure of ``plot.response``.

    The nominal plant, the ends of the uncertainty and, where it sways or the deflection has a limit, the deflection; of
    several axes a figure for each that moves.

    Args:
        problem: the problem.
        shapers: those that are drawn, by name, with equally many impulses, so that one program runs them.
        bare: no shaper, with as many.
        duration: of the longest shaped command, s.
    """
    plant, move = problem.plant, as_command(problem.distance)
    horizon = _check.scalar(shown_until(plant, duration), "horizon")
    ends = [
        with_leaves(plant, {name: end * leaf(plant, name)})
        for name, values in problem.over.items()
        for end in (min(values), max(values))
    ]
    # As many steps for all as the fastest takes, a power of two, so that one program runs them: that of the rehearsal.
    most = max(steps_between(one, schedule(one, move), horizon, SAMPLES) for one in (plant, *ends))
    steps = 2 ** math.ceil(math.log2(most))

    def run(plant: AbstractPlant, shaper: Shaping) -> SimpleNamespace:
        # The kernel that tuned and judged the shapers; its error is far below a line's width, and it compiles soonest.
        plan, plant, state = prepared(plant, shaper, move, None)
        found = simulate_fixed(plant, plan, state, horizon, SAMPLES, steps)
        return numbers_of(found, "times", "command", "payload", "deflection", "states")

    nominal = {name: run(plant, shaper) for name, shaper in shapers.items()}
    extremes = {name: [run(end, shaper) for end in ends] for name, shaper in shapers.items()}
    turning = [plant.axis_unit(i) == "rad" for i in range(max(len(plant.axes), 1))]
    liquid = isinstance(plant, SloshingTank)
    limits = limits_of(problem).peak_deflection
    sways = any(turning) or isinstance(plant, AbstractCrane) or bool(limits)
    unshaped = run(plant, bare) if sways else None
    axes = moving(plant, move)
    for i, axis in [(plant.axes.index(axis), axis) for axis in axes] or [(0, "")]:
        turns, drive = turning[i], plant.drives(i)[0]

        def along(drawn, i=i):
            return _along(plant, drawn, i)

        # A motor under a controller follows its reference.
        turned = "reference" if isinstance(plant, FlexibleJoint | FlexibleLink) else "motor"
        moved = {"displacement": turned if turns else "base", "force": ""}.get(drive, "tank" if liquid else "trolley")
        label = f"{axis} {'angle (°)' if turns else 'position (m)'}".strip()
        _, unit, words = bent_along(plant, next(iter(nominal.values())), i)
        # Of a crane that slews angles of the cable are drawn, on which there is no limit.
        limit = None if isinstance(plant, AbstractSlewingCrane) and i < 2 else limits.get(axis)
        scale = 1e3 if unit == "mm" else 180 / np.pi
        values = (
            {name: along(drawn) for name, drawn in nominal.items()},
            {name: [along(drawn) for drawn in some] for name, some in extremes.items()},
            ((axis or moved) if moved else "", "liquid" if liquid else "payload"),
            label,
            None if unshaped is None else along(unshaped),
            f"{words} ({unit})" if sways else None,
            None if limit is None else scale * float(limit),
        )
        yield f"response_{axis}" if axis else "response", values


def shown_until(plant: AbstractPlant, duration: float, frequencies: ArrayLike | None = None) -> float:
    """Until when a move is drawn, s: one and a half slow periods after the end of a shaped command of that duration.

    Args:
        plant: that moves.
        duration: of the shaped command, s.
        frequencies: natural ones of the plant, rad/s, where they are known already.
    """
    natural = float(np.min(np.asarray(natural_frequencies(plant) if frequencies is None else frequencies)))
    return duration + (3 * np.pi / natural if natural > 0 else duration)


def _along(plant: AbstractPlant, drawn: SimpleNamespace, axis: int) -> SimpleNamespace:
    """The curves of one axis: angles in degrees, deflections in degrees or mm."""
    size = 180 / np.pi if plant.axis_unit(axis) == "rad" else 1.0
    command = drawn.command
    if isinstance(plant, AbstractSlewingCrane):
        # The payload's place counts from the axis of slewing; so does that of what it hangs from.
        command = drawn.payload - drawn.deflection
    command, payload = (values[:, axis] if plant.axes else values for values in (command, drawn.payload))
    bent = bent_along(plant, drawn, axis)[0]
    return SimpleNamespace(times=drawn.times, command=size * command, payload=size * payload, deflection=bent)


def numbers_of(result: Any, *names: str) -> SimpleNamespace:
    """The named parts of a result as plain arrays."""
    return SimpleNamespace(**{name: np.asarray(getattr(result, name)) for name in names})
