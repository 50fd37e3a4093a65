"""Do 95 % intervals of springs, friction, delay and payloads hold the truth in 95 of 100 random machines?

Machines are drawn at random, their motions simulated by SciPy's DOP853 on equations of this script's own, sampled 300
times with white noise, and identified. Springs: k1 from 5 to 20 N/m, k3 from 30 to 200 N/m³; c from 0.05 to 0.5 N s/m,
dry friction from 0.1 to 0.6 N over 0.03 m/s, noise from 0.5 to 5 mm of a first swing of 1 m (all with uniform
logarithms); delays from 5 to 80 ms; payloads from 0.7 to 2 kg. ± is the binomial standard error.

Run: python -m experiments.identification.intervals [DRAWS]; 150 draws take 5 minutes of processor time
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy.integrate import solve_ivp

import jshape as js
from experiments.markdown import table

TIMES = np.arange(300) * 0.015
WIDTH = 0.03
"""m/s, over which dry friction changes its sign."""

Truth = dict[str, float]


def drawn(random: np.random.Generator) -> Truth:
    """A machine without friction and delay, and the standard deviation of its sensor."""
    ranges = {"k1": (5, 20), "k3": (30, 200), "c": (0.05, 0.5), "noise": (0.0005, 0.005)}
    return {name: float(np.exp(random.uniform(*np.log(ends)))) for name, ends in ranges.items()}


def moved(
    truth: Truth, random: np.random.Generator, mass: float, first: float = 1.0, base: Callable | None = None
) -> np.ndarray:
    """The measured position of a payload, m; ``base``: its position and speed at an instant."""

    def field(t: float, y: np.ndarray) -> list[float]:
        place, speed = base(t) if base else (0.0, 0.0)
        bend, slip = y[0] - place, y[1] - speed
        pull = truth["k1"] * bend + truth["k3"] * bend**3 + truth["c"] * slip
        return [y[1], -(pull + truth.get("friction", 0.0) * np.tanh(slip / WIDTH)) / mass]

    run = solve_ivp(field, (0, TIMES[-1]), [first, 0.0], "DOP853", TIMES, rtol=1e-9, atol=1e-11, max_step=0.02)
    return run.y[0] + random.uniform(-0.1, 0.1) + truth["noise"] * random.normal(size=len(TIMES))


def ring_down(random: np.random.Generator) -> tuple[Truth, Any]:
    truth = drawn(random)
    return truth, js.identify_duffing(TIMES, moved(truth, random, 1.2), mass=1.2)


def dry_friction(random: np.random.Generator) -> tuple[Truth, Any]:
    truth = drawn(random) | {"friction": float(np.exp(random.uniform(*np.log([0.1, 0.6]))))}
    values = moved(truth, random, 1.2)
    return truth, js.identify_duffing(TIMES, values, mass=1.2, friction=True, friction_width=WIDTH)


def late_base(random: np.random.Generator) -> tuple[Truth, Any]:
    truth = drawn(random) | {"delay": random.uniform(0.005, 0.08)}
    omega, phase = random.uniform(2, 8, 3), random.uniform(0, 2 * np.pi, 3)

    def place(t):
        return 0.1 * np.sum(np.sin(np.multiply.outer(t, omega) + phase) - np.sin(phase), axis=-1)

    def speed(t):
        return 0.1 * np.sum(omega * np.cos(omega * t + phase))

    def late(t):
        return (place(t - truth["delay"]), speed(t - truth["delay"])) if t > truth["delay"] else (0.0, 0.0)

    values = moved(truth, random, 1.2, 0.0, late)
    return truth, js.identify_duffing(TIMES, values, mass=1.2, inputs=place(TIMES), delay=True, between="spline")


def payloads(random: np.random.Generator) -> tuple[Truth, Any]:
    truth = drawn(random) | {"mass_2": random.uniform(0.7, 2.0), "mass_3": random.uniform(0.7, 2.0)}
    masses = (1.2, truth["mass_2"], truth["mass_3"])
    records = [(TIMES, moved(truth, random, mass, random.uniform(0.5, 1.0))) for mass in masses]
    return truth, js.identify_payloads(records, [1.2, None, None])


KINDS = {
    "ring-down": ring_down,
    "ring-down with dry friction": dry_friction,
    "base that moves late": late_base,
    "three payloads, one of known mass": payloads,
}


def coverage(kind: str, draws: int) -> list[list[str]]:
    """Rows of the table: how often each parameter's interval holds the truth."""
    held: dict[str, list[bool]] = {}
    failed = 0
    for draw in range(draws):
        truth, found = KINDS[kind](np.random.default_rng([list(KINDS).index(kind), draw]))
        failed += not found.converged
        for name, (low, high) in found.interval().items() if found.converged else ():
            held.setdefault(name, []).append(low <= truth[name] <= high)
    return [
        [kind, name, str(len(each)), str(failed), f"{100 * np.mean(each):.1f} ± {_error(each):.1f} %"]
        for name, each in held.items()
    ]


def _error(held: list[bool]) -> float:
    """The standard error of a share of 95 %, per cent."""
    return 100 * float(np.sqrt(0.95 * 0.05 / len(held)))


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    rows = [row for kind in KINDS for row in coverage(kind, draws)]
    head = ["record", "of", "intervals", "did not converge", "hold the truth"]
    lines = ["# Intervals of identified springs", "", (__doc__ or "").strip(), "", *table(head, rows)]
    Path(__file__).with_suffix(".md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
