"""A shaper as a C99 header: taps and a ring-buffer filter, in floating or in fixed point, without a heap.

The filter is one state machine for all arithmetics (``templates/shaper.h``); here stands what differs between them.
"""

from collections.abc import Sequence

import numpy as np

from jshape import _check
from jshape.export.fixed_point import error_bound, quantise
from jshape.export.text import about, digitised_about, fill, identifier
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
    """A C99 header with the shaper's taps at ``sample_time`` (s) and a filter that runs them.

    ``method`` and ``modes``: as in ``Shaper.digitise``; what digitising costs at the modes stands in the comment.
    ``name``: what the types and functions begin with. ``arithmetic``: ``"float"``, ``"double"``, or samples in fixed
    point ``"q15"`` (int16_t, gains of 14 bits) or ``"q31"`` (int32_t, gains of 30 bits), saturated at full scale.

    At rest the output equals the command exactly, in all of them. *Raises* ``ValueError`` as ``Shaper.digitise``, for a
    name that C does not allow and, in fixed point, for amplitudes whose magnitudes sum to 4 or more.
    """
    name = identifier(name, "c99")
    _check.one_of(arithmetic, "arithmetic", ARITHMETICS)
    taps = shaper.digitise(sample_time, method, modes)
    parts, gains, rounded = (_real if arithmetic in ("float", "double") else _fixed)(arithmetic, taps, name)
    delays = np.flatnonzero(taps)
    text = [*about(shaper), "", *digitised_about(shaper, rounded, float(sample_time), method, modes)]
    return fill(
        "shaper.h",
        **parts,
        about=text,
        name=name,
        NAME=name.upper(),
        sample_time=repr(float(sample_time)),
        capacity=len(taps),
        count=len(delays),
        delays=_rows([str(d) for d in delays]),
        gains=_rows([gains[d] for d in delays]),
    )


def _rows(items: list[str], width: int = 100) -> list[str]:
    """Items separated by commas, in lines of about that width."""
    lines = [""]
    for item in items:
        if len(lines[-1]) + len(item) > width:
            lines.append("")
        lines[-1] += f"{item}, "
    return [line.rstrip() for line in lines]


def _real(arithmetic: str, taps: np.ndarray, name: str) -> tuple[dict, list[str], np.ndarray]:
    suffix, kind = ("f", np.float32) if arithmetic == "float" else ("", np.float64)
    parts = {
        "sample": arithmetic,
        "tap": arithmetic,
        "wide": arithmetic,
        "unity": f"1.0{suffix}",
        "gain_unit": "they sum to 1; if not, the tap without delay has the rest",
        "arithmetic": [f"Samples and gains are {arithmetic}s. At rest the output is the command, exactly."],
        "refused": "a delay does not fit",
        "includes": [],
        "constants": [],
        # Differences to the command: at rest every term is exactly 0, whatever the gains were rounded to.
        "accumulate": "sum += taps->gain[i] * (then - now);",
        "finish": "return now + sum;",
        "deliver": "return shaped;",
        "check_start": [],
        "check_each": [],
        "check_end": [],
    }
    rounded = taps.astype(kind)
    return parts, [f"{tap!s}{suffix}" for tap in rounded], rounded.astype(float)


def _fixed(arithmetic: str, taps: np.ndarray, name: str) -> tuple[dict, list[str], np.ndarray]:
    samples = 16 if arithmetic == "q15" else 32
    bits, one = samples - 2, f"{name.upper()}_ONE"
    sample, wide, most, least = f"int{samples}_t", f"int{2 * samples}_t", f"INT{samples}_MAX", f"INT{samples}_MIN"
    whole = quantise(taps, bits)
    bound = error_bound(taps, whole, bits, samples)
    parts = {
        "sample": sample,
        "tap": sample,
        "wide": wide,
        "unity": one,
        "gain_unit": f"in steps of 2^-{bits}; they sum to {one}",
        "arithmetic": [
            f"Samples are Q{samples - 1} ({sample}), gains Q2.{bits} that sum to exactly 1: at rest the output is the",
            f"command, bit for bit. Otherwise it errs by at most {bound:.4g} steps of 2^-{samples - 1} against",
            "exact taps; while a change of taps runs out, by as much as both together. It saturates at full scale.",
        ],
        "refused": "a delay does not fit, the gains do not sum to 1 or their magnitudes to less than 4",
        "includes": ["", "#include <stdint.h>"],
        "constants": [f"#define {one} (({wide})1 << {bits}) /* a gain of 1 */"],
        "accumulate": f"sum += ({wide})taps->gain[i] * then;",
        "finish": ["(void)now;", f"return (sum >= 0 ? sum + {one} / 2 : sum - {one} / 2) / {one};"],
        "deliver": f"return ({sample})(shaped > {most} ? {most} : shaped < {least} ? {least} : shaped);",
        "check_start": ["int64_t sum = 0, magnitude = 0;"],
        "check_each": [
            "sum += taps->gain[i];",
            "magnitude += taps->gain[i] < 0 ? -(int64_t)taps->gain[i] : taps->gain[i];",
        ],
        "check_end": [f"if (sum != {one} || magnitude >= (int64_t)4 * {one}) {{", "    return 0;", "}"],
    }
    return parts, [str(q) for q in whole.tolist()], whole / 2.0**bits
