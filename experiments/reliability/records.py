"""Small files, to be damaged: measured records, a shaper, a trajectory."""

import numpy as np

SHAPER = '{"format": "jshape-shaper", "version": 1, "amplitudes": [0.5, 0.5], "times": [0.0, 0.5]}'

MOVES = "\n".join(["t [s],a [rad]", *(f"{0.01 * i:.2f},{1 - np.cos(i * np.pi / 30):.6g}" for i in range(31)), ""])
"""A trajectory."""


def vibration(random: np.random.Generator) -> str:
    """A measured vibration as a CSV file, with one of several separators and headers."""
    time, separator = np.arange(120) * 0.01, ",;\t"[random.integers(3)]
    values = np.exp(-0.4 * time) * np.cos(20 * time) + 1e-3 * random.standard_normal(120)
    head = [["time", "x"], ["t [ms]", "Weg"], ["1", "2"]][random.integers(3)]
    rows = [separator.join(head), *(f"{t:.6g}{separator}{x:.6g}" for t, x in zip(time, values, strict=True))]
    return "\n".join(rows) + "\n"


def accelerations() -> list[str]:
    """The lines of a printer's record of its accelerometer."""
    time = np.arange(300) / 500
    waves = np.sin(np.outer(time, [200.0, 260.0, 310.0])) * 1e3
    rows = [",".join(f"{value:.6g}" for value in (t, *row)) for t, row in zip(time, waves, strict=True)]
    return ["#time,accel_x,accel_y,accel_z", *rows]
