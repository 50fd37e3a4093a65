"""The Silverbox, an electronic Duffing oscillator: four parameters from a record, free runs, and the circuit's shaper.

μ y″ + d y′ + κ1 y + κ3 y³ = u (V), sampled at 610.35 Hz. ``js.identify_duffing`` fits the four to a random multisine;
free runs, from inputs alone, are then compared with another multisine and with a noise whose amplitude grows, by a
Runge–Kutta method of this script's own. The measured data carry no licence and are not kept here; with `--measured`
they are fetched by ``nonlinear_benchmarks`` (PyPI) in its splits. Otherwise a twin is made: the same equation and
lengths, made-up parameters of the circuit's size, white noise of 0.25 mV.

Run: python -m experiments.identification.silverbox [--measured]

Source: Wigren and Schoukens (2013), three free data sets for development and benchmarking.
"""

import sys
from typing import NamedTuple

import jax
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

import jshape as js
from experiments.identification.record import Record, write

TRUE = {"mass": 1.09e-5, "c": 2.13e-4, "k1": 1.0, "k3": 3.55}
"""μ (s²), d (s), κ1, κ3 (1/V²) under the names of a mass on a spring."""

RATE, NOISE, BEGIN, FINER = 610.35, 0.25e-3, 50, 8
"""Samples a second; standard deviation, V; samples of a test from which it may begin; steps of the simulation."""

LENGTHS = (65062, 21688, 40475)
"""Samples: of the multisine for training, of that for the test, and of the growing noise."""


class Circuit(NamedTuple):
    """What a record is simulated with.

    Attributes:
        parameters: under the names of ``TRUE``.
        voltage: the input at the samples, V.
    """

    parameters: dict[str, float]
    voltage: np.ndarray

    def run(self, start: np.ndarray | tuple[float, float] = (0.0, 0.0), samples: int | None = None) -> np.ndarray:
        """The circuit's answer at the samples, V, by Runge and Kutta's method; the input is a spline between them."""
        count = len(self.voltage) if samples is None else samples
        step = 1 / (RATE * FINER)
        fine = CubicSpline(np.arange(len(self.voltage)) / RATE, self.voltage)
        inputs = fine(0.5 * step * np.arange(2 * FINER * (count - 1) + 1)).tolist()
        mass, c, k1, k3 = (self.parameters[name] for name in TRUE)

        def force(u, y, v):
            return (u - c * v - (k1 + k3 * y * y) * y) / mass

        (y, v), found = map(float, start), [float(start[0])]
        for i in range(FINER * (count - 1)):
            begin, middle, end = inputs[2 * i : 2 * i + 3]
            a1, v2 = force(begin, y, v), v + step / 2 * force(begin, y, v)
            a2, v3 = force(middle, y + step / 2 * v, v2), v + step / 2 * force(middle, y + step / 2 * v, v2)
            a3 = force(middle, y + step / 2 * v2, v3)
            v4 = v + step * a3
            a4 = force(end, y + step * v3, v4)
            y, v = y + step / 6 * (v + 2 * v2 + 2 * v3 + v4), v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            if (i + 1) % FINER == 0:
                found.append(y)
        return np.array(found)

    def error(self, measured: np.ndarray) -> float:
        """Of a free run, the root of the mean square beyond the first samples, V, which place its beginning alone."""
        scale = np.array([1.0, np.sqrt(self.parameters["k1"] / self.parameters["mass"])])
        first = least_squares(lambda z: self.run(scale * z, BEGIN) - measured[:BEGIN], [measured[0], 0.0]).x
        return float(np.sqrt(np.mean((self.run(scale * first) - measured)[BEGIN:] ** 2)))


def twin(lengths: tuple[int, int, int] = LENGTHS) -> list[Record]:
    """Records of the made-up circuit: a multisine for training, one for the test, a noise that grows."""
    random, found = np.random.default_rng(0), []
    for number, count in enumerate(lengths):
        voltage = growing(count, random) if number == 2 else multisine(count, random)
        measured = Circuit(TRUE, voltage).run() + NOISE * random.normal(size=count)
        found.append(Record(np.arange(count) / RATE, voltage, measured))
    return found


def multisine(count: int, random: np.random.Generator) -> np.ndarray:
    """A random-phase multisine up to 200 Hz, periods of 8192 samples, standard deviation 67 mV."""
    period = 8192
    spectrum = np.zeros(period // 2 + 1, complex)
    lines = np.arange(1, int(200 / RATE * period))
    spectrum[lines] = np.exp(2j * np.pi * random.uniform(size=len(lines)))
    values = np.fft.irfft(spectrum, period)
    return 0.067 * np.resize(values / values.std(), count)


def growing(count: int, random: np.random.Generator) -> np.ndarray:
    """Noise below 200 Hz whose amplitude grows evenly, to a standard deviation of 90 mV at its end."""
    values = np.asarray(sosfiltfilt(butter(6, 200, fs=RATE, output="sos"), random.normal(size=count)))
    return 0.09 * np.linspace(0, 1, count) * values / values.std()


def measured() -> list[Record]:
    """The circuit's own records, in the splits of ``nonlinear_benchmarks``."""
    import nonlinear_benchmarks  # pyright: ignore[reportMissingImports]

    train, (multisine, arrow, _) = nonlinear_benchmarks.Silverbox()
    return [Record(np.arange(len(part.y)) / RATE, part.u, part.y) for part in (train, multisine, arrow)]


def results(records: list[Record], true: dict[str, float] | None = None) -> tuple[list[list[str]], js.Shaper]:
    """Rows of a table: the parameters, with the truth where it is known, and the free runs; the circuit's shaper."""
    train, *tests = records
    found = js.identify_duffing(
        train.times, train.values, mass=1e-5, inputs=train.inputs, drive="force", between="spline"
    )
    assert found.converged, found.message
    rows = []
    for name, (low, high) in found.interval().items():
        known = [f"{true[name]:.6g}", f"{found.parameters[name] / true[name] - 1:+.1e}"] if true else []
        rows.append([name, f"{found.parameters[name]:.6g}", f"{low:.6g} to {high:.6g}", *known])
    errors = [("training", found.noise)]
    for name, test in zip(("multisine", "growing noise"), tests, strict=True):
        errors.append((name, Circuit(found.parameters, test.inputs).error(test.values)))
    rows += [[f"free run, {name} (mV)", f"{1e3 * error:.3f}", *([""] * (3 if true else 1))] for name, error in errors]
    # A step of 0.1 V; three impulses that leave nothing of it, and for the circuit within 5 % of its springs.
    swing = 2 * np.pi / float(found.plant.natural_frequency())
    shaper = js.tune(found.plant, 0.1, impulses=3, duration=swing, over={"spring.k1": np.linspace(0.95, 1.05, 11)})
    plain = js.residual_energy(found.plant, js.Shaper([1.0], [0.0]), 0.1)
    left = js.residual_energy(found.plant, shaper.shaper, 0.1)
    rows.append(["energy left of a step of 0.1 V, shaped over bare", f"{float(left / plain):.2e}", *rows[-1][2:]])
    return rows, shaper.shaper


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    real = "--measured" in sys.argv
    rows, shaper = results(measured() if real else twin(), None if real else TRUE)
    write(__file__, __doc__, rows, real, f"Shaper: amplitudes {shaper.amplitudes}, times {shaper.times} s.")


if __name__ == "__main__":
    main()
