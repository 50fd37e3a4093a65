"""A shaper as a C99 header: taps and a ring-buffer filter, in floating or in fixed point, without a heap.

The filter is one state machine for all arithmetics (``templates/shaper.h``); what differs between them stands in
``templates/arithmetics.toml``.
"""

import textwrap
import tomllib
from collections.abc import Iterable, Sequence
from string import Template

import numpy as np

from jshape import _check
from jshape.export.text import TEMPLATES, digitised_about, fill, identifier
from jshape.shaper import Shaper

ARITHMETICS = ("float", "double", "q15", "q31")


def c99(
    shaper: Shaper,
    *,
    sample_time: float,
    method: str = "nearest",
    modes: Sequence[tuple[float, float]] = (),
    name: str = "shaper",
    arithmetic: str = "float",
) -> str:
    """A C99 header with the shaper's taps and a filter that runs them. At rest its output equals the command exactly.

    Args:
        shaper: the shaper.
        sample_time: s.
        method: as in ``Shaper.digitise``.
        modes: likewise; the residual vibration of the digital filter there stands in the comment.
        name: what the types and functions begin with.
        arithmetic: ``"float"``, ``"double"``, or samples in fixed point, saturated at full scale: ``"q15"`` (int16_t,
            gains of 14 bits) or ``"q31"`` (int32_t, gains of 30 bits).

    Raises:
        ValueError: as ``Shaper.digitise``, for a name that C does not allow and, in fixed point, for amplitudes whose
            magnitudes sum to 4 or more.
    """
    name = identifier(name, "c99")
    _check.one_of(arithmetic, "arithmetic", ARITHMETICS)
    taps = shaper.digitise(sample_time, method, modes)
    if arithmetic in ("float", "double"):
        suffix = "f" if arithmetic == "float" else ""
        rounded = taps.astype(np.float32 if arithmetic == "float" else np.float64)
        gains = [f"{tap!s}{suffix}" for tap in rounded]
        table, values = "real", dict(arithmetic=arithmetic, suffix=suffix)
    else:
        samples = 16 if arithmetic == "q15" else 32
        bits = samples - 2
        whole = quantise(taps, bits)
        gains, rounded = [str(gain) for gain in whole.tolist()], whole / 2.0**bits
        values = dict(samples=samples, twice=2 * samples, fraction=samples - 1, bits=bits, ONE=f"{name.upper()}_ONE")
        table, values["bound"] = "fixed", f"{error_bound(taps, whole, bits, samples):.4g}"
    fragments = Template((TEMPLATES / "arithmetics.toml").read_text(encoding="utf-8")).safe_substitute(values)
    delays = np.flatnonzero(taps)
    return fill(
        "shaper.h",
        **tomllib.loads(fragments)[table],
        about=digitised_about(shaper, rounded.astype(float), float(sample_time), method, modes),
        name=name,
        NAME=name.upper(),
        sample_time=repr(float(sample_time)),
        capacity=len(taps),
        count=len(delays),
        delays=_rows(map(str, delays.tolist())),
        gains=_rows(gains[d] for d in delays),
    )


def quantise(taps: np.ndarray, bits: int) -> np.ndarray:
    """Taps as whole multiples of 2^-``bits``, each off by less than one, that sum to 2^``bits``.

    At rest the output is then the command, bit for bit: rounding leaves no offset. All are rounded down and the
    remainder goes to the largest remainders, one each, so that the total error is the smallest that such a sum allows.
    *Raises* ``ValueError`` if the magnitudes sum to 4 or more: the accumulator of the filter would overflow.
    """
    one = 1 << bits
    scaled = np.asarray(taps, float) / np.sum(taps) * one
    whole = np.floor(scaled).astype(np.int64)
    missing = one - int(whole.sum())
    whole[np.argsort(whole - scaled, kind="stable")[:missing]] += 1
    if np.abs(whole).sum() >= 4 * one or np.abs(whole).max() >= 2 * one:
        raise ValueError(
            f"amplitudes: their magnitudes sum to {np.abs(taps).sum():.6g}, the largest is {np.abs(taps).max():.6g}; "
            "in fixed point the sum must be below 4 and each below 2"
        )
    return whole


def error_bound(taps: np.ndarray, whole: np.ndarray, bits: int, samples: int) -> float:
    """The greatest error of the output against the exact ``taps``, in steps of a sample of ``samples`` bits.

    For any commands within full scale: the taps' rounding against full-scale commands of the worst signs, and half a
    step for the one rounding of the output.
    """
    full = 2.0 ** (samples - 1)
    return float(np.abs(whole / 2.0**bits - taps).sum() * full + 0.5)


def _rows(items: Iterable[str]) -> list[str]:
    """Items separated by commas, in lines."""
    return textwrap.wrap(", ".join(items) + ",", 100, break_on_hyphens=False)
