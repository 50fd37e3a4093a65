"""Growth of the cost of residual energies: ``python -m experiments.benchmarks.growth`` (about ten minutes).

Plants, impulses, states and segments one at a time, value and gradient, by the default call of ``js.residual_energy``
under ``jit`` and ``vmap`` on all cores. Writes the table, and a figure with the slopes, beside itself.

Shapers and commands last as long whatever their number of impulses and segments: fewer of them are longer.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from matplotlib import ticker

import jshape as js
from experiments import markdown
from experiments.benchmarks.record import about, keep, least, processor
from jshape.reports import style

PLANTS, DURATION = 1000, 2.0
"""Plants at once, where it is not their number that grows; the shaper's or command's duration, s."""

TOGETHER = 10_000
"""Plants that go through the kernel together; more of them take turns."""


MANY = 1_000_000
"""Plants up to which calls are repeated."""


class Chain(js.plants.AbstractPlant):
    """Equal masses in a row, each on a hardening spring (10 N/m, 100 N/m³) to the one before, the first to the base.

    State: positions, then velocities.
    """

    m: jax.Array
    masses: int = eqx.field(static=True)
    drive = "displacement"

    def stretch(self, state, inputs):
        x = state[: self.masses]
        return x - jnp.concatenate([jnp.atleast_1d(inputs), x[:-1]])

    def vector_field(self, t, state, inputs):
        d = self.stretch(state, inputs)
        force = 10 * d + 100 * d**3
        pulled = jnp.append(force[1:], 0.0) - force
        return jnp.concatenate([state[self.masses :], pulled / self.m])

    def residual_energy(self, state, inputs):
        d, v = self.stretch(state, inputs), state[self.masses :]
        return jnp.sum(self.m * v**2 / 2 + 5 * d**2 + 25 * d**4)

    def rest_state(self, inputs):
        return jnp.concatenate([jnp.full(self.masses, inputs), jnp.zeros(self.masses)])


class Row(NamedTuple):
    """Cost of one number of something: the first call (s), and a plant's value and its gradient (s)."""

    what: str
    number: int
    first: float
    first_gradient: float
    value: float
    gradient: float
    flagged: float


def cases() -> Iterator[tuple[str, int, int, Callable[..., Any], np.ndarray]]:
    """The growing quantities and their ranges, plants, the energy of a mass and of parameters, and these."""

    def two(mass):
        return js.plants.TwoMass(m2=mass, spring=js.plants.Duffing(10, 100))

    def shaped(make, mass, x):
        return js.residual_energy(make(mass), js.Shaper(jnp.append(x, 1 - jnp.sum(x)), even(len(x) + 1)), 1.0)

    for plants in 10 ** np.arange(8):
        yield "plants", int(plants), int(plants), partial(shaped, two), np.array([0.25, 0.5])
    for impulses in (2, 4, 8, 16, 32):
        amplitudes = np.full(impulses - 1, 1 / impulses)
        yield "impulses", impulses, PLANTS, partial(shaped, two), amplitudes
    for masses in (1, 2, 4, 8):
        chain = partial(Chain, masses=masses)
        yield "states", 2 * masses, PLANTS, partial(shaped, chain), np.array([0.25, 0.5])
    for segments in (1, 2, 4, 8, 16, 32, 64):
        times = DURATION * np.arange(segments + 1) / segments
        planned = (1 - np.cos(np.pi * times / DURATION)) / 2

        def along(mass, x, times=times):
            return js.residual_energy(two(mass), None, js.Sampled(times, jnp.append(0.0, x)))

        yield "segments", segments, PLANTS, along, planned[1:]


def even(impulses: int) -> np.ndarray:
    return DURATION * np.arange(impulses) / (impulses - 1)


def measure(what: str, number: int, plants: int, energy: Callable[..., Any], x: np.ndarray) -> Row:
    """One row; the least time of several rounds, or where one takes minutes the first, which also compiles."""
    masses = jnp.linspace(0.8, 1.2, plants)

    def values(x):
        return jax.lax.map(lambda m: energy(m, x), masses, batch_size=min(plants, TOGETHER))

    runs = {"value": jax.jit(values), "gradient": jax.jit(jax.grad(lambda x: jnp.sum(values(x))))}
    firsts = {}
    for name, run in runs.items():
        begin = time.perf_counter()
        found = jax.block_until_ready(run(x))
        firsts[name] = time.perf_counter() - begin
        if name == "value":
            flagged = float(jnp.mean(jnp.isnan(found)))
    again = {name: partial(run, x) for name, run in runs.items()}
    taken = firsts if plants > MANY else least(again, rounds=1 if plants == MANY else 5)
    row = Row(what, number, *firsts.values(), *(taken[name] / plants for name in runs), flagged)
    print(row, flush=True)
    return row


def slope(rows: list[Row], of: str) -> float:
    """By what power of the number the whole cost grows over its upper half."""
    upper = rows[len(rows) // 2 - 1 :]
    numbers = np.array([row.number for row in upper], float)
    costs = np.array([getattr(row, of) * (row.number if row.what == "plants" else 1) for row in upper])
    return float(np.polyfit(np.log(numbers), np.log(costs), 1)[0])


def draw(groups: dict[str, list[Row]], path: Path) -> None:
    """Times against numbers, one panel for each thing that grows, on logarithmic axes."""
    with style.using():
        figure, axes = plt.subplots(1, len(groups), figsize=(2 * style.WIDTH, 2.2))
        for ax, (what, rows) in zip(axes, groups.items(), strict=True):
            numbers = [row.number for row in rows]
            for of, look in zip(
                ("value", "gradient"), (dict(marker="o"), dict(marker="s", linestyle="--")), strict=True
            ):
                scale = np.array(numbers) if what == "plants" else PLANTS
                costs = np.array([getattr(row, of) for row in rows]) * scale
                ax.loglog(numbers, costs, markersize=3, label=of, color=style.COLOURS[of == "gradient"], **look)
            ax.set_title(f"slopes {slope(rows, 'value'):.2f}, {slope(rows, 'gradient'):.2f}")
            ax.set_xlabel(what if what == "plants" else f"{what} ({PLANTS:,} plants)")
            if numbers[-1] < 100:
                ax.set_xticks(numbers, map(str, numbers))
                ax.xaxis.set_minor_locator(ticker.NullLocator())
                style.plain_decades(ax.yaxis, 10.0)
        axes[0].set_ylabel("time of all plants (s)")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    write([measure(*case) for case in cases()])


def write(rows: list[Row]) -> None:
    groups = {what: [row for row in rows if row.what == what] for what in dict.fromkeys(row.what for row in rows)}
    cells = [
        [row.what, f"{row.number:,}", f"{row.first:.1f}", f"{row.first_gradient:.1f}", f"{1e6 * row.value:.3g}",
         f"{1e6 * row.gradient:.3g}", f"{row.gradient / row.value:.1f}", f"{row.flagged:.1%}"]
        for row in rows
    ]  # fmt: skip
    head = (
        *("what grows", "number", "first value (s)", "first gradient (s)"),
        *("value (µs a plant)", "gradient (µs a plant)", "gradient over value", "flagged"),
    )
    slopes = {what: {of: slope(some, of) for of in ("value", "gradient")} for what, some in groups.items()}
    said = ", ".join(f"{what} {two['value']:.2f} and {two['gradient']:.2f}" for what, two in slopes.items())
    on = about(f"all cores of {processor()}", "jax", "numpy")
    keep(
        __file__,
        dict(about=on, rows=[row._asdict() for row in rows], slopes=slopes),
        [
            "# How cost grows", "", "`python -m experiments.benchmarks.growth`", "",
            "Slopes of value and gradient over the upper half (the power of the number that the whole cost grows by): "
            f"{said}.",
            "", "![Times against numbers](growth.svg)", "", *markdown.table(head, cells),
        ],
    )  # fmt: skip
    draw(groups, Path(__file__).with_suffix(".svg"))


if __name__ == "__main__":
    main()
