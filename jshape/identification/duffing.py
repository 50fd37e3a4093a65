"""``js.identify_duffing``: a hardening or softening spring from one record, by gradient through the simulator.

    found = js.identify_duffing(times, position, mass=1.2)     # a ring-down of the payload
    found.parameters, found.std                                 # {"k1": …, "k3": …, "c": …}, N/m, N/m³, N s/m
    js.design.energy.three_impulse(found.plant, 1.0)

The start comes from the equation of motion itself, which is linear in the unknowns; then Levenberg and Marquardt's
method fits the simulated motion to the measured one, over a part of the record that grows from a few periods to all.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from jshape import _check
from jshape._memo import last_result
from jshape.command import Sampled
from jshape.identification._uncertainty import covariance, is_white
from jshape.identification.records import Record, RecordError, Where, check_record, longest_stretch, row
from jshape.plants import AbstractPlant, Duffing, ForcedMass, LinearDamper, PowerDamper, TwoMass
from jshape.simulation.simulate import simulate
from jshape.status import Result, Status

DRIVES = ("displacement", "force")


@dataclasses.dataclass(frozen=True)
class IdentifiedDuffing(Result):
    """A Duffing oscillator as fitted.

    Attributes:
        plant: the machine.
        parameters: by name, ``k1`` (N/m), ``k3`` (N/m³), ``c`` (N s/m, or N s³/m³) and, under a force, ``mass`` (kg).
        std: standard deviation of each.
        covariance: in their order.
        times: s, shape (rows,).
        values: the measured position, m, shape (rows,).
        predicted: the fitted position, m, shape (rows,).
        noise: standard deviation of the difference, m.
        status: ``STOPPED`` where the fit did not converge.
        message: what was found.
        notes: on the record.
    """

    plant: AbstractPlant
    parameters: dict[str, float]
    std: dict[str, float]
    covariance: np.ndarray
    times: np.ndarray
    values: np.ndarray
    predicted: np.ndarray
    noise: float
    status: Status
    message: str
    notes: tuple[str, ...]


def identify_duffing(
    times: Any,
    values: Any,
    *,
    mass: float = 1.0,
    inputs: Any = None,
    drive: str = "displacement",
    power: int = 1,
    where: Where = row,
) -> IdentifiedDuffing:
    """A payload on a spring k1 x + k3 x³ and a damper c v (or c v³), from its measured position.

    Where the sensor's zero is, and how the motion began, is fitted, too.

    Args:
        times: s, even, shape (rows,).
        values: the payload's position, m, shape (rows,).
        mass: of the payload, kg; a motion without a measured force determines only the ratios to it, and with one it
            is fitted as well, from this start.
        inputs: what drove it meanwhile, straight lines between samples, shape (rows,); a free vibration unless given.
        drive: what ``inputs`` are, ``"displacement"`` of the base, m, or ``"force"`` on the payload, N.
        power: of the damper, 1 or 3.
        where: says where a row stands, for messages.

    Raises:
        RecordError: a ``ValueError``, for a record that cannot be used or a motion that no such spring explains.
        ValueError: for wrong arguments.
    """
    _check.one_of(drive, "drive", DRIVES)
    mass = float(_check.scalar(mass, "mass"))
    _check.positive(mass, "mass")
    if power not in (1, 3):
        raise ValueError(f"power must be 1 or 3, not {power!r}")
    if drive == "force" and inputs is None:
        raise ValueError('inputs must be given for drive="force": the force, N')
    _check.warn_if_single()
    record = longest_stretch(check_record(times, values, inputs, where=where))
    if record.values.shape[1] != 1:
        raise ValueError(f"values must be one channel, the payload's position, not {record.values.shape[1]}")
    return _identified(record, mass, drive == "force", power)


def _identified(record: Record, mass: float, forced: bool, power: int) -> IdentifiedDuffing:
    x = record.values[:, 0]
    p, residuals, jacobian, converged = _fitted(record, mass, forced, power)
    names = ["k1", "k3", "c", "mass"] if forced else ["k1", "k3", "c"]
    count, free = len(names), len(x) - len(p)
    noise = max(float(np.sqrt(np.sum(residuals**2) / free)), 1e-300)
    explained = 1 - np.sum(residuals**2) / np.sum((x - np.mean(x)) ** 2)
    if not explained > 0.5:
        raise RecordError("values: no spring k1 x + k3 x³ explains this motion")
    spread = covariance(jacobian[:, None] / noise, residuals[:, None] / noise, free)[:count, :count]
    parameters = dict(zip(names, p[:count].tolist(), strict=True))
    std = dict(zip(names, np.sqrt(np.diag(spread)).tolist(), strict=True))
    notes = list(record.notes)
    if not is_white(residuals[:, None]):
        notes.append(
            "the residuals are no white noise: intervals allow for it, but another spring or damper may fit better"
        )
    described = ", ".join(f"{name} {value:.5g} ± {1.96 * std[name]:.2g}" for name, value in parameters.items())
    message = f"{described} (95 % intervals); explains {100 * explained:.4g} % of the motion"
    return IdentifiedDuffing(
        _plant(jnp.asarray(p[:count]), jnp.asarray(mass), forced, power), parameters, std, spread,
        record.axis, x, x + residuals, noise,
        Status.CONVERGED if converged else Status.STOPPED,
        message if converged else f"did not converge; {message}", tuple(notes),
    )  # fmt: skip


def _fitted(record: Record, mass: float, forced: bool, power: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """The parameters that fit best, the residuals (simulated less measured, m), their derivative, and whether the fit
    converged."""
    times, x = record.axis - record.axis[0], record.values[:, 0]
    step = float(times[-1]) / (len(times) - 1)
    if np.max(np.abs(times - step * np.arange(len(times)))) > 0.05 * step:
        raise RecordError("times must be even: a simulation is compared with every sample")
    driven = np.zeros_like(x) if record.inputs is None else record.inputs
    start, period = _start(x, driven, step, mass, power, forced)
    fixed = (jnp.asarray(times), jnp.asarray(driven), jnp.asarray(mass), jnp.asarray(x))

    @last_result
    def compared(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The residuals and their derivative; finite, also where the simulation diverges."""
        slopes, residuals = _compared(jnp.asarray(p), fixed, forced, power)
        finite = np.nan_to_num(np.asarray(residuals), nan=1e9, posinf=1e9, neginf=-1e9)
        return finite, np.nan_to_num(np.asarray(slopes))

    lower = np.full(len(start), -np.inf)
    lower[[0, 2]] = 1e-9 * start[0], 0.0
    if forced:
        lower[3] = 1e-9 * start[3]
    p, rows = np.maximum(start, lower), min(len(x), max(16, int(4 * period / step)))
    while True:
        jacobian: Any = lambda p, rows=rows: compared(p)[1][:rows]
        found = least_squares(
            lambda p, rows=rows: compared(p)[0][:rows], p, jacobian, bounds=(lower, np.inf),
            x_scale="jac", ftol=1e-12, xtol=1e-12, gtol=1e-15, max_nfev=100,
        )  # fmt: skip
        p = found.x
        if rows == len(x):
            return p, *compared(p), found.status > 0
        rows = min(len(x), 2 * rows)


def _plant(p: Array, mass: Array, forced: bool, power: int) -> AbstractPlant:
    spring, damper = Duffing(p[0], p[1]), LinearDamper(p[2]) if power == 1 else PowerDamper(p[2], power)
    return ForcedMass(p[3], spring, damper) if forced else TwoMass(m2=mass, spring=spring, damper=damper)


def _simulated(p: Array, fixed: Any, forced: bool, power: int) -> tuple[Array, Array]:
    """Simulated less measured position, m, twice: one of them is differentiated.

    Args:
        p: the plant's parameters, then position and speed at first, and the sensor's zero.
        fixed: times, input, mass and measured position.
    """
    times, driven, mass, x = fixed
    plant = _plant(p, mass, forced, power)
    run = simulate(
        plant, Sampled(times, driven), initial_state=p[-3:-1], horizon=times[-1], samples=len(x), method="fixed"
    )
    residuals = run.payload + p[-1] - x
    return residuals, residuals


_compared: Any = eqx.filter_jit(jax.jacfwd(_simulated, has_aux=True))


def _start(
    x: np.ndarray, driven: np.ndarray, step: float, mass: float, power: int, forced: bool
) -> tuple[np.ndarray, float]:
    """First estimates, from derivatives of the smoothed record, and the period, s.

    m x'' = −k1 d − k3 d³ − c v (+ force) is linear in the unknowns; the constant beside them moves the zero.
    """
    omegas = 2 * np.pi * np.fft.rfftfreq(4 * len(x), step)
    size = np.abs(np.fft.rfft((x - np.mean(x)) * np.hanning(len(x)), 4 * len(x)))
    period = 2 * np.pi / float(omegas[1 + np.argmax(size[1:])])
    window = max(5, int(period / step / 4) | 1)
    if window >= len(x):
        raise RecordError("values: too short a record, not even half a period")
    order = 4 if window > 5 else 3
    position, speed, force = (np.asarray(savgol_filter(x, window, order, k, delta=step)) for k in range(3))
    zero = 0.0 if forced else float(np.mean(x - driven))
    bend = position - zero - (0.0 if forced else driven)
    slip = speed - (0.0 if forced else np.gradient(driven, step))
    scale = float(np.max(np.abs(bend)))
    shapes = [bend, bend**3 / scale**2, np.sign(slip) * np.abs(slip) ** power]
    # With the force on the left the mass, too, is among the factors; else the constant moves the zero.
    last, left = (force, driven) if forced else (np.ones_like(x), -mass * force)
    k1, k3, c, m = np.linalg.lstsq(np.stack([*shapes, last], axis=1), left, rcond=None)[0]
    k3 = k3 / scale**2
    m = m if forced and m > 0 else mass
    if not k1 > 0:
        k1, k3 = m * (2 * np.pi / period) ** 2, 0.0
    plant = [k1, k3, max(c, 0.0), m] if forced else [k1, k3, max(c, 0.0)]
    return np.array([*plant, position[0] - zero, speed[0], zero]), period
