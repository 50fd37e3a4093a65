"""Our way: identify from every sample, moving or not, and begin each move from the vibration that is there.

Three parts. Least squares on filtered signals know the first mode after half a swing, in motion as well. Each change of
the reference is shaped by the shaper of its moment, so that nothing has to wait for a standstill. And a move that
begins while the payload still swings gets a shaper that takes the swing away with it.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from jshape import _check
from jshape.adaptive.identifiers.estimate import FOUND, check_band, check_time
from jshape.adaptive.identifiers.least_squares import FilteredLeastSquares, Normal
from jshape.adaptive.identifiers.sensor import LIMIT, SENSOR_AT_START, Sensor, half_period, look
from jshape.adaptive.numbers import NUMPY, Numbers
from jshape.adaptive.shapers.increments import IncrementShaper, Queue
from jshape.adaptive.shapers.transition import transition_zvd
from jshape.adaptive.strategies.strategy import Decision, FormulaStrategy, Readings
from jshape.design import linear
from jshape.shaper import Shaper


class Belief(NamedTuple):
    """The first mode as it is believed, with standard deviations that grow with age."""

    omega: Any
    zeta: Any
    gain: Any
    omega_std: Any
    gain_std: Any


class AwareState(NamedTuple):
    """All that a ``StateAware`` strategy remembers."""

    strain: Sensor
    normal: Normal
    belief: Belief
    queue: Queue
    quiet: Any
    """For how long the command has stood still, s."""
    doubted: Any


class StateAware(FormulaStrategy):
    """A ZVD for the first mode, tuned while moving, that takes along the vibration it finds; a fixed ZVD for the
    others.

    ``sample_time``: s. ``omega``, ``zeta``: what it starts with, one a mode, rad/s and –; of the first mode, omega is
    learned within ``band`` (rad/s) and zeta between 0 and ``zeta_limit``. ``servo``: frequency (rad/s) and damping of
    the motor's loop, which a correction passes through. ``correction``: the largest vibration that a move takes away
    with it, as a fraction of what the bare move would cause; 0 for none. ``threshold``: the least vibration of the
    strain gauge, rad, that is listened to. ``memory``: s, of the least squares.

    *Raises* ``ValueError`` for numbers that are not positive, a start outside the band, or lists of different lengths.
    """

    others: Shaper
    omega: Any
    zeta: Any
    servo: Any
    correction: Any
    sample_time: float = eqx.field(static=True)
    band: tuple[float, float] = eqx.field(static=True)
    zeta_limit: float = eqx.field(static=True)
    identifier: FilteredLeastSquares = eqx.field(static=True)
    queue: IncrementShaper = eqx.field(static=True)

    def __init__(
        self,
        sample_time: float,
        omega: Any = (9.0, 70.0),
        zeta: Any = (0.017, 0.019),
        band: tuple[float, float] = (4.0, 14.0),
        zeta_limit: float = 0.1,
        servo: Any = (40.0, 0.9),
        correction: Any = 0.3,
        threshold: float = 3e-3,
        memory: float = 1.0,
    ):
        self.sample_time = check_time(sample_time)
        self.band = check_band(band, self.sample_time)
        self.identifier = FilteredLeastSquares(self.sample_time, self.band, threshold=threshold, memory=memory)
        self.omega, self.zeta, self.servo = (
            _check.as_array(value, name) for value, name in ((omega, "omega"), (zeta, "zeta"), (servo, "servo"))
        )
        self.correction = _check.scalar(correction, "correction")
        self.zeta_limit = float(zeta_limit)
        for value, name in ((self.omega, "omega"), (self.servo, "servo")):
            _check.positive(value, name)
        _check.damping_ratio(self.zeta)
        _check.damping_ratio(self.zeta_limit, "zeta_limit")
        _check.not_negative(self.correction, "correction")
        if self.omega.ndim != 1 or self.omega.shape != self.zeta.shape or self.servo.shape != (2,):
            raise ValueError(
                "omega and zeta must have one entry a mode each, servo two numbers, not of shapes "
                f"{self.omega.shape}, {self.zeta.shape} and {self.servo.shape}"
            )
        if not self.band[0] <= float(self.omega[0]) <= self.band[1]:
            raise ValueError(f"omega must begin within band {self.band}, not with {float(self.omega[0]):g}")
        others = Shaper([1.0], [0.0])
        for pair in zip(self.omega[1:], self.zeta[1:], strict=True):
            others = others.convolve(linear.zvd(*pair))
        self.others = others
        slowest = 2 * np.pi / self.band[0] / np.sqrt(1 - self.zeta_limit**2)
        self.queue = IncrementShaper(self.sample_time, float(slowest + others.duration))

    def initial(self, reference: Any) -> AwareState:
        # The gain of a uniform beam without load, until the first move tells.
        start = Belief(self.omega[0], self.zeta[0], 1.14, np.inf, 0.2)
        return AwareState(SENSOR_AT_START, Normal(), start, self.queue.initial(reference), np.inf, 0)

    def advance(
        self: Any, numbers: Numbers, state: AwareState, reference: Any, readings: Readings
    ) -> tuple[AwareState, Decision]:
        select, xp = numbers.select, numbers.xp
        patience = half_period(self.band, self.sample_time)
        strain, sample, reason = look(numbers, state.strain, readings.strain, True, LIMIT, patience)
        believed = (reason == FOUND) & xp.isfinite(readings.motor)
        normal = self.identifier.advance(numbers, state.normal, select(believed, sample, np.nan), readings.motor)
        belief = _believe(self, numbers, state.belief, normal)

        def shaper(change: Any) -> tuple[Any, Any]:
            rest = _rest(self, numbers, state.quiet, belief, normal, change)
            amplitudes, times = transition_zvd(numbers, belief.omega, belief.zeta, rest)
            return (
                (amplitudes[:, None] * self.others.amplitudes[None, :]).reshape(-1),
                (times[:, None] + self.others.times[None, :]).reshape(-1),
            )

        queue = self.queue.advance(numbers, state.queue, reference, shaper)
        quiet = select(queue.left > 0, 0.0, state.quiet + self.sample_time)
        doubted = state.doubted + select(believed, 0, 1)
        tuned = lambda first, all: xp.concatenate([xp.reshape(first, (1,)), all[1:]])
        decision = Decision(queue.command, tuned(belief.omega, self.omega), tuned(belief.zeta, self.zeta), doubted)
        return AwareState(strain, normal, belief, queue, quiet, doubted), decision

    def bound(self, omega: float, zeta: float) -> float:
        """The most that a step can leave of a first mode of that truth, over what a bare step leaves, however wrong
        the estimates are: over all frequencies in the band, damping ratios and corrections that are allowed.

        A grid of 2,000 frequencies, 5 damping ratios and 72 phases; for concrete values only.
        """
        pole = omega * complex(-zeta, np.sqrt(1 - zeta**2))
        worst, tuned = 0.0, np.geomspace(*self.band, 2000)
        phases = np.append(np.exp(1j * np.linspace(0, 2 * np.pi, 73)) * float(self.correction), 0.0)
        for damping in np.linspace(0, self.zeta_limit, 5):
            amplitudes, times = transition_zvd(NUMPY, 1.0, damping, phases)
            # As the envelope at the last impulse, like V.
            waves = np.exp(pole * (times[-1] - times[:, None]) / tuned)
            worst = max(worst, float(np.max(np.abs(amplitudes.T @ waves))))
        return worst


def _believe(own: Any, numbers: Numbers, old: Belief, normal: Normal) -> Belief:
    """What is newly found replaces the belief where it is surer, or contradicts it."""
    xp, select = numbers.xp, numbers.select
    found = own.identifier.fit(numbers, normal)
    # What was known well ten seconds ago is known less well now: the payload may have changed since.
    age = np.exp(own.sample_time / 10.0)
    omega_std, gain_std = old.omega_std * age, old.gain_std * age
    apart = abs(found.omega - old.omega) > 4 * (found.omega_std + omega_std)
    better = found.valid & ((found.omega_std < omega_std) | apart)
    louder = found.known & (found.gain_std < gain_std)
    zeta = xp.clip(found.zeta, 0.0, own.zeta_limit)
    return Belief(
        select(better, found.omega, old.omega),
        select(better, zeta, old.zeta),
        select(louder, found.gain, old.gain),
        select(better, found.omega_std, omega_std),
        select(louder, found.gain_std, gain_std),
    )


def _rest(own: Any, numbers: Numbers, quiet: Any, belief: Belief, normal: Normal, change: Any) -> Any:
    """ρ of ``transition_zvd``: 0 unless the servo has settled, frequency and gain are known, and the move begins."""
    xp, select = numbers.xp, numbers.select
    frequency, damping = own.servo[0], own.servo[1]
    root = xp.sqrt(1 - belief.zeta * belief.zeta)
    pole = belief.omega * (-belief.zeta + 1j * root)
    swing = own.identifier.phasor(numbers, normal, belief.omega, belief.zeta)
    # What a full step gives the mode, through the other modes' shapers and the servo: twice the residue of
    # −s² F(s) S(s)/s at the pole.
    through = frequency**2 / (pole * pole + 2 * damping * frequency * pole + frequency**2)
    through = through * xp.sum(own.others.amplitudes * xp.exp(-pole * own.others.times))
    step = 1j * belief.gain * pole * through / (belief.omega * root) * change
    settled = quiet > 8 / (frequency * damping) + 4 / own.identifier.corner
    possible = settled & (abs(step) > 1e-12) & xp.isfinite(belief.gain_std) & xp.isfinite(belief.omega_std)
    rest = -swing / select(possible, step, 1.0)
    size = abs(rest)
    rest = rest * xp.minimum(1.0, own.correction / xp.maximum(size, 1e-12))
    return select(possible & xp.isfinite(size), rest, 0.0 * rest)
