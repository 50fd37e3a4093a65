"""A shaper that is retuned while it runs: a cascade of digital filters, one a mode, whose output never jumps.

    shaper = js.adaptive.AdaptiveShaper(
        sample_time=0.005, omega=(9.0, 70.0), zeta=(0.017, 0.019), bands=((4.0, 14.0), (50.0, 105.0))
    )
    state = shaper.start(reference)
    state, shaped = shaper.step(state, reference, estimate)   # pure: for scan, jit, vmap and grad
    online = shaper.online(reference)
    shaped = online.push(reference, estimate)                 # NumPy, for a control loop

An estimate is only noted when it comes. New taps are taken at the one instant at which the output cannot jump: when
the reference, having stood still for longer than all taps reach, begins to move (``retune="steady"``); or the output
goes over from the old filters' to the new ones' (``"crossfade"``), for references that never stand still.

A wrong estimate does no more than ``bound`` says: frequencies stay in their bands and change by a limited factor a
retune; what is not a number is left out and counted.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jshape import _check
from jshape._types import ArrayLike
from jshape.adaptive.arguments import check_band, check_order, check_time
from jshape.adaptive.formulas import JAX, NUMPY, as_jax, as_lists, like
from jshape.adaptive.identifiers.estimate import Estimate
from jshape.adaptive.shapers.cascade import Cascade, Shaped, ShaperState
from jshape.adaptive.shapers.repeated import repeated
from jshape.adaptive.shapers.taps import KINDS, ROUNDINGS, Filters
from jshape.shaper import Shaper

RETUNES = ("steady", "crossfade")


class AdaptiveShaper(eqx.Module):
    """A cascade of shapers, one a mode, retuned to estimates of the modes.

    Args:
        sample_time: s.
        omega: frequencies to start with, rad/s, shape (modes,).
        zeta: damping ratios to start with, shape (modes,).
        bands: lowest and highest frequency of each filter, rad/s, shape (modes, 2).
        kind: of ``js.design.linear``, those with positive amplitudes (``"zvd"``, ``"zv"``, ``"ei"``, …).
        retune: ``"steady"`` or ``"crossfade"``.
        fade: length of a cross-fade, s; that of the longest filter, unless given.
        blank: s after the reference last moved in which ``Shaped.steady`` stays false.
        change: a frequency is multiplied or divided by at most 1 + ``change`` a retune.
        zeta_bounds: between which damping ratios stay.
        rounding: of the impulses to samples: ``"nearest"``, the interval between them, so that the third comes at twice
            the second's time; ``"split"``, each shared between two samples, through which derivatives pass.

    Raises:
        ValueError: for lists of different lengths, values outside their bands or bounds, bands that are none or too
            fast for the sample time, bounds too wide for the kind, and unknown words.

    Source: Chatlatanagulchai, Chotana and Prutthapong, Eq. 4 and Fig. 3; retuning at the edges, cross-fade and bounds
        are this module's.
    """

    omega: Float[jax.Array, " modes"]
    zeta: Float[jax.Array, " modes"]
    cascade: Cascade = eqx.field(static=True)
    """All the rest: bands, kind, times in samples."""

    def __init__(
        self,
        sample_time: float,
        omega: Any,
        zeta: Any,
        bands: Any,
        *,
        kind: str = "zvd",
        retune: str = "steady",
        fade: float | None = None,
        blank: float = 0.0,
        change: float = 0.5,
        zeta_bounds: tuple[float, float] = (0.0, 0.1),
        rounding: str = "nearest",
    ):
        self.omega = jnp.atleast_1d(_check.as_array(omega, "omega"))
        self.zeta = jnp.atleast_1d(_check.as_array(zeta, "zeta"))
        # Concrete also where the modes are being traced.
        with jax.ensure_compile_time_eval():
            sample_time = check_time(sample_time)
            pairs = np.atleast_2d(np.asarray(_check.as_array(bands, "bands"), float))
            edges = tuple(check_band(pair, sample_time, "bands") for pair in pairs)
        if not self.omega.shape == self.zeta.shape == (len(edges),):
            raise ValueError(
                "omega, zeta and bands must have one entry a mode each, not "
                f"{self.omega.shape}, {self.zeta.shape} and {len(edges)}"
            )
        _check.one_of(kind, "kind", KINDS)
        _check.one_of(retune, "retune", RETUNES)
        _check.one_of(rounding, "rounding", ROUNDINGS)
        _check.damping_ratio(zeta_bounds, "zeta_bounds")
        low, high = check_order(zeta_bounds, "zeta_bounds")
        _inside(self.omega, np.array(edges), "omega", "its bands")
        _inside(self.zeta, np.array([[low, high]]), "zeta", "zeta_bounds")
        _check.not_negative(blank, "blank")
        _check.positive(change, "change")
        filters = Filters(kind, (low, high), rounding, sample_time)
        slowest, fastest = np.min(edges), np.max(edges)
        if filters.delays(fastest).min() < 1:
            raise ValueError(
                f"bands must end below {fastest:g} rad/s, where impulses fall on one sample of {sample_time:g} s"
            )
        reach = int(filters.delays(slowest).max())
        fade = reach * sample_time if fade is None else fade
        _check.positive(fade, "fade")
        self.cascade = Cascade(
            filters=filters,
            bands=edges,
            retune=retune,
            fade=max(round(fade / sample_time), 1),
            blank=round(blank / sample_time),
            change=float(change),
            # Some more, for what single precision may round up.
            length=reach + 3,
        )

    @property
    def sample_time(self) -> float:
        """s."""
        return self.cascade.filters.sample_time

    def start(self, reference: ArrayLike = 0.0) -> ShaperState:
        """The state of a machine that has long stood at ``reference``: a pytree of JAX arrays of fixed shapes."""
        _check.finite(reference, "reference")
        reference = _check.scalar(reference, "reference")
        return as_jax(self.cascade.initial(jnp, self.omega, self.zeta, reference))

    def step(
        self, state: ShaperState, reference: ArrayLike, estimate: Estimate | None = None
    ) -> tuple[ShaperState, Shaped]:
        """The state and the shaped reference after a sample.

        Args:
            state: from ``start`` or the last step.
            reference: in any unit, a scalar.
            estimate: of all modes, shape (modes,), if there is one; only modes that are ``valid`` count, and damping
                ratios only where ``zeta_std`` is finite.

        Raises:
            ValueError: for estimates of another number of modes.
        """
        new, shaped = self.cascade.advance(JAX, state, reference, estimate)
        return like(state, new), shaped

    def online(self, reference: float = 0.0) -> "OnlineShaper":
        """The same shaper as a plain object for a control loop, at rest at ``reference``."""
        return OnlineShaper(self, reference)

    def shaper(self, omega: ArrayLike | None = None, zeta: ArrayLike | None = None) -> Shaper:
        """All filters together as they run, tuned to those modes: with times on samples. For concrete values only.

        Args:
            omega: rad/s, shape (modes,); what the shaper starts with, unless given.
            zeta: damping ratios, shape (modes,); likewise.
        """
        omega, zeta = self.omega if omega is None else omega, self.zeta if zeta is None else zeta
        return functools.reduce(Shaper.convolve, self.cascade.filters.shapers(omega, zeta))

    def bound(
        self, omega: ArrayLike | None = None, zeta: ArrayLike | None = None, spacing: float | None = None
    ) -> Float[np.ndarray, " modes"]:
        """An upper bound of each mode's residual vibration after a step, over a bare step's, whatever estimates come.

        ``retune="steady"``: the largest V over all that the mode's own filter can be tuned to, since a step passes taps
        of one tuning only; other modes' filters reduce it further. Never more than 1. ``"crossfade"``: a fade while the
        step passes can sway the output back and forth, by 1 + 2 (longest delay)/``fade`` a filter at most, and that is
        the bound. For concrete values only.

        Args:
            omega: true frequencies, rad/s, shape (modes,); the worst in the bands, unless given.
            zeta: true damping ratios, shape (modes,); those of the start, unless given.
            spacing: for steps of one size that follow each other, the least time from one to the next, s: what wrong
                ones leave adds up (``repeated``).
        """
        zeta = self.zeta if zeta is None else zeta
        if spacing is not None:
            slowest = [low for low, _ in self.cascade.bands] if omega is None else omega
            return repeated(self.bound(omega, zeta), slowest, zeta, spacing)
        cascade, shape = self.cascade, self.zeta.shape
        if cascade.retune == "crossfade":
            sway = [1 + 2 * cascade.filters.delays(low).max() / cascade.fade for low, _ in cascade.bands]
            return np.full(shape, np.prod(sway))
        zetas = np.broadcast_to(np.asarray(zeta, float), shape).tolist()
        omegas = [None] * len(zetas) if omega is None else np.broadcast_to(np.asarray(omega, float), shape).tolist()
        return np.array([cascade.filters.worst(*mode) for mode in zip(cascade.bands, omegas, zetas, strict=True)])


def _inside(values: Any, edges: np.ndarray, name: str, where: str) -> None:
    """*Raises* ``ValueError`` unless all concrete values lie between the edges, (values, 2)."""
    _check.finite(values, name)
    if _check.is_concrete(values) and not np.all((edges[:, 0] <= values) & (values <= edges[:, 1])):
        pairs = ", ".join(f"({low:g}, {high:g})" for low, high in edges)
        raise ValueError(f"{name} must lie in {where} {pairs}, not be {_check.show(values)}")


class OnlineShaper:
    """An adaptive shaper as a plain object: Python numbers in nested lists, some microseconds a sample.

    Attributes:
        state: the whole state.
    """

    def __init__(self, shaper: AdaptiveShaper, reference: float = 0.0):
        _check.finite(reference, "reference")
        # Not through the shaper: equinox wraps its methods at every look.
        self._cascade = shaper.cascade
        self.state = as_lists(
            self._cascade.initial(np, np.asarray(shaper.omega), np.asarray(shaper.zeta), float(reference))
        )

    def push(self, reference: float, estimate: Estimate | None = None) -> Shaped:
        """The shaped reference after a sample, as ``AdaptiveShaper.step`` gives it."""
        self.state, shaped = self._cascade.advance(NUMPY, self.state, float(reference), estimate)
        return shaped
