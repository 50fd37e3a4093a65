"""A raw accelerometer record of a printer that does not exist, as Klipper writes one, for the tests and the README.

Two modes are shaken by a sweep whose acceleration grows with its frequency, as Klipper's test does, and measured with
noise. Run: python -m experiments.calibration.record OUT.csv [SCALE]; SCALE multiplies both frequencies (a loaded bed).
"""

import sys
from pathlib import Path

import numpy as np
from scipy.signal import bilinear, lfilter

MODES = ((61.0, 0.06, 1.0), (93.0, 0.05, 0.45))
"""Hz, damping ratio, and the part of the shaking that goes through the mode."""

RATE, DURATION, SWEEP, PER_HZ, NOISE = 800.0, 2.4, (5.0, 150.0), 60.0, 120.0
"""Samples a second, s, Hz from and to, mm/s² for each Hz of the sweep, standard deviation of the noise in mm/s²."""


def record(scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and accelerations (mm/s², samples × 3) of the shaken tool; ``scale`` multiplies the frequencies."""
    times = np.arange(round(RATE * DURATION)) / RATE
    first, last = SWEEP
    frequency = first + (last - first) * times / DURATION
    phase = 2 * np.pi * (first * times + (last - first) * times**2 / (2 * DURATION))
    shaken = PER_HZ * frequency * np.sin(phase)
    measured = NOISE * np.random.default_rng(0).standard_normal((len(times), 3))
    for hertz, zeta, part in MODES:
        omega = 2 * np.pi * hertz * scale
        # From the base's acceleration to the tool's, through spring and damper.
        through, against = bilinear([2 * zeta * omega, omega**2], [1.0, 2 * zeta * omega, omega**2], RATE)
        measured[:, 0] += part * np.asarray(lfilter(through, against, shaken))
    return times, measured


def main(path: str, scale: float = 1.0) -> None:
    times, measured = record(scale)
    rows = [f"{t:.6f},{x:.1f},{y:.1f},{z:.1f}" for t, (x, y, z) in zip(times, measured, strict=True)]
    Path(path).write_text("\n".join(["#time,accel_x,accel_y,accel_z", *rows]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:3]))
