"""The point-by-point DFT: the spectrum of the last N samples after every sample, for a few operations a bin.

Samples lie in a ring of N places. A sample that comes is added to the sum of the window, turned by the phase of its
place, and the one that lay there is taken off. A second sum is only ever added to: it begins anew with every round of
the ring, at whose end it is the sum of the window and takes its place. Errors thus live for two rounds at most, however
long the machine runs, and no damping factor falsifies the spectrum.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jshape import _check
from jshape.adaptive.formulas import JAX, NUMPY, Numbers, plain
from jshape.adaptive.identifiers import reasons
from jshape.adaptive.identifiers.estimate import AbstractIdentifier, Estimate, settle, uninformed
from jshape.adaptive.identifiers.sensor import LIMIT, Sensor, checked

WINDOWS = ("rectangular", "hann")
INTERPOLATIONS = ("jacobsen", "parabolic", "none")
FLOOR = 1e-14
"""Of the window's sum of squares, what is taken as noise where there seems to be less: rounding errors."""


class Sums(NamedTuple):
    """Over some samples."""

    spectrum: Any
    """Σ x e^(−jω·place), of shape (offsets, bins)."""
    total: Any
    """Σ x."""
    squares: Any
    """Σ x²."""


NOTHING = Sums(0.0, 0.0, 0.0)


class SpectrumState(NamedTuple):
    """A sliding DFT after some samples."""

    ring: Any
    """The samples of the window."""
    place: Any
    """Where in the ring the next sample goes: where the oldest one is."""
    oldest: Any
    """What lies there. Read before it is needed, so that nothing reads the ring that is being written, which would
    make a scan copy it for every sample."""
    filled: Any
    """How many samples are in the window."""
    phase: Any
    """e^(−jω·place) of the next sample, of shape (offsets, bins); 1 at the beginning of a round."""
    whole: Sums
    """Over the samples of the window."""
    round: Sums
    """Over those of this round of the ring."""
    sensor: Sensor
    estimate: Estimate
    reason: Any


class SlidingDFT(AbstractIdentifier):
    """The strongest frequency inside a band, by a discrete Fourier transform over the last samples.

    A magnitude is that of the DFT's sum, |Σ x_n e^(−jωn)|, in the unit of the samples and in either window: a steady
    vibration of amplitude A has A·points/2. A peak whose neighbour beyond the band is higher is the leakage of
    something outside, and no estimate. The standard deviation is that of Jacobsen's ratio with everything in the window
    but the tone counted as white noise, together with what leaks in from the tone's negative frequency or its alias,
    and the width of a bin where nothing is interpolated, or a parabola is laid through the DFT's own bins. What is not
    in it: a frequency that changes within the window is smeared, two that lie closer than two bins are taken for one,
    and a vibration struck anew, out of phase with itself, may split the peak and shift it by a bin and more. Damping is
    not observed.

    Args:
        sample_time: s.
        points: samples in the window.
        band: lowest and highest allowed frequency, rad/s.
        threshold: least magnitude of a peak.
        bins: frequencies of one's own, rad/s, increasing, some beyond the band's ends; those of the DFT inside the band
            and one beyond either end, if not given.
        window: ``"rectangular"``, or ``"hann"``, which combines neighbouring bins.
        interpolation: between bins: ``"jacobsen"``, exact for one long vibration in either window, for the DFT's own
            bins; ``"parabolic"``, through the peak and its neighbours, for bins that lie closer; ``"none"``.
        limit: greatest plausible |sample|.

    Raises:
        ValueError: for a band that is no band or holds no bin, bins that do not increase, unknown words, or
            ``"jacobsen"`` at bins of one's own.

    Source: Chatlatanagulchai, Chotana and Prutthapong, Eqs. 1–2 and the rule for an update; Duda (2010), Accurate,
        guaranteed stable, sliding discrete Fourier transform, for sums that are turned, not their poles; Jacobsen and
        Kootsookos (2007), Fast, accurate frequency estimators, Eq. 3.
    """

    rotation: Complex[Array, "offsets bins"]
    """By which the phase turns with every sample."""
    omegas: Float[Array, "offsets bins"]
    """Row 0: of the spectrum, rad/s; for the Hann window then their neighbours, one period less and more."""
    points: int = eqx.field(static=True)
    allowed: tuple[int, int] = eqx.field(static=True)
    """The bins in the band: from the first to before the second."""
    window: str = eqx.field(static=True)
    interpolation: str = eqx.field(static=True)
    spacing: float = eqx.field(static=True)
    """Between two bins of the DFT, rad/s."""
    own_bins: bool = eqx.field(static=True)
    """Whether the bins are the DFT's, a whole number of periods in the window each."""

    def __init__(
        self,
        sample_time: float,
        points: int,
        band: Any,
        threshold: Any,
        *,
        bins: Any = None,
        window: str = "rectangular",
        interpolation: str = "jacobsen",
        limit: Any = LIMIT,
    ):
        super().__init__(sample_time, band, threshold, limit)
        self.points = _check.count(points, "points", least=4)
        self.spacing = 2 * np.pi / (self.points * self.sample_time)
        _check.one_of(window, "window", WINDOWS)
        _check.one_of(interpolation, "interpolation", INTERPOLATIONS)
        self.window, self.interpolation, self.own_bins = window, interpolation, bins is None
        if not self.own_bins and interpolation == "jacobsen":
            raise ValueError("interpolation 'jacobsen' needs the DFT's own bins: leave bins out, or use 'parabolic'")
        if bins is None:
            first, last = np.asarray(self.band) / self.spacing
            bins = np.arange(np.ceil(first - 1e-9) - 1, np.floor(last + 1e-9) + 2) * self.spacing
        bins = np.asarray(_check.as_array(bins, "bins"), float)
        _check.finite(bins, "bins")
        low, high = self.band
        inside = np.flatnonzero((bins >= low * (1 - 1e-9)) & (bins <= high * (1 + 1e-9)))
        if not len(inside):
            raise ValueError(f"band must hold a bin, but ({low:g}, {high:g}) rad/s holds none of {_check.show(bins)}")
        if bins.ndim != 1 or len(bins) < 3 or np.any(np.diff(bins) <= 0):
            raise ValueError(f"bins must be at least three increasing frequencies, not {_check.show(bins)}")
        self.allowed = int(inside[0]), int(inside[-1]) + 1
        offsets = np.array([0.0, -1.0, 1.0] if window == "hann" else [0.0]) * self.spacing
        omegas = bins + offsets[:, None]
        self.omegas = jnp.asarray(omegas)
        self.rotation = jnp.asarray(np.exp(-1j * self.sample_time * omegas))

    def initial(self) -> SpectrumState:
        nothing = Sums(np.zeros(self.omegas.shape, complex), 0.0, 0.0)
        return SpectrumState(
            ring=np.zeros(self.points),
            place=0,
            oldest=0.0,
            filled=0,
            phase=np.ones(self.omegas.shape, complex),
            whole=nothing,
            round=nothing,
            sensor=Sensor(),
            estimate=uninformed(self.band),
            reason=reasons.STARTING,
        )

    def forget(self, state: SpectrumState) -> SpectrumState:
        """The state with an empty window; the last estimate stays. What lies in the ring is filled before it counts."""
        nothing = jax.tree.map(lambda sum: 0 * sum, state.round)
        start = dict(place=0 * state.place, filled=0 * state.filled, phase=0 * state.phase + 1)
        return state._replace(**start, whole=nothing, round=nothing)

    def spectrum(self, state: SpectrumState) -> tuple[Any, Any]:
        """Frequencies (rad/s) and magnitudes of the window in that state, both of shape (bins,)."""
        numbers, own = (NUMPY, plain(self)) if isinstance(state.ring, np.ndarray) else (JAX, self)
        return own.omegas[0], abs(_windowed(own, numbers, state.place, state.whole, state.round))

    @staticmethod
    def advance(own: Any, numbers: Numbers, state: SpectrumState, sample: Any, active: Any) -> SpectrumState:
        select, points = numbers.select, own.points
        sensor, value, trouble = checked(numbers, state.sensor, sample, active, own.limit, own.patience)

        place, there, full = state.place, state.oldest, state.filled == points
        comes, goes, one = select(active, (value, select(full, there, 0.0), 1), (0.0, 0.0, 0))
        whole, round, turned, change = state.whole, state.round, state.phase, comes - goes
        squares = whole.squares + (comes * comes - goes * goes)
        whole = Sums(whole.spectrum + change * turned, whole.total + change, squares)
        round = Sums(round.spectrum + comes * turned, round.total + comes, round.squares + comes * comes)
        ring = numbers.put(state.ring, place, select(active, value, there))
        around = place + one == points
        phase = select(active, turned * own.rotation, turned)
        whole, round, phase = select(around, (round, NOTHING, 1.0), (whole, round, phase))
        place, filled = select(around, 0, place + one), select(full, points, state.filled + one)
        oldest = numbers.get(ring, place)

        found, outside = _peak(own, numbers, place, whole, round)
        reason = reasons.first(
            numbers,
            (trouble != reasons.FOUND, trouble),
            (filled < points, reasons.STARTING),
            (found.magnitude <= own.threshold, reasons.WEAK),
            (outside, reasons.OUTSIDE),
        )
        estimate = settle(numbers, state.estimate, found, reason)
        return SpectrumState(ring, place, oldest, filled, phase, whole, round, sensor, estimate, reason)


def _peak(own: Any, numbers: Numbers, place: Any, whole: Sums, round: Sums) -> tuple[Estimate, Any]:
    """The highest bin of the band, interpolated, and whether a neighbour is higher."""
    math, select, (first, last), bins = numbers.math, numbers.select, own.allowed, own.omegas[0]
    sums = _unwindowed(own, numbers, place, whole, round, centred=True)
    values = _window_of(own, numbers, place, sums)
    magnitudes = abs(values)
    highest = first + magnitudes[first:last].argmax()
    middle = select(highest < 1, 1, select(highest > len(bins) - 2, len(bins) - 2, highest))
    left, peak, right = numbers.three(magnitudes, middle)
    bin_peak = numbers.get(bins, middle)

    if own.interpolation == "jacobsen":
        turn = _turn(own, numbers, place)
        below, centre, above = numbers.three(values, middle)
        below, above = below / turn, above * turn
        bend = 2 * centre - below - above
        off = ((below - above) / select(bend == 0, 1.0, bend)).real
        off = 2 * off if own.window == "hann" else off
    elif own.interpolation == "parabolic":
        bin_below, _, bin_above = numbers.three(bins, middle)
        down, up = bin_peak - bin_below, bin_above - bin_peak
        fall, rise = up * (peak - left), down * (peak - right)
        off = (up * fall - down * rise) / (2 * own.spacing * select(fall + rise == 0, 1.0, fall + rise))
    else:
        off = 0.0 * peak
    off = select(abs(off) > 0.9, 0.0 * off, off)

    # The error of Jacobsen's ratio by the white noise of what is not the tone, as three bins show that.
    inner = select(abs(off) < 1e-6, 1e-6, off)
    sinc, spread = math.sin(np.pi * inner) / (np.pi * inner * (1 - inner * inner)), 1 + 3 * off**2
    shape = 1 - off**2, abs(off) * (1 - off), abs(off) * (1 + off)
    rectangular = _fitted(shape, sinc, numbers.three(abs(sums[0]), middle))
    tone, squares = rectangular, whole.squares - whole.total * whole.total / own.points
    if own.window == "hann":
        sinc, spread = sinc / (4 - inner**2), (10 + 17.5 * off**2) / 72
        shape = 4 - off**2, (1 - off) * (2 - off), (1 + off) * (2 + off)
        tone = _fitted(shape, sinc, (left, peak, right))
    tone = 2 * tone**2 / own.points
    tone = select(tone > 0, tone, 1.0)
    # Three bins may show more than there is where two tones lie close together: no tone fits by as much, either. In
    # either window the difference may vanish by chance.
    misfit, other = abs(squares - tone), abs(squares - 2 * rectangular**2 / own.points)
    misfit = select(misfit > other, misfit, other)
    floor = FLOOR * abs(whole.squares)
    noise = select(misfit > floor, misfit, floor)
    variance = own.spacing**2 * spread * noise / (2 * sinc**2 * tone * own.points)
    if own.interpolation == "none" or (own.interpolation == "parabolic" and own.own_bins):
        bin_below, _, bin_above = numbers.three(bins, middle)
        variance = variance + ((bin_above - bin_below) / 2) ** 2 / 12
    else:
        # What the same vibration at the negative frequency, or its alias, leaks into the peak moves it by about so many
        # bins.
        away, sample_rate = 2 * bin_peak, own.points * own.spacing
        share = own.spacing / select(2 * away < sample_rate, away, sample_rate - away)
        leak = share**3 if own.window == "hann" else share / np.pi
        leak = leak * share if own.interpolation == "jacobsen" else leak
        variance = variance + (own.spacing * leak) ** 2
    omega = bin_peak + own.spacing * off
    return Estimate(omega, 0.0, math.sqrt(variance), np.inf, peak, True), (left > peak) | (right > peak)


def _fitted(shape: Any, sinc: Any, magnitudes: Any) -> Any:
    """The magnitude of a tone by least squares from three bins.

    Args:
        shape: what a tone of size 1 / ``sinc`` has in the middle bin, the one below and the one above.
        sinc: of the window.
        magnitudes: of the bin below, the middle one and the one above.
    """
    below, centre, above = magnitudes
    fitted = shape[0] * centre + shape[1] * below + shape[2] * above
    return fitted / (sinc * (shape[0] ** 2 + shape[1] ** 2 + shape[2] ** 2))


def _windowed(own: Any, numbers: Numbers, place: Any, whole: Sums, round: Sums) -> Any:
    """The window's DFT at the bins, but for the phase of the window's beginning."""
    return _window_of(own, numbers, place, _unwindowed(own, numbers, place, whole, round))


def _unwindowed(own: Any, numbers: Numbers, place: Any, whole: Sums, round: Sums, centred: bool = False) -> Any:
    """The same in the rectangular window, of every offset.

    ``centred``: of the samples less their mean, which has no part in the DFT's own bins.
    """
    sums = whole.spectrum
    if not own.own_bins:
        # Samples of the round before lie N places back: whole periods of the DFT's own bins.
        xp, angle = numbers.xp, own.sample_time * own.omegas
        turn = xp.exp(1j * own.points * angle)
        sums = round.spectrum + (sums - round.spectrum) * turn[0]
        if centred:
            single = 1 - xp.exp(-1j * angle)
            alone = abs(single) < 1e-12
            ones = xp.where(alone, own.points, (turn - 1) * xp.exp(-1j * place * angle) / xp.where(alone, 1.0, single))
            sums = sums - whole.total / own.points * ones
    return sums


def _window_of(own: Any, numbers: Numbers, place: Any, sums: Any) -> Any:
    """A bin and, for the Hann window, its neighbours, combined."""
    if own.window == "rectangular":
        return sums[0]
    turn = _turn(own, numbers, place)
    return sums[0] - (sums[1] / turn + sums[2] * turn) / 2


def _turn(own: Any, numbers: Numbers, place: Any) -> Any:
    """The difference in phase of the window's beginning between two bins of the DFT."""
    angle = 2 * np.pi / own.points * place
    return numbers.math.cos(angle) + 1j * numbers.math.sin(angle)
