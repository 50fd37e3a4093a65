"""The frequencies in a short window of samples: the peak of its Fourier transform, or a least-squares fit of sines.

A band for each mode tells where to look. It may lie beyond half the sampling rate, as long as no two frequencies of the
bands look alike in the samples.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape._types import Scalar
from jshape_envs.baselines.observed import evenly

GRID = 64
"""Frequencies that are tried in a band."""
SWEEPS = 3
"""How often each of several modes is looked for anew, the others being as they were found last."""
PRECISION = 0.05
"""Standard deviation of a frequency, as a fraction of its band's width, up to which it tells anything. A looser bound
would take for a fast mode what a sine leaves of a slow one's decay."""


class Tones(NamedTuple):
    """``omega``: rad/s; ``amplitude``: in the samples' unit; ``deviation``: standard deviation of omega, rad/s."""

    omega: Float[Array, " modes"]
    amplitude: Float[Array, " modes"]
    deviation: Float[Array, " modes"]

    def told(self, bands: Float[Array, "modes 2"]) -> Bool[Array, " modes"]:
        """Which frequencies the samples tell to a twentieth of their bands."""
        return self.deviation < PRECISION * (bands[:, 1] - bands[:, 0])


def transform(
    samples: Float[Array, " samples"], times: Float[Array, " samples"], omega: Float[Array, " frequencies"]
) -> Float[Array, " frequencies"]:
    """|Σ x exp(−iωt)|²: the discrete Fourier transform's squared magnitude between its bins, as zeros put after the
    samples would give it."""
    angle = omega[:, None] * times
    return (jnp.cos(angle) @ samples) ** 2 + (jnp.sin(angle) @ samples) ** 2


def peaks(
    windows: Float[Array, "windows samples"], times: Float[Array, " samples"], bands: Float[Array, "modes 2"]
) -> tuple[Float[Array, " modes"], Float[Array, " modes"]]:
    """Where in each band (rad/s) the windows' mean squared Fourier transform is greatest, and the amplitude of a sine
    of that height. A parabola through the peak and its neighbours finds it between the grid's frequencies."""

    def one(band: Float[Array, "2"]) -> tuple[Scalar, Scalar]:
        grid = evenly(band, GRID)
        power = jnp.mean(jax.vmap(lambda x: transform(x, times, grid))(windows), axis=0)
        return _at_peak(grid, power), 2 / len(times) * jnp.sqrt(jnp.max(power))

    return jax.vmap(one)(bands)


def fit_tones(
    samples: Float[Array, " samples"],
    times: Float[Array, " samples"],
    bands: Float[Array, "modes 2"],
    deviation: Scalar,
) -> Tones:
    """The sines, one in each band (rad/s), that fit the samples best by least squares.

    Unlike a peak of the Fourier transform, a fit is not misled by a window of a period or two. ``deviation``: of a
    sample; where the samples fit worse than that, what they leave counts as their noise.

    *Source*: Rife and Boorstyn (1974), Eq. 17, for the frequency's standard deviation: √(24/n) σ/(A T).
    """
    modes, count = len(bands), len(samples)

    def left(omega: Float[Array, " modes"]) -> tuple[Scalar, Float[Array, "modes 2"]]:
        angle = omega[:, None] * times
        columns = jnp.concatenate([jnp.cos(angle), jnp.sin(angle)])
        normal = columns @ columns.T
        ridge = 1e-5 * count * jnp.eye(2 * modes, dtype=samples.dtype)
        weights = _solve(normal + ridge, columns @ samples)
        return jnp.sum((samples - weights @ columns) ** 2), weights.reshape(2, modes).T

    omega = jnp.mean(bands, axis=1)
    for mode in [m for _ in range(SWEEPS if modes > 1 else 1) for m in range(modes)]:
        grid = evenly(bands[mode], GRID)
        misfit = jax.vmap(lambda w, mode=mode, omega=omega: left(omega.at[mode].set(w))[0])(grid)
        omega = omega.at[mode].set(_at_peak(grid, -misfit))
    misfit, weights = left(omega)
    amplitude = jnp.hypot(weights[:, 0], weights[:, 1])
    noise = jnp.maximum(deviation, jnp.sqrt(misfit / (count - 3 * modes)))
    tiny = jnp.finfo(samples.dtype).tiny
    spread = (24 / count) ** 0.5 * noise / jnp.maximum(amplitude * (times[-1] - times[0]), tiny)
    return Tones(omega, amplitude, spread)


def _solve(matrix: Float[Array, "n n"], right: Float[Array, " n"]) -> Float[Array, " n"]:
    """x of matrix x = right, for a small positive definite matrix.

    Written out: no library is called once for each of thousands of fits side by side.
    """
    both = jnp.concatenate([matrix, right[:, None]], axis=1)
    for i in range(len(right)):
        row = both[i] / both[i, i]
        both = (both - both[:, i : i + 1] * row).at[i].set(row)
    return both[:, -1]


def _at_peak(grid: Float[Array, " grid"], values: Float[Array, " grid"]) -> Scalar:
    """Where the parabola through the greatest value and its neighbours peaks; the grid's ends stay what they are."""
    top = jnp.clip(jnp.argmax(values), 1, len(grid) - 2)
    before, here, after = values[top - 1], values[top], values[top + 1]
    bend = before - 2 * here + after
    share = jnp.where(bend < 0, (before - after) / (2 * jnp.where(bend < 0, bend, 1.0)), 0.0)
    return jnp.clip(grid[top] + share * (grid[1] - grid[0]), grid[0], grid[-1])
