"""What the tests of the calibration share: files of Klipper's kinds, made up or measured, and a single resonance."""

from pathlib import Path

import numpy as np

from jshape.calibration.spectrum import Spectrum

MEASURED = Path(__file__).parents[2] / "shared" / "data" / "klipper" / "resonances_x.csv"
"""A real printer's spectrum, where it lies beside the repository."""

RECORD = Path(__file__).parents[1] / "experiments" / "calibration" / "raw_data_x_simulated.csv"
"""The simulated printer's raw record that comes with the repository."""


def resonance(frequencies, centre, zeta=0.05):
    ratio = np.asarray(frequencies) / centre
    return 1 / ((1 - ratio**2) ** 2 + (2 * zeta * ratio) ** 2)


def printer(*centres: float, name: str = "made up") -> Spectrum:
    """A normalised spectrum with a resonance at each frequency (Hz)."""
    f = np.arange(0, 201, 1.6)
    return Spectrum(name, f, np.sum([resonance(f, centre) for centre in centres], axis=0))


def spectrum_text(rows: int = 125, normalised: bool = False) -> str:
    """A spectrum as Klipper writes it, peaks at 55 and 90 Hz."""
    f = np.round(1.6 * np.arange(rows), 1)
    x = 1e3 * (f + 1) * (resonance(f, 55.0) + 0.3 * resonance(f, 90.0)) / 100
    columns = np.stack([f, x, x / 7, x / 5, x + x / 7 + x / 5], axis=1)
    header = "freq,psd_x,psd_y,psd_z,psd_xyz" + (",shapers:,mzv(55.0)" if normalised else "")
    tail = ",,0.250" if normalised else ""
    return "\n".join([header, *(f"{r[0]:.1f}," + ",".join(f"{v:.3e}" for v in r[1:]) + tail for r in columns)]) + "\n"


def sets_text(normalised: bool = False) -> str:
    """Two sets in one file, one of them named with a comma."""
    f = np.round(1.6 * np.arange(125), 1)
    one, two = 1e4 * resonance(f, 50.0), 1e4 * resonance(f, 62.0)
    header = 'freq,"empty, cold",loaded' + (",shapers:,zv(50.0)" if normalised else "")
    tail = ",,0.5" if normalised else ""
    return "\n".join([header, *(f"{a},{b:.3e},{c:.3e}{tail}" for a, b, c in zip(f, one, two, strict=True))]) + "\n"


def record_text(samples: int = 300, rate: float = 400.0) -> str:
    """A raw record: two decaying sines."""
    t = np.arange(samples) / rate
    x = 900 * np.exp(-3 * t) * np.sin(2 * np.pi * 47 * t)
    y = 400 * np.exp(-2 * t) * np.sin(2 * np.pi * 71 * t)
    rows = (f"{a:.6f},{b:.3f},{c:.3f},{9810 + 20 * b / 900:.3f}" for a, b, c in zip(t, x, y, strict=True))
    return "\n".join(["#time,accel_x,accel_y,accel_z", *rows]) + "\n"
