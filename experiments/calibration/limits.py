"""What stock Klipper's own shapers can do at most for a measured printer: a scan of all of them.

Every shaper is brought to a given smoothing by its frequency, so that of each family remain its parameter and the
damping ratio: all mzv(n, t) with n from 3 to 10, all ei(v_tol), ZV, ZVD and the humps, for damping ratios up to the
greatest at which they are judged. For each smoothing the least vibration of all stands in the table, by formulas of
its own, beside what ``jshape.calibration.tune_firmware`` finds by its gradients. Greater damping ratios are left out:
with ζ 0.92, at 9.9 Hz, the measure says 0 % of an MZV that smooths 10 % less, but all but a thousandth of it is its
first impulse, so that nothing is shaped; the measure's own decay is mistaken for a zero.

Run: python -m experiments.calibration.limits [SPECTRUM.csv]; 2 minutes of processor time
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.markdown import table
from jshape import calibration, klipper

MEASURED = Path(__file__).parents[3] / "shared" / "data" / "klipper" / "resonances_x.csv"
"""A real printer's spectrum, where it lies beside the repository."""

ZETAS = (0.075, 0.1, 0.15)
"""At which Klipper judges."""

LESS = (0.0, 0.04, 0.07, 0.075, 0.08, 0.085, 0.09, 0.1, 0.12)
"""Shares by which smoothing is less than the plain MZV's."""


class Best(NamedTuple):
    """The shaper with the least vibration.

    Attributes:
        vibration: by Klipper's measure, a fraction.
        name: with its parameter.
        zeta: damping ratio for which it is made.
        frequency: Hz.
    """

    vibration: float
    name: str
    zeta: float
    frequency: float


class Spectrum(NamedTuple):
    """The frequencies (Hz) that count, and their density over the greatest."""

    frequencies: np.ndarray
    density: np.ndarray


def read(path: Path) -> Spectrum:
    (measured,) = calibration.read(path)
    inside = measured.frequencies <= 200
    density = measured.density[inside] / measured.density[inside].max()
    return Spectrum(measured.frequencies[inside][density > 1 / 20], density[density > 1 / 20])


def vibration(amplitudes: np.ndarray, times: np.ndarray, spectrum: Spectrum) -> np.ndarray:
    """Klipper's measure of many shapers of as many impulses each, shape (shapers, impulses)."""
    worst = np.zeros(len(amplitudes))
    omega, density = 2 * np.pi * spectrum.frequencies, spectrum.density
    for zeta in ZETAS:
        left = times[:, -1:] - times
        weights = amplitudes[..., None] * np.exp(-zeta * omega * left[..., None])
        phases = np.sqrt(1 - zeta**2) * omega * times[..., None]
        size = np.hypot((weights * np.cos(phases)).sum(axis=1), (weights * np.sin(phases)).sum(axis=1))
        above = np.maximum(size * density - 1 / 20, 0).sum(axis=-1) / (density - 1 / 20).sum()
        worst = np.maximum(worst, above)
    return worst


def frequencies(amplitudes: np.ndarray, periods: np.ndarray, smoothing: float) -> np.ndarray:
    """The frequency (Hz) at which each shaper smooths by so much (mm), at 5000 mm/s² and a corner speed of 5 mm/s."""
    lag = periods - (amplitudes * periods).sum(axis=1, keepdims=True)
    after = amplitudes * (lag >= 0)
    reversal = 2500 * (amplitudes * lag**2).sum(axis=1)
    corner, turn = 5 * np.sqrt(2) * (after * lag).sum(axis=1), 2500 * np.sqrt(2) * (after * lag**2).sum(axis=1)
    turned = (corner + np.sqrt(corner**2 + 4 * smoothing * turn)) / (2 * smoothing)
    return np.maximum(np.sqrt(reversal / smoothing), turned)


def shapers(step: float, ratio: float) -> Iterator[tuple[list[tuple[str, float]], np.ndarray, np.ndarray]]:
    """Names with damping ratios, amplitudes and times in undamped periods, a family at a time.

    Args:
        step: of t; a tenth of it that of v_tol.
        ratio: the step of the damping ratio.
    """
    kinds = [["zv"], ["zvd"], ["2hump_ei"], ["3hump_ei"]]
    kinds.append([f"ei(v_tol={v:.4f})" for v in np.arange(step / 10, 0.5, step / 10)])
    for n in range(3, 11):
        kinds.append([f"mzv(n={n},t={t:.4f})" for t in np.arange(0.5, min((n - 1) / 2, 3) - 1e-4, step)])
    zetas = np.round(np.arange(0, max(ZETAS) + ratio / 2, ratio), 6)
    for names in kinds:
        pairs = [(name, float(zeta)) for name in names for zeta in zetas]
        made = [klipper.impulses(name, 1.0, zeta) for name, zeta in pairs]
        yield pairs, np.array([each[0] for each in made]), np.array([each[1] for each in made])


def least(spectrum: Spectrum, smoothings: np.ndarray, step: float = 0.005, ratio: float = 0.005) -> list[Best]:
    """Of all shapers that smooth by so much (mm), the one with the least vibration, for each of several smoothings."""
    best = [Best(np.inf, "", 0.0, 0.0)] * len(smoothings)
    for pairs, amplitudes, periods in shapers(step, ratio):
        for i, smoothing in enumerate(smoothings):
            at = frequencies(amplitudes, periods, smoothing)
            times, parts = periods / at[:, None], [slice(j, j + 2000) for j in range(0, len(pairs), 2000)]
            left = np.concatenate([vibration(amplitudes[part], times[part], spectrum) for part in parts])
            j = int(left.argmin())
            best[i] = min(best[i], Best(float(left[j]), *pairs[j], float(at[j])))
    return best


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else MEASURED
    spectra = calibration.read(path)
    plain = calibration.fit("mzv", spectra)
    smoothings = plain.smoothing * (1 - np.array(LESS))
    rows = []
    for less, smoothing, best in zip(LESS, smoothings, least(read(path), smoothings), strict=True):
        tuned = calibration.tune_firmware(spectra, smoothing=float(smoothing)).rated
        name = f"`{best.name}` at {best.frequency:.2f} Hz, ζ {best.zeta:.3f}"
        cells = [f"{100 * less:.1f} %", f"{100 * best.vibration:.3f} %", name, f"{100 * tuned.vibration:.3f} %"]
        rows.append([*cells, f"`{tuned.name}` at {tuned.frequency:.2f} Hz, ζ {tuned.zeta:.3f}"])
    headings = ["less smoothing", "least vibration, scan", "by", "least vibration, gradients", "by"]
    about = f"The plain mzv at {plain.frequency:.1f} Hz leaves {100 * plain.vibration:.3f} % of {path.name}."
    lines = ["# The limit of Klipper's own shapers", "", (__doc__ or "").strip(), "", about, ""]
    text = "\n".join([*lines, *table(headings, rows)]) + "\n"
    Path(__file__).with_suffix(".md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
