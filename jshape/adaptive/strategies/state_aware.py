"""Adaptation while the machine moves: identify from every sample, and begin each move from the vibration that is there.

Three parts. Least squares on filtered signals estimate the first mode after half a period, in motion as well. Each
change of the reference is shaped by the shaper of its moment, so that nothing has to wait for a standstill. And a move
that begins while the payload still swings gets a shaper that cancels this swing as well.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from jshape import _check
from jshape.adaptive.arguments import check_band, check_positive, check_time
from jshape.adaptive.formulas import NUMPY, Numbers
from jshape.adaptive.identifiers.estimate import half_period
from jshape.adaptive.identifiers.least_squares import FilteredLeastSquares, Normal
from jshape.adaptive.identifiers.reasons import FOUND
from jshape.adaptive.identifiers.sensor import LIMIT, Sensor, checked
from jshape.adaptive.shapers.increments import IncrementShaper, Queue
from jshape.adaptive.shapers.repeated import repeated
from jshape.adaptive.shapers.transition import transition_zvd
from jshape.adaptive.strategies.strategy import AbstractStrategy, Decision, Readings
from jshape.design import linear
from jshape.shaper import Shaper


class Mode(NamedTuple):
    """The best estimate of the first mode, with standard deviations that grow with age."""

    omega: Any
    zeta: Any
    gain: Any
    omega_std: Any
    gain_std: Any


class AwareState(NamedTuple):
    """The state of a ``StateAware`` strategy."""

    strain: Sensor
    normal: Normal
    mode: Mode
    queue: Queue
    quiet: Any
    """For how long the command has stood still, s."""
    rejected: Any


class StateAware(AbstractStrategy):
    """A ZVD for the first mode, retuned while moving, that cancels the vibration it finds; a fixed ZVD for the others.

    Args:
        sample_time: s.
        omega: frequencies to start with, rad/s, shape (modes,).
        zeta: damping ratios to start with, shape (modes,).
        band: lowest and highest frequency of the first mode, rad/s.
        servo: frequency (rad/s) and damping ratio of the motor's loop, through which a correction passes.
        threshold: least amplitude of the strain gauge's signal that is evaluated, rad.
        gain: of the first mode, in the strain gauge's rad over the motor's, and its standard deviation; unknown until a
            move has shown it, unless given. Without it nothing is cancelled.
        correction: the largest vibration that a move cancels, as a fraction of what the bare move would cause; 0 for
            none.
        zeta_limit: greatest damping ratio of the first mode.
        memory: of the least squares, s; a period of the band's geometric mean, unless given.
        limit: greatest plausible |reading| of the strain gauge, rad; half a turn, unless given. A greater one would
            stand in the least squares until it is forgotten to below the vibration's square: one of 1e6 rad for longer
            than thirty times ``memory``.

    Raises:
        ValueError: for numbers that are not positive, a start outside the band, or lists of different lengths.
    """

    others: Shaper
    omega: Any
    zeta: Any
    servo: Any
    correction: Any
    gain: Any
    """Prior mean and standard deviation."""
    limit: Any
    sample_time: float = eqx.field(static=True)
    band: tuple[float, float] = eqx.field(static=True)
    zeta_limit: float = eqx.field(static=True)
    identifier: FilteredLeastSquares = eqx.field(static=True)
    queue: IncrementShaper = eqx.field(static=True)

    def __init__(
        self,
        sample_time: float,
        omega: Any,
        zeta: Any,
        band: tuple[float, float],
        servo: Any,
        threshold: float,
        *,
        gain: tuple[float, float] = (1.0, np.inf),
        correction: Any = 0.3,
        zeta_limit: float = 0.1,
        memory: float | None = None,
        limit: Any = np.pi,
    ):
        self.sample_time = check_time(sample_time)
        self.band = check_band(band, self.sample_time)
        self.identifier = FilteredLeastSquares(self.sample_time, self.band, threshold, memory=memory)
        self.omega, self.zeta = _check.as_array(omega, "omega"), _check.as_array(zeta, "zeta")
        self.servo, self.gain = _check.as_array(servo, "servo"), _check.as_array(gain, "gain")
        self.correction, self.limit = _check.scalar(correction, "correction"), check_positive(limit, "limit")
        self.zeta_limit = float(zeta_limit)
        for value, name in ((self.omega, "omega"), (self.servo, "servo")):
            _check.positive(value, name)
        _check.damping_ratio(self.zeta)
        _check.damping_ratio(self.zeta_limit, "zeta_limit")
        _check.not_negative(self.correction, "correction")
        shapes = self.omega.shape, self.zeta.shape, self.servo.shape, self.gain.shape
        if self.omega.ndim != 1 or shapes[0] != shapes[1] or shapes[2:] != ((2,), (2,)):
            raise ValueError(
                f"omega and zeta must have one entry a mode each, servo and gain two numbers, not of shapes {shapes}"
            )
        if not float(self.gain[1]) > 0:
            raise ValueError(f"gain must have a standard deviation greater than 0, not {float(self.gain[1]):g}")
        if not self.band[0] <= float(self.omega[0]) <= self.band[1]:
            raise ValueError(f"omega must begin within band {self.band}, not with {float(self.omega[0]):g}")
        others = Shaper([1.0], [0.0])
        for pair in zip(self.omega[1:], self.zeta[1:], strict=True):
            others = others.convolve(linear.zvd(*pair))
        self.others = others
        slowest = 2 * np.pi / self.band[0] / np.sqrt(1 - self.zeta_limit**2)
        self.queue = IncrementShaper(self.sample_time, float(slowest + others.duration))

    def initial(self, reference: Any) -> AwareState:
        mode = Mode(self.omega[0], self.zeta[0], self.gain[0], np.inf, self.gain[1])
        return AwareState(Sensor(), Normal(), mode, self.queue.initial(reference), np.inf, 0)

    def advance(
        self: Any, numbers: Numbers, state: AwareState, reference: Any, readings: Readings
    ) -> tuple[AwareState, Decision]:
        select, xp = numbers.select, numbers.xp
        patience = half_period(self.band, self.sample_time)
        strain, sample, reason = checked(numbers, state.strain, readings.strain, True, self.limit, patience)
        usable = (reason == FOUND) & (abs(readings.motor) <= LIMIT)
        normal = self.identifier.advance(numbers, state.normal, select(usable, sample, np.nan), readings.motor)
        mode = _updated(self, numbers, state.mode, normal)

        def shaper(change: Any) -> tuple[Any, Any]:
            rest = _rest(self, numbers, state.quiet, mode, normal, change)
            amplitudes, times = transition_zvd(numbers, mode.omega, mode.zeta, rest)
            return (
                (amplitudes[:, None] * self.others.amplitudes[None, :]).reshape(-1),
                (times[:, None] + self.others.times[None, :]).reshape(-1),
            )

        queue = self.queue.advance(numbers, state.queue, reference, shaper)
        quiet = select(queue.left > 0, 0.0, state.quiet + self.sample_time)
        rejected = state.rejected + select(usable, 0, 1)
        omega, zeta = (
            xp.concatenate([xp.reshape(first, (1,)), fixed[1:]])
            for first, fixed in ((mode.omega, self.omega), (mode.zeta, self.zeta))
        )
        decision = Decision(queue.command, omega, zeta, rejected)
        return AwareState(strain, normal, mode, queue, quiet, rejected), decision

    def bound(self, omega: float, zeta: float, spacing: float | None = None) -> float:
        """The largest residual vibration of the first mode, over a bare step's, however wrong the estimates are.

        Over all frequencies in the band, damping ratios and corrections that are allowed: a grid of 2,000 frequencies,
        5 damping ratios and 72 phases; for concrete values only.

        Args:
            omega: true frequency, rad/s.
            zeta: true damping ratio.
            spacing: of steps of one size, the least time from one to the next, s (``repeated``).
        """
        if spacing is not None:
            return float(repeated(self.bound(omega, zeta), omega, zeta, spacing))
        pole = omega * complex(-zeta, np.sqrt(1 - zeta**2))
        worst, tuned = 0.0, np.geomspace(*self.band, 2000)
        phases = np.append(np.exp(1j * np.linspace(0, 2 * np.pi, 73)) * float(self.correction), 0.0)
        for tuned_zeta in np.linspace(0, self.zeta_limit, 5):
            amplitudes, times = transition_zvd(NUMPY, 1.0, tuned_zeta, phases)
            # As the envelope at the last impulse, like V.
            waves = np.exp(pole * (times[-1] - times[:, None]) / tuned)
            worst = max(worst, float(np.max(np.abs(amplitudes.T @ waves))))
        return worst


def _updated(own: Any, numbers: Numbers, old: Mode, normal: Normal) -> Mode:
    """A new estimate replaces the old one where its standard deviation is less, or where it contradicts it."""
    xp, select = numbers.xp, numbers.select
    found = own.identifier.fit(numbers, normal)
    # An estimate loses a factor e of its precision in ten seconds: the payload may have changed since.
    age = np.exp(own.sample_time / 10.0)
    omega_std, gain_std = old.omega_std * age, old.gain_std * age
    apart = abs(found.omega - old.omega) > 4 * (found.omega_std + omega_std)
    better = found.valid & ((found.omega_std < omega_std) | apart)
    wrong_gain = abs(found.gain - old.gain) > 4 * (found.gain_std + gain_std)
    better_gain = found.gain_valid & ((found.gain_std < gain_std) | wrong_gain)
    zeta = xp.clip(found.zeta, 0.0, own.zeta_limit)
    return Mode(
        select(better, found.omega, old.omega),
        select(better, zeta, old.zeta),
        select(better_gain, found.gain, old.gain),
        select(better, found.omega_std, omega_std),
        select(better_gain, found.gain_std, gain_std),
    )


def _rest(own: Any, numbers: Numbers, quiet: Any, mode: Mode, normal: Normal, change: Any) -> Any:
    """ρ of ``transition_zvd``: 0 unless the servo has settled, frequency and gain are known, and the move begins."""
    xp, select = numbers.xp, numbers.select
    servo_omega, servo_zeta = own.servo[0], own.servo[1]
    root = xp.sqrt(1 - mode.zeta * mode.zeta)
    pole = mode.omega * (-mode.zeta + 1j * root)
    swing = own.identifier.phasor(numbers, normal, mode.omega, mode.zeta)
    # What a full step gives the mode, through the other modes' shapers and the servo: twice the residue of
    # −s² F(s) S(s)/s at the pole.
    through = servo_omega**2 / (pole * pole + 2 * servo_zeta * servo_omega * pole + servo_omega**2)
    through = through * xp.sum(own.others.amplitudes * xp.exp(-pole * own.others.times))
    step = 1j * mode.gain * pole * through / (mode.omega * root) * change
    settled = quiet > 8 / (servo_omega * servo_zeta) + 4 / own.identifier.corner
    possible = settled & (abs(step) > 1e-12) & xp.isfinite(mode.gain_std) & xp.isfinite(mode.omega_std)
    rest = -swing / select(possible, step, 1.0)
    size = abs(rest)
    rest = rest * xp.minimum(1.0, own.correction / xp.maximum(size, 1e-12))
    return select(possible & xp.isfinite(size), rest, 0.0 * rest)
