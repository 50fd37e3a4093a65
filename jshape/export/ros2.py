"""A shaper as the parameters of a filter of ros2_control: YAML for its chained filter controller."""

import re
from collections.abc import Sequence

from jshape.export.text import comment, digitised_about, fill
from jshape.shaper import Shaper

ROW = 6
"""Taps in a line of the file."""

VALUES = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
"""Words that YAML 1.1 takes for truth values and for nothing."""


def ros2_filter(
    shaper: Shaper,
    *,
    sample_time: float,
    method: str = "nearest",
    modes: Sequence[tuple[float, float]] = (),
    name: str = "input_shaper",
) -> str:
    """The taps of a shaper as parameters of ros2_control's chained filter controller, in YAML.

    The controller passes the state interfaces that it is given through a chain of filters of the package ``filters``,
    here one ``TransferFunctionFilterDouble``: a₀ y[n] = Σ b_k x[n − k] − Σ a_k y[n − k] with a = [1] and the taps as b.
    What was before its first sample it takes as 0.

    Args:
        shaper: the shaper.
        sample_time: of the controller, s.
        method: as in ``Shaper.digitise``.
        modes: likewise; the residual vibration of the digital filter there stands in the comment.
        name: of the controller.

    Raises:
        ValueError: as ``Shaper.digitise``, and for a name that ROS does not allow.

    Source: the parameters are those that the sources of ``chained_filter_controller`` 6.9 and ``filters`` 2.1 read.
    """
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise ValueError(f"name must be a letter followed by letters, digits and underscores, not {name!r}")
    if name.lower() in VALUES:
        raise ValueError(f"name must not be {name!r}, which YAML takes for a value")
    taps = shaper.digitise(sample_time, method, modes)
    words = [_number(tap) for tap in taps.tolist()]
    rows = [", ".join(words[begin : begin + ROW]) for begin in range(0, len(words), ROW)]
    return fill(
        "ros2_filter.yaml",
        about=comment("#", digitised_about(shaper, taps, float(sample_time), method, modes)).rstrip(),
        sample_time=repr(float(sample_time)),
        duration=f"{(len(taps) - 1) * float(sample_time):.6g}",
        name=name,
        taps=[row + "," * (i < len(rows) - 1) for i, row in enumerate(rows)],
    )


def _number(value: float) -> str:
    """A number with a point in it, without which YAML counts it as a text or as a whole number."""
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")
