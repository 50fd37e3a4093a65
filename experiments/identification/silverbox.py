"""A twin of the Silverbox, the electronic Duffing oscillator of the identification benchmarks, with made-up data.

μ y″ + d y′ + κ1 y + κ3 y³ = u (V), sampled at 610.35 Hz, with noise of 0.25 mV. Four parameters are fitted to a random
multisine by ``js.identify_duffing`` and simulated in free run on another multisine and on a noise whose amplitude
grows, from inputs alone. The measured data carry no licence and are not used; the parameters are made up, of the
circuit's size. Run: python -m experiments.identification.silverbox

Source: the equation is that of Wigren and Schoukens (2013), three free data sets.
"""

from pathlib import Path

import jax
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

import jshape as js
from experiments.markdown import table

TRUE = {"mass": 1.09e-5, "c": 2.13e-4, "k1": 1.0, "k3": 3.55}
"""μ (s²), d (s), κ1, κ3 (1/V²) under the names of a mass on a spring."""

RATE, NOISE, SAMPLES, FINER = 610.35, 0.25e-3, 1024, 8
"""Samples a second; standard deviation, V; in a record; steps of the interpolation between samples."""


def multisine(seed: int) -> np.ndarray:
    """A random-phase multisine up to 200 Hz, standard deviation 67 mV."""
    lines = np.arange(1, int(200 / RATE * SAMPLES))
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    values = np.cos(2 * np.pi * np.outer(np.arange(SAMPLES), lines) / SAMPLES + phases).sum(axis=1)
    return 0.067 * values / values.std()


def growing(seed: int) -> np.ndarray:
    """Noise below 200 Hz whose amplitude grows evenly, to a standard deviation of 90 mV at its end."""
    values = np.random.default_rng(seed).normal(size=SAMPLES)
    values = np.asarray(sosfiltfilt(butter(6, 200, fs=RATE, output="sos"), values))
    return 0.09 * np.linspace(0, 1, SAMPLES) * values / values.std()


def response(parameters: dict[str, float], voltage: np.ndarray) -> np.ndarray:
    """The circuit's answer at the samples, V, from rest; the input is a spline between samples."""
    times, (m, c, k1, k3) = np.arange(SAMPLES) / RATE, (parameters[name] for name in TRUE)
    inputs = CubicSpline(times, voltage)
    field = lambda t, y: [y[1], (inputs(t) - c * y[1] - k1 * y[0] - k3 * y[0] ** 3) / m]
    run = solve_ivp(field, (0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-11)
    return run.y[0]


def results(seed: int = 0) -> dict[str, float]:
    """Fitted over true parameters, and the free-run errors (mV, root of the mean square) without the noise."""
    voltage, random = multisine(seed), np.random.default_rng(seed + 1)
    times = np.arange(SAMPLES) / RATE
    measured = response(TRUE, voltage) + NOISE * random.normal(size=SAMPLES)
    # identify_duffing takes inputs as straight lines between rows: rows are made closer.
    fine = np.linspace(0, times[-1], FINER * (SAMPLES - 1) + 1)
    found = js.identify_duffing(
        fine, CubicSpline(times, measured)(fine), mass=1e-5, inputs=CubicSpline(times, voltage)(fine), drive="force"
    )
    assert found.converged, found.message
    ratios = {f"{name} over true": found.parameters[name] / TRUE[name] for name in TRUE}
    tests = {"multisine": multisine(seed + 2), "growing noise": growing(seed + 3)}
    return ratios | {
        f"free run, {name} (mV)": 1e3 * float(np.std(response(found.parameters, u) - response(TRUE, u)))
        for name, u in tests.items()
    }


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    rows = [[name, f"{value:.5f}" if "over" in name else f"{value:.3f}"] for name, value in results().items()]
    lines = ["# The Silverbox's twin", "", (__doc__ or "").strip(), "", *table(["number", "value"], rows)]
    Path(__file__).with_suffix(".md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
