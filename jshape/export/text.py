"""Parts of all generated texts: templates, checked names, and the shaper's own numbers for the comments."""

import re
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from jshape.shaper import Shaper
from jshape.vibration import percentage_vibration


def numbers(shaper: Shaper) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes and times (s) in double precision."""
    return np.asarray(shaper.amplitudes, float), np.asarray(shaper.times, float)


TEMPLATES = files("jshape.export") / "templates"
"""Texts with ``$names`` to fill in, and the reserved words of each language."""


LONGEST = 100
"""Characters of a name, which is part of a file's, too."""


def identifier(name: Any, language: str) -> str:
    """``name``, if a program in that language may call something so.

    *Raises* ``ValueError`` unless it is a letter and then letters, digits and single underscores, at most ``LONGEST``,
    and no reserved word (in lower or upper case).
    """
    if isinstance(name, str) and len(name) > LONGEST:
        raise ValueError(f"name must have at most {LONGEST} characters, not {len(name)}")
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", name):
        raise ValueError(f"name must be a letter followed by letters, digits and single underscores, not {name!r}")
    if name.lower() in (TEMPLATES / f"{language}.reserved").read_text(encoding="utf-8").split():
        raise ValueError(f"name must not be {name!r}, a word of the language")
    return name


def about(shaper: Shaper) -> list[str]:
    """The shaper in lines for a comment: how many impulses, how long, each one's time and amplitude."""
    amplitudes, times = (values.tolist() for values in numbers(shaper))
    count = f"{len(times)} impulse{'s' if len(times) > 1 else ''}"
    return [
        f"Input shaper from jshape: {count}, {times[-1]:.6g} s long.",
        "",
        f"    {'time (s)':<24} amplitude (they sum to 1)",
        *(f"    {time!r:<24} {amplitude!r}" for time, amplitude in zip(times, amplitudes, strict=True)),
    ]


def digitised_about(shaper: Shaper, taps: np.ndarray, sample_time: float, method: str, modes: Any) -> list[str]:
    """The shaper and its digital filter in lines for a comment, with the residual vibration of both at the modes."""
    line = f'Digitised at {sample_time!r} s ("{method}"): {np.count_nonzero(taps)} taps, {len(taps)} samples long.'
    return [*about(shaper), "", line, *vibrations(shaper, impulses(taps, sample_time), modes, "digitised")]


def impulses(taps: np.ndarray, sample_time: float) -> Shaper:
    """The shaper whose impulses are the taps of a digital filter, on whole multiples of its sample time."""
    kept = np.flatnonzero(taps)
    kept = kept if kept[0] == 0 else np.concatenate([[0], kept])
    # Taps that were rounded to single precision may sum to a little more or less.
    return _summing(taps[kept], kept * sample_time)


def _summing(amplitudes: np.ndarray, times: np.ndarray) -> Shaper:
    total = amplitudes.sum()
    return Shaper(amplitudes if abs(total - 1) < 1e-7 else amplitudes / total, times)


def in_double(shaper: Shaper) -> Shaper:
    """The shaper; one of single precision, whose amplitudes sum to 1 to four digits, with amplitudes that do to all."""
    return shaper if shaper.amplitudes.dtype == np.float64 else _summing(*numbers(shaper))


def vibrations(exact: Shaper, changed: Shaper, modes: Any, word: str) -> list[str]:
    """Residual vibration V of two shapers at every mode, a line each."""
    return [
        f"Vibration at omega = {omega!r} rad/s, zeta = {zeta!r}: "
        f"{100 * float(percentage_vibration(exact, omega, zeta)):.4g} % exact, "
        f"{100 * float(percentage_vibration(changed, omega, zeta)):.4g} % {word}."
        for omega, zeta in pairs(modes)
    ]


def pairs(modes: Any) -> list[tuple[float, float]]:
    """Modes as pairs of numbers (rad/s, –). *Raises* ``ValueError`` if they are none."""
    try:
        return [(float(omega), float(zeta)) for omega, zeta in modes]
    except (OverflowError, TypeError, ValueError):
        raise ValueError(f"modes must be pairs (omega, zeta), not {modes!r}") from None


def comment(mark: str, lines: list[str]) -> str:
    """Lines as comments that begin with a mark."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)


def fill(template: str, **values: Any) -> str:
    """A template of this package with its ``$names`` replaced.

    A value of several lines is indented, and prefixed, as the line that holds its name.
    """
    text = (TEMPLATES / template).read_text(encoding="utf-8")
    lines = []
    for line in text.splitlines():
        alone = re.fullmatch(r"([\s*%]*)\$(\w+)", line)
        if alone and isinstance(values[alone[2]], list):
            lines += [(alone[1] + item).rstrip() for item in values[alone[2]]]
        else:
            lines.append(Template(line).substitute(values))
    return "\n".join(lines) + "\n"
