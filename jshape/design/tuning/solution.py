"""The result of a search: the shaper, its objective and how accurate that is, and why it is an optimum."""

import dataclasses
import html

import numpy as np
from jaxtyping import Float

from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.status import Result, Status


@dataclasses.dataclass(frozen=True, repr=False)
class Solution(Result):
    """A tuned shaper and how it was found.

    Attributes:
        shaping: what the metrics take: the shaper, or axis → the shaper of that axis.
        objective: residual energy (J; or the metric asked for): the nominal plant's, or the worst, mean or tail mean
            over the uncertain set, or what the objective's function makes of them.
        status: ``CONVERGED`` at an optimum to which searches from around it come back, ``STOPPED`` where the iterations
            ran out before, or where there are many local optima, of which this is one (see ``optimality``), and a
            better one may exist, ``INFEASIBLE`` where a limit is missed, ``DIVERGED`` where a plant diverged,
            ``INTERRUPTED`` by the user.
        message: how the search ended, a sentence.
        history: the objective, with the cost of time if it has one, after each iteration (nominal: of the best start)
            or at each design evaluated (others), the least so far.
        energies: of every plant of the set, J; in the worst case after those given come others between them, the worst
            among them.
        samples: the leaves of those plants, absolute, one entry a plant.
        objective_on_finer_set: the objective on a set ten times finer along each leaf (as far as that stays under
            20,000 plants), J; in the worst case with the maxima between its plants.
        error: how much the objective changes with a tolerance of the integration that is ten times tighter, J; where
            rounding keeps that from being met, the greatest error that the energies' own estimates state.
        active: leaves of the active plants, whose energies define the optimum, and under ``"multiplier"`` their
            multipliers, the greatest first; empty without an uncertain set.
        optimality: residual of the Karush–Kuhn–Tucker conditions, relative to the steepest slope; 0 at an optimum, NaN
            after an interrupt that came before derivatives were compiled. Of impulses at multiples of a sample time
            that of the amplitudes.
        plant: the nominal plant with the designed leaves in place.
        leaves: values of the designed leaves.
        slack: of the limit on the move that is closest: 1 where none of it is used, negative where it is missed.
    """

    shaping: Shaper | dict[str, Shaper]
    objective: float
    status: Status
    message: str
    history: Float[np.ndarray, " evaluations"]
    energies: Float[np.ndarray, " plants"]
    samples: dict[str, Float[np.ndarray, " plants"]]
    objective_on_finer_set: float
    error: float
    active: dict[str, Float[np.ndarray, " active"]]
    optimality: float
    plant: AbstractPlant
    leaves: dict[str, float]
    slack: float

    @property
    def shaper(self) -> Shaper:
        """The shaper.

        Raises:
            ValueError: where there is one for each axis: ``shapers``.
        """
        if not isinstance(self.shaping, Shaper):
            raise ValueError(f"shaper: each axis has its own; take shapers, of {', '.join(self.shaping)}")
        return self.shaping

    @property
    def shapers(self) -> dict[str, Shaper]:
        """Axis → shaper; a plant of one axis has the axis ``"command"``."""
        if not isinstance(self.shaping, Shaper):
            return self.shaping
        return dict.fromkeys(self.plant.axes or ("command",), self.shaping)

    def __repr__(self) -> str:
        return "\n  ".join([f"Solution({self.message})", *(f"{name}: {text}" for name, text in self._rows())])

    def _repr_html_(self) -> str:
        rows = [("status", self.message), *self._rows()]
        table = "".join(f"<tr><th>{name}</th><td>{html.escape(text)}</td></tr>" for name, text in rows)
        # Shapers draw themselves, where they can.
        pictures = [getattr(shaper, "_repr_html_", str)() for shaper in self._distinct().values()]
        return f"<table>{table}</table>{''.join(pictures)}"

    def _distinct(self) -> dict[str, Shaper]:
        """The shaper, or those of the axes, by the words before them."""
        one = isinstance(self.shaping, Shaper)
        return {"shaper": self.shaper} if one else {f"shaper of {axis}": one for axis, one in self.shapers.items()}

    def _rows(self) -> list[tuple[str, str]]:
        """What a person reads first: names and texts."""
        plants = [
            ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.active, row, strict=True))
            for row in zip(*self.active.values(), strict=True)
        ]
        return [
            *((words, repr(shaper)) for words, shaper in self._distinct().items()),
            (
                "objective",
                f"{self.objective:.6g}, {self.objective_on_finer_set:.6g} on the finer set, error {self.error:.1e}",
            ),
            ("active plants", "; ".join(plants) or "the nominal plant"),
            ("optimality", f"{self.optimality:.1e}, least slack of the limits {self.slack:.3g}"),
        ]
