"""A shaper tuned by gradients of the residual energy, for any plant and any command.

``js.tune(plant, 1.0, impulses=2)`` drives the nominal plant's residual energy to zero; with an uncertain set it looks
for the shaper that is best in the worst case, on average or in the tail::

    sol = js.tune(plant, 1.0, impulses=3, duration=1.643, objective="worst", over={"m2": jnp.linspace(0.8, 1.2, 41)})
    sol.shaper, sol.objective, sol.status
"""

from collections.abc import Mapping, Sequence
from typing import Any

from jshape import _check
from jshape._types import ArrayLike, Progress, silent
from jshape.axes import moving
from jshape.command import Distance
from jshape.design.tuning import digital
from jshape.design.tuning.design_problem import DesignProblem, design_problem
from jshape.design.tuning.objective import Objective
from jshape.design.tuning.scenarios import Limits, Metric, Point
from jshape.design.tuning.search import Search
from jshape.design.tuning.solution import Solution
from jshape.design.tuning.starts import starts as starting_points
from jshape.memory import make_room
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.simulate import warn_unless_at_rest


def tune(
    plant: AbstractPlant,
    distance: Distance,
    impulses: int = 3,
    duration: float | tuple[float, float] | None = None,
    amplitudes: str = "positive",
    limit: float | None = None,
    over: Mapping[str, Any] | None = None,
    objective: Objective = "nominal",
    starts: int = 32,
    seed: int = 0,
    *,
    relative: bool = True,
    metric: Metric | None = None,
    time_cost: float = 0.0,
    sample_time: float | None = None,
    also: Sequence[str] | Mapping[str, Any] = (),
    shapers: str | Sequence[str] = "shared",
    peak_deflection: float | Mapping[str, float] | None = None,
    speed_limit: float | Mapping[str, float] | None = None,
    command_overshoot: float | Mapping[str, float] | None = None,
    initial_state: ArrayLike | None = None,
    start: Shaper | Mapping[str, Shaper] | None = None,
    iterations: int | None = None,
    method: str = "second-order",
    progress: Progress | None = None,
) -> Solution:
    """Minimise the residual energy of one or many plants over the amplitudes and times of a shaper.

    ``"second-order"`` is, for the nominal plant alone, Levenberg–Marquardt within the bounds on the departure from
    rest, from one start after the other, the closed forms first, until one reaches zero with all impulses. Else, and
    where zero is out of reach, the best starts are refined in a trust region: quadratic models of all energies, whose
    objective an interior point minimises. Where plants of a set take long to simulate, the best designs of their linear
    models are among the starts, and where two searches of the models agree, little else is refined. In the worst case
    the worst plants between those given are added until none is worse. ``"first-order"`` is Adam (optax) on the
    smoothed objective, projected onto the bounds, alone; it is slower to the last digits.

    An interrupt (Ctrl-C) after the first candidate returns the best design so far.

    Args:
        plant: the nominal plant.
        distance: of the move, m or rad, or any command.
        impulses: of the shaper, at least 2.
        duration: of the shaper, s, or (shortest, longest); if not given it is free, up to three quarters of the
            slowest mode's period an interval.
        amplitudes: ``"positive"``, ``"bounded"`` (|A| ≤ ``limit``), ``"unity"`` (1, −1, …, 1: only times are tuned) or
            ``"free"``.
        limit: greatest magnitude of an amplitude; with a ``sample_time`` no two impulses share a sample then, without
            one the message names those that coincide and add up to more.
        over: an uncertain set: leaves and their values, multiples of nominal; several leaves make a grid. Those of the
            command, such as ``command.distance`` (``command.slew.distance``), make one shaper for several moves.
        objective: ``"nominal"``, ``"worst"``, ``"mean"``, ``"cvar"`` (the mean of the worst tenth), or a function in
            JAX of all plants' energies.
        starts: number of starting points; where evaluations cost little, half as many more lie around the best design.
            The closed-form shapers of fewer impulses are always among them, in addition where there are few.
        seed: of the random ones among them.
        relative: whether ``over`` holds multiples of nominal values, not absolute ones.
        metric: what takes the residual energy's place, a function in JAX (plant, shaper, command) → scalar.
        time_cost: added to the objective for each second of the shaper (of every one, where there are several), J/s.
        sample_time: of a controller, s; all impulses at multiples of it, the best of which are looked for from the best
            design without the rule and, where rounding costs more than a hundredth, everywhere.
        also: leaves of the plant that are designed with the shaper, a list (within a tenth and ten times nominal) or
            leaf → (least, greatest).
        shapers: of a plant of several axes: ``"shared"``, one for all axes, ``"per axis"``, one each for those that
            move, or a list of axes that share one, while the others are not shaped.
        peak_deflection: greatest deflection of every plant, of those between the plants of the set, too, until a period
            after the move, m; this and the next two of several axes a number for every one, or axis → number.
        speed_limit: greatest speed of the shaped command, its unit per s.
        command_overshoot: of the shaped command past its ends, a fraction of the distance; 0 for none. A number is for
            every axis that moves.
        initial_state: of every plant; at rest if not given.
        start: begin at this shaper (axis → shaper) and nowhere else.
        iterations: at most so many (40 for Levenberg–Marquardt, 360 for the trust region, 1000 for Adam).
        method: ``"second-order"`` or ``"first-order"``.
        progress: called along the way (see ``jshape._types.Progress``).

    Returns:
        The design. One that does not reach an optimum, misses a limit or diverges is no error: its ``status`` and
        ``message`` say so.

    Raises:
        ValueError: for arguments that make no sense.
    """
    starts = _check.count(starts, "starts")
    seed = _check.count(seed, "seed", 0, 10**18)
    _check.function(progress, "progress")
    _check.one_of(method, "method", ("second-order", "first-order"))
    if iterations is not None:
        iterations = _check.count(iterations, "iterations")
    if command_overshoot is not None and not isinstance(command_overshoot, Mapping) and getattr(plant, "axes", ()):
        # An axis that ends where it began has nothing to overshoot.
        command_overshoot = dict.fromkeys(moving(plant, distance), command_overshoot)
    problem = design_problem(
        plant, distance, impulses, duration, amplitudes, limit, over, objective,
        relative=relative, metric=metric, also=also, initial_state=initial_state, time_cost=time_cost, shapers=shapers,
        limits=Limits(peak_deflection, speed_limit, command_overshoot, getattr(plant, "axes", ())),
    )  # fmt: skip
    warn_unless_at_rest(problem.scenarios.plant, problem.scenarios.command)
    if sample_time is not None:
        _check.positive(sample_time, "sample_time")
        digital.check(sample_time, problem.bounds)
    points = starting_points(problem, starts, seed) if start is None else [_begin(problem, start)]
    make_room()
    search = Search(problem, progress or silent, seed, starts)
    return search.run(points, method, iterations, sample_time)


def _begin(problem: DesignProblem, start: Shaper | Mapping[str, Shaper]) -> Point:
    """The design to begin with.

    Raises:
        ValueError: for a shaper with another number of impulses, and where that of an axis is missing.
    """
    _check.instance(start, "start", Shaper | Mapping, "a shaper, or axis → shaper")
    groups = problem.scenarios.groups or (("command",),)
    given = dict.fromkeys((axes[0] for axes in groups), start) if isinstance(start, Shaper) else start
    missing = [axes[0] for axes in groups if axes[0] not in given]
    if missing:
        raise ValueError(f"start must name a shaper for each of {', '.join(missing)}, not only {', '.join(given)}")
    some = [given[axes[0]] for axes in groups]
    for shaper in some:
        _check.instance(shaper, "start", Shaper, "a shaper, or axis → shaper")
        if len(shaper.times) != problem.bounds.impulses:
            raise ValueError(f"start must have {problem.bounds.impulses} impulses, not {len(shaper.times)}")
    return problem.bounds.nearest(*some)
