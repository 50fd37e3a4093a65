"""Shapers for machines with many modes, beside the least that positive impulses can leave.

    python -m experiments.reliability.many_modes      # about two minutes

Machines of one to four modes, all frequencies uncertain by 5 %, as ``jshape identify`` writes them: the shaper lasts as
long as ZVD and has as many impulses as help. Beside what ``js.tune`` leaves stand ZVD, the same search without the
convex program (``minimax``), and the lower bound: no positive impulses of that duration, however many, leave less of
the models of a few plants of the set.
"""

import time
from typing import Any
from unittest.mock import patch

import jax
import numpy as np

import jshape as js
from experiments import markdown
from jshape.compilation_cache import keep_programs
from jshape.design.tuning.design_problem import design_problem
from jshape.design.tuning.interval import with_places
from jshape.design.tuning.linear_models import LinearModels
from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Limits
from jshape.design.tuning.starts import starts

HERTZ, GAINS, ZETA = [3.1, 5.2, 9.0, 14.0], [0.3, 1.3, 0.3, 0.4], 0.02
"""The modes, their gains and their damping ratio."""

COUNT = {1: 11, 2: 5, 3: 3}
"""Values of each frequency where there are so many modes; two where there are more."""


def bound(plant: Any, duration: float, over: dict[str, Any]) -> tuple[float, int]:
    """The least that positive impulses of a duration leave of linear models, J, and how many impulses the best has."""
    problem = design_problem(
        plant, 1.0, 12, duration, "positive", None, over, "worst",
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip
    search = ScaledProblem(with_places(problem))
    models = LinearModels(search)
    models.fit(np.array([search.vector(one) for one in starts(problem, 24, 0)]))
    found = models.minimax()
    return found.bound, len(found.times)


def greatest(plant: Any, shaper: js.Shaper) -> float:
    """The greatest energy over the frequencies, J, by the closed form of each mode's response. Their energies add
    up, so that the greatest is the sum of the greatest."""
    times = np.asarray(shaper.times)
    amplitudes, since = np.asarray(shaper.amplitudes)[:, None], times[-1] - times
    total = 0.0
    for omega, zeta, weight in zip(*map(np.asarray, (plant.omega, plant.zeta, plant.weights())), strict=True):
        omega = omega * np.linspace(0.95, 1.05, 100_001)
        damped = omega * np.sqrt(1 - zeta**2)
        phase = np.multiply.outer(since, damped)
        faded = amplitudes * np.exp(-zeta * np.multiply.outer(since, omega))
        left = np.sum(faded * (np.cos(phase) + zeta * omega / damped * np.sin(phase)), axis=0)
        speed = np.sum(faded * omega**2 / damped * np.sin(phase), axis=0)
        total += weight * np.max(speed**2 + (omega * left) ** 2) / 2
    return float(total)


def row(modes: int) -> list[str]:
    """What is left of a machine with so many modes."""
    omega = 2 * np.pi * np.array(HERTZ[:modes])
    plant = js.plants.ModalPlant(omega=omega, zeta=[ZETA] * modes, gains=GAINS[:modes] / np.sum(GAINS[:modes]))
    over = {f"omega.{i}": np.linspace(0.95, 1.05, COUNT.get(modes, 2)) for i in range(modes)}
    duration = float(sum(2 * np.pi / (omega * np.sqrt(1 - ZETA**2))))
    least, impulses = bound(plant, duration, over)

    def tuned() -> tuple[Any, float]:
        begin = time.perf_counter()
        found = js.tune(plant, 1.0, impulses, duration, "positive", over=over, objective="worst")
        return found, time.perf_counter() - begin

    found, seconds = tuned()
    with patch.object(LinearModels, "convex", False):
        other, more = tuned()
    zvd = js.design.linear.multi_mode([(each, ZETA) for each in omega], kind="zvd")
    energies = [greatest(plant, each) for each in (zvd, found.shaper)]
    apart = abs(energies[1] / found.objective - 1)
    cells = [f"{duration:.3f}", f"{impulses}", f"{len(zvd.times)}", *(f"{value:.3g}" for value in (energies[0], least))]
    cells += [f"{found.objective:.3g}", f"{apart:.0e}", f"{found.status.value}, {seconds:.0f} s"]
    return [*cells, f"{other.objective:.3g}", f"{other.status.value}, {more:.0f} s"]


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    keep_programs()
    rows = {}
    for modes in range(1, len(HERTZ) + 1):
        rows[str(modes)] = row(modes)
        print(modes, *rows[str(modes)], flush=True)
    headings = ["modes", "duration (s)", "impulses", "of ZVD", "ZVD (J)", "lower bound (J)", "js.tune (J)", "apart", "",
                "without minimax (J)", ""]  # fmt: skip
    lines = markdown.table(headings, [[name, *cells] for name, cells in rows.items()])
    title = "Machines with many modes beside the least that positive impulses can leave"
    command = "python -m experiments.reliability.many_modes"
    markdown.write_beside(__file__, title, command, [*markdown.explained(__doc__), *lines])


if __name__ == "__main__":
    main()
