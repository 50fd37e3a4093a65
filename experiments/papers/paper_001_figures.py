"""The figures of paper_001."""

from typing import Any

import numpy as np
from scipy.optimize import brentq

import jshape as js
from experiments.papers import frame
from experiments.papers.frame import Picture, figure
from experiments.papers.paper_001_designs import DAMPINGS, LONGEST, MASSES, PLANT, PRESENTED, RATIOS, at
from jshape.reports.style import COLOURS, LINES


def pictures(
    found: dict[str, js.Shaper], prv: dict[str, dict[str, np.ndarray]], damped: dict[str, np.ndarray]
) -> list[Picture]:
    """Every figure but the diagrams, Figs. 2, 3 and 7."""
    family = {"α = 0.50": found["3-impulse"], "α = 1.00": found["2-impulse"], **found}

    def of(leaf, names):
        return {name: (RATIOS, prv[leaf][name]) for name in names}

    def run(name):
        return js.simulate(PLANT, 1.0, found[name].pad(LONGEST), horizon=6.0, samples=401)

    responses = {name: run(name) for name in ("linear ZVD", *PRESENTED)}
    alphas = {"α = 0.50": (RATIOS, prv["m2"]["3-impulse"])}
    alphas |= of("m2", ("α = 0.55", "α = 0.60", "α = 0.65", "α = 0.70"))
    percent = "PRV (%)"
    drawn = {
        "01": (cancellation(), "Two impulse responses that cancel (1 Hz and 10 % damping: the paper's are not given)"),
        "04": (
            profiles(family, {f"α = {a}": f"$α$ = {a}" for a in ("0.45", "0.50", "0.55", "1.00")}),
            "Energies of the three-impulse shaper by α",
        ),
        "05": (lines(alphas, "$m_{2a}/m_{2m}$", percent, ), "Residual vibration by α"),
        "06": (
            profiles(found, {f"{k + 2}-impulse": f"$k$ = {k}" for k in range(4)}),
            "Energies of the robust shapers with k = 0 … 3 rests",
        ),
        "08": (families(), "Amplitudes of the fast three-impulse shaper; the grey line is A1 = A2"),
        "09": (
            profiles(
                found,
                {
                    "A1 = 0.25": "$A_1$ = 0.25 < $A_2$",
                    "fast 3-impulse": "$A_1$ = $A_2$ = 0.3042",
                    "A1 = 0.40": "$A_1$ = 0.40 > $A_2$",
                },
            ),
            "Energies of the fast three-impulse shaper",
        ),
        "10": (
            lines({name: (r.times, r.payload) for name, r in responses.items()}, "time (s)", "$x_2$ (m)"),
            "Responses of the payload",
        ),
        "11": (
            lines(
                of("m2", PRESENTED) | {"jshape, 1.575 s": (RATIOS, prv["m2"]["tuned, at most"])},
                "$m_{2a}/m_{2m}$", percent,
            ),
            "Fig. 11 of 2025, sensitivity to the payload, with jshape's three positive impulses in 1.575 s",
        ),
        "12": (lines(of("spring.k1", PRESENTED), "$k_{1a}/k_{1m}$", percent), "Sensitivity to k1"),
        "13": (lines(of("spring.k3", PRESENTED), "$k_{3a}/k_{3m}$", percent), "Sensitivity to k3"),
        "14": (
            lines({name: (DAMPINGS, at(damped[name], 1.0, MASSES)) for name in PRESENTED}, "$c$ (N s³/m³)", percent),
            "Overshoot of the undamped shapers with a cubic damper",
        ),
    }  # fmt: skip
    return frame.pictures("001", drawn, "11")


def lines(curves: dict[str, tuple[Any, Any]], across: str, up: str, **options: Any) -> Any:
    """One panel with a line for each name."""
    drawn, axes = figure(height=2.9, **options)
    axis = axes[0, 0]
    for i, (name, (x, y)) in enumerate(curves.items()):
        heavy = name.startswith("jshape")
        colour, wide, line = ("black", 2.0, "-") if heavy else (COLOURS[i % 6], 1.0, LINES[i % len(LINES)])
        axis.plot(x, y, color=colour, linewidth=wide, linestyle=line, label=name)
    axis.set(xlabel=across, ylabel=up)
    axis.margins(x=0)
    drawn.legend(loc="outside upper center", ncols=3)
    return drawn


def profiles(found: dict[str, js.Shaper], names: dict[str, str]) -> Any:
    """Kinetic, potential and total energy over the payload's position, a panel a shaper."""
    drawn, axes = figure(len(names), height=1.5, sharex=True)
    for axis, (name, title) in zip(axes[:, 0], names.items(), strict=True):
        along = js.energy_profile(PLANT, found[name].pad(LONGEST), 1.0, points=33)
        for i in range(len(found[name].times) - 1):
            for line, (label, value) in enumerate(
                {"kinetic": along.kinetic, "potential": along.potential, "total": along.total}.items()
            ):
                axis.plot(along.position[i], value[i], COLOURS[line], linestyle=LINES[line], label=None if i else label)
        axis.set_title(title, loc="left")
        axis.set(ylabel="energy (J)", xlim=(0, 1))
        axis.set_ylim(bottom=0)
    axes[-1, 0].set_xlabel("$x_2$ (m)")
    drawn.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return drawn


def cancellation() -> Any:
    """Fig. 1: two impulses on a linear mode; the paper's frequency and damping are not printed."""
    omega, zeta = 2 * np.pi, 0.1
    zv, damped = js.design.linear.zv(omega, zeta), omega * np.sqrt(1 - zeta**2)
    times = np.linspace(0.0, 2.5, 301)
    since = [np.maximum(times - float(t), 0.0) for t in zv.times]
    each = [
        float(a) * omega / np.sqrt(1 - zeta**2) * np.exp(-zeta * omega * s) * np.sin(damped * s)
        for a, s in zip(zv.amplitudes, since, strict=True)
    ]
    named = {"first impulse": each[0], "second impulse": each[1], "both": each[0] + each[1]}
    return lines({name: (times, value) for name, value in named.items()}, "time (s)", "response")


def families() -> Any:
    """Fig. 8: the amplitudes for which the fast three-impulse shaper leaves nothing."""

    def balance(y: float, x: float, kr: float) -> float:
        """Eq. 46."""
        energies = [z**2 + kr * z**4 for z in (x, y, 1 - x - y)]
        return energies[0] + energies[1] - energies[2]

    drawn, axes = figure(1, 2, height=2.6)
    first = np.linspace(0.002, 0.498, 125)
    for kr, name, line in ((0.0, "linear", "-"), (5.0, "$k_r$ = 5", "--")):
        second = np.array([brentq(balance, 0.0, 1 - x, args=(x, kr)) for x in first])
        axes[0, 0].plot(first, second, COLOURS[0], linestyle=line, label=name)
        axes[0, 1].plot(first, second, COLOURS[0], linestyle=line, label=f"$A_2$, {name}")
        axes[0, 1].plot(first, 1 - first - second, COLOURS[1], linestyle=line, label=f"$A_3$, {name}")
    shaper = js.design.energy.fast_three_impulse(PLANT, 1.0)
    for axis in axes[0]:
        axis.axvline(float(shaper.amplitudes[0]), color="0.5", linewidth=0.6)
        axis.set(xlabel="$A_1/x_d$", xlim=(0, 0.5))
        axis.legend()
    axes[0, 0].set_ylabel("$A_2/x_d$")
    axes[0, 1].set_ylabel("$A_2/x_d$, $A_3/x_d$")
    return drawn
