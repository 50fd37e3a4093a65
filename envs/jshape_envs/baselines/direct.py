"""Direct adaptive shaping, move by move: linear shapers for the frequencies measured last.

``DirectAdaptive`` is the paper's scheme: frequencies from the peak of a Fourier transform over the last windows (I-D),
and damping ratios by extremum seeking as well (I-D-E). ``FrequencyTracker`` fits sines to the last window instead.
Neither knows a model, so that on a nonlinear plant both take the frequency of a small residual vibration for
that of a whole move; ``scale`` corrects them by a factor.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jshape import _check
from jshape._types import ArrayLike, Scalar
from jshape.adaptive import ExtremumSeeking
from jshape.adaptive.strategies.extremum_seeking import SeekingState
from jshape.design.linear import multi_mode
from jshape.moves import AbstractPolicy, Choice, EnvState, Observation, Params
from jshape_envs.baselines.frequency import fit_tones, peaks
from jshape_envs.baselines.observed import frequency_bands, middle, modes_of, observed, sensor_deviation

WINDOWS = 2
"""Number of windows over which the power of the Fourier transform is averaged."""
CLEAR = 4.0
"""Amplitude, in standard deviations of a sample, from which a peak counts: below it is the noise floor."""


class Windows(NamedTuple):
    """The memory of ``DirectAdaptive``.

    Attributes:
        windows: the last ones, m, newest first.
        made: number of moves made.
        omega: estimates, rad/s.
        seeking: the state of extremum seeking on the damping ratios.
        distance: of the last move, m, signed.
    """

    windows: Float[Array, "windows samples"]
    made: Int[Array, ""]
    omega: Float[Array, " modes"]
    seeking: SeekingState
    distance: Scalar


class DirectAdaptive(AbstractPolicy):
    """ZVDs (one for each mode, convolved) for the frequencies at the peaks of the Fourier transform.

    A peak below the sensor's noise floor leaves the estimate as it is.

    Attributes:
        bands: of each mode's frequency, rad/s.
        nominal: the first estimates, rad/s.
        scale: of the shaper's frequencies over the measured ones.
        seeking: of the damping ratios, a step a move; its cost is the mean square of the samples after a move over the
            square of its distance.
        seeks: whether the damping ratios adapt (I-D-E).

    Source: Chatlatanagulchai, Chotana and Prutthapong, Section 3 and Fig. 2, where the transform slides on with every
    sample; here it advances with every move, as the sensor does.
    """

    bands: Float[Array, "modes 2"]
    nominal: Float[Array, " modes"]
    scale: Scalar
    seeking: ExtremumSeeking
    seeks: bool = eqx.field(static=True)

    def init(self, params: Params) -> Windows:
        dtype = params.period.dtype
        empty = jnp.zeros((WINDOWS, params.sensor.samples), dtype)
        return Windows(empty, jnp.zeros((), jnp.int32), self.nominal, self.seeking.start(), jnp.ones((), dtype))

    def act(self, memory: Windows, observation: Observation, params: Params, state: EnvState | None) -> Choice:
        samples, distance = observed(observation, params)
        moved = memory.made > 0
        windows = jnp.concatenate([jnp.where(moved, samples, 0.0)[None], memory.windows[:-1]])
        found, height = peaks(windows, params.sensor.times, self.bands)
        omega = jnp.where(moved & (height > CLEAR * sensor_deviation(params)), found, memory.omega)
        cost = jnp.mean(samples**2) / memory.distance**2
        seeking, zeta = self.seeking.step(memory.seeking, jnp.where(moved, cost, jnp.nan))
        zeta = zeta if self.seeks else self.seeking.centre
        shaper = multi_mode(list(zip(self.scale * omega, zeta, strict=True)), "zvd")
        return Windows(windows, memory.made + 1, omega, seeking, distance), shaper


def direct_adaptive(params: Params, seeks: bool = False, scale: Any = 1.0, zeta: Any = 0.03) -> DirectAdaptive:
    """The paper's I-D, or I-D-E, begun with the middle payload.

    Args:
        params: the environment.
        seeks: whether the damping ratios adapt, too (I-D-E).
        scale: of the shaper's frequencies over the measured ones.
        zeta: the first damping ratio.

    Raises:
        ValueError: for a damping ratio that leaves its bounds, 0 to 0.2, no room.
    """
    dtype, nominal = params.period.dtype, modes_of(params, middle(params)).astype(params.period.dtype)
    modes = len(nominal)
    seeking = ExtremumSeeking(
        step_time=1.0,
        start=jnp.full(modes, zeta, dtype),
        omega=jnp.linspace(1.6, 2.2, modes, dtype=dtype),
        amplitude=jnp.asarray(0.01, dtype),
        gain=jnp.asarray(-0.5, dtype),
        high_pass=jnp.asarray(0.5, dtype),
        low_pass=jnp.asarray(0.5, dtype),
        bounds=jnp.asarray((0.0, 0.2), dtype),
    )
    return DirectAdaptive(frequency_bands(params), nominal, jnp.asarray(scale, dtype), seeking, bool(seeks))


class FrequencyTracker(AbstractPolicy):
    """A linear shaper for the frequencies of the sines that fit the last window best.

    A frequency that the samples do not resolve is left as it is.

    Attributes:
        bands: of each mode's frequency, rad/s.
        nominal: the first estimates, rad/s.
        scale: of the shaper's frequencies over the measured ones.
        zeta: damping ratio of the shaper.
        kind: ``"zv"``, ``"zvd"`` …
    """

    bands: Float[Array, "modes 2"]
    nominal: Float[Array, " modes"]
    scale: Scalar
    zeta: Scalar
    kind: str = eqx.field(static=True)

    def init(self, params: Params) -> Float[Array, " modes"]:
        return self.nominal

    def act(
        self, memory: Float[Array, " modes"], observation: Observation, params: Params, state: EnvState | None
    ) -> Choice:
        # Before the first move there is noise alone, which resolves nothing.
        samples, _ = observed(observation, params)
        found = fit_tones(samples, params.sensor.times, self.bands, sensor_deviation(params))
        omega = jnp.where(found.resolved(self.bands), found.omega, memory)
        return omega, multi_mode([(self.scale * w, self.zeta) for w in omega], self.kind)


def frequency_tracker(
    params: Params, kind: str = "zvd", scale: ArrayLike = 1.0, zeta: ArrayLike = 0.0
) -> FrequencyTracker:
    """A tracker begun with the middle payload; see ``FrequencyTracker``.

    Raises:
        ValueError: for a damping ratio outside [0, 1).
    """
    zeta = _check.scalar(zeta, "zeta")
    _check.damping_ratio(zeta, "zeta")
    dtype, nominal = params.period.dtype, modes_of(params, middle(params)).astype(params.period.dtype)
    return FrequencyTracker(frequency_bands(params), nominal, jnp.asarray(scale, dtype), zeta.astype(dtype), kind)
