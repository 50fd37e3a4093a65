"""The figures of paper_002: 7 to 11 as the simulated experiment gives them, and what explains the fixed shapers."""

from typing import Any

import numpy as np

import jshape as js
from experiments.papers import frame
from experiments.papers.frame import Picture, draw, figure
from experiments.papers.paper_002_judge import STEP, ZETAS, modes
from experiments.papers.paper_002_link import BANDS, TICK, fixed, gain, link
from jshape.adaptive.closed_loop import loop_figures as figures
from jshape.adaptive.closed_loop import report
from jshape.reports.style import COLOURS, LINES


def pictures(paper: js.Shaper, robust: js.Shaper, rounded: js.Shaper, run: report.Experiment) -> list[Picture]:
    """``robust``: jshape's fixed shaper, ``rounded``: the same on the clock of the experiment, ``run``."""
    given = run.problem.adapt
    both = {name: run.traces[name] for name in ("I", "I-D-E")}

    def spectra(surface):
        return figures.spectrogram(both, given.sample_time, given.points, given.bands, surface)

    schedule, cases = run.schedule, ("I-D-E", "I-D", "I", "state-aware")
    true = np.array([modes(float(coins)) for coins in schedule.loads])
    tip = fixed(rounded, np.asarray(schedule.reference), np.asarray(schedule.loads)[np.asarray(schedule.which)])["tip"]
    move = np.maximum(np.asarray(schedule.move), 0)
    totals = {name: run.accumulated[name] for name in cases}
    totals["jshape, fixed"] = np.bincount(move, np.abs(tip) * TICK)
    adapting = {name: run.traces[name] for name in ("I-D-E", "state-aware")}
    # The first payload's last moves.
    zoomed = figures.moves(both | {"state-aware": run.traces["state-aware"]}, schedule, TICK, run.loads()[0][2] - 3, 3)
    drawn = {
        "07": (spectra(True), "Fig. 7: DFT magnitudes in cases I and I-D-E, simulated"),
        "08": (spectra(False), "Fig. 8: the same from above"),
        "09": (
            figures.adaptation(adapting, schedule, true, TICK),
            "Fig. 9: frequencies and damping ratios in I-D-E, and those of the state-aware strategy",
        ),
        "10": (
            figures.accumulated(totals),
            "Fig. 10: accumulated vibration of each move; and with jshape's state-aware strategy and its fixed shaper, "
            "which leaves as much of both modes: the second weighs more in an acceleration",
        ),
        "11": (zoomed, "Fig. 11: the payload's angle with 20 coins, simulated"),
        "sensitivity": (_sensitivity(paper, robust), "V of the fixed shapers over both modes; shaded: 0 to 20 coins"),
        "response_function": (_response_function(), "Frequency response of the link from reference to payload"),
        "fixed": (
            _fixed(paper, robust),
            "A step of 30° with 0, 10 and 20 coins: the paper's fixed shaper (case I) and jshape's, both 0.788 s long",
        ),
    }
    return frame.pictures("002", drawn, "fixed")


def _sensitivity(paper: js.Shaper, robust: js.Shaper) -> Any:
    drawn, axes = figure(1, 2, sharey=True)
    for axis, (low, high), band, zeta in zip(axes[0], ((4, 14), (50, 105)), BANDS, ZETAS, strict=True):
        omega, shapers = np.linspace(low, high, 401), {"ZVD at 9 and 70 rad/s": paper, "jshape": robust}
        curves = {name: (omega, 100 * js.percentage_vibration(shaper, omega, zeta)) for name, shaper in shapers.items()}
        axis.axvspan(*band, color="0.5", alpha=0.12, linewidth=0)
        draw(axis, curves, xlabel="frequency (rad/s)", xlim=(low, high), ylim=(0, 100))
    axes[0, 0].set_ylabel("V (%)")
    return drawn


def _response_function() -> Any:
    drawn, axes = figure(height=2.4)
    omega = np.geomspace(2, 150, 1500)
    curves = {f"{coins:g} coins": (omega, gain(omega, coins)) for coins in (0.0, 10.0, 20.0)}
    labels = dict(xlabel="frequency (rad/s)", ylabel="$|θ_p / θ_r|$")
    draw(axes[0, 0], curves, xscale="log", yscale="log", xlim=(2, 150), **labels)
    return drawn


def _fixed(paper: js.Shaper, robust: js.Shaper) -> Any:
    drawn, axes = figure(3, height=1.5, sharex=True)
    padded = {"paper, case I": paper, "jshape": robust.pad(len(paper.times))}
    for axis, coins in zip(axes[:, 0], (0.0, 10.0, 20.0), strict=True):
        axis.axhline(30, color="0.35", linestyle=":", linewidth=0.8)
        for i, (name, shaper) in enumerate(padded.items()):
            run = js.simulate(link(coins), STEP, shaper, horizon=6.0, samples=301)
            axis.plot(run.times, np.degrees(run.payload), color=COLOURS[1 - i], linestyle=LINES[1 - i], label=name)
        axis.set_title(f"{coins:g} coins", loc="left")
        axis.set(ylabel="$θ_p$ (°)", xlim=(0, 6))
    axes[-1, 0].set_xlabel("time (s)")
    drawn.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return drawn
