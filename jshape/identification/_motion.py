"""One mass on a spring and a damper, simulated and compared with measured records: what is fitted to them.

m x″ = F(t) − offset − k1 d − k3 d³ − c sᵖ − friction tanh(s/w), with d and s the position and speed relative to the
base, and the measured position x + zero. What is common to all records comes first among the unknowns, then what each
record has of its own.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from jshape._memo import value_and_jacobian
from jshape.command import polynomial
from jshape.simulation.integrate import integrate
from jshape.simulation.schedule import Schedule, Segments

NAMES = ("k1", "k3", "c", "friction", "offset", "delay", "mass", "position", "speed", "zero")
"""Everything that a record's motion depends on; position and speed are those at its first row."""

BETWEEN = ("line", "spline", "hold")
"""How an input moves between rows: straight, as a cubic spline, or not at all."""

POSITIVE = ("c", "friction", "delay")
"""What may not become negative."""

_MOST_STEPS = 64
"""Steps of the integration between rows, at most."""

_SURE = 1e-3
"""The error of the integration over the noise from which on steps are halved."""

_ROUNDING = 1e-10
"""The same over the record's greatest value."""


class Law(NamedTuple):
    """What kind of motion it is.

    Attributes:
        forced: whether inputs are forces on the mass, and not displacements of the base.
        power: of the damper.
        delayed: whether a delay is among the unknowns.
    """

    forced: bool
    power: int
    delayed: bool


class Data(NamedTuple):
    """A record as it is simulated.

    Attributes:
        times: s, from 0 on, shape (rows,).
        coefficients: of the input from each row on, in powers of the time since it, shape (rows, powers).
        values: the measured position, m, shape (rows,).
    """

    times: np.ndarray
    coefficients: np.ndarray
    values: np.ndarray


def pieces(times: np.ndarray, inputs: np.ndarray, between: str) -> np.ndarray:
    """The polynomial of an input from each row on, in powers of the time since it, shape (rows, powers)."""
    if between == "hold":
        return inputs[:, None]
    if between == "line":
        return np.stack([inputs, np.append(np.diff(inputs) / np.diff(times), 0.0)], axis=1)
    spline = CubicSpline(times, inputs).c[::-1].T
    return np.vstack([spline, [inputs[-1], 0.0, 0.0, 0.0]])


Model = Callable[..., tuple[np.ndarray, np.ndarray | None]]
"""``model(unknowns, values of NAMES, places of the unknowns among them, data, steps, slopes)``: simulated less measured
position and, if asked for, its derivative by the unknowns."""


def _simulated(unknowns: Array, values: Array, places: Any, width: Any, data: Any, law: Law, steps: int) -> Any:
    """Simulated less measured position, m, twice: one of them is differentiated.

    Args:
        unknowns: in the order of ``places``.
        values: of everything in ``NAMES``, those that are known.
        places: which of them are unknown.
        width: the speed over which dry friction changes its sign, m/s.
        data: the record.
        law: the kind of motion.
        steps: of the integration, from row to row.
    """
    times, coefficients, measured = data
    k1, k3, c, friction, offset, delay, mass, position, speed, zero = values.at[places].set(unknowns)

    def field(local: Array, state: Array, segment: Segments) -> Array:
        age = segment.age + local
        driven = [polynomial(segment.coefficients, age, order) for order in (0, 1)]
        base, base_speed, force = (0.0, 0.0, driven[0]) if law.forced else (*driven, 0.0)
        bend, slip = state[0] - base, state[1] - base_speed
        pull = (k1 + k3 * bend**2) * bend + c * slip**law.power + friction * jnp.tanh(slip / width)
        return jnp.stack([state[1], (force - offset - pull) / mass])

    if law.delayed:
        rest = jnp.zeros_like(coefficients[:1]).at[:, 0].set(coefficients[0, 0])
        breaks = jnp.concatenate([jnp.zeros(1), times + delay])
        segments, at = Schedule(breaks, jnp.concatenate([rest, coefficients])).sampled(times)
    else:
        segments = Segments(times[:-1], jnp.diff(times), jnp.zeros_like(times[:-1]), coefficients[:-1])
        at = jnp.arange(len(times))
    first = jnp.stack([position, speed])
    _, _, states = integrate(field, first, segments.duration, segments, steps, save=True)
    assert states is not None
    residuals = jnp.concatenate([position[None], states[:, -1, 0]])[at] + zero - measured
    return residuals, residuals


_compared: Any = eqx.filter_jit(jax.jacfwd(_simulated, has_aux=True))
_residuals: Any = eqx.filter_jit(_simulated)


def oscillator(law: Law, width: float) -> Model:
    """The model of a mass on a spring.

    Args:
        law: the kind of motion.
        width: the speed over which dry friction changes its sign, m/s.
    """

    def model(unknowns: np.ndarray, values: np.ndarray, places: np.ndarray, data: Data, steps: int, slopes: bool):
        arrays = jax.tree.map(jnp.asarray, (unknowns, values, places, width, data))
        if slopes:
            slope, residuals = _compared(*arrays, law, steps)
            return np.asarray(residuals), np.asarray(slope)
        return np.asarray(_residuals(*arrays, law, steps)[0]), None

    return model


@dataclasses.dataclass(frozen=True)
class Problem:
    """Records and what is sought.

    Attributes:
        model: how they are simulated.
        records: of motions by the same law.
        known: of each record, values of ``NAMES``; those that are sought are where the search begins.
        shared: names of what is sought and common to all.
        own: of each record, names of what is sought for it alone.
    """

    model: Model
    records: list[Data]
    known: list[dict[str, float]]
    shared: tuple[str, ...]
    own: list[tuple[str, ...]]

    def start(self) -> np.ndarray:
        """The unknowns where the search begins."""
        common = [self.known[0][name] for name in self.shared]
        each = [known[name] for known, own in zip(self.known, self.own, strict=True) for name in own]
        return np.array([*common, *each])

    def names(self) -> list[str]:
        """Of the unknowns."""
        return [*self.shared, *(name for own in self.own for name in own)]

    def places(self) -> list[list[int]]:
        """Of each record, where its unknowns stand among all."""
        count, begin, found = len(self.shared), len(self.shared), []
        for own in self.own:
            found.append([*range(count), *range(begin, begin + len(own))])
            begin += len(own)
        return found

    def values(self, p: np.ndarray) -> list[dict[str, float]]:
        """Of each record the value of everything in ``NAMES``."""
        names = self.names()
        return [
            known | {names[i]: float(p[i]) for i in at} for known, at in zip(self.known, self.places(), strict=True)
        ]

    def compared(self, p: np.ndarray, steps: int, slopes: bool = True) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each record the residuals, m, and their derivative by all unknowns; finite, also where it diverges."""
        found = []
        for data, known, own, at in zip(self.records, self.known, self.own, self.places(), strict=True):
            values = np.array([known[name] for name in NAMES])
            places = np.array([NAMES.index(name) for name in (*self.shared, *own)])
            residuals, slope = self.model(p[at], values, places, data, steps, slopes)
            whole = np.zeros((len(data.times), len(p)))
            if slope is not None:
                whole[:, at] = np.nan_to_num(slope)
            found.append((np.clip(np.nan_to_num(residuals, nan=1e9), -1e9, 1e9), whole))
        return found


class Fit(NamedTuple):
    """The unknowns that fit best.

    Attributes:
        unknowns: in their order.
        residuals: simulated less measured position of each record, m.
        slopes: their derivatives.
        noise: standard deviation of each record's residuals, m.
        converged: whether the fit did.
        error: of the integration, over the noise, an estimate.
    """

    unknowns: np.ndarray
    residuals: list[np.ndarray]
    slopes: list[np.ndarray]
    noise: np.ndarray
    converged: bool
    error: float


def fit(problem: Problem, first: int) -> Fit:
    """Levenberg and Marquardt's fit of the simulated to the measured motions, over parts that grow.

    Args:
        problem: with where the search begins.
        first: rows of each record over which it begins.
    """
    p, steps, rows = problem.start(), 1, first
    longest = max(len(data.times) for data in problem.records)
    names = problem.names()
    lower = np.array([0.0 if name in POSITIVE else -np.inf for name in names])
    lower[[name in ("k1", "mass") for name in names]] = 1e-9 * p[[name in ("k1", "mass") for name in names]]
    p, weights = np.maximum(p, lower), np.ones(len(problem.records))
    while True:
        found = _least_squares(problem, p, lower, steps, rows, weights)
        p = found.x
        if rows < longest:
            rows = min(longest, 4 * rows)
            continue
        parts = problem.compared(p, steps)
        noise = np.array([np.sqrt(np.mean(residuals**2)) for residuals, _ in parts])
        if len(noise) > 1 and np.all(weights == 1):
            weights = noise.max() / np.maximum(noise, 1e-12 * noise.max())
            continue
        finer = problem.compared(p, 2 * steps, slopes=False)
        floor = _ROUNDING * np.array([np.abs(data.values).max() for data in problem.records])
        off = [np.abs(a - b).max() for (a, _), (b, _) in zip(parts, finer, strict=True)]
        error = float(np.max(np.array(off) / np.maximum(noise, floor / _SURE)))
        if error <= _SURE or 2 * steps > _MOST_STEPS:
            residuals, slopes = ([part[i] for part in parts] for i in (0, 1))
            return Fit(p, residuals, slopes, np.maximum(noise, 1e-300), found.status > 0, error)
        steps *= 2


def _least_squares(
    problem: Problem, p: np.ndarray, lower: np.ndarray, steps: int, rows: int, weights: np.ndarray
) -> Any:
    """SciPy's fit over the first rows of each record."""

    def compared(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts = problem.compared(p, steps)
        cut = [(w * r[:rows], w * s[:rows]) for (r, s), w in zip(parts, weights, strict=True)]
        return np.concatenate([r for r, _ in cut]), np.concatenate([s for _, s in cut])

    residuals, jacobian = value_and_jacobian(compared)
    return least_squares(
        residuals, p, jacobian, bounds=(lower, np.inf), x_scale="jac",
        ftol=1e-12, xtol=1e-12, gtol=1e-15, max_nfev=100,
    )  # fmt: skip
