"""Direct adaptive shaping: a cascade of ZVD filters, retuned by a point-by-point DFT and by extremum seeking.

Three cases of one loop: input shaping alone (I), with the DFT for the frequencies (I-D), and with extremum seeking for
the damping ratios beside it (I-D-E).

Extremum seeking is that of the paper's Fig. 2, but its time counts in moves and not in seconds. A damping ratio enters
with an edge, and what it was worth is known with the next, so that there is one perturbation a move and the cost of a
move meets the perturbation it had; seconds would multiply it with that of a later moment, and the sign of the slope
would depend on how long a move takes. Nor does a move count whose frequencies were wrong or whose shaper had not run
out: its vibration is far larger than any damping ratio's share, and the next move's cost is then the first of a new
series.

Source: Chatlatanagulchai, Chotana and Prutthapong, Figs. 3 and 6.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jshape._types import Scalar
from jshape.adaptive.arguments import check_positive
from jshape.adaptive.formulas import JAX
from jshape.adaptive.identifiers.estimate import Estimate
from jshape.adaptive.identifiers.sliding_dft import SlidingDFT
from jshape.adaptive.shapers.adaptive_shaper import AdaptiveShaper
from jshape.adaptive.shapers.cascade import ShaperState
from jshape.adaptive.strategies.extremum_seeking import ExtremumSeeking
from jshape.adaptive.strategies.strategy import AbstractStrategy, Decision, OnlineStrategy, Readings

AGREE = 0.05
"""By how much the frequencies estimated in a movement may differ from those it was shaped for, as a fraction, if its
vibration is to count as a cost: a ZVD shaper leaves 0.6 % then, and more than that is not the damping ratios' doing."""


class DirectState(NamedTuple):
    """All that a ``DirectAdaptive`` strategy remembers."""

    shaper: Any
    dfts: tuple[Any, ...]
    seeking: Any
    cost: Any
    """∫ |a| dt since the last edge, m/s; NaN before the first."""
    reference: Any
    steady: Any
    rejected: Any


class DirectAdaptive(AbstractStrategy):
    """An ``AdaptiveShaper`` of two modes: the tip's accelerometer measures the first, the one in the middle the second.

    The DFTs take samples while the shaper says that the reference is steady.

    Args:
        shaper: with bands, blanking and start.
        dfts: one ``SlidingDFT`` for each mode, or none: then the frequencies stay.
        seeking: of the damping ratios, one step a move, by the vibration accumulated over the preceding movement; or
            ``None``.
        cost_unit: the seeking's cost is ∫ |a| dt in this unit, m/s.

    Raises:
        ValueError: if the numbers of modes differ, or sample times do, or the seeking's step is not one move.
    """

    shaper: AdaptiveShaper
    dfts: tuple[SlidingDFT, ...]
    seeking: ExtremumSeeking | None
    cost_unit: Scalar

    def __init__(
        self,
        shaper: AdaptiveShaper,
        dfts: tuple[SlidingDFT, ...] = (),
        seeking: ExtremumSeeking | None = None,
        cost_unit: Any = 1.0,
    ):
        self.shaper, self.dfts, self.seeking = shaper, tuple(dfts), seeking
        self.cost_unit = check_positive(cost_unit, "cost_unit")
        modes = len(shaper.omega)
        if modes != 2 or len(self.dfts) not in (0, modes) or (seeking and len(seeking.centre) != modes):
            raise ValueError(
                f"shaper must be of two modes, with as many dfts (or none) and damping ratios to seek, not of {modes}, "
                f"{len(self.dfts)} and {len(seeking.centre) if seeking else 0}"
            )
        for part in self.dfts:
            if part.sample_time != shaper.sample_time:
                raise ValueError(
                    f"dfts must have the shaper's sample time {shaper.sample_time}, not {part.sample_time}"
                )
        if seeking and seeking.step_time != 1:
            raise ValueError(f"seeking must count its time in moves, with a step_time of 1, not {seeking.step_time}")

    @property
    def sample_time(self) -> float:
        """s."""
        return self.shaper.sample_time

    def start(self, reference: Any) -> DirectState:
        seeking = () if self.seeking is None else self.seeking.start()
        return DirectState(
            self.shaper.start(reference),
            tuple(dft.start() for dft in self.dfts),
            seeking,
            jnp.full_like(jnp.asarray(reference), jnp.nan),
            jnp.asarray(reference),
            jnp.asarray(False),
            jnp.asarray(0, jnp.int32),
        )

    def step(self, state: DirectState, reference: Any, readings: Readings) -> tuple[DirectState, Decision]:
        moved = jnp.isfinite(reference) & (reference != state.reference)
        tip = jnp.where(jnp.isfinite(readings.tip), jnp.abs(readings.tip), 0.0) * self.sample_time
        measured = [
            dft.step(memory, sample, state.steady)
            for dft, memory, sample in zip(self.dfts, state.dfts, (readings.tip, readings.middle), strict=False)
        ]
        seeking, zeta = state.seeking, None
        if self.seeking is not None:
            stepped, _ = self.seeking.step(seeking, state.cost / self.cost_unit)
            counts = state.steady & _agree(jnp, state.shaper)
            stepped = JAX.select(counts, stepped, self.seeking.skip(seeking))
            seeking = JAX.select(moved, stepped, seeking)
            zeta = self.seeking.parameters(seeking)
        cost = jnp.where(moved, 0.0, state.cost) + tip
        estimate = _together(jnp.stack, [estimate for _, estimate in measured], zeta)
        shaper, shaped = self.shaper.step(state.shaper, reference, estimate)
        missed = ~jnp.isfinite(readings.tip) | ~jnp.isfinite(readings.middle)
        rejected = state.rejected + missed.astype(jnp.int32)
        new = DirectState(
            shaper, tuple(memory for memory, _ in measured), seeking, cost,
            jnp.where(jnp.isfinite(reference), reference, state.reference), shaped.steady, rejected,
        )  # fmt: skip
        return new, Decision(shaped.command, shaped.omega, shaped.zeta, rejected + jnp.sum(shaped.rejected))

    def online(self, reference: float = 0.0) -> OnlineStrategy:
        return _OnlineDirect(self, reference)


def _agree(xp: Any, shaper: ShaperState) -> Any:
    """Whether the filters were tuned to the frequencies that were estimated during the movement."""
    wanted, tuned = xp.asarray(shaper.wanted.omega), xp.asarray(shaper.tuning.omega)
    return xp.all(abs(wanted - tuned) <= AGREE * tuned)


def _together(pack: Callable[[Any], Any], estimates: list[Estimate], zeta: Any) -> Estimate | None:
    """One estimate of both modes: frequencies from the DFTs, damping ratios from the extremum seeking."""
    if not estimates:
        return None
    omega, zetas, omega_std, zeta_std, magnitude, valid = map(pack, zip(*estimates, strict=True))
    if zeta is not None:
        zetas, zeta_std = pack(list(zeta)), pack([0.0 * each for each in zeta])
    return Estimate(omega, zetas, omega_std, zeta_std, magnitude, valid)


class _OnlineDirect:
    """``DirectAdaptive`` as a plain object, of the parts' own plain objects."""

    def __init__(self, strategy: DirectAdaptive, reference: float):
        self._time, self._unit = strategy.sample_time, float(strategy.cost_unit)
        self._shaper = strategy.shaper.online(reference)
        self._dfts = [dft.online() for dft in strategy.dfts]
        self._seeking = strategy.seeking and strategy.seeking.online()
        self._zeta = self._seeking and self._seeking.parameters.tolist()
        self._reference, self._steady, self._cost, self._missed = float(reference), False, np.nan, 0

    def push(self, reference: float, readings: Readings) -> Decision:
        samples = (readings.tip, readings.middle)
        usable = [math.isfinite(sample) for sample in samples]
        tip = abs(readings.tip) * self._time if usable[0] else 0.0
        moved = math.isfinite(reference) and reference != self._reference
        if moved and self._seeking:
            if self._steady and _agree(np, self._shaper.state):
                self._seeking.push(self._cost / self._unit)
            else:
                self._seeking.skip()
            self._zeta = self._seeking.parameters.tolist()
        self._cost = tip if moved else self._cost + tip
        self._reference = reference if moved else self._reference
        measured = [dft.push(float(sample), self._steady) for dft, sample in zip(self._dfts, samples, strict=False)]
        shaped = self._shaper.push(reference, _together(list, measured, self._zeta))
        self._steady = shaped.steady
        self._missed += not all(usable)
        return Decision(shaped.command, shaped.omega, shaped.zeta, self._missed + int(sum(shaped.rejected)))
