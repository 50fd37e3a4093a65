"""The figures of paper_003: every one that is not a sketch, a photograph or a measurement."""

import numpy as np

import jshape as js
from experiments.papers.frame import Picture, draw, figure
from experiments.papers.paper_003_judge import WIDTH, G, L
from experiments.papers.paper_003_pendulum import BAND, DISTANCE, HERTZ, bob_at, on_off, pendulum, ride
from jshape.design import insensitive
from jshape.reports.style import COLOURS

FREQUENCY = dict(xlabel="bob position x (m)", ylabel="natural frequency (Hz)")


def pictures(paper: insensitive.Specified, place: float, top: float, bottom: float) -> list[Picture]:
    return [
        _posicast(), _sensitivity(paper), _curve(place, bottom, top), _limits(place, bottom, top), _impulses(paper),
        _delays(paper), _response(paper, place),
    ]  # fmt: skip


def _posicast() -> Picture:
    drawn, axes = figure(1, 2, sharey=True)
    plant = js.plants.ModalPlant(1.626 / np.sqrt(1 - 0.3**2), 0.3)
    shaper = js.design.linear.zv(1.626 / np.sqrt(1 - 0.3**2), 0.3)
    plain = js.simulate(plant, 1.0, horizon=10.0, samples=400)
    shaped = js.simulate(plant, 1.0, shaper, horizon=10.0, samples=400)
    curves = {"step": (plain.times, plain.payload), "posicast": (shaped.times, shaped.payload)}
    draw(axes[0, 0], {"step": curves["step"]}, "(a)", xlabel="time (s)", xlim=(0, 10), ylabel="response")
    draw(axes[0, 1], curves, "(b)", xlabel="time (s)", xlim=(0, 10))
    return Picture("paper_003_figure_02", drawn, "Fig. 2: step response and the effect of posicast.")


def _sensitivity(paper: insensitive.Specified) -> Picture:
    drawn, axes = figure(1, 2)
    ratio = np.linspace(0.6, 1.4, 401)
    delay = insensitive.solve((0.8, 1.2), duration=2 * np.pi, impulses=3).shaper
    left, right = axes[0]
    shapers = {"ZV": js.design.linear.zv(1.0), "TDF (±20 %)": delay}
    curves = {name: (ratio, 100 * js.percentage_vibration(shaper, ratio)) for name, shaper in shapers.items()}
    draw(left, curves, "(a)", xlabel="actual over modelled frequency", ylabel="residual vibration (%)")
    hertz = np.linspace(0.35, 0.8, 451)
    right.plot(hertz, 100 * np.asarray(js.percentage_vibration(paper.shaper, HERTZ * hertz)), color=COLOURS[0])
    samples = np.linspace(*BAND, 5)
    right.plot(samples / HERTZ, 100 * np.asarray(js.percentage_vibration(paper.shaper, samples)), "o", markersize=3,
               color=COLOURS[1], label="sampled")  # fmt: skip
    right.axhline(8, color="0.5", linewidth=0.6)
    right.set(ylim=(0, 40), xlabel="frequency (Hz)")
    right.legend()
    right.set_title("(b)", loc="left")
    return Picture("paper_003_figure_04", drawn, "Fig. 4: sensitivity curves; (b) is the filter of Fig. 8.", shown=True)


def _curve(place: float, bottom: float, top: float) -> Picture:
    drawn, axes = figure()
    x = np.linspace(0.05, 1.0, 300)
    axis = axes[0, 0]
    physical, simple = pendulum(0.5).frequency_curve(x) / HERTZ, np.sqrt(G / x) / HERTZ
    axis.plot([place, L], [top / HERTZ, bottom / HERTZ], "o", markersize=3, color="black")
    draw(axis, {"physical pendulum": (x, physical), "simple pendulum": (x, simple)}, ylim=(0.4, 1.6), **FREQUENCY)
    return Picture("paper_003_figure_05b", drawn, "Fig. 5(b): natural frequency against the bob's position.")


def _limits(place: float, bottom: float, top: float) -> Picture:
    drawn, axes = figure()
    x = np.linspace(0.05, 1.0, 300)
    axis = axes[0, 0]
    axis.plot(x, np.asarray(pendulum(0.5).frequency_curve(x)) / HERTZ, color=COLOURS[0])
    for hertz, words in ((0.45, "Table 1"), (0.70, None)):
        axis.axhline(hertz, color=COLOURS[1], linestyle="--", label=words)
    for omega, words in ((bottom, "Eq. 15"), (top, None)):
        axis.axhline(omega / HERTZ, color=COLOURS[2], linestyle=":", label=words)
    axis.set(ylim=(0.4, 0.8), **FREQUENCY)
    axis.legend()
    return Picture("paper_003_figure_07", drawn, "Fig. 7: limits of the range, as printed and as Eq. 15 gives them.")


def _impulses(paper: insensitive.Specified) -> Picture:
    drawn, axes = figure(height=1.8)
    axis = axes[0, 0]
    axis.stem(np.asarray(paper.shaper.times), np.asarray(paper.shaper.amplitudes), basefmt="k-")
    axis.set(xlabel="time (s)", ylabel="amplitude")
    return Picture("paper_003_figure_08", drawn, "Fig. 8: the filter's five impulses.")


def _delays(paper: insensitive.Specified) -> Picture:
    drawn, axes = figure(1, 2)
    tolerable = np.array([0.08, 0.10, 0.125, 0.15, 0.20])
    curves = {}
    for low, high in ((0.45, 0.70), (0.40, 0.75)):
        delays = [on_off((low * HERTZ, high * HERTZ), v).duration for v in tolerable]
        curves[f"{low:.2f}–{high:.2f} Hz"] = 100 * tolerable, delays
    draw(axes[0, 0], curves, "(a)", xlabel="tolerable vibration (%)", ylabel="delay of the filter (s)")
    command = paper.shaper.shape(js.Pulse(1.0, WIDTH))
    times = np.append(np.asarray(command.breaks), 5.0)
    levels = np.asarray(command.coefficients)[:, 0]
    axes[0, 1].step(times, np.append(levels, levels[-1]), where="post", color=COLOURS[0])
    axes[0, 1].set(xlabel="time (s)", ylabel="command")
    axes[0, 1].set_title("(b)", loc="left")
    return Picture("paper_003_figure_09", drawn, "Fig. 9: delay against tolerable vibration; the filtered command.")


def _response(paper: insensitive.Specified, place: float) -> Picture:
    drawn, axes = figure()
    curves, x = {}, bob_at(0.57, place)
    for name, shaper in {"SI-TD filtered": paper.shaper, "unfiltered": None}.items():
        run = js.simulate(pendulum(x), ride(DISTANCE / WIDTH), shaper, horizon=10.0, samples=500)
        curves[name] = run.times, np.degrees(run.states[:, 0])
    draw(axes[0, 0], curves, xlabel="time (s)", ylabel="deviation from the vertical (°)")
    words = "Fig. 11(a): simulated response at 0.57 Hz; 1.5 m in a pulse of 3 s is assumed, which gives its 10°."
    return Picture("paper_003_figure_11a", drawn, words)
