"""Input shapers: a few impulses through which a command passes.

A shaper is its normalised amplitudes (they sum to 1) and its times::

    s = js.Shaper(amplitudes=[0.5, 0.5], times=[0.0, 0.59])
    s.shape(js.Step(1.0))          # the staircase that the machine follows
    s.convolve(other)              # both, one after the other: two modes
    s.digitise(0.005)              # taps of a digital filter at 200 Hz
    js.export(s, "c99", "shaper.h", sample_time=0.005)
"""

import html
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jshape import _check
from jshape._check import Argument, Checked, as_array, finite
from jshape._types import Impulses, Scalar
from jshape.axes import Axes
from jshape.command import AbstractCommand, superpose


class Shaper(Checked):
    """An input shaper: a short sequence of impulses with which a command is convolved.

    Both fields are leaves, so a shaper passes through ``jit``, ``vmap`` and ``grad``. Concrete values are checked at
    construction; traced ones pass, also when their order changes.

    Attributes:
        amplitudes: normalised, they sum to 1 (to 1e-6; to 1e-4 in single precision); shape (impulses,).
        times: s, not decreasing, the first is 0; equal times are allowed; shape (impulses,).

    Raises:
        ValueError: if there is no impulse, the lengths differ, a value is not finite, the times decrease or do not
            begin at 0, or the amplitudes do not sum to 1.
    """

    amplitudes: Impulses = eqx.field(converter=Argument(finite, convert=as_array))
    times: Impulses = eqx.field(converter=Argument(finite, convert=as_array))

    def __check_init__(self):
        shape = self.amplitudes.shape
        if self.amplitudes.ndim != 1 or self.times.shape != shape:
            raise ValueError(
                "amplitudes and times must be two lists of the same length, not of shapes "
                f"{shape} and {self.times.shape}"
            )
        if not shape[0]:
            raise ValueError("amplitudes is empty: a shaper needs at least one impulse")
        _check.instants(self.times, "times")
        if _check.is_concrete(self.amplitudes):
            total = float(np.sum(np.asarray(self.amplitudes, dtype=np.float64)))
            tolerance = 1e-4 if self.amplitudes.dtype == jnp.float32 else 1e-6
            if abs(total - 1) > tolerance:
                raise ValueError(f"amplitudes must sum to 1, not {total:.9g} (they are {_check.show(self.amplitudes)})")

    def _rows(self) -> list[tuple[float, float]] | None:
        """Amplitude and time of each impulse; ``None`` for a batch of shapers and for traced or replaced leaves."""
        leaves = (self.amplitudes, self.times)
        if not _check.is_concrete(self) or not all(eqx.is_array(leaf) and leaf.ndim == 1 for leaf in leaves):
            return None
        return list(zip(*(np.asarray(leaf, float).tolist() for leaf in leaves), strict=True))

    def __repr__(self) -> str:
        rows = self._rows()
        if rows is None:
            return f"Shaper(amplitudes={_short(self.amplitudes)}, times={_short(self.times)})"
        return f"Shaper({', '.join(f'{amplitude:.4g} at {time:.4g} s' for amplitude, time in rows)})"

    def _repr_html_(self) -> str:
        rows = self._rows()
        if rows is None:
            return f"<code>{html.escape(repr(self))}</code>"
        cells = "".join(f"<tr><td>{amplitude:.6g}</td><td>{time:.6g}</td></tr>" for amplitude, time in rows)
        head = "<tr><th>amplitude</th><th>time, s</th></tr>"
        return f"<div>{_stems(rows)}<table><thead>{head}</thead><tbody>{cells}</tbody></table></div>"

    @property
    def duration(self) -> Scalar:
        """Time of the last impulse, s: what the shaper adds to a move."""
        xp = _check.numerics(self.times)
        return _check.on_device(xp.max(xp.asarray(self.times)))

    def convolve(self, other: "Shaper") -> "Shaper":
        """The convolution of two shapers: impulses at every ``t_i + t_j`` with amplitudes ``A_i A_j``, sorted.

        Raises:
            ValueError: for what is no ``Shaper``.
        """
        _check.instance(other, "other", Shaper, "a Shaper")
        xp = _check.numerics(self, other)
        mine, others = (tuple(map(xp.asarray, (one.times, one.amplitudes))) for one in (self, other))
        times = (mine[0][:, None] + others[0][None, :]).reshape(-1)
        amplitudes = (mine[1][:, None] * others[1][None, :]).reshape(-1)
        order = xp.argsort(times, stable=True)
        return Shaper(amplitudes[order], times[order])

    def scale(self, factor: Any) -> "Shaper":
        """The same shaper with its times multiplied by ``factor`` (> 0): for a frequency divided by it.

        Raises:
            ValueError: for a factor that is not positive.
        """
        factor = _check.scalar(factor, "factor")
        _check.positive(factor, "factor")
        return Shaper(self.amplitudes, self.times * factor)

    def pad(self, impulses: int) -> "Shaper":
        """The same shaper with impulses of amplitude 0 at its end, ``impulses`` in all, so that several can be stacked.

        Raises:
            ValueError: if it has more than that already.
        """
        missing = _check.count(impulses, "impulses", least=len(self.times)) - len(self.times)
        xp = _check.numerics(self)
        amplitudes, times = xp.asarray(self.amplitudes), xp.asarray(self.times)
        times = xp.concatenate([times, xp.repeat(times[-1:], missing)])
        return Shaper(xp.concatenate([amplitudes, xp.zeros(missing, amplitudes.dtype)]), times)

    def shape(self, command: AbstractCommand) -> AbstractCommand:
        """The shaped command: the sum of the command's copies, delayed and weighted, itself a command.

        All axes of a command of several axes are shaped alike.

        Raises:
            ValueError: for what is no command.
        """
        _check.instance(command, "command", AbstractCommand, "a jshape command, such as Step")
        if isinstance(command, Axes):
            return command.mapped(lambda _, one: self.shape(one))
        return superpose(command, self.amplitudes, self.times)

    def digitise(
        self, sample_time: Any, method: str = "nearest", modes: Sequence[tuple[float, float]] = ()
    ) -> Float[np.ndarray, " taps"]:
        """The taps of the shaper as a digital FIR filter; for concrete shapers only.

        Args:
            sample_time: of the controller that runs the filter, s.
            method: ``"nearest"`` puts each impulse at its nearest sample. ``"split"`` shares each between its two
                neighbouring samples, so that its mean time stays. ``"zeros"`` splits, then makes the smallest change
                of the taps that gives the filter, at each of the modes, exactly the response that the shaper has
                there: a zero stays a zero, and a double one (of a ZVD) a double one.
            modes: pairs (omega, zeta) for ``"zeros"``, rad/s and –.

        Returns:
            The taps, shape (taps,); they sum to 1.

        Raises:
            ValueError: for a sample time that is not positive, an unknown method, ``"nearest"`` where one tap is left,
                which shapes nothing, ``"zeros"`` without modes, or modes too many or too fast for that sample time.
        """
        sample_time = _check.scalar(sample_time, "sample_time")
        _check.positive(sample_time, "sample_time")
        _check.one_of(method, "method", ("nearest", "split", "zeros"))
        _check.samples(float(self.duration), float(sample_time))
        amplitudes, exact = np.asarray(self.amplitudes, float), np.asarray(self.times, float) / float(sample_time)
        # A time that is a whole number of samples but for rounding is taken as one.
        position = np.where(np.abs(exact - np.rint(exact)) < 1e-9, np.rint(exact), exact)
        if method == "nearest":
            taps = np.zeros(int(np.rint(position).max()) + 1)
            np.add.at(taps, np.rint(position).astype(int), amplitudes)
            if np.count_nonzero(np.abs(taps) > 1e-9) < 2 and np.ptp(position[amplitudes != 0]) > 0.5:
                raise ValueError(
                    f"sample_time {float(sample_time):g} s is too long: of impulses over {float(self.duration):.4g} s"
                    " one tap is left, which shapes nothing; method 'split' leaves more"
                )
            return taps
        taps = np.zeros(int(np.ceil(position).max()) + 1)
        below, share = np.floor(position).astype(int), position - np.floor(position)
        np.add.at(taps, below, amplitudes * (1 - share))
        np.add.at(taps, np.ceil(position).astype(int), amplitudes * share)
        return taps if method == "split" else _place_zeros(taps, amplitudes, exact, float(sample_time), modes)


Shaping = Shaper | Mapping[str, Shaper | None] | None
"""What shapes a command: one shaper for all axes, axis → its own, or none."""


def shaped(command: AbstractCommand, shaper: Shaping) -> AbstractCommand:
    """A command as it is shaped.

    Args:
        command: of one axis or several.
        shaper: one for all axes, a mapping from axes to shapers, in which those that are missing or ``None`` are not
            shaped, or ``None``.

    Raises:
        ValueError: for what is no shaper, an axis that the command does not have, or a mapping for a plain command.
    """
    if shaper is None:
        return command
    if isinstance(shaper, Shaper):
        return shaper.shape(command)
    if not isinstance(shaper, Mapping):
        raise ValueError(f"shaper must be a jshape.Shaper or None, or a mapping from axes to these, not {shaper!r}")
    if not isinstance(command, Axes):
        raise ValueError(f"shaper must be one for a command of one axis, not a mapping from {', '.join(shaper)}")
    unknown = [str(name) for name in shaper if name not in command.names]
    if unknown:
        raise ValueError(f"shaper: the command has the axes {', '.join(command.names)}, and no {', '.join(unknown)}")
    return command.mapped(lambda name, one: shaped(one, shaper.get(name)))


def _short(leaf: Any) -> str:
    """A leaf without its values: type and shape of an array, else the type's name."""
    kind = getattr(leaf, "dtype", type(leaf).__name__)
    return f"{kind}[{','.join(map(str, leaf.shape))}]" if hasattr(leaf, "shape") else str(kind)


def _stems(rows: list[tuple[float, float]]) -> str:
    """An SVG picture of the impulses: a stem each over a time axis, negative ones below it."""
    width, height, margin = 320, 120, 12
    amplitudes = [amplitude for amplitude, _ in rows]
    longest = max(time for _, time in rows) or 1.0
    top, bottom = max(*amplitudes, 0.0), min(*amplitudes, 0.0)
    span = top - bottom or 1.0

    def across(time: float) -> float:
        return margin + time / longest * (width - 2 * margin)

    def down(value: float) -> float:
        return margin + (top - value) / span * (height - 2 * margin)

    stems = "".join(
        f'<line x1="{across(time):.1f}" y1="{down(0.0):.1f}" x2="{across(time):.1f}" y2="{down(amplitude):.1f}"/>'
        f'<circle cx="{across(time):.1f}" cy="{down(amplitude):.1f}" r="3"/>'
        for amplitude, time in rows
    )
    axis = f'<line x1="0" y1="{down(0.0):.1f}" x2="{width}" y2="{down(0.0):.1f}" stroke-opacity="0.4"/>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" role="img" '
        f'aria-label="impulses over time" stroke="currentColor" fill="currentColor">{axis}{stems}</svg>'
    )


def _place_zeros(taps, amplitudes, position, sample_time: float, modes) -> Float[np.ndarray, " taps"]:
    """The taps, corrected so that transform and slope at every mode's pole are the shaper's own."""
    try:
        pairs: np.ndarray = np.asarray(modes, float)
    except (OverflowError, TypeError, ValueError):
        pairs = np.zeros(0)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise ValueError(f'modes must be at least one pair (omega, zeta) for method="zeros", not {modes!r}')
    # One free tap on either side of each impulse is enough room for the corrections of several modes.
    support = np.unique(
        np.clip(np.concatenate([np.floor(position + 1e-9) + k for k in (-1, 0, 1, 2)]), 0, len(taps)).astype(int)
    )
    wide = np.zeros(support.max() + 1)
    wide[: len(taps)] = taps
    rows, targets = [np.ones(len(support))], [amplitudes.sum() - wide[support].sum()]
    for omega, zeta in pairs:
        _check.positive(omega, "modes: omega")
        _check.damping_ratio(zeta, "modes: zeta")
        pole = omega * sample_time * complex(-zeta, np.sqrt(1 - zeta**2))
        if not (1e-9 <= omega * sample_time <= 1e3 and zeta * omega * sample_time * len(wide) <= 300):
            raise ValueError(
                f"modes: omega {omega:g} rad/s with zeta {zeta:g} is too fast or too slow for a sample time of "
                f"{sample_time:g} s"
            )
        for power in (0, 1):
            row = support**power * np.exp(-pole * support)
            wanted = np.sum(amplitudes * position**power * np.exp(-pole * position)) - row @ wide[support]
            rows += [row.real, row.imag]
            targets += [wanted.real, wanted.imag]
    matrix, target = np.array(rows), np.array(targets)
    scale = np.linalg.norm(matrix, axis=1, keepdims=True)
    change, *_ = np.linalg.lstsq(matrix / scale, target / scale[:, 0], rcond=None)
    residual = np.abs(matrix @ change - target) / scale[:, 0]
    if residual.max() > 1e-9:
        raise ValueError(
            f"modes cannot all be placed exactly with {len(support)} taps at a sample time of {sample_time} s "
            f"(the worst misses by {residual.max():.2g}); use a shorter sample time or fewer modes"
        )
    wide[support] += change
    return np.trim_zeros(wide, "b")
