"""The cascade of filters as it runs: one sample in, one out, and new taps only where the output does not jump.

Each filter has a ring of what went into it, so that a sample costs one multiplication a tap. The same lines serve JAX
arrays and Python numbers (``Numbers``); the latter in nested lists, which for so few are far faster than arrays.
"""

import dataclasses
from functools import partial, reduce
from operator import and_, ge, ne, or_
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jshape._types import ArrayLike
from jshape.adaptive.formulas import JAX, Numbers, as_lists
from jshape.adaptive.identifiers.estimate import Estimate
from jshape.adaptive.shapers.taps import Filters

MOST = np.iinfo(np.int32).max
"""Where counts stop."""


class Shaped(NamedTuple):
    """The output of an adaptive shaper after a sample."""

    command: Any
    """The shaped reference, in its unit."""
    steady: Any
    """Whether the reference has stood still for as long as the taps reach, and for ``blank``: time to measure."""
    omega: Any
    """Frequencies that the filters are tuned to, rad/s, (modes,)."""
    zeta: Any
    """Their damping ratios, (modes,)."""
    rejected: Any
    """How many estimates marked as valid were no frequency, (modes,)."""
    limited: Any
    """How many lay outside their band or the damping's bounds, and were taken as the nearest inside, (modes,)."""
    missing: Any
    """How many samples of the reference were not numbers; the last one was held."""


class Tuning(NamedTuple):
    """The modes that the filters are tuned to, and their taps."""

    omega: Any
    """rad/s, (modes,)."""
    zeta: Any
    gains: Any
    """Of the taps after the first, (banks, modes, taps); the last bank is the newest."""
    delays: Any
    """Of the same, samples."""
    reach: Any
    """The longest delay of each filter, (modes,)."""
    faded: Any
    """How many samples of the cross-fade have passed."""


class Wanted(NamedTuple):
    """The modes that the estimates so far ask for; each of shape (modes,)."""

    omega: Any
    """As last estimated, rad/s."""
    zeta: Any
    rejected: Any
    """How many estimates marked as valid were no frequency."""
    limited: Any
    """How many lay outside what is allowed."""


class ShaperState(NamedTuple):
    """An adaptive shaper after some samples: arrays for a scan, nested lists for a control loop."""

    lines: Any
    """What went into each filter before ``last``, (length, modes), in the order of the places in the ring."""
    place: Any
    """Where ``last`` goes."""
    last: Any
    """What went into each filter with the last sample, (modes,)."""
    still: Any
    """For how many samples each filter's input has stood still, (modes,)."""
    wanted: Wanted
    tuning: Tuning
    missing: Any


@dataclasses.dataclass(frozen=True)
class Cascade:
    """The constants of an adaptive shaper while it runs.

    Attributes:
        filters: one kind for all modes.
        bands: lowest and highest frequency of each mode, rad/s.
        retune: ``"steady"`` or ``"crossfade"``.
        fade: samples.
        blank: samples.
        change: a frequency is multiplied or divided by at most 1 + ``change`` in a retune.
        length: samples that are stored of each filter's input: as many as the slowest frequencies allowed ask for.
    """

    filters: Filters
    bands: tuple[tuple[float, float], ...]
    retune: str
    fade: int
    blank: int
    change: float
    length: int

    def initial(self, xp: Any, omega: ArrayLike, zeta: ArrayLike, reference: ArrayLike) -> ShaperState:
        """The state at rest at ``reference``, tuned to those modes; ``xp``: NumPy or ``jax.numpy``."""
        modes = len(self.bands)
        gains, delays = self.filters.taps(xp, omega, zeta)
        banks, none = 2 if self.retune == "crossfade" else 1, np.zeros(modes, np.int32)
        gains, delays, reach = xp.stack([gains] * banks), xp.stack([delays] * banks), xp.max(delays, axis=1)
        return ShaperState(
            lines=xp.full((self.length, modes), reference),
            place=np.int32(0),
            last=xp.full(modes, reference),
            still=np.full(modes, self._long, np.int32),
            wanted=Wanted(omega, zeta, rejected=none, limited=none),
            tuning=Tuning(omega, zeta, gains, delays, reach, np.int32(self.fade)),
            missing=np.int32(0),
        )

    @property
    def _long(self) -> int:
        """Samples beyond which it does not matter how long the reference has stood still."""
        return max(self.length, self.blank)

    def advance(
        self, numbers: Numbers, state: ShaperState, reference: Any, estimate: Estimate | None
    ) -> tuple[ShaperState, Shaped]:
        """The state and the shaped reference after a sample."""
        select, modes = numbers.select, range(len(self.bands))
        last, tuning = state.last, state.tuning
        # Written before anything is read, so that a scan does it in place.
        lines = numbers.put(state.lines, state.place, last)
        place = select(state.place + 1 == self.length, 0, state.place + 1)
        usable = abs(reference) < np.inf  # false for a NaN
        value = select(usable, reference, last[0])
        missing = _count(select, state.missing, usable == 0)
        wanted = state.wanted if estimate is None else self._noted(numbers, state.wanted, estimate)

        fading = self.retune == "crossfade"
        news = _any_differ(wanted.omega, tuning.omega) | _any_differ(wanted.zeta, tuning.zeta)
        if fading:
            due = news & (tuning.faded == self.fade)
        else:
            due = news & (value != last[0]) & _all_reach(state.still, tuning.reach)
        retuned = partial(self._retuned, numbers)
        tuning = numbers.when(due, retuned, lambda t, *_: t, tuning, wanted.omega, wanted.zeta, state.still)
        shares: tuple = (1.0,)
        if fading:
            tuning = tuning._replace(faded=select(tuning.faded < self.fade, tuning.faded + 1, self.fade))
            share = tuning.faded * (1 / self.fade)
            shares = (1 - share, share)

        inputs, command = [], value
        for mode in modes:
            inputs.append(command)
            for bank, share in enumerate(shares):
                gains, delays = tuning.gains[bank][mode], tuning.delays[bank][mode]
                command = command + share * _departure(numbers, gains, lines, place, delays, mode, inputs[mode])
        long = self._long
        still = [
            select(inputs[k] == last[k], select(state.still[k] < long, state.still[k] + 1, long), 0) for k in modes
        ]
        steady = (still[0] >= self.blank) & _all_reach(still, tuning.reach)
        state = ShaperState(lines, place, packed(numbers, inputs), packed(numbers, still), wanted, tuning, missing)
        return state, Shaped(command, steady, tuning.omega, tuning.zeta, wanted.rejected, wanted.limited, missing)

    def _noted(self, numbers: Numbers, wanted: Wanted, estimate: Estimate) -> Wanted:
        """The wanted modes after this estimate, which are not in use yet."""
        select, modes = numbers.select, len(self.bands)
        names = ("omega", "zeta", "zeta_std", "valid")
        omega, zeta, deviation, valid = (_each(numbers, getattr(estimate, name), modes, name) for name in names)
        noted = []
        for k in range(modes):
            taken = valid[k] & (omega[k] > 0) & (omega[k] < np.inf)  # false for a NaN
            damped = taken & (abs(zeta[k]) < np.inf) & (deviation[k] < np.inf)
            near, out = _nearest(select, omega[k], self.bands[k])
            near_zeta, zeta_out = _nearest(select, zeta[k], self.filters.zeta_bounds)
            noted.append((
                select(taken, near, wanted.omega[k]),
                select(damped, near_zeta, wanted.zeta[k]),
                _count(select, wanted.rejected[k], valid[k] & (taken == 0)),
                _count(select, wanted.limited[k], (taken & out) | (damped & zeta_out)),
            ))  # fmt: skip
        return Wanted(*(packed(numbers, column) for column in zip(*noted, strict=True)))

    def _retuned(self, numbers: Numbers, tuning: Tuning, omega: Any, zeta: Any, still: Any) -> Tuning:
        """The tuning with new taps, as near to what is wanted as one retune may go, if the output does not jump."""
        xp = numbers.xp
        now, zeta, admissible = xp.asarray(tuning.omega), xp.asarray(zeta), True
        omega = xp.clip(xp.asarray(omega), now / (1 + self.change), now * (1 + self.change))
        gains, delays = self.filters.taps(xp, omega, zeta)
        reach = xp.max(delays, axis=1)
        if self.retune == "steady":
            # Longer taps may reach to before the stillness: they wait for the next edge.
            admissible = xp.all(reach <= xp.asarray(still))
            gains, delays = gains[None], delays[None]
        else:
            old = xp.asarray(tuning.gains)[1], xp.asarray(tuning.delays)[1]
            gains, delays = xp.stack([old[0], gains]), xp.stack([old[1], delays])
            reach = xp.maximum(reach, xp.max(old[1], axis=1))
        new = Tuning(omega, zeta, gains, delays, reach, 0 * tuning.faded)
        if numbers is JAX:
            return numbers.select(admissible, new, tuning)
        return as_lists(new) if admissible else tuning


def _count(select: Any, count: Any, happened: Any) -> Any:
    return select(happened & (count < MOST), count + 1, count)


def _nearest(select: Any, value: Any, bounds: tuple[float, float]) -> tuple[Any, Any]:
    """The nearest value within the bounds, and whether it is another."""
    low, high = bounds
    below, above = value < low, value > high
    return select(below, low, select(above, high, value)), below | above


def _any_differ(one: Any, other: Any) -> Any:
    """Whether any entries differ."""
    return reduce(or_, map(ne, one, other))


def _all_reach(counts: Any, reach: Any) -> Any:
    """Whether every filter's input has stood still for as long as its taps reach."""
    return reduce(and_, map(ge, counts, reach))


def packed(numbers: Numbers, values: Any) -> Any:
    """One value a mode as the state keeps them."""
    return numbers.xp.stack(values) if numbers is JAX else list(values)


def _departure(numbers: Numbers, gains: Any, lines: Any, place: Any, delays: Any, mode: int, value: Any) -> Any:
    """A filter's output less its input.

    Written with differences, which vanish exactly where the input has stood still: taps that are rounded sum to 1.
    """
    if numbers is JAX:
        return gains @ (lines[(place - delays) % len(lines), mode] - value)
    return sum([gain * (lines[place - delay][mode] - value) for gain, delay in zip(gains, delays, strict=True)])


def _each(numbers: Numbers, values: Any, modes: int, name: str) -> Any:
    """One value a mode. *Raises* ``ValueError`` if there are others."""
    if numbers is JAX:
        values = jnp.asarray(values)
    elif isinstance(values, np.ndarray | np.generic):
        values = values.tolist()
    if not isinstance(values, list) and not getattr(values, "ndim", hasattr(values, "__len__")):
        return [values] * modes
    if len(values) != modes:
        raise ValueError(f"estimate.{name} must be of {modes} modes, not of {len(values)}")
    return values
