"""The result of an identification: modes and their uncertainty, the plant that they make, what it predicts."""

import abc
import dataclasses

import numpy as np

from jshape.identification._projection import AbstractFamily, Fit
from jshape.identification._uncertainty import half_width
from jshape.plants import ModalPlant
from jshape.status import Result, Status

MEASURED = ("position", "velocity", "acceleration")
"""What a sensor sees, each the derivative of the one before."""


def of_position(residues: np.ndarray, omega: np.ndarray, zeta: np.ndarray, measured: str) -> np.ndarray:
    """The residues of a position, modes × channels: at the pole λ a derivative's are λ times as great."""
    pole = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    return residues / pole[:, None] ** MEASURED.index(measured)


class AbstractIdentified(Result):
    """Modes with their uncertainty."""

    omega: np.ndarray
    zeta: np.ndarray

    @property
    @abc.abstractmethod
    def omega_std(self) -> np.ndarray:
        """Standard deviation of each frequency, rad/s."""

    @property
    @abc.abstractmethod
    def zeta_std(self) -> np.ndarray:
        """Standard deviation of each damping ratio."""

    @property
    @abc.abstractmethod
    def free(self) -> float:
        """Degrees of freedom of the deviations."""

    def interval(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Confidence intervals: lower and upper ends for ω, rad/s, and for ζ, each of shape (2, modes).

        Args:
            level: the probability with which an interval holds the truth.

        Raises:
            ValueError: unless 0 < level < 1.
        """
        reach = half_width(level, self.free) * np.array([[-1.0], [1.0]])
        return self.omega + reach * self.omega_std, np.maximum(self.zeta + reach * self.zeta_std, 0.0)


@dataclasses.dataclass(frozen=True)
class Identified(AbstractIdentified):
    """Modes of a measured machine, ascending.

    Attributes:
        kind: of the record.
        omega: undamped natural frequencies, rad/s, shape (modes,).
        zeta: damping ratios, shape (modes,).
        covariance: of ω_1 …, ζ_1 ….
        residues: complex, in the channels' units, shape (modes, channels): a mode is Re(c e^{λ t}) from the record's
            first sample on (spectra, sweeps: ½ c/(s − λ) and its conjugate).
        gains: what ``ModalPlant`` takes, shape (modes, channels); absolute where the input is known, else shares of the
            vibration.
        noise: standard deviation of what the modes do not explain, in the channels' units (of a power spectral density:
            a fraction), shape (channels,).
        criteria: the criterion for 0, 1, 2 … modes; the least decides.
        status: ``STOPPED`` where the fit did not converge.
        message: what was found.
        notes: on the record.
        axis: of the record as it was used, s (spectra: rad/s), shape (rows,).
        values: likewise, shape (rows, channels).
        inputs: likewise, shape (rows,), or ``None``.
        names: of the channels.
        measured: what they are; the gains are those of a position.
    """

    kind: str
    omega: np.ndarray
    zeta: np.ndarray
    covariance: np.ndarray
    residues: np.ndarray
    gains: np.ndarray
    noise: np.ndarray
    criteria: np.ndarray
    status: Status
    message: str
    notes: tuple[str, ...]
    axis: np.ndarray
    values: np.ndarray
    inputs: np.ndarray | None
    names: tuple[str, ...]
    measured: str
    _family: AbstractFamily = dataclasses.field(repr=False)
    _fit: Fit = dataclasses.field(repr=False)
    _scale: tuple[np.ndarray, np.ndarray] = dataclasses.field(repr=False)
    _rest: np.ndarray | None = dataclasses.field(default=None, repr=False)

    @property
    def omega_std(self) -> np.ndarray:
        """Standard deviation of each frequency, rad/s."""
        return np.sqrt(np.diag(self.covariance)[: len(self.omega)])

    @property
    def zeta_std(self) -> np.ndarray:
        """Standard deviation of each damping ratio."""
        return np.sqrt(np.diag(self.covariance)[len(self.omega) :])

    @property
    def free(self) -> float:
        """Degrees of freedom of the deviations."""
        return self._fit.free

    @property
    def plant(self) -> ModalPlant:
        """The modes as a plant, with the gains of the first channel."""
        return ModalPlant(self.omega, self.zeta, self.gains[:, 0])

    def predict(self, at: np.ndarray | None = None, inputs: np.ndarray | None = None) -> np.ndarray:
        """The channels according to the fit, shape (rows, channels).

        Args:
            at: instants, s (spectra: rad/s); the record's own unless given. Where the record was driven they must begin
                where it does. Before a step the machine is where it was recorded to rest.
            inputs: at those instants, where the record was driven; the record's own unless ``at`` is given.

        Raises:
            ValueError: for inputs that are missing or of another length, instants that begin elsewhere, and instants
                before a step of which the record has none.
        """
        axis = self.axis if at is None else np.atleast_1d(np.asarray(at, float))
        before = np.zeros(len(axis), bool)
        if self.kind == "step":
            before = axis < self.axis[0] - 0.5 * float(np.median(np.diff(self.axis)))
        if before.any() and self._rest is None:
            raise ValueError(
                f"at must not begin before the step, at {self.axis[0]:.9g} s, but does at {axis[before][0]:.9g} s: "
                "the record does not say where the machine was"
            )
        given = self.inputs if at is None and inputs is None else inputs
        family = self._family.at(np.where(before, self.axis[0], axis), given)
        centre, scale = self._scale
        predicted = family.join(self._fit.fitted(family) * scale + centre)
        if before.any():
            predicted[before] = self._rest
        return predicted
