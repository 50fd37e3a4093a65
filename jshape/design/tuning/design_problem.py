"""The design problem that ``tune`` and ``pareto`` solve, made from their arguments.

``design_problem(...)`` checks the arguments; the result says what is minimised (``objective``, ``time_cost``), over
which designs (``bounds``), and for which moves (``scenarios``).
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import ArrayLike
from jshape.axes import Axes, Rest, for_axes
from jshape.command import AbstractCommand
from jshape.design.tuning import constraints
from jshape.design.tuning.bounds import Bounds, design_bounds, designed_leaves
from jshape.design.tuning.objective import Objective, checked_objective, objective_name, value_of
from jshape.design.tuning.scenarios import Limits, Metric, Point, Scenarios
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial, natural_frequencies, with_arrays
from jshape.sweeps.leaves import changed, check_over, grid, warn_if_absolute

FINEST = 20_000
"""Plants that the finer set has at most."""


@dataclasses.dataclass(frozen=True)
class DesignProblem:
    """The optimisation problem of a design: objective, variables and moves.

    Attributes:
        scenarios: the moves that a design is judged by.
        bounds: the designs that are considered.
        objective: what the energies of all plants come to.
        time_cost: added to the objective for each second of the shaper, J/s.
        uncertain: absolute values of each uncertain leaf.
        added: how many plants were added to the set between those given.
    """

    scenarios: Scenarios
    bounds: Bounds
    objective: Objective
    time_cost: float
    uncertain: dict[str, Array]
    added: int = 0

    @property
    def given(self) -> int:
        """The number of plants in the set as it was given; 1 without one."""
        return int(np.prod([len(values) for values in self.uncertain.values()])) if self.scenarios.samples else 1

    @property
    def zero_is_optimal(self) -> bool:
        """Whether only residual energies count, which cannot fall below zero, within limits or not."""
        return isinstance(self.objective, str) and self.scenarios.metric is None and self.time_cost == 0

    @property
    def has_roots(self) -> bool:
        """Whether the nominal plant's residual energy alone counts, of which Levenberg–Marquardt finds zeros."""
        open_ended = self.bounds.fixed_duration or self.bounds.shortest == 0
        unlimited = self.zero_is_optimal and not self.scenarios.limits.any
        return self.objective == "nominal" and unlimited and open_ended

    @property
    def over_interval(self) -> bool:
        """Whether the worst case counts, which may stand between the plants of the set."""
        return self.objective == "worst" and bool(self.scenarios.samples)

    @property
    def energy_unit(self) -> str:
        """Of what the plants are left with."""
        return self.scenarios.plant.energy_unit

    def total(self, energies: Float[np.ndarray, " plants"], point: Point) -> float:
        """The objective with the cost of the shaper's duration, J."""
        return value_of(self.objective, energies) + self.time_cost * float(np.sum(point.gaps))

    def finer_samples(self) -> dict[str, np.ndarray]:
        """A finer set: the leaves' values ten times as dense, or as dense as ``FINEST`` plants allow.

        Empty where there is no set.
        """
        if not self.scenarios.samples:
            return {}
        lengths = np.array([len(values) for values in self.uncertain.values()])
        times = next((n for n in range(10, 1, -1) if np.prod((lengths - 1.0) * n + 1) <= FINEST), 1)
        finer = {}
        for name, values in self.uncertain.items():
            at = np.arange((len(values) - 1) * times + 1) / times
            finer[name] = np.interp(at, np.arange(len(values)), np.sort(np.asarray(values)))
        return {name: np.asarray(values) for name, values in grid(finer).items()}


def design_problem(
    plant: AbstractPlant,
    command: Any,
    impulses: int,
    duration: Any,
    amplitudes: str,
    limit: float | None,
    over: Mapping[str, Any] | None,
    objective: Objective,
    *,
    relative: bool,
    initial_state: ArrayLike | None,
    limits: Limits,
    metric: Metric | None = None,
    also: Sequence[str] | Mapping[str, Any] = (),
    time_cost: float = 0.0,
    shapers: str | Sequence[str] = "shared",
) -> DesignProblem:
    """``tune``'s arguments, checked, as a design problem; *Raises* ``ValueError`` where they make no sense."""
    impulses = _check.count(impulses, "impulses", least=2)
    objective = checked_objective(objective)
    if objective != "nominal" and over is None:
        name = repr(objective) if isinstance(objective, str) else objective_name(objective)
        raise ValueError(f"over must name the uncertain leaves for objective={name}")
    if metric is not None and not callable(metric):
        raise ValueError(f"metric must be a function (plant, shaper, command) → scalar, not {metric!r}")
    _check.not_negative(time_cost := float(_check.scalar(time_cost, "time_cost")), "time_cost")
    schedule(plant, command)
    plant, command = with_arrays(plant), for_axes(command, plant.axes, type(plant).__name__)
    groups = _groups(command, shapers)
    uncertain = {} if over is None else check_over(plant, over, relative, command)
    if relative:
        warn_if_absolute(plant, over or {}, command)
    leaves = designed_leaves(plant, also, uncertain)
    count = len(groups) or 1
    bounds = design_bounds(impulses, amplitudes, limit, _durations(plant, impulses, duration), leaves, count)
    constraints.check(limits, command, plant)
    fine_steps = 1
    if limits.peak_deflection:
        # Of the set those at both ends of each leaf.
        ends = [(name, end) for name, values in uncertain.items() for end in (jnp.min(values), jnp.max(values))]
        some = [plant, *(changed(plant, command, {name: end})[0] for name, end in ends)]
        fine_steps = constraints.fine_steps(some, command, bounds.longest, impulses)
    scenarios = Scenarios(
        plant=plant,
        command=command,
        samples=grid(uncertain) if uncertain and objective != "nominal" else {},
        state=None if initial_state is None else initial(plant, initial_state),
        limits=limits,
        fine_steps=fine_steps,
        designed=tuple(leaves),
        metric=metric,
        groups=groups,
    )
    return DesignProblem(scenarios, bounds, objective, time_cost, uncertain)


def _groups(command: AbstractCommand, shapers: str | Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """The axes of each shaper; without any, one shaper shapes the whole command.

    Raises:
        ValueError: for what is neither ``"shared"`` nor ``"per axis"``, nor a list of axes that move.
    """
    moving = [axis for axis, one in command.items() if not isinstance(one, Rest)] if isinstance(command, Axes) else []
    if isinstance(shapers, str):
        _check.one_of(shapers, "shapers", ("shared", "per axis"))
        return tuple((axis,) for axis in moving) if shapers == "per axis" else ()
    _check.instance(shapers, "shapers", Collection, "a word or a list of axes")
    unknown = [repr(axis) for axis in shapers if axis not in moving]
    if unknown or not shapers:
        words = f"must be among the axes that move, {', '.join(moving)}" if moving else "names axes; the plant has one"
        raise ValueError(f"shapers {words}, not {', '.join(unknown) or list(shapers)}")
    return (tuple(shapers),)


def slowest_period(plant: AbstractPlant, argument: str) -> float:
    """Period of the slowest mode at rest, s. *Raises* ``ValueError`` that asks for the argument where there is none."""
    omega = float(np.min(np.asarray(natural_frequencies(plant))))
    if not np.isfinite(omega) or omega <= 0:
        raise ValueError(f"{argument} must be given: {type(plant).__name__} has no natural frequency at rest")
    return 2 * np.pi / omega


def _durations(plant: AbstractPlant, impulses: int, duration: Any) -> tuple[float, float]:
    """The shortest and the longest duration that a search considers, s."""
    if duration is None:
        return 0.0, (impulses - 1) * 0.75 * slowest_period(plant, "duration")
    given = np.asarray(_check.as_array(duration, "duration"), float)
    if given.ndim == 0:
        _check.positive(given, "duration")
        return float(given), float(given)
    _check.not_negative(given, "duration")
    if given.shape != (2,) or not given[0] < given[1]:
        raise ValueError(
            f"duration must be one number, or the shortest and the longest in that order, not {duration!r}"
        )
    return float(given[0]), float(given[1])
