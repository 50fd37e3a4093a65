"""The specification and a candidate design: the two records that every solver here takes and returns."""

import dataclasses

from jshape.design.insensitive._band import Region, Vector
from jshape.design.insensitive._dual import Dual, Kind


@dataclasses.dataclass(frozen=True)
class Specification:
    """Minimise the duration subject to V ≤ ``vibration``; or, where that is None, V in at most ``duration``.

    Frequencies are of the order of 1 rad/s. Where both are None, V is minimised over all durations.
    """

    region: Region
    kind: Kind
    vibration: float | None = None
    duration: float | None = None

    @property
    def minimises_vibration(self) -> bool:
        """Whether V is minimised, rather than the duration."""
        return self.vibration is None

    def met_by(self, design: "Design") -> bool:
        """Whether the design keeps the limit on V, if there is one."""
        return self.vibration is None or design.vibration <= self.vibration * (1 + 1e-9)


@dataclasses.dataclass(frozen=True)
class Design:
    """A candidate: impulses, the largest V where it is limited, and the dual weights if it is a stationary point."""

    amplitudes: Vector
    times: Vector
    vibration: float
    dual: Dual | None = None

    @property
    def duration(self) -> float:
        """Time of the last impulse, for frequencies of the order of 1 rad/s."""
        return float(self.times[-1])
