"""Frequencies and damping ratios of a few modes from a short window: a fit of damped sinusoids that reaches the
Cramér–Rao bound.

A subspace method (ESPRIT) finds where to begin, Gauss–Newton steps go on to the least-squares fit, which for white
noise is the most likely one, and its Jacobian gives the uncertainties. A window of two periods is enough, where a DFT
needs thousands of samples to tell two frequencies apart; in return the window must hold one free decay.
"""

from itertools import permutations
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.adaptive.arguments import check_band, check_level
from jshape.adaptive.formulas import Numbers
from jshape.adaptive.identifiers import reasons
from jshape.adaptive.identifiers.estimate import AbstractIdentifier, Estimate, uninformed
from jshape.adaptive.identifiers.sensor import LIMIT, Block, Sensor, averaged, block_size, checked, mean_gain

MEANS = 8
"""Least number of block means in the shortest period."""
SUBSPACE = 24
"""Greatest length of the vectors whose subspace is sought; longer ones cost more and only begin the fit."""
GREATEST_ZETA = 0.7
"""Of a mode; beyond it a decay is hardly a vibration."""
STEPS = 8
"""Gauss–Newton steps: from the beginning that ESPRIT gives, 3 or 4 reach rounding errors in most windows."""


class DecayState(NamedTuple):
    """A fit of damped sinusoids after some samples."""

    ring: Any
    """The means of the window."""
    place: Any
    filled: Any
    waited: Any
    """Means since the last fit."""
    block: Block
    sensor: Sensor
    fit: Any
    """Reason of the last fit, one a mode."""
    estimate: Estimate
    reason: Any


class DampedSinusoids(AbstractIdentifier):
    """Frequency and damping ratio of several modes by a least-squares fit to the last samples.

    The estimate's arrays have the shape (modes,). Samples are averaged in blocks, eight or more to the shortest period,
    which leaves poles as they are; a constant is fitted with the modes. Blocks do not tell a frequency from one that a
    whole number of blocks a second lies apart: of a mode near that number a tenth or so is taken for one in the band.
    Modes are those with damping ratios up to ``GREATEST_ZETA``. A blanked sample or a sensor that stood still
    begins the window anew: there is no fit across a gap. A new excitation within the window makes the fit poor by more
    than its standard deviation says: blank the samples in which the machine is driven.

    A fit takes some hundred microseconds in NumPy, between fits a sample takes a few. Under ``vmap`` a fit is made with
    every sample, and only one in many is used: for a thousand windows at once call ``fit_window`` under ``vmap``.

    Args:
        sample_time: s.
        band: lowest and highest allowed frequency of all modes, rad/s, shape (2,), or one such pair for each, shape
            (modes, 2). Modes stand in ascending order, but where another order puts more of them into their own bands.
        modes: how many.
        points: samples in the window; two periods of the lowest frequency, if not given.
        every: block means from one fit to the next.
        threshold: least amplitude (``magnitude``) at the window's end, in the unit of the samples.
        precision: greatest standard deviation of a valid frequency, relative to it.
        limit: greatest plausible |sample|.

    Raises:
        ValueError: for a band that is no band, or a window too short for the modes.

    Source: Roy and Kailath (1989), ESPRIT; Golub and Pereyra (1973), The differentiation of pseudo-inverses and
        nonlinear least squares problems whose variables separate.
    """

    precision: Float[Array, ""]
    points: int = eqx.field(static=True)
    modes: int = eqx.field(static=True)
    bands: tuple[tuple[float, float], ...] = eqx.field(static=True)
    """One for each mode; ``band`` spans all."""
    every: int = eqx.field(static=True)
    block: int = eqx.field(static=True)
    """Samples in a block."""

    def __init__(
        self,
        sample_time: float,
        band: Any,
        modes: int,
        *,
        points: int | None = None,
        every: int = 4,
        threshold: Any = 0.0,
        precision: Any = 0.05,
        limit: Any = LIMIT,
    ):
        self.modes = _check.count(modes, "modes")
        given = np.asarray(_check.as_array(band, "band"), float)
        if given.shape not in ((2,), (self.modes, 2)):
            raise ValueError(f"band must be (low, high), or one such pair for each mode, not of shape {given.shape}")
        pairs = np.broadcast_to(given, (self.modes, 2))
        super().__init__(sample_time, (pairs.min(), pairs.max()), threshold, limit)
        self.bands = tuple(check_band(pair, self.sample_time) for pair in pairs)
        self.every = _check.count(every, "every")
        self.precision = check_level(precision, "precision")
        self.block = block_size(self.band, self.sample_time, MEANS)
        if points is None:
            points = int(np.ceil(4 * np.pi / self.band[0] / self.sample_time))
        self.points = _check.count(points, "points")
        least = (8 * self.modes + 4) * self.block
        if self.points // self.block < 8 * self.modes + 4:
            raise ValueError(
                f"points must be at least {least} for {self.modes} modes up to {self.band[1]:g} rad/s at "
                f"{self.sample_time:g} s, not {self.points}"
            )

    def initial(self) -> DecayState:
        start = [uninformed(band) for band in self.bands]
        reason = np.full(self.modes, reasons.STARTING)
        return DecayState(
            ring=np.zeros(self.points // self.block),
            place=0,
            filled=0,
            waited=0,
            block=Block(),
            sensor=Sensor(),
            fit=reason,
            estimate=Estimate(*(np.array(column) for column in zip(*start, strict=True))),
            reason=reason,
        )

    @staticmethod
    def advance(own: Any, numbers: Numbers, state: DecayState, sample: Any, active: Any) -> DecayState:
        xp, select = numbers.xp, numbers.select
        sensor, value, trouble = checked(numbers, state.sensor, sample, active, own.limit, own.patience)
        block, full, mean, gap = averaged(numbers, state.block, value, own.block, trouble)
        filled, fit = select(gap, (0, state.fit * 0 + reasons.STARTING), (state.filled, state.fit))
        size, place = len(state.ring), state.place
        ring = numbers.put(state.ring, place, select(full, mean, state.ring[place]))
        come = select(full, 1, 0)
        place = (place + come) % size
        filled = select(filled + come > size, size, filled + come)
        waited = state.waited + come
        due = full & (filled == size) & (waited >= own.every)

        def refit(last: Estimate, _: Any) -> tuple[Estimate, Any]:
            found = fit_window(own, numbers, xp.roll(ring, -place))
            low, high = np.array(own.bands).T
            causes = reasons.first(
                numbers._replace(select=xp.where),
                (found.magnitude <= own.threshold, reasons.WEAK),
                ((found.omega < low) | (found.omega > high) | (found.zeta > GREATEST_ZETA), reasons.OUTSIDE),
                (~(found.omega_std <= own.precision * found.omega), reasons.UNCERTAIN),
            )
            return _settle(xp, last, found, causes), xp.asarray(causes, state.fit.dtype)

        estimate, fit = numbers.when(due, refit, lambda last, fit: (last, fit), state.estimate, fit)
        reason = select(trouble != reasons.FOUND, 0 * fit + trouble, fit)
        estimate = estimate._replace(valid=reason == reasons.FOUND)
        return DecayState(ring, place, filled, select(due, 0, waited), block, sensor, fit, estimate, reason)


def _settle(xp: Any, last: Estimate, found: Estimate, causes: Any) -> Estimate:
    """Mode by mode, ``found`` where there is no reason against it."""
    good = causes == reasons.FOUND
    return Estimate(*(xp.where(good, new, old) for new, old in zip(found[:-1], last[:-1], strict=True)), valid=good)


def fit_window(own: Any, numbers: Numbers, means: Any) -> Estimate:
    """Modes of a window by the least-squares fit, whether or not it is valid.

    Args:
        own: a ``DampedSinusoids``, or whatever has its fields (``plain``).
        numbers: JAX or NumPy.
        means: block means, oldest first, in the unit of the samples.
    """
    xp, modes, spacing = numbers.xp, own.modes, own.block * own.sample_time
    times = spacing * np.arange(len(means))
    scale = xp.maximum(xp.max(abs(means)), 1e-300)
    data = means / scale
    # Where a fit begins does not change where it ends, so nothing is differentiated through it.
    poles = _esprit(xp, numbers.constant(data), modes, spacing)
    far = np.pi / times[-1]

    def gauss_newton(poles: Any) -> Any:
        step = _linearised(xp, data, times, poles)[0]
        decay, omega = poles + xp.clip(step, -far, far)
        omega = xp.clip(omega, own.band[0] / 2, np.pi / spacing)
        return xp.stack([xp.clip(decay, -0.1 * omega, omega), omega])

    poles = numbers.repeat(STEPS, gauss_newton, poles)
    _, covariance, amplitudes = _linearised(xp, data, times, poles)
    decay, damped = poles
    omega = xp.hypot(decay, damped)
    by_omega = xp.stack([decay / omega, damped / omega])
    by_zeta = xp.stack([damped**2 / omega**3, -decay * damped / omega**3])
    omega_std, zeta_std = (xp.sqrt(abs(xp.einsum("im,imjm,jm->m", by, covariance, by))) for by in (by_omega, by_zeta))
    gain = mean_gain(numbers, damped, own.sample_time, own.block)
    magnitude = scale * amplitudes * xp.exp(-decay * times[-1]) / gain
    zeta = decay / omega
    # What is cut off of a vibration that grows counts as an error.
    zeta, zeta_std = xp.maximum(zeta, 0.0), xp.hypot(zeta_std, xp.minimum(zeta, 0.0))
    found = Estimate(omega, zeta, omega_std, zeta_std, magnitude, xp.full(modes, True))
    order = _order(xp, own.bands, found)
    return Estimate(*(field[order] for field in found))


def _esprit(xp: Any, data: Any, modes: int, spacing: float) -> Any:
    """Decays and damped frequencies (1/s, rad/s; of shape (2, modes)), ascending, by the rotation of a subspace."""
    length = min(len(data) // 2, SUBSPACE)
    hankel = (data - xp.mean(data))[np.arange(length)[:, None] + np.arange(len(data) - length + 1)]
    vectors = xp.linalg.eigh(hankel @ hankel.T)[1]
    # One more than two a mode: what is left of a constant.
    vectors = vectors[:, -(2 * modes + 1) :]
    upper, last = vectors[:-1], vectors[-1]
    shifted = upper.T @ vectors[1:]
    # The inverse of upperᵀ upper = 1 − last lastᵀ, by Sherman and Morrison.
    rotation = shifted + xp.outer(last, last @ shifted) / xp.maximum(1 - last @ last, 1e-9)
    # Complex even where all are real, as NumPy gives them then: the logarithm of a negative one would be no number.
    logarithms = xp.log(xp.linalg.eigvals(rotation) + (1e-300 + 0j))
    angles = xp.where(logarithms.imag > 3.1, 0.0, logarithms.imag)
    chosen = xp.argsort(angles)[-modes:]
    return xp.stack([-logarithms.real[chosen], angles[chosen]]) / spacing


def _linearised(xp: Any, data: Any, times: Any, poles: Any) -> tuple[Any, Any, Any]:
    """The Gauss–Newton step of the poles, their covariance, and the amplitudes at time 0 that fit best."""
    decay, omega = poles[:, None]
    modes = decay.shape[1]
    time = times[:, None]
    swing = xp.exp(-decay * time)
    cosine, sine = swing * xp.cos(omega * time), swing * xp.sin(omega * time)
    linear = xp.concatenate([cosine, sine, xp.ones_like(time)], axis=1)
    weights = _inverse(xp, linear) @ (linear.T @ data)
    a, b = weights[:modes], weights[modes : 2 * modes]
    along, across = a[None], b[None]
    slopes = [-time * (along * cosine + across * sine), time * (across * cosine - along * sine)]
    jacobian = xp.concatenate([*slopes, linear], axis=1)
    residual = data - linear @ weights
    inverse = _inverse(xp, jacobian)
    noise = residual @ residual / (len(data) - jacobian.shape[1])
    step = (inverse @ (jacobian.T @ residual))[: 2 * modes].reshape(2, modes)
    covariance = noise * inverse[: 2 * modes, : 2 * modes].reshape(2, modes, 2, modes)
    return step, covariance, xp.hypot(a, b)


def _inverse(xp: Any, columns: Any) -> Any:
    """(columnsᵀ columns)⁻¹, the columns scaled to one length; a trace of ridge keeps it from being singular."""
    scale = 1 / xp.sqrt(xp.sum(columns**2, axis=0) + 1e-200)
    scaled = columns * scale[None, :]
    ridge = 1e-13 * np.eye(columns.shape[1])
    return scale[:, None] * xp.linalg.inv(scaled.T @ scaled + ridge) * scale[None, :]


def _order(xp: Any, bands: Any, found: Estimate) -> Any:
    """Which of the ascending frequencies belongs to which band: where most strength falls into its own band."""
    low, high = np.array(bands)[:, :, None].transpose(1, 0, 2)
    weights = xp.where((found.omega >= low) & (found.omega <= high), found.magnitude, 0.0)
    orders = np.array(list(permutations(range(len(bands)))))
    scores = weights[np.arange(len(bands)), orders].sum(axis=1)
    # Rounding errors must not change the ascending order, which comes first.
    return xp.asarray(orders)[(scores >= (1 - 1e-9) * scores.max()).argmax()]
