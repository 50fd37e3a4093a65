"""Frequencies from a short window of samples: the peak of its Fourier transform, or a least-squares fit of sines.

Each mode is looked for in a band. It may lie beyond half the sample rate, as long as no two frequencies of the bands
are aliases of each other.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jshape._types import Scalar
from jshape.vibration import transform
from jshape_envs.baselines.observed import evenly

GRID = 64
"""Number of frequencies tried in a band."""
SWEEPS = 3
"""How often each of several modes is fitted anew, the others held at their last estimates."""
PRECISION = 0.05
"""Standard deviation of a frequency, as a fraction of its band's width, up to which an estimate counts. A looser bound
would accept, for a fast mode, what a sine leaves of a slow one's decay."""


class Tones(NamedTuple):
    """Estimates of the sines in a window.

    Attributes:
        omega: frequencies, rad/s.
        amplitude: in the samples' unit.
        deviation: standard deviations of omega, rad/s.
    """

    omega: Float[Array, " modes"]
    amplitude: Float[Array, " modes"]
    deviation: Float[Array, " modes"]

    def resolved(self, bands: Float[Array, "modes 2"]) -> Bool[Array, " modes"]:
        """Which frequencies are estimated to a twentieth of their bands."""
        return self.deviation < PRECISION * (bands[:, 1] - bands[:, 0])


def peaks(
    windows: Float[Array, "windows samples"], times: Float[Array, " samples"], bands: Float[Array, "modes 2"]
) -> tuple[Float[Array, " modes"], Float[Array, " modes"]]:
    """The peak of the windows' mean squared Fourier transform in each band, refined by a parabola.

    Args:
        windows: samples of each, in any unit.
        times: of the samples, s.
        bands: lowest and highest frequency of each mode, rad/s.

    Returns:
        Frequencies (rad/s), and the amplitudes of sines of that height, in the samples' unit.
    """

    def one(band: Float[Array, "2"]) -> tuple[Scalar, Scalar]:
        grid = evenly(band, GRID)
        # Between the bins of the discrete Fourier transform, as padding by zeros would give it.
        power = jnp.mean(jax.vmap(lambda x: jnp.abs(transform(x, times, 1j * grid)) ** 2)(windows), axis=0)
        return _at_peak(grid, power), 2 / len(times) * jnp.sqrt(jnp.max(power))

    return jax.vmap(one)(bands)


def fit_tones(
    samples: Float[Array, " samples"],
    times: Float[Array, " samples"],
    bands: Float[Array, "modes 2"],
    deviation: Scalar,
) -> Tones:
    """The sines, one in each band, that fit the samples best by least squares.

    Unlike a peak of the Fourier transform, a fit is not biased by leakage in a window of a period or two.

    Args:
        samples: in any unit.
        times: of the samples, s.
        bands: lowest and highest frequency of each mode, rad/s.
        deviation: standard deviation of a sample; where the residuals are larger, theirs counts.

    Source: Rife and Boorstyn (1974), Eq. 17, for the frequency's standard deviation: √(24/n) σ/(A T).
    """
    modes, count = len(bands), len(samples)

    def fit(omega: Float[Array, " modes"]) -> tuple[Scalar, Float[Array, "modes 2"]]:
        angle = jnp.outer(omega, times)
        columns = jnp.concatenate([jnp.cos(angle), jnp.sin(angle)])
        normal = columns @ columns.T
        ridge = 1e-5 * count * jnp.eye(2 * modes, dtype=samples.dtype)
        weights = _solve(normal + ridge, columns @ samples)
        return jnp.sum((samples - weights @ columns) ** 2), weights.reshape(2, modes).T

    def misfit_at(omega: Float[Array, " modes"], mode: int, frequency: Scalar) -> Scalar:
        return fit(omega.at[mode].set(frequency))[0]

    omega = jnp.mean(bands, axis=1)
    for mode in [m for _ in range(SWEEPS if modes > 1 else 1) for m in range(modes)]:
        grid = evenly(bands[mode], GRID)
        misfit = jax.vmap(partial(misfit_at, omega, mode))(grid)
        omega = omega.at[mode].set(_at_peak(grid, -misfit))
    misfit, weights = fit(omega)
    amplitude = jnp.hypot(weights[:, 0], weights[:, 1])
    noise = jnp.maximum(deviation, jnp.sqrt(misfit / (count - 3 * modes)))
    tiny = jnp.finfo(samples.dtype).tiny
    spread = (24 / count) ** 0.5 * noise / jnp.maximum(amplitude * (times[-1] - times[0]), tiny)
    return Tones(omega, amplitude, spread)


def _solve(matrix: Float[Array, "n n"], right: Float[Array, " n"]) -> Float[Array, " n"]:
    """The solution x of matrix x = right, for a small positive definite matrix.

    Gaussian elimination written out, for speed alone: no library is called once for each of thousands of fits side by
    side. Where that no longer costs, ``jnp.linalg.solve`` takes its place.
    """
    both = jnp.concatenate([matrix, right[:, None]], axis=1)
    for i in range(len(right)):
        row = both[i] / both[i, i]
        both = (both - jnp.outer(both[:, i], row)).at[i].set(row)
    return both[:, -1]


def _at_peak(grid: Float[Array, " grid"], values: Float[Array, " grid"]) -> Scalar:
    """The place between the grid's ends at which the values peak, by a parabola."""
    top, share = peak(values)
    return jnp.clip(grid[top] + share * (grid[1] - grid[0]), grid[0], grid[-1])


def peak(values: Float[Array, " values"]) -> tuple[Int[Array, ""], Scalar]:
    """The index of the greatest value, but for both ends, and the offset from it, in indices, at which the parabola
    through it and its neighbours peaks; 0 where that has no peak."""
    top = jnp.clip(jnp.argmax(values), 1, len(values) - 2)
    before, here, after = values[top - 1], values[top], values[top + 1]
    curvature = before - 2 * here + after
    concave = jnp.isfinite(curvature) & (curvature < 0)
    return top, jnp.where(concave, (before - after) / (2 * jnp.where(concave, curvature, 1.0)), 0.0)
