"""The response of a plant to a command, with its accuracy; as a line, and as a small picture in a notebook."""

import html
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._types import Scalar, Times
from jshape.status import Result, Status

INACCURATE = 1e-3
"""The error of a response, relative to the greatest state, beyond which it has not converged."""


class Response(Result, eqx.Module):
    """The response of a plant to a command. All arrays have a leading time axis; of a plant of several axes command,
    payload and deflection have one column each.

    Attributes:
        times: s.
        states: shape (times, state), as the plant documents them.
        command: the (shaped) command, in the plant's ``command_unit``.
        payload: position of what is to arrive, in the plant's unit, m or rad.
        deflection: of the flexible part, in the same.
        energy: above rest at the input of that instant, J.
        diverged: whether the plant has left the region from which it returns to rest.
        error: estimate of the worst absolute error of any state at any sample.
    """

    times: Times
    states: Float[Array, "times state"]
    command: Float[Array, "times *axes"]
    payload: Float[Array, "times *axes"]
    deflection: Float[Array, "times *axes"]
    energy: Times
    diverged: Bool[Array, ""]
    error: Scalar

    @property
    def status(self) -> Status:  # pyright: ignore[reportIncompatibleVariableOverride]
        """``CONVERGED``, ``STOPPED`` where the states are not known to a thousandth of the greatest, or ``DIVERGED``.

        For concrete responses, not under a JAX transformation.
        """
        if bool(self.diverged):
            return Status.DIVERGED
        known = float(self.error) <= INACCURATE * float(np.max(np.abs(self.states), initial=0.0))
        return Status.CONVERGED if known else Status.STOPPED

    @property
    def message(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The status in a sentence, with the states' accuracy."""
        finite = np.all(np.isfinite(np.asarray(self.states)), axis=1)
        since = "" if finite.all() else f"from {float(self.times[np.argmin(finite)]):.4g} s on"
        if bool(self.diverged):
            until = f"; not finite {since}" if since else ""
            return f"diverged: the plant left the region from which it returns to rest{until}"
        if since:
            return f"{self.status.value}: states are not known {since}, with the most steps there are"
        return f"{self.status.value}: states within about {float(self.error):.1e}"

    def __repr__(self) -> str:
        if self.times.ndim != 1 or not _check.is_concrete(self):
            return f"Response(times of shape {self.times.shape})"
        return f"Response({len(self.times)} samples to {float(self.times[-1]):.4g} s, {self.message})"

    def _repr_html_(self) -> str:
        if self.times.ndim != 1 or not _check.is_concrete(self):
            return f"<code>{html.escape(repr(self))}</code>"
        peaks, left = np.atleast_1d(np.max(np.abs(self.deflection), axis=0)).tolist(), float(self.energy[-1])
        # Each axis has a unit of its own, m or rad, and energies may be J/kg, which the plant knows.
        peak = ", ".join(f"{peak:.4g}" for peak in peaks)
        rows = [("status", self.message), ("peak deflection", peak), ("energy at the end", f"{left:.4g}")]
        table = "".join(f"<tr><th>{name}</th><td>{html.escape(text)}</td></tr>" for name, text in rows)
        columns = zip(*(np.reshape(x, (len(self.times), -1)).T for x in (self.command, self.payload)), strict=True)
        return f"<div>{''.join(_curves(self.times, *pair) for pair in columns)}<table>{table}</table></div>"


def _curves(times: Any, *curves: Any) -> str:
    """Command (grey) and payload against time as a small SVG picture."""
    width, height = 320, 120
    values = np.nan_to_num(np.array([np.asarray(curve, float) for curve in curves]), posinf=0.0, neginf=0.0)
    x = np.asarray(times, float) / max(float(times[-1]), 1e-300) * width
    y = height * (1 - (values - values.min()) / max(np.ptp(values), 1e-300))
    lines = [
        f'<polyline fill="none" stroke="{colour}" points="{_points(x, row)}"/>'
        for colour, row in zip(("#999", "#06c"), y, strict=False)
    ]
    return f'<svg viewBox="-4 -4 {width + 8} {height + 8}" width="{width}" role="img">{"".join(lines)}</svg>'


def _points(x: np.ndarray, y: np.ndarray) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
