"""Adaptation while the machine moves: identify from every sample, and begin each move from the vibration that is there.

Three parts. Least squares on filtered signals estimate the first mode after half a period, in motion as well. Each
change of the reference is shaped by the shaper of its moment, so that nothing has to wait for a standstill. And a move
that begins while the payload still swings gets a shaper that cancels this swing as well.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.adaptive.arguments import check_band, check_positive, check_time
from jshape.adaptive.formulas import NUMPY, Numbers
from jshape.adaptive.identifiers.estimate import half_period
from jshape.adaptive.identifiers.least_squares import FilteredLeastSquares, Normal
from jshape.adaptive.identifiers.reasons import FOUND
from jshape.adaptive.identifiers.sensor import LIMIT, Sensor, checked
from jshape.adaptive.shapers.increments import IncrementShaper, Queue
from jshape.adaptive.shapers.repeated import repeated
from jshape.adaptive.shapers.transition import transition
from jshape.adaptive.strategies.replanning import Plan, begun, no_plan, replanned
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
    plan: Plan


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
        replans: how often a move may be planned anew while it runs (``replanning``).
        sway: how far a new plan may go back and forth, over the move.

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
    replans: int = eqx.field(static=True)
    sway: float = eqx.field(static=True)
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
        replans: int = 0,
        sway: float = 0.3,
    ):
        self.sample_time = check_time(sample_time)
        self.band = check_band(band, self.sample_time)
        self.identifier = FilteredLeastSquares(self.sample_time, self.band, threshold, memory=memory)
        self.omega, self.zeta = _check.as_array(omega, "omega"), _check.as_array(zeta, "zeta")
        self.servo, self.gain = _check.as_array(servo, "servo"), _check.as_array(gain, "gain")
        self.correction, self.limit = _check.scalar(correction, "correction"), check_positive(limit, "limit")
        self.zeta_limit, self.sway = float(zeta_limit), float(sway)
        self.replans = _check.count(replans, "replans", least=0)
        for value, name in ((self.omega, "omega"), (self.servo, "servo")):
            _check.positive(value, name)
        _check.damping_ratio(self.zeta)
        _check.damping_ratio(self.zeta_limit, "zeta_limit")
        _check.not_negative(self.correction, "correction")
        _check.not_negative(self.sway, "sway")
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

    def initial(self, reference: ArrayLike) -> AwareState:
        mode = Mode(self.omega[0], self.zeta[0], self.gain[0], np.inf, self.gain[1])
        plan = no_plan(1 + self.replans, 5 * len(self.others.times))
        return AwareState(Sensor(), Normal(), mode, self.queue.initial(reference), np.inf, 0, plan)

    def advance(
        self: Any, numbers: Numbers, state: AwareState, reference: ArrayLike, readings: Readings
    ) -> tuple[AwareState, Decision]:
        select, xp = numbers.select, numbers.xp
        patience = half_period(self.band, self.sample_time)
        strain, sample, reason = checked(numbers, state.strain, readings.strain, True, self.limit, patience)
        usable = (reason == FOUND) & (abs(readings.motor) <= LIMIT)
        normal = self.identifier.advance(numbers, state.normal, select(usable, sample, np.nan), readings.motor)
        mode = _updated(self, numbers, state.mode, normal)
        change = select(xp.isfinite(reference), reference, state.queue.reference) - state.queue.reference
        plan = state.plan._replace(age=state.plan.age + 1)

        def begin(plan: Plan) -> Plan:
            shaper, swing = _shaper(self, numbers, state.quiet, mode, normal, change)
            # The filter's lags have to see the move before its estimates count.
            wait = 4 / self.identifier.corner
            return begun(numbers, plan, change, state.queue.left == 0, shaper, swing, wait)

        def shaper(change: Any) -> tuple[Any, Any]:
            return plan.amounts[0] / select(change == 0, 1.0, change), plan.times[0]

        def anew(queue: Queue, plan: Plan) -> tuple[Queue, Plan]:
            return replanned(self, numbers, queue, plan, mode.omega, mode.zeta, _unit(self, numbers, mode)[0])

        plan = numbers.when(change != 0, begin, lambda same: same, plan)
        queue = self.queue.advance(numbers, state.queue, reference, shaper)
        if self.replans:
            fresh = (mode.omega != state.mode.omega) & (plan.age * self.sample_time >= plan.wait)
            due = fresh & (queue.left > 0) & (plan.made > 0) & (plan.made <= self.replans)
            queue, plan = numbers.when(due, anew, lambda *same: same, queue, plan)
        quiet = select(queue.left > 0, 0.0, state.quiet + self.sample_time)
        rejected = state.rejected + select(usable, 0, 1)
        omega, zeta = (
            xp.concatenate([xp.reshape(first, (1,)), fixed[1:]])
            for first, fixed in ((mode.omega, self.omega), (mode.zeta, self.zeta))
        )
        decision = Decision(queue.command, omega, zeta, rejected)
        return AwareState(strain, normal, mode, queue, quiet, rejected, plan), decision

    def bound(self, omega: float, zeta: float, spacing: float | None = None) -> float:
        """The largest residual vibration of the first mode, over a bare step's, however wrong the estimates are.

        Over all frequencies in the band, damping ratios and corrections that are allowed: a grid of 2,000 frequencies,
        5 damping ratios and 72 phases; for concrete values only. With ``replans`` every plan after the first adds at
        most ``sway`` to the way that the command goes, whose length over the move's is then the bound: no mode of a
        linear link is left with more.

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
            amplitudes, times = transition(NUMPY, 1.0, tuned_zeta, 1.0, phases)
            # As the envelope at the last impulse, like V.
            waves = np.exp(pole * (times[-1] - times[:, None]) / tuned)
            left = np.sum(np.abs(amplitudes), axis=0) if self.replans else np.abs(amplitudes.T @ waves)
            worst = max(worst, float(np.max(left)))
        return worst + self.replans * self.sway


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


def _unit(own: Any, numbers: Numbers, mode: Mode) -> tuple[Any, Any]:
    """The phasor that a step of 1 in the motor's reference gives the mode, through the servo, and the mode's pole."""
    root = numbers.xp.sqrt(1 - mode.zeta * mode.zeta)
    pole, (servo_omega, servo_zeta) = mode.omega * (-mode.zeta + 1j * root), own.servo
    # Twice the residue of −s² F(s) S(s)/s at the pole.
    through = servo_omega**2 / (pole * pole + 2 * servo_zeta * servo_omega * pole + servo_omega**2)
    return 1j * mode.gain * pole * through / (mode.omega * root), pole


def _shaper(
    own: Any, numbers: Numbers, quiet: Any, mode: Mode, normal: Normal, change: Any
) -> tuple[tuple[Any, Any], Any]:
    """Amplitudes and times (s) of a move's shaper, and the swing that it is to cancel: 0 unless the servo has settled,
    frequency and gain are known, and the move begins."""
    xp, select = numbers.xp, numbers.select
    swing = own.identifier.phasor(numbers, normal, mode.omega, mode.zeta)
    unit, pole = _unit(own, numbers, mode)
    # Through the other modes' shapers, too.
    step = unit * xp.sum(own.others.amplitudes * xp.exp(-pole * own.others.times)) * change
    settled = quiet > 8 / (own.servo[0] * own.servo[1]) + 4 / own.identifier.corner
    possible = settled & (abs(step) > 1e-12) & xp.isfinite(mode.gain_std) & xp.isfinite(mode.omega_std)
    rest = -swing / select(possible, step, 1.0)
    size = abs(rest)
    possible = possible & xp.isfinite(size)
    rest = select(possible, rest * xp.minimum(1.0, own.correction / xp.maximum(size, 1e-12)), 0.0 * rest)
    amplitudes, times = transition(numbers, mode.omega, mode.zeta, 1.0, rest)
    amplitudes = (amplitudes[:, None] * own.others.amplitudes[None, :]).reshape(-1)
    times = (times[:, None] + own.others.times[None, :]).reshape(-1)
    return (amplitudes, times), select(possible, swing, 0.0 * swing)
