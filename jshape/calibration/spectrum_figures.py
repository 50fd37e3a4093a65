"""The figures that printer owners expect: spectrum, spectrum behind each shaper, V(f), step response."""

from collections.abc import Iterator, Sequence

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from jshape.calibration.modes import Mode, step_response
from jshape.calibration.score import Rated, vibration
from jshape.calibration.spectrum import Spectrum
from jshape.reports.plot import STYLE, WIDTH, labelled_lines


def figures(
    spectra: Sequence[Spectrum], modes: Sequence[Mode], shapers: Sequence[Rated], zeta: float, ceiling: float
) -> Iterator[tuple[str, Figure]]:
    """Each figure by its name, one at a time. ``zeta``: for V(f); ``ceiling``: Hz, where the frequencies end."""
    yield "spectrum", spectrum(spectra, modes, ceiling)
    yield "after", after(spectra[0], shapers, zeta, ceiling)
    yield "vibration", residual(shapers, zeta, ceiling)
    yield "step", step(modes, shapers)


def spectrum(spectra: Sequence[Spectrum], modes: Sequence[Mode], ceiling: float) -> Figure:
    """The normalised density of each spectrum over its greatest, and the modes as ticks above."""
    with mpl.rc_context(STYLE):
        figure, axis = _axes(ceiling)
        labelled_lines(figure, axis, [(s.name, s.frequencies, s.density / s.density.max()) for s in spectra])
        for mode in modes:
            words = f"{mode.frequency:.0f}"
            axis.annotate(words, (mode.frequency, 1), xycoords=("data", "axes fraction"), fontsize=6, ha="center")
        axis.set_ylabel("power density over its greatest")
    return figure


def after(measured: Spectrum, shapers: Sequence[Rated], zeta: float, ceiling: float) -> Figure:
    """The density, and what each shaper leaves of it, logarithmic, with the level under which nothing counts."""
    f, p = measured.frequencies, measured.density / measured.density.max()
    with mpl.rc_context(STYLE):
        figure, axis = _axes(ceiling)
        curves = [("unshaped", f, p)]
        curves += [(r.name, f, p * vibration(r.amplitudes, r.times, f, zeta)) for r in shapers]
        labelled_lines(figure, axis, curves)
        axis.axhline(1 / 20, color="0.5", linewidth=0.6)
        axis.set_yscale("log")
        axis.set_ylim(1e-4, 1.5)
        axis.set_ylabel("power density over the greatest")
    return figure


def residual(shapers: Sequence[Rated], zeta: float, ceiling: float) -> Figure:
    """V(f) of each shaper, %."""
    f = np.linspace(1, ceiling, 800)
    with mpl.rc_context(STYLE):
        figure, axis = _axes(ceiling)
        labelled_lines(figure, axis, [(r.name, f, 100 * vibration(r.amplitudes, r.times, f, zeta)) for r in shapers])
        axis.set_ylim(0, 100)
        axis.set_ylabel(f"residual vibration (%), ζ = {zeta:g}")
    return figure


def step(modes: Sequence[Mode], shapers: Sequence[Rated]) -> Figure:
    """The tool after a step of 1, by the identified modes, behind each shaper."""
    slowest = 1 / min(mode.frequency for mode in modes)
    t = np.linspace(0, max(r.duration for r in shapers) + 2 * slowest, 800)
    with mpl.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(WIDTH, 2.6))
        curves = [("unshaped", 1e3 * t, step_response([1.0], [0.0], modes, t))]
        curves += [(r.name, 1e3 * t, step_response(r.amplitudes, r.times, modes, t)) for r in shapers]
        labelled_lines(figure, axis, curves)
        axis.set_xlabel("time (ms)")
        axis.set_ylabel("position over the step")
    return figure


def _axes(ceiling: float):
    figure, axis = plt.subplots(figsize=(WIDTH, 2.6))
    axis.set_xlabel("frequency (Hz)")
    axis.set_xlim(0, ceiling)
    return figure, axis
