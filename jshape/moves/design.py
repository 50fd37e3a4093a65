"""The oracle's table, designed: for every payload and move the cheapest positive shaper that leaves next to nothing."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Scalar
from jshape.design.linear import zv
from jshape.moves.actions import from_logits
from jshape.moves.machine import CASES, AbstractMachine
from jshape.moves.oracle import ShaperTable
from jshape.moves.physics import Steps, greatest_energy, plan_move, run_move
from jshape.shaper import Shaper

_SCALES = (0.35, 0.5, 0.7, 0.85, 1.0, 1.15)
"""Multiples of the linear half periods that the searches begin with."""


STRICTNESS = 10.0
"""The weight of residual energy in the search, over that in a move's cost. What one move leaves, the next ones keep,
and a hardening spring makes it grow: the shaper that is cheapest for one move alone is not the cheapest for many."""

_LEAST = 1e-4
"""Least amplitude, and least gap over the duration, that a search begins with: their logarithms are searched."""

IDLE = 1e-3
"""An amplitude that hardly anything depends on: whatever it excites, a millionth of the bare move's energy."""


def design_table(
    machine: AbstractMachine,
    payload: Float[Array, "2"],
    distance: Float[Array, "2"],
    weights: tuple[Scalar, Scalar],
    period: Scalar,
    steps: Steps,
    grid: tuple[int, int],
) -> ShaperTable:
    """The oracle's table for a machine, over payloads and sizes of moves.

    Two impulses for one mode, four for two: BFGS (optimistix) on the cost, begun from linear shapers; the best of
    several starts counts. Takes some seconds. Shapers should change little from one payload to the next: two modes,
    whose best shapers follow the ratio of their frequencies, need a finer grid.

    Args:
        machine: what moves.
        payload: least and greatest, in the unit of the plant's leaf.
        distance: shortest and longest move, m.
        weights: of the normalised residual energy, and of the shaper's duration in periods.
        period: that the duration is counted in, s.
        steps: how finely moves are integrated.
        grid: number of payloads and of sizes.

    Raises:
        ValueError: where no shaper of finite cost is found.
    """
    payloads, sizes = (jnp.linspace(ends[0], ends[1], n) for ends, n in zip((payload, distance), grid, strict=True))
    signs, moves = (jnp.asarray(part) for part in zip(*map(machine.example, range(CASES)), strict=True))
    cases = signs.astype(sizes.dtype), moves
    amplitudes, times, reference, cost = _design_all(machine, payloads, sizes, cases, weights, period, steps)
    if not bool(jnp.all(jnp.isfinite(cost))):
        raise ValueError(
            f"distance: no shaper brings the payload to {_check.show(distance)} m: the plant diverges on the way with "
            "some payloads; shorten the moves"
        )
    return ShaperTable(payload, distance, amplitudes, times, reference, cost)


@eqx.filter_jit
def _design_all(
    machine: AbstractMachine, payloads: Array, sizes: Array, cases: tuple[Array, Array], weights: Any, period: Scalar,
    steps: Steps,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Amplitudes and times of the shapers, references and costs of the moves, over payloads × sizes × cases."""

    def design(payload: Scalar, size: Scalar, case: tuple[Scalar, Array]) -> tuple[Array, Array, Scalar, Scalar]:
        sign, moves = case
        plant, command = machine.plant(payload, moves), machine.command(sign * size, moves)
        state = plant.rest_state(plant.zero_inputs())
        reference = greatest_energy(plant, command, steps)

        def cost(trial: Shaper, strictness: float) -> Scalar:
            _, energy = run_move(plant, plan_move(plant, command, trial, jnp.zeros_like(size)), state, steps)
            # A bare move without a positive energy has diverged, and nothing can be counted by it.
            counts = (reference > 0) & jnp.isfinite(reference)
            residual = jnp.where(counts, energy / reference, jnp.inf)
            return strictness * weights[0] * residual + weights[1] * trial.duration / period

        def search(scale: Scalar) -> tuple[Array, Scalar]:
            parts = [zv(omega / scale) for omega in jnp.atleast_1d(plant.natural_frequency())]
            return cheapest(lambda trial: cost(trial, STRICTNESS), functools.reduce(Shaper.convolve, parts), 80)

        points, costs = jax.vmap(search)(jnp.asarray(_SCALES, size.dtype))
        chosen = _tidied(_shaper(points[jnp.nanargmin(costs)]))
        return chosen.amplitudes, chosen.times, reference / size**2, cost(chosen, 1.0)

    over_cases = jax.vmap(design, in_axes=(None, None, 0))
    return jax.vmap(jax.vmap(over_cases, in_axes=(None, 0, None)), in_axes=(0, None, None))(payloads, sizes, cases)


def cheapest(cost: Callable[[Shaper], Scalar], begin: Shaper, most: int) -> tuple[Float[Array, " point"], Scalar]:
    """The positive shaper of least cost near ``begin``, as a point for ``_shaper``, and its cost.

    Args:
        cost: what is minimised, by BFGS (optimistix).
        begin: where the search starts.
        most: steps at most.
    """
    ratios = jnp.maximum(begin.amplitudes, _LEAST) / jnp.maximum(begin.amplitudes[0], _LEAST)
    gaps = jnp.maximum(jnp.diff(begin.times), _LEAST * begin.duration)
    point = jnp.concatenate([jnp.log(ratios[1:]), jnp.log(gaps)])

    def objective(point: Float[Array, " point"], _: Any = None) -> Scalar:
        return cost(_shaper(point))

    found = optx.minimise(objective, optx.BFGS(rtol=1e-8, atol=1e-8), point, max_steps=most, throw=False)
    return found.value, objective(found.value)


def improved(begin: Shaper, cost: Callable[[Shaper], Scalar], most: int) -> Shaper:
    """The positive shaper of least cost near ``begin``, in at most so many steps of BFGS, or ``begin`` if better."""
    point, least = cheapest(cost, begin, most)
    better = least < cost(begin)
    return jax.tree.map(functools.partial(jnp.where, better), _shaper(point), begin)


def _shaper(point: Float[Array, " point"]) -> Shaper:
    """Any point is a valid shaper: logarithms of the amplitudes over the first one's, then of the gaps in s."""
    logits, gaps = jnp.split(point, 2)
    return from_logits(jnp.concatenate([jnp.zeros_like(point[:1]), logits]), jnp.exp(gaps))


def _tidied(shaper: Shaper) -> Shaper:
    """The shaper with each idle impulse moved to the one before it.

    An idle impulse may stand anywhere, but what is interpolated between it and its neighbours in the table, which are
    not idle, may not. The last one is never idle: it would cost time.
    """
    amplitudes, times = shaper.amplitudes, shaper.times
    idle = (amplitudes < IDLE).at[jnp.array([0, -1])].set(False)
    return Shaper(amplitudes, jnp.where(idle, jnp.roll(times, 1), times))
