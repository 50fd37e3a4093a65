"""Designs that a limit on the deflection holds back, beside SciPy's SLSQP.

    python -m experiments.reliability.limits      # about a quarter of an hour

A crane, a double pendulum and a hardening pair, each with an uncertain leaf: designs without a limit, then with one 3 %
below the deflection that the first one takes. The judge is SLSQP with differences of the energies and peaks of six
times as many plants (the mean counts those of the set alone), from the design without a limit, from ``js.tune``'s own
and from random ones; the peaks of 401 plants over the limit say whether it is kept between those of the set.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

import jshape as js
from experiments import markdown
from jshape.compilation_cache import keep_programs

IMPULSES, TIGHTER, RANDOM = 3, 0.97, 2
"""Of all designs; the limit over what the first design takes; random starts of the judge."""

BETWEEN, DENSE = 6, 401
"""Plants of the judge for each one of the set, and how many those are whose peaks are looked at."""


class Case(NamedTuple):
    """A machine: its plant for each value of the uncertain leaf, the leaf, its nominal value, how many values over
    which range, the command, and the duration of the shaper, s."""

    plant: Callable[[Any], Any]
    leaf: str
    nominal: float
    values: int
    range: tuple[float, float]
    command: Any
    duration: float


MOVE = js.Trapezoid(4.0, 1.0, 0.5)
CASES = {
    "crane, 4 m": Case(js.plants.Crane, "cable_length", 4.0, 7, (0.8, 1.2), MOVE, 4.0),
    "double pendulum, 6 and 1 m": Case(
        lambda v: js.plants.DoublePendulumCrane(6.0, 1.0, 500.0, v), "payload_mass", 100.0, 5, (0.5, 1.5), MOVE, 5.0
    ),
    "hardening pair": Case(
        lambda v: js.plants.TwoMass(1.0, v, js.plants.Duffing(10.0, 100.0)), "m2", 1.0, 7, (0.8, 1.2), js.Step(1.0), 0.9
    ),
}


def left(case: Case, count: int) -> Callable[..., tuple[Any, Any]]:
    """Energies and greatest deflections of so many plants, as a function of amplitudes and times."""
    values = case.nominal * jnp.linspace(*case.range, count)

    @jax.jit
    def found(amplitudes: Any, times: Any) -> tuple[Any, Any]:
        def one(value: Any) -> tuple[Any, Any]:
            plant, shaper = case.plant(value), js.Shaper(amplitudes, times)
            metrics = js.residual_energy, js.peak_deflection
            return metrics[0](plant, shaper, case.command), metrics[1](plant, shaper, case.command)

        return jax.vmap(one)(values)

    return found


def judged(case: Case, mean: bool, limit: float, starts: list[js.Shaper]) -> float:
    """The least objective that SLSQP reaches from any start within the limit, J; infinite where it reaches none."""
    of = left(case, BETWEEN * (case.values - 1) + 1)
    every = BETWEEN if mean else 1
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def impulses(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        free, inner = np.split(x, [IMPULSES - 1])
        return np.append(free, 1 - free.sum()), np.concatenate([[0.0], inner, [case.duration]])

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if (key := x.tobytes()) not in known:
            known[key] = tuple(np.asarray(part) for part in of(*map(jnp.asarray, impulses(x))))
        return known[key]

    def objective(energies: np.ndarray) -> np.ndarray:
        return energies[::every].mean(keepdims=True) if mean else energies

    least = np.inf
    for start in starts:
        x = np.concatenate([np.asarray(start.amplitudes)[:-1], np.asarray(start.times)[1:-1]])
        unit = max(float(at(x)[0].max()), 1e-12)
        # With the epigraph's variable: the greatest energy, or that of the mean, which takes its place.
        kept = [
            dict(type="ineq", fun=lambda z, unit=unit: z[-1] - objective(at(z[:-1])[0]) / unit),
            dict(type="ineq", fun=lambda z: 1 - at(z[:-1])[1] / limit),
            dict(type="ineq", fun=lambda z: impulses(z[:-1])[0]),
            dict(type="ineq", fun=lambda z: np.diff(impulses(z[:-1])[1])),
        ]
        end = minimize(lambda z: z[-1], np.append(x, 1.0), method="SLSQP", constraints=kept, options=dict(maxiter=80)).x
        if np.all(np.isfinite(end)) and at(end[:-1])[1].max() <= limit * (1 + 1e-6):
            least = min(least, float(objective(at(end[:-1])[0]).max()))
    return least


def row(case: Case, objective: str) -> list[str]:
    """A design without and one with the limit, and what the judge leaves."""
    over = {case.leaf: np.linspace(*case.range, case.values)}
    asked = dict(impulses=IMPULSES, duration=case.duration, over=over, objective=objective)
    plant = case.plant(case.nominal)
    free = js.tune(plant, case.command, **asked)
    peaks = left(case, DENSE)
    limit = TIGHTER * float(peaks(free.shaper.amplitudes, free.shaper.times)[1].max())
    found = js.tune(plant, case.command, peak_deflection=limit, **asked)
    random = np.random.default_rng(0)
    drawn = [
        js.Shaper(random.dirichlet(np.ones(IMPULSES)), [0.0, *inner, case.duration])
        for inner in np.sort(random.uniform(0.0, case.duration, (RANDOM, IMPULSES - 2)), axis=1)
    ]
    least = judged(case, objective == "mean", limit, [free.shaper, found.shaper, *drawn])
    most = float(peaks(found.shaper.amplitudes, found.shaper.times)[1].max()) / limit - 1
    cells = [f"{free.objective:.4g}", f"{limit:.4g}", f"{found.objective:.5g}", f"{least:.5g}", f"{most:.0e}"]
    return [*cells, found.status.value]


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    keep_programs()
    rows = []
    for name, case in CASES.items():
        for objective in ("mean", "worst"):
            rows.append([name, objective, *row(case, objective)])
            print(*rows[-1], flush=True)
    headings = ["machine", "objective", "without a limit (J)", "limit (m or rad)", "js.tune (J)",
                "SLSQP (J)", "greatest peak over the limit, less 1", ""]  # fmt: skip
    title = "Designs that a limit holds back"
    command = "python -m experiments.reliability.limits"
    lines = [*markdown.explained(__doc__), *markdown.table(headings, rows)]
    markdown.write_beside(__file__, title, command, lines)


if __name__ == "__main__":
    main()
