"""What every identification of a motion's law returns: parameters, their uncertainty, and how the fit ended."""

import dataclasses
from typing import Any

import numpy as np

from jshape.identification._motion import Fit, Problem
from jshape.identification._uncertainty import covariance, half_width, is_white
from jshape.identification.records import RecordError
from jshape.status import Result, Status

_ALIKE = 1e-4
"""The least of the slopes' singular values over the greatest below which unknowns are alike."""

HIDDEN = ("position", "speed", "zero")
"""What is fitted, but belongs to the record and not to the machine."""


@dataclasses.dataclass(frozen=True)
class IdentifiedMotion(Result):
    """The law of a motion, as fitted.

    Attributes:
        parameters: by name, in SI units.
        std: standard deviation of each.
        covariance: in their order.
        free: degrees of freedom of the deviations.
        status: ``STOPPED`` where the fit did not converge.
        message: what was found.
        notes: on the records.
    """

    parameters: dict[str, float]
    std: dict[str, float]
    covariance: np.ndarray
    free: float
    status: Status
    message: str
    notes: tuple[str, ...]

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Confidence intervals by name.

        Args:
            level: the probability with which an interval holds the truth.

        Raises:
            ValueError: unless 0 < level < 1.
        """
        reach = half_width(level, self.free)
        return {
            name: (value - reach * self.std[name], value + reach * self.std[name])
            for name, value in self.parameters.items()
        }


def concluded(problem: Problem, fitted: Fit, notes: list[str], unlike: str) -> dict[str, Any]:
    """The fields of an ``IdentifiedMotion``.

    Args:
        problem: what was sought.
        fitted: what was found.
        notes: on the records.
        unlike: what is said where the law explains less than half of a motion.

    Raises:
        RecordError: where it does.
    """
    explained = [
        1 - np.sum(left**2) / np.sum((data.values - np.mean(data.values)) ** 2)
        for data, left in zip(problem.records, fitted.residuals, strict=True)
    ]
    if not min(explained) > 0.5:
        raise RecordError(f"values: {unlike}")
    free = float(sum(map(len, fitted.residuals)) - len(fitted.unknowns))
    residuals = np.concatenate([r / n for r, n in zip(fitted.residuals, fitted.noise, strict=True)])
    slopes = np.concatenate([s / n for s, n in zip(fitted.slopes, fitted.noise, strict=True)])
    labels, kept = _labels(problem)
    _require_apart(slopes, problem.names())
    # Steps of an encoder and what the law lacks are correlated for long.
    spread = covariance(slopes[:, None], residuals[:, None], free, most=len(residuals))
    values, spread = fitted.unknowns[kept], spread[np.ix_(kept, kept)]
    parameters = dict(zip(labels, values.tolist(), strict=True))
    std = dict(zip(labels, np.sqrt(np.diag(spread)).tolist(), strict=True))
    if not all(is_white(left[:, None]) for left in fitted.residuals):
        notes.append(
            "the residuals are no white noise: intervals allow for it, but another spring or damper may fit better"
        )
    if fitted.error > 0.1:
        notes.append(f"the simulation's own error is {fitted.error:.2g} of the noise: dry friction is too sudden")
    described = ", ".join(f"{name} {value:.5g} ± {1.96 * std[name]:.2g}" for name, value in parameters.items())
    message = f"{described} (95 % intervals); explains {100 * min(explained):.4g} % of the motion"
    return dict(
        parameters=parameters,
        std=std,
        covariance=spread,
        free=free,
        status=Status.CONVERGED if fitted.converged else Status.STOPPED,
        message=message if fitted.converged else f"did not converge; {message}",
        notes=tuple(notes),
    )


def _require_apart(slopes: np.ndarray, names: list[str]) -> None:
    """Refuse unknowns that move the record alike: no interval of them would mean anything.

    Raises:
        RecordError: that names them.
    """
    sizes = np.sqrt(np.sum(slopes**2, axis=0))
    _, values, directions = np.linalg.svd(slopes / np.where(sizes > 0, sizes, 1.0), full_matrices=False)
    if not values[-1] > _ALIKE * values[0]:
        alike = dict.fromkeys(name for name, part in zip(names, directions[-1], strict=True) if abs(part) > 0.1)
        raise RecordError(f"values: the motion does not determine {' and '.join(alike)}: others would fit as well")


def _labels(problem: Problem) -> tuple[list[str], list[int]]:
    """Names of the unknowns that belong to the machine, and their places."""
    labels, several = list(problem.shared), len(problem.own) > 1
    for number, own in enumerate(problem.own, 1):
        labels += [f"{name}_{number}" if several and name not in HIDDEN else name for name in own]
    kept = [place for place, label in enumerate(labels) if label not in HIDDEN]
    return [labels[place] for place in kept], kept
