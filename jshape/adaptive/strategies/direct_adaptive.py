"""Direct adaptive shaping: a cascade of ZVD filters, retuned by a point-by-point DFT and by extremum seeking.

Three cases of one loop: input shaping alone (I), with the DFT for the frequencies (I-D), and with extremum seeking for
the damping ratios beside it (I-D-E).

Extremum seeking is that of the paper's Fig. 2, but its time counts in moves and not in seconds. A damping ratio enters
with an edge, and what it was worth is known with the next, so that there is one perturbation a move and the cost of a
move meets the perturbation it had; seconds would multiply it with that of a later moment, and the sign of the slope
would depend on how long a move takes. Nor does a move count whose frequencies were wrong or whose shaper had not run
out: its vibration is far larger than any damping ratio's share, and the next move's cost is then the first of a new
series. The same holds for a cost beyond its unit, as a broken accelerometer shows it: a single one would take the
damping ratios to their bounds, from where costs of the usual size bring them back in tiny steps only.

Source: Chatlatanagulchai, Chotana and Prutthapong, Figs. 3 and 6.
"""

from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from jshape._types import Scalar
from jshape.adaptive.arguments import check_positive
from jshape.adaptive.formulas import Numbers, plain
from jshape.adaptive.identifiers.estimate import Estimate
from jshape.adaptive.identifiers.sensor import LIMIT
from jshape.adaptive.identifiers.sliding_dft import SlidingDFT
from jshape.adaptive.shapers.adaptive_shaper import AdaptiveShaper
from jshape.adaptive.shapers.cascade import Cascade, ShaperState, packed
from jshape.adaptive.strategies.extremum_seeking import ExtremumSeeking, advanced, perturbed, skipped
from jshape.adaptive.strategies.strategy import AbstractStrategy, Decision, OnlineStrategy, Readings

AGREE = 0.05
"""By how much the frequencies estimated in a movement may differ from those it was shaped for, as a fraction, if its
vibration is to count as a cost: a ZVD shaper leaves 0.6 % then, and more than that is not the damping ratios' doing."""


class DirectState(NamedTuple):
    """The state of a ``DirectAdaptive`` strategy."""

    shaper: Any
    dfts: tuple[Any, ...]
    seeking: Any
    zeta: Any
    """What the extremum seeking asks for, (modes,)."""
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
        cost_unit: the seeking's cost is ∫ |a| dt in this unit, m/s, and what is more does not count.

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

    @property
    def cascade(self) -> Cascade:
        """The filters as they run."""
        return self.shaper.cascade

    def initial(self, reference: Any) -> DirectState:
        seeking, zeta = (), ()
        if self.seeking is not None:
            seeking = self.seeking.start()
            zeta = self.seeking.parameters(seeking)
        dfts = tuple(dft.initial() for dft in self.dfts)
        return DirectState(self.shaper.start(reference), dfts, seeking, zeta, np.nan * reference, reference, False, 0)

    def online(self, reference: float = 0.0) -> OnlineStrategy:
        reference, seeking = float(reference), self.seeking and self.seeking.online()
        state = DirectState(
            self.shaper.online(reference).state, tuple(dft.initial() for dft in self.dfts),
            seeking and seeking.state, seeking and seeking.parameters, np.nan, reference, False, 0,
        )  # fmt: skip
        own = SimpleNamespace(
            cascade=self.cascade, dfts=tuple(map(plain, self.dfts)), seeking=seeking and seeking.own,
            cost_unit=float(self.cost_unit), sample_time=self.sample_time,
        )  # fmt: skip
        return OnlineStrategy(own, type(self).advance, state)

    def advance(
        self: Any, numbers: Numbers, state: DirectState, reference: Any, readings: Readings
    ) -> tuple[DirectState, Decision]:
        select, samples = numbers.select, (readings.tip, readings.middle)
        tip_usable, middle_usable = abs(readings.tip) <= LIMIT, abs(readings.middle) <= LIMIT  # false for a NaN
        reference_usable = abs(reference) < np.inf
        moved = reference_usable & (reference != state.reference)
        seeking, zeta = state.seeking, state.zeta
        if self.seeking is not None:
            after_move = partial(_after_move, self, numbers)
            seeking, zeta = numbers.when(moved, after_move, lambda state: (state.seeking, state.zeta), state)
        tip = select(tip_usable, abs(readings.tip), 0.0) * self.sample_time
        cost = select(moved, 0.0, state.cost) + tip
        dfts = tuple(
            SlidingDFT.advance(dft, numbers, memory, sample, state.steady)
            for dft, memory, sample in zip(self.dfts, state.dfts, samples, strict=False)
        )
        estimates = [memory.estimate for memory in dfts]
        estimate = _together(numbers, estimates, zeta if self.seeking is not None else None) if estimates else None
        shaper, shaped = self.cascade.advance(numbers, state.shaper, reference, estimate)
        rejected = state.rejected + select(tip_usable & middle_usable, 0, 1)
        reference = select(reference_usable, reference, state.reference)
        decision = Decision(shaped.command, shaped.omega, shaped.zeta, rejected + sum(shaped.rejected))
        return DirectState(shaper, dfts, seeking, zeta, cost, reference, shaped.steady, rejected), decision


def _after_move(own: Any, numbers: Numbers, state: DirectState) -> tuple[Any, Any]:
    """The extremum seeking at an edge and its damping ratios: a step, unless the cost has another cause than those."""
    counts = state.steady & _agree(numbers.xp, state.shaper) & ((state.cost > own.cost_unit) == 0)  # true for a NaN
    stepped = advanced(numbers, own.seeking, state.seeking, state.cost / own.cost_unit)
    seeking = numbers.select(counts, stepped, skipped(own.seeking, state.seeking))
    return seeking, perturbed(numbers, own.seeking, seeking)


def _agree(xp: Any, shaper: ShaperState) -> Any:
    """Whether the filters were tuned to the frequencies that were estimated during the movement."""
    wanted, tuned = xp.asarray(shaper.wanted.omega), xp.asarray(shaper.tuning.omega)
    return xp.all(abs(wanted - tuned) <= AGREE * tuned)


def _together(numbers: Numbers, estimates: list[Estimate], zeta: Any) -> Estimate:
    """One estimate of both modes: frequencies from the DFTs, damping ratios from the extremum seeking."""
    omega, zetas, omega_std, zeta_std, *rest = [packed(numbers, column) for column in zip(*estimates, strict=True)]
    if zeta is not None:
        zetas, zeta_std = zeta, packed(numbers, [0.0, 0.0])
    return Estimate(omega, zetas, omega_std, zeta_std, *rest)
