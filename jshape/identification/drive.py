"""``js.identify_drive``: mass, viscous and dry friction of an axis that a motor pushes, from force and position.

    found = js.identify_drive(times, position, force)
    found.parameters        # {"mass": kg, "c": N s/m, "friction": N, "offset": N}

m x″ = F − offset − c x′ − friction sign(x′): the joint of a robot or the slide of a machine tool with its motor.
Between rows the force is constant, as a controller gives it, so that the motion is known in closed form, with the
instants at which the axis stops, and dry friction holds it until the force is enough. Nothing else holds it at a place:
what it weighs and how it rubs are found in a free run of the simulation, over all of the record.

Source: Janot, Gautier and Brunot (2019), data set and reference models of an electro-mechanical positioning system.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from jshape import _check
from jshape._types import ArrayLike
from jshape.identification._motion import NAMES, Data, Problem, fit
from jshape.identification._start import prepared
from jshape.identification.motion import IdentifiedMotion, concluded
from jshape.identification.records import Where, row

FORCES = ("hold", "line")
"""How a force moves between rows: not at all, or straight, for which its mean stands."""

_WIDTH = 0.01
"""Of dry friction's change of sign, over the greatest speed, where the search begins."""

_RATE = 1e-9
"""1/s, on top of c/m, which may be nothing and is a divisor: no friction that is seen in any record."""


@dataclasses.dataclass(frozen=True)
class IdentifiedDrive(IdentifiedMotion):
    """A driven axis as fitted: ``mass`` (kg), ``c`` (N s/m), ``friction`` (N), ``offset`` (N).

    Attributes:
        times: s, shape (rows,).
        values: the measured position, m, shape (rows,).
        predicted: the fitted position, m, shape (rows,).
        noise: standard deviation of the difference, m.
    """

    times: np.ndarray
    values: np.ndarray
    predicted: np.ndarray
    noise: float


def identify_drive(
    times: ArrayLike, values: Any, inputs: Any, *, mass: float = 1.0, between: str = "hold", where: Where = row
) -> IdentifiedDrive:
    """An axis that a motor pushes, from the motor's force and the measured position.

    Args:
        times: s, even, shape (rows,).
        values: the position, m (or rad), shape (rows,).
        inputs: the motor's force, N (or torque, N m), shape (rows,).
        mass: where the search begins, kg (or kg m²), should the record's derivatives say nothing.
        between: how the force moves between rows: ``"hold"``, as a controller's output, or ``"line"``.
        where: says where a row stands, for messages.

    Raises:
        RecordError: a ``ValueError``, for a record that cannot be used or a motion that no such axis explains.
        ValueError: for wrong arguments.
    """
    _check.one_of(between, "between", FORCES)
    _check.positive(float(_check.scalar(mass, "mass")), "mass")
    _check.warn_if_single()
    record, data, driven = prepared(times, values, inputs, "hold", where)
    if between == "line":
        means = np.append((driven[1:] + driven[:-1]) / 2, driven[-1])
        data = data._replace(coefficients=means[:, None])
    shared = ("mass", "c", "friction", "offset")
    problem = Problem(_axis, [data], [_start(data, float(mass))], shared, [("position", "speed")])
    # Over all rows at once: in a part that moves one way alone dry friction and offset are the same.
    fitted = fit(problem, len(data.times))
    return IdentifiedDrive(
        **concluded(problem, fitted, list(record.notes), "no mass with friction explains this motion"),
        times=record.axis,
        values=data.values,
        predicted=data.values + fitted.residuals[0],
        noise=float(fitted.noise[0]),
    )


def _start(data: Data, mass: float) -> dict[str, float]:
    """First estimates: integrated twice, the equation of motion is linear in its unknowns and needs no acceleration."""
    times, force, x = data.times, data.coefficients[:, 0], data.values
    speed = np.asarray(savgol_filter(x, 7, 2, 1, delta=float(times[1])))
    direction = np.tanh(speed / max(_WIDTH * float(np.max(np.abs(speed))), 1e-300))

    def integral(y):
        return cumulative_trapezoid(y, times, initial=0.0)

    columns = [x, integral(x), integral(integral(direction)), times**2 / 2, times, np.ones_like(x)]
    sizes = np.array([np.linalg.norm(column) for column in columns])
    solution = np.linalg.lstsq(np.stack(columns, axis=1) / sizes, integral(integral(force)), rcond=None)[0] / sizes
    heavy, c, dry, offset, slope, _ = solution.tolist()
    heavy = heavy if heavy > 0 else mass
    found = {"mass": heavy, "c": max(c, 0.0), "friction": max(dry, 0.0), "offset": offset, "position": float(x[0])}
    return dict.fromkeys(NAMES, 0.0) | found | {"speed": -(slope + c * float(x[0])) / heavy}


def _axis(
    unknowns: np.ndarray, values: np.ndarray, places: np.ndarray, data: Data, steps: int, slopes: bool
) -> tuple[np.ndarray, np.ndarray | None]:
    """The model of a driven axis, exact in any number of steps: its unknowns are all that it depends on."""
    del values, places, steps
    found = (_compared if slopes else _residuals)(*jax.tree.map(jnp.asarray, (unknowns, data)))
    return (np.asarray(found[1]), np.asarray(found[0])) if slopes else (np.asarray(found[0]), None)


def _simulated(unknowns: Array, data: Any) -> tuple[Array, Array]:
    """Simulated less measured position, m, twice: one of them is differentiated."""
    mass, c, dry, offset, position, speed = unknowns
    times, coefficients, measured = data
    rate = c / mass + _RATE

    def moved(state: tuple[Array, Array], sign: Array, net: Array, time: Array) -> tuple[Array, Array]:
        """A while later, at a constant force and direction: x″ = g − rate x′."""
        gain = (net - sign * dry) / mass - rate * state[1]
        # (rate t - 1 + exp(-rate t))/rate²; for a small rate t a series has more digits.
        small = rate * time
        series = time**2 / 2 * (1 - small / 3 * (1 - small / 4 * (1 - small / 5 * (1 - small / 6))))
        grown = jnp.where(small < 1e-2, series, (small + jnp.expm1(-small)) / rate**2)
        return state[0] + state[1] * time + gain * grown, state[1] + gain * (time - rate * grown)

    def advance(state: tuple[Array, Array], item: tuple[Array, Array]) -> tuple[tuple[Array, Array], Array]:
        (x, v), (duration, force) = state, item
        net = force - offset
        away = jnp.where(jnp.abs(net) > dry, jnp.sign(net), 0.0)
        sign = jnp.where(v == 0, away, jnp.sign(v))
        # The instant at which it stops: rate v/(rate v - g) of the way to where it would end is done.
        gain = (net - sign * dry) / mass - rate * v
        braking = sign * gain < -rate * jnp.abs(v)
        share = jnp.where(braking, -rate * v / jnp.where(braking, gain, 1.0), 0.0)
        stop = jnp.where(braking, -jnp.log1p(-share) / rate, jnp.inf)
        stops = stop < duration
        time = jnp.where(stops, stop, duration)
        at, fast = moved((x, v), sign, net, time)
        fast = jnp.where(stops, 0.0, fast)
        after = moved((at, jnp.zeros_like(v)), away, net, duration - time)
        held = (sign == 0) & (v == 0)
        later = jnp.where(held | (stops & (away == 0)), jnp.where(held, x, at), jnp.where(stops, after[0], at))
        faster = jnp.where(held | (stops & (away == 0)), 0.0, jnp.where(stops, after[1], fast))
        return (later, faster), later

    _, found = jax.lax.scan(advance, (position, speed), (jnp.diff(times), coefficients[:-1, 0]))
    residuals = jnp.concatenate([position[None], found]) - measured
    return residuals, residuals


_compared: Any = eqx.filter_jit(jax.jacfwd(_simulated, has_aux=True))
_residuals: Any = eqx.filter_jit(_simulated)
