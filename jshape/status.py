"""Outcomes of computations: a status that a program can compare, and a sentence that a person can read."""

import enum


class Status(enum.Enum):
    """The outcome of a computation."""

    CONVERGED = "converged"
    """The conditions of a solution hold to the tolerance asked for."""
    STOPPED = "stopped"
    """The iterations, starts or samples ran out before that; the best result so far is returned."""
    INTERRUPTED = "interrupted"
    """The user interrupted; the best result so far is returned."""
    INFEASIBLE = "infeasible"
    """No result keeps every limit; the one that comes nearest is returned."""
    DIVERGED = "diverged"
    """The plant left the region from which it returns to rest, or a number is not finite."""


class Result:
    """The base of all results: ``status``, ``converged``, ``message``.

    A subclass has ``status`` and ``message`` as fields or properties.
    """

    status: Status
    message: str

    @property
    def converged(self) -> bool:
        """Whether the status is ``Status.CONVERGED``."""
        return self.status is Status.CONVERGED
