"""Simulation-based calibration of the intervals of ``js.identify``: do 95 % of them hold the truth?

    python -m experiments.reliability.intervals --draws 1000 --seed 0      # writes intervals.md and .svg; 10 minutes

Machines and records are drawn at random from a stated prior and identified with nothing known but the record. Every
draw has random numbers of its own, and what is finished is kept in a file, so that the same command goes on where it
was interrupted. An interval is right if the truth lies in it as often as it says, and the truth's rank in the
distribution that the interval stands for is even.

Source: Talts et al. (2018), arXiv:1804.06788, ranks; Cook, Gelman and Rubin, J. Comput. Graph. Stat. 15 (2006).
"""

import experiments.benchmarks.one_thread  # noqa: F401  # isort: skip

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter, welch
from scipy.stats import chisquare

import jshape as js
from experiments import markdown
from experiments.papers import frame

LEVELS = (0.8, 0.6, 0.4, 0.2)
"""Intervals whose ends, with the estimate itself, part the distribution into ten parts of equal probability."""

KEPT = "file of finished draws; another one, or none, after the identification was changed"

OUTCOMES = ("right", "fewer modes", "more modes", "refused", "did not converge")
"""What becomes of a draw; only of those that are right can intervals be compared with the truth."""


class Machine(NamedTuple):
    """One or two modes.

    Attributes:
        omega: undamped natural frequencies, rad/s, ascending.
        zeta: damping ratios.
        residues: complex amplitudes.
    """

    omega: np.ndarray
    zeta: np.ndarray
    residues: np.ndarray

    @property
    def poles(self) -> np.ndarray:
        """1/s."""
        return self.omega * (-self.zeta + 1j * np.sqrt(1 - self.zeta**2))


def machine(random: np.random.Generator, least: float = 0.002) -> Machine:
    count = int(random.integers(1, 3))
    hertz = logarithmic(random, 1, 20) * np.cumprod([1.0, random.uniform(1.5, 4)][:count])
    zeta = np.array([logarithmic(random, least, 0.1) for _ in range(count)])
    sizes = np.array([logarithmic(random, 1, 5) for _ in range(count)])
    return Machine(2 * np.pi * hertz, zeta, sizes * np.exp(1j * random.uniform(-np.pi, np.pi, count)))


def logarithmic(random: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def ring_down(random: np.random.Generator, memory: float = 0.0) -> tuple[Machine, np.ndarray, np.ndarray]:
    """Free vibration; ``memory``: the noise's correlation from one sample to the next."""
    drawn = machine(random)
    step = 2 * np.pi / drawn.omega[-1] / random.uniform(4, 20)
    times = np.arange(0, logarithmic(random, 8, 60) * 2 * np.pi / drawn.omega[0], step)
    size = logarithmic(random, 0.003, 0.1) * np.sqrt(np.sum(np.abs(drawn.residues) ** 2) / 2)
    noise = coloured(random, len(times), memory)
    values = np.real(np.exp(np.outer(times, drawn.poles)) @ drawn.residues)
    return drawn, times, values + random.uniform(-3, 3) + size * noise


def coloured(random: np.random.Generator, count: int, memory: float) -> np.ndarray:
    """Stationary noise of first order and standard deviation 1."""
    kicks = np.sqrt(1 - memory**2) * random.standard_normal(count)
    kicks[0] /= np.sqrt(1 - memory**2)
    return np.asarray(lfilter([1.0], [1.0, -memory], kicks))


def ring_down_in_coloured_noise(random: np.random.Generator) -> tuple[Machine, np.ndarray, np.ndarray]:
    return ring_down(random, random.uniform(0.3, 0.95))


def frequency_response(random: np.random.Generator) -> tuple[Machine, np.ndarray, np.ndarray]:
    drawn = machine(random, 0.005)
    count, size = int(random.integers(150, 601)), logarithmic(random, 0.003, 0.1)
    axis = np.linspace(random.uniform(0.2, 0.6) * drawn.omega[0], random.uniform(1.4, 2.0) * drawn.omega[-1], count)
    parts = [drawn.residues / (1j * axis[:, None] - drawn.poles) / 2]
    parts += [drawn.residues.conj() / (1j * axis[:, None] - drawn.poles.conj()) / 2]
    values = np.sum(parts[0] + parts[1], axis=1)
    noise = size * np.max(np.abs(values)) * (random.standard_normal((count, 2)) @ [1.0, 1j]) / np.sqrt(2)
    return drawn, axis, values + noise


def power_spectrum(random: np.random.Generator) -> tuple[Machine, np.ndarray, np.ndarray]:
    """Welch's estimate of what white noise shakes, after ten times as fine a simulation."""
    drawn = machine(random, 0.005)
    rate = 20 * drawn.omega[-1] / 2 / np.pi
    width = np.min(2 * drawn.zeta * drawn.omega) / 2 / np.pi
    each = int(rate * logarithmic(random, 4, 20) / width)
    shaken = random.standard_normal(each * int(random.integers(10, 51)))
    values = np.zeros(len(shaken))
    for pole, size in zip(np.exp(drawn.poles / rate), np.abs(drawn.residues), strict=True):
        values += size * lfilter([0.0, pole.imag], [1.0, -2 * pole.real, abs(pole) ** 2], shaken)
    hertz, density = welch(values, rate, nperseg=each)
    axis = 2 * np.pi * hertz
    kept = (axis > 0.3 * drawn.omega[0]) & (axis < 1.6 * drawn.omega[-1])
    return drawn, axis[kept], density[kept]


class Kind(NamedTuple):
    """One row of the table.

    Attributes:
        draw: a machine and its record from the prior.
        record: what ``js.identify`` takes it for.
        given: whether the number of modes is known.
        prior: in words.
    """

    draw: Callable[[np.random.Generator], tuple[Machine, np.ndarray, np.ndarray]]
    record: str
    given: bool
    prior: str


RECORD = (
    "record of 8 to 60 periods of the lowest mode (logarithm uniform), 4 to 20 samples a period of the highest; noise "
    "of 0.3 to 10 % of the modes' root mean square at the beginning (logarithm uniform)"
)
COLOURED = f"{RECORD}, of first order: correlation from sample to sample 0.3 to 0.95"

KINDS: dict[str, Kind] = {
    "ring-down, white noise": Kind(ring_down, "ring-down", False, RECORD),
    "ring-down, coloured noise, number of modes given": Kind(
        ring_down_in_coloured_noise, "ring-down", True, COLOURED
    ),
    "ring-down, coloured noise": Kind(
        ring_down_in_coloured_noise, "ring-down", False, COLOURED
    ),
    "frequency response": Kind(
        frequency_response, "spectrum", False,
        "150 to 600 frequencies from 0.2–0.6 of the lowest mode to 1.4–2 of the highest; white complex noise of 0.3 to "
        "10 % of the highest peak (logarithm uniform)",
    ),
    "power spectrum": Kind(
        power_spectrum, "spectrum", False,
        "white noise shakes the modes, Welch's method with Hann's window: as long as 10 to 50 segments that overlap by "
        "half, the narrowest peak 4 to 20 frequency steps wide (logarithm uniform), from 0.3 of the lowest mode to 1.6 "
        "of the highest",
    ),
}  # fmt: skip

MACHINES = (
    "Every machine has one or two modes with equal chance: the first from 1 to 20 Hz, the second 1.5 to 4 times as "
    "high; damping ratios from 0.002 (spectra: 0.005) to 0.1 and amplitudes within a factor of 5, each with a uniform "
    "logarithm; phases uniform."
)

NOTES = (
    "A draw is right if as many modes were found as there are and the fit converged; only then can intervals be "
    "compared with the truth. The others are counted by what became of them (refused: `js.identify` raised an error), "
    "and in the column *of all modes* theirs are intervals that do not hold the truth. The number of modes is unknown "
    "unless the row says otherwise. ± is the binomial standard error of as many intervals at 95 %. Ranks: how many "
    "truths lie in each tenth of the distribution (Student's t) that the interval stands for; p: of Pearson's "
    "chi-squared test that all tenths are equally frequent.",
    "",
    "![Ranks over what is even; the band is twice the standard error of a bin.](intervals.svg)",
)


def attempt(kind: Kind, random: np.random.Generator) -> dict[str, Any]:
    """One draw: what became of it and, where that is right, each mode's place among ten, for ω and for ζ."""
    drawn, axis, values = kind.draw(random)
    count = len(drawn.omega)
    try:
        found = js.identify(axis, values, kind=kind.record, modes=count if kind.given else None)
    except ValueError:
        return {"outcome": "refused", "modes": count}
    if len(found.omega) != count:
        return {"outcome": "fewer modes" if len(found.omega) < count else "more modes", "modes": count}
    if not found.converged:
        return {"outcome": "did not converge", "modes": count}
    ends = [found.interval(level) for level in LEVELS]
    holds, places = [], []
    for i, (truth, middle) in enumerate([(drawn.omega, found.omega), (drawn.zeta, found.zeta)]):
        low, high = found.interval()[i]
        holds.append([bool(held) for held in (low <= truth) & (truth <= high)])
        edges = np.array([*(end[i] for end in ends)])
        places.append((np.sum(truth > edges, axis=(0, 1)) + (truth > middle)).tolist())
    return {"outcome": "right", "modes": count, "holds": holds, "places": places}


def sample(draws: int, seed: int, store: Path) -> dict[str, list[dict[str, Any]]]:
    """All draws of every kind; those in ``store`` are not made again."""
    finished = {}
    if store.exists():
        for line in store.read_text(encoding="utf-8").splitlines():
            # The last line may have been cut short.
            if line.endswith("}"):
                one = json.loads(line)
                finished[one["kind"], one["seed"], one["draw"]] = one
    store.parent.mkdir(parents=True, exist_ok=True)
    wanted = [(name, seed, i) for name in KINDS for i in range(draws)]
    missing = [key for key in wanted if key not in finished]
    begin = shown = time.monotonic()
    with store.open("a", encoding="utf-8") as file:
        for done, (name, _, i) in enumerate(missing, 1):
            found = attempt(KINDS[name], np.random.default_rng([seed, list(KINDS).index(name), i]))
            finished[name, seed, i] = {"kind": name, "seed": seed, "draw": i, **found}
            file.write("\n" + json.dumps(finished[name, seed, i]))
            if time.monotonic() - shown > 5 or done == len(missing):
                shown = time.monotonic()
                file.flush()
                left = (shown - begin) / done * (len(missing) - done)
                print(f"{name}: {done / len(missing):.1%} done, about {left:.0f} s left", flush=True)
    return {name: [finished[key] for key in wanted if key[0] == name] for name in KINDS}


def rows(found: dict[str, list[dict[str, Any]]]) -> tuple[list[list[object]], dict[str, np.ndarray]]:
    """The table's rows, and the histograms of ω and ζ by their names."""
    lines, histograms = [], {}
    for name, draws in found.items():
        right = [draw for draw in draws if draw["outcome"] == "right"]
        intervals, modes = sum(draw["modes"] for draw in right), sum(draw["modes"] for draw in draws)
        counts = [sum(draw["outcome"] == outcome for draw in draws) for outcome in OUTCOMES]
        for i, what in enumerate(("frequency", "damping ratio")):
            held = sum(sum(draw["holds"][i]) for draw in right)
            share = held / intervals if intervals else np.nan
            error = np.sqrt(0.95 * 0.05 / intervals) if intervals else np.nan
            bins = np.bincount([place for draw in right for place in draw["places"][i]], minlength=10)
            histograms[f"{name}: {what}"] = bins
            p_value = chisquare(bins).pvalue if intervals else np.nan
            lines.append([
                name, what, len(draws), *counts, intervals, f"{100 * share:.1f} ± {100 * error:.1f} %",
                f"{100 * held / modes:.1f} %", " ".join(map(str, bins)), f"{p_value:.2g}",
            ])  # fmt: skip
    return lines, histograms


def picture(histograms: dict[str, np.ndarray], path: Path) -> None:
    """Every kind's histograms over what is even, with twice the standard error of a tenth."""
    figure, axes = frame.figure(len(KINDS), 1, height=1.5, sharex=True, sharey=True)
    for axis, kind in zip(axes[:, 0], KINDS, strict=True):
        bins = {what: histograms[f"{kind}: {what}"] for what in ("frequency", "damping ratio")}
        edges = np.repeat(np.linspace(0, 1, 11), 2)[1:-1]
        frame.draw(axis, {what: (edges, np.repeat(10 * n / max(np.sum(n), 1), 2)) for what, n in bins.items()}, kind)
        error = np.sqrt(9 / max(np.sum(bins["frequency"]), 1))
        axis.axhspan(1 - 2 * error, 1 + 2 * error, color="0.5", alpha=0.3)
    for axis in axes[1:, 0]:
        axis.get_legend().remove()
    axes[0, 0].set(ylim=(0, 2), xticks=(0, 0.5, 1))
    axes[-1, 0].set_xlabel("rank of the truth in its distribution")
    figure.supylabel("share of the modes over what is even", fontsize=8)
    figure.savefig(path, metadata={"Date": None})
    frame.small(path, frame.LARGEST_SVG)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--store", type=Path, default=Path("out/intervals.jsonl"), help=KEPT)
    given = parser.parse_args()
    table, histograms = rows(sample(given.draws, given.seed, given.store))
    picture(histograms, Path(__file__).with_suffix(".svg"))
    head = [
        "record", "of", "draws", *OUTCOMES, "intervals", "hold the truth", "of all modes",
        "ranks in tenths", "flat: p",
    ]  # fmt: skip
    lines = [
        MACHINES,
        "",
        *(f"- {name}: {kind.prior}." for name, kind in KINDS.items()),
        "",
        *NOTES,
        "",
        *markdown.table(head, table),
    ]
    command = f"python -m experiments.reliability.intervals --draws {given.draws} --seed {given.seed}"
    markdown.write_beside(__file__, "Intervals of identified modes", command, lines)


if __name__ == "__main__":
    main()
