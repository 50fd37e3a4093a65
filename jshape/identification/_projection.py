"""Modes fitted by variable projection: frequencies and damping ratios are searched for, all else is linear.

Whatever was measured, a mode contributes a few known shapes (``AbstractFamily.columns``) with unknown factors. For
given frequencies and ratios the best factors are a linear least squares problem; what it leaves, and the exact
derivative of that, go to Levenberg and Marquardt's method.

Source: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973), the derivative of a projection.
"""

import abc
import dataclasses
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares

from jshape._memo import value_and_jacobian
from jshape._types import ArrayLike
from jshape.identification._uncertainty import covariance

STEEPEST = 0.95
"""The greatest damping ratio that is searched."""


class AbstractFamily(abc.ABC):
    """The model of a record: the shapes that any mode adds, and the background.

    Attributes:
        data: real, shape (rows, channels).
        weights: shape (rows,).
        background: shapes that need no mode, shape (rows, shapes).
        lowest: frequency that the record resolves, rad/s.
        highest: likewise.
        reach: over how many rows the noise is correlated by the way the rows are made; 0 where that is not known.
        in_time: whether the rows follow each other in time.
    """

    reach: ClassVar[int] = 0
    in_time: ClassVar[bool] = True
    data: np.ndarray
    weights: np.ndarray
    background: np.ndarray
    lowest: float
    highest: float

    @abc.abstractmethod
    def columns(self, omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A mode's shapes (rows × shapes) and their derivatives along ω and along ζ."""

    @abc.abstractmethod
    def power(self, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (rad/s) and how much of the residuals (rows × channels, weighted) lies there."""

    def residue(self, factors: np.ndarray) -> np.ndarray:
        """The complex amplitude of a mode in each channel, from its factors (shapes × channels)."""
        return factors[0] + 1j * factors[1]

    @abc.abstractmethod
    def at(self, axis: np.ndarray, inputs: np.ndarray | None) -> "AbstractFamily":
        """The same shapes at other times or frequencies, without data."""

    def join(self, values: np.ndarray) -> np.ndarray:
        """Rows as they were measured: complex again, where the two parts are rows of their own."""
        return values


def pole(omega: float, zeta: float) -> tuple[complex, complex, complex]:
    """λ = −ζω + iω√(1−ζ²) and its derivatives along ω and ζ."""
    root = np.sqrt(1 - zeta**2)
    return omega * complex(-zeta, root), complex(-zeta, root), omega * complex(-1, -zeta / root)


def real_columns(*parts: np.ndarray) -> np.ndarray:
    """The shapes of Re(c z) for complex c: Re z and −Im z, for every z."""
    return np.conj(np.stack(parts, axis=1, dtype=complex)).view(float)


@dataclasses.dataclass(frozen=True)
class Fit:
    """Modes as fitted.

    Attributes:
        omega: rad/s, shape (modes,).
        zeta: damping ratios, shape (modes,).
        factors: of the background and of every mode in turn, shape (shapes, channels).
        noise: standard deviation of a row of weight 1, shape (channels,).
        residuals: weighted, in units of the noise, shape (rows, channels).
        squares: sum of their squares in the data's units, shape (channels,).
        free: degrees of freedom a channel.
        jacobian: of the residuals, shape (rows, channels, parameters).
        basis: orthonormal, of all shapes.
        converged: whether the search did.
    """

    omega: np.ndarray
    zeta: np.ndarray
    factors: np.ndarray
    noise: np.ndarray
    residuals: np.ndarray
    squares: np.ndarray
    free: float
    jacobian: np.ndarray
    basis: np.ndarray
    converged: bool

    def fitted(self, family: AbstractFamily) -> np.ndarray:
        """The modes and the background in the rows of a family, rows × channels."""
        modes = zip(self.omega, self.zeta, strict=True)
        return np.hstack([family.background, *(family.columns(*mode)[0] for mode in modes)]) @ self.factors

    def covariance(self, reach: int = 0) -> np.ndarray:
        """Of (ω_1 …, ζ_1 …); ``reach``: over how many rows the noise is known to be correlated, 0 if it is not."""
        return covariance(self.jacobian, self.residuals, self.free, reach, self.basis)


def project(
    family: AbstractFamily, omega: np.ndarray, zeta: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The best factors at these modes.

    Returns:
        The residuals (rows × channels, in units of the noise), the factors in the data's units, an orthonormal basis of
        the shapes, and the residuals' derivative along ω_1 …, ζ_1 …: all of it, and the part that remains where the
        residuals are noise, whose inverse square is the covariance.
    """
    weights = family.weights[:, None]
    modes = [[weights * part for part in family.columns(*mode)] for mode in zip(omega, zeta, strict=True)]
    shapes = np.hstack([weights * family.background, *(mode[0] for mode in modes)])
    size = np.linalg.norm(shapes, axis=0)
    size = np.where(size > 0, size, 1.0)
    basis, values, right = np.linalg.svd(shapes / size, full_matrices=False)
    kept = values > 1e-11 * values[0]
    basis, inverse = basis[:, kept], (right[kept].T / values[kept]).T / size
    data = weights * family.data / noise
    residuals = data - basis @ (basis.T @ data)
    factors = inverse.T @ (basis.T @ data)
    # By rows, channels and parameters.
    moved = np.empty((*residuals.shape, 2 * len(modes)))
    turned = np.empty((basis.shape[1], *moved.shape[1:]))
    begin = family.background.shape[1]
    for i, (shape, *slopes) in enumerate(modes):
        place = slice(begin, begin + shape.shape[1])
        for j, slope in enumerate(slopes):
            moved[..., i + j * len(modes)] = slope @ factors[place]
            turned[..., i + j * len(modes)] = inverse[:, place] @ (slope.T @ residuals)
        begin = place.stop
    moved, turned = moved.reshape(len(moved), -1), turned.reshape(len(turned), -1)
    plain = basis @ (basis.T @ moved) - moved
    shape = residuals.size, 2 * len(modes)
    return residuals, factors * noise, basis, (plain - basis @ turned).reshape(shape), plain.reshape(shape)


def fit(family: AbstractFamily, omega: ArrayLike, zeta: ArrayLike, noise: np.ndarray) -> Fit:
    """Modes refined from a start; ``noise``: a first estimate of each channel's, improved on the way."""
    found = _refined(family, np.asarray(omega, float), np.asarray(zeta, float), noise)
    # With one channel the noise scales everything alike; with several it says how much each one counts.
    for _ in range(0 if family.data.shape[1] == 1 or not len(found.omega) else 2):
        found = _refined(family, found.omega, found.zeta, found.noise)
    return found


def _refined(family: AbstractFamily, omega: np.ndarray, zeta: np.ndarray, noise: np.ndarray) -> Fit:
    count, channels, converged = len(omega), family.data.shape[1], True
    if count:
        lower, upper = np.repeat([family.lowest, 0.0], count), np.repeat([family.highest, STEEPEST], count)

        def projected(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            residuals, _, _, slopes, _ = project(family, x[:count], x[count:], noise)
            return residuals.ravel(), slopes

        values, jacobian = value_and_jacobian(projected)
        start = np.clip(np.concatenate([omega, zeta]), lower + 1e-9 * upper, upper * (1 - 1e-9))
        found = least_squares(
            values, start, jacobian, bounds=(lower, upper),
            x_scale="jac", ftol=1e-10, xtol=1e-10, gtol=1e-12, max_nfev=60,
        )  # fmt: skip
        omega, zeta, converged = found.x[:count], found.x[count:], found.status > 0
    residuals, factors, basis, _, plain = project(family, omega, zeta, noise)
    free = max(len(residuals) - basis.shape[1] - 2 * count / channels, 1.0)
    squares = np.sum(residuals**2, axis=0) * noise**2
    estimate = np.maximum(np.sqrt(squares / free), 1e-13 * np.max(np.abs(family.data), axis=0))
    residuals = residuals * (noise / estimate)
    plain = plain.reshape(len(residuals), channels, 2 * count) * (noise / estimate)[:, None]
    return Fit(omega, zeta, factors, estimate, residuals, squares, free, plain, basis, converged)
