"""A shaper tuned by gradients of the residual energy, for any plant and any command.

``js.tune(plant, 1.0, impulses=2)`` drives the nominal plant's residual energy to zero; with an uncertain set it looks
for the shaper that is best in the worst case, on average or in the tail::

    sol = js.tune(plant, 1.0, impulses=3, duration=1.643, objective="worst", over={"m2": jnp.linspace(0.8, 1.2, 41)})
    sol.shaper, sol.objective, sol.result
"""

from collections.abc import Mapping, Sequence
from typing import Any

from jshape import _check
from jshape.design.tuning import digital as _digital
from jshape.design.tuning import starts as _starts
from jshape.design.tuning.objective import Objective
from jshape.design.tuning.prepare import number, prepare
from jshape.design.tuning.search import Progress, Search
from jshape.design.tuning.slsqp import ROUND
from jshape.design.tuning.solution import Solution
from jshape.design.tuning.task import Metric
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper


def tune(
    plant: AbstractPlant,
    distance: Any,
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
    peak_deflection: float | None = None,
    rate: float | None = None,
    command_overshoot: float | None = None,
    initial_state: Any = None,
    start: Shaper | None = None,
    iterations: int | None = None,
    method: str = "second-order",
    progress: Progress | None = None,
) -> Solution:
    """Tune the amplitudes and times of a shaper.

    ``impulses``: at least 2. ``duration``: of the shaper, s, or (shortest, longest); if not given it is free, up to
    three quarters of the slowest mode's period an interval. ``time_cost``: what a second of it costs, J/s, added to
    the objective. ``amplitudes``: ``"positive"``, ``"bounded"`` (|A| ≤ ``limit``), ``"unity"`` (1, −1, …, 1: only
    times are tuned) or ``"free"``. ``sample_time``: s; all impulses at multiples of it.

    ``over``: an uncertain set, multiples of nominal unless ``relative=False``; several leaves make a grid.
    ``objective``: ``"nominal"``, ``"worst"``, ``"mean"``, ``"cvar"`` (the mean of the worst tenth), or a function in
    JAX of all plants' energies. ``metric``: what takes the residual energy's place, a function in JAX (plant, shaper,
    command) → scalar. ``also``: leaves of the plant that are designed with the shaper, a list (within a tenth and ten
    times nominal) or leaf → (least, greatest).

    Limits: ``peak_deflection``: m, of every plant, until a period after the move. ``rate``: of the shaped command,
    per s. ``command_overshoot``: of the shaped command past its ends, over the distance; 0 for none.

    ``starts``: how many starting points are tried, ``seed``: of the random ones. ``start``: begin there and nowhere
    else. ``iterations``: at most so many (40 for Levenberg–Marquardt, 360 for SLSQP, 1000 for Adam). ``progress``: see
    ``Progress``.

    ``method``: ``"second-order"`` is, for nominal, Levenberg–Marquardt (optimistix) on the residual state, all starts
    side by side; of those that reach zero the first counts, and the textbook shapers come first. For the others, and
    wherever there are limits, the best starts (of more than 64, after a first-order descent side by side) are polished
    by SLSQP (SciPy) on the objective's epigraph. ``"first-order"`` is Adam (optax) on the smoothed objective,
    projected onto the rules, alone; it is slower to the last digits.

    *Raises* ``ValueError`` for arguments that make no sense. A design that does not reach zero, misses a limit, or does
    not converge, is no error: ``result`` says so.
    """
    starts = _check.count(starts, "starts")
    _check.one_of(method, "method", ("second-order", "first-order"))
    if iterations is not None:
        iterations = _check.count(iterations, "iterations")
    task, allowed, absolute = prepare(
        plant, distance, impulses, duration, amplitudes, limit, over, objective,
        relative=relative, metric=metric, also=also, initial_state=initial_state,
        peak_deflection=peak_deflection, rate=rate, command_overshoot=command_overshoot,
    )  # fmt: skip
    time_cost = number(time_cost, "time_cost") or 0.0
    if sample_time is not None:
        _check.positive(sample_time, "sample_time")
        _digital.check(sample_time, allowed.shortest, allowed.longest)
    if start is None:
        begin = _starts.starts(task.plant, float(task.command.final), allowed, starts, seed)
    else:
        if len(start.times) != allowed.impulses:
            raise ValueError(f"start must have {allowed.impulses} impulses, not {len(start.times)}")
        begin = _starts.stack([allowed.fit(start)])
    search = Search(task, allowed, objective, time_cost, progress or (lambda stage, done, total, best: None))
    if method == "first-order":
        found = search.first_order(begin, iterations or 1000)
    elif objective == "nominal" and search.simple:
        found = search.nominal(begin, iterations or 40)
    else:
        found = search.robust(begin, iterations or 360)
    if sample_time is not None:
        found = search.digital(found, sample_time, min(iterations or ROUND, ROUND))
    return search.solution(found, absolute)
