"""Moonmangmee and Chatlatanagulchai (2025): general, robust and fast shapers by energy, and how sensitive they are.

    python experiments/papers/paper_001.py --out out/papers

The plant of all numbers: m1 = m2 = 1 kg, k1 = 10 N/m, k3 = 100 N/m³, a move of 1 m. PRV is the paper's percentage
residual vibration, the first overshoot over the distance.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from frame import Paper, Picture, Row, Surpassed, after, compare, figure, main
from scipy.optimize import brentq

import jshape as js
from jshape.plot import COLOURS, LINES

K1, K3 = 10.0, 100.0
PLANT = js.plants.TwoMass(1.0, 1.0, spring=js.plants.Duffing(K1, K3))
DAMPED = js.plants.TwoMass(1.0, 1.0, spring=js.plants.Duffing(K1, K3), damper=js.plants.PowerDamper(0.1, 3))
RATIOS = np.linspace(0.6, 1.4, 81)
TWENTY = np.linspace(0.8, 1.2, 41)
"""The uncertain payload, multiples of nominal."""

MASSES, DAMPINGS = np.linspace(0.6, 1.4, 17), np.linspace(0.0, 1.0, 21)
"""For Fig. 14 and what is said of the damped plant: m2 (kg) and c (N s³/m³)."""

LONGEST = 6
"""All shapers are padded to so many impulses, so that one compiled program serves them all."""

PRESENTED = ("2-impulse", "fast 3-impulse", "3-impulse", "4-impulse", "5-impulse", "6-impulse")
"""The shapers of Figs. 11 to 14."""


# The judge: equations of its own, integrated by SciPy.


def field(t: float, y: np.ndarray, base: float, m2: float = 1.0) -> list[float]:
    """Eq. 6 for the payload, its spring force put right, with the base as commanded: y = (x2, x2')."""
    x = y[0] - base
    return [y[1], -(K1 * x + K3 * x**3) / m2]


def potential(x: float) -> float:
    """Energy of the spring, J: what Eq. 6 prints as its force."""
    return K1 * x**2 / 2 + K3 * x**4 / 4


def left(shaper: js.Shaper, m2: float = 1.0) -> float:
    """Energy that a payload of m2 (kg) keeps after the move, J."""
    end = float(shaper.duration)
    x, v = after(lambda t, y, u: field(t, y, u, m2), [0.0, 0.0], shaper.times, shaper.amplitudes, end)[0]
    return m2 * v**2 / 2 + potential(x - 1.0)


def worst(shaper: js.Shaper, masses: np.ndarray = TWENTY) -> float:
    """The greatest of those energies, J."""
    return max(left(shaper, float(m2)) for m2 in masses)


def width(vibration: Callable[[float], float]) -> float:
    """Width of the interval of payloads around 1 kg for which a vibration (PRV, a fraction) stays below 5 %, kg."""
    ends = []
    for way in (-1, 1):
        near, far = 1.0, 1.0
        while vibration(far) < 0.05:
            near, far = far, far + 0.02 * way
        ends.append(brentq(lambda m2: vibration(m2) - 0.05, near, far, xtol=1e-10))
    return ends[1] - ends[0]


def vibration(shaper: js.Shaper, m2: float) -> float:
    """The deflection whose energy is the one left, over the distance: PRV as a fraction."""
    energy = left(shaper, m2)
    return float(np.sqrt((np.sqrt(K1**2 + 4 * K3 * energy) - K1) / K3))


# What jshape computes.


def shapers() -> dict[str, js.Shaper]:
    """All shapers of the paper, by name."""
    energy = js.design.energy
    found = {
        "linear ZVD": js.design.linear.zvd(np.sqrt(K1)),
        "fast 3-impulse": energy.fast_three_impulse(PLANT, 1.0),
    }
    found |= {f"{n}-impulse": energy.robust(PLANT, 1.0, rests=n - 2) for n in range(2, 7)}
    found |= {f"α = {alpha:.2f}": energy.three_impulse(PLANT, 1.0, alpha) for alpha in (0.45, 0.55, 0.6, 0.65, 0.7)}
    found |= {f"A1 = {first:.2f}": energy.fast_three_impulse(PLANT, 1.0, first=first) for first in (0.25, 0.40)}
    return found


def designs(found: dict[str, js.Shaper]) -> dict[str, js.Shaper]:
    """jshape's own for a payload known to 20 %: the least worst case in the time of one of the paper's."""
    given: dict[str, Any] = dict(over={"m2": TWENTY}, objective="worst")
    three, four, fast = (float(found[name].duration) for name in ("3-impulse", "4-impulse", "fast 3-impulse"))
    best = {
        "same time": js.tune(PLANT, 1.0, impulses=3, duration=three, **given),
        "at most": js.tune(PLANT, 1.0, impulses=3, duration=(0, three), **given),
        "four": js.tune(PLANT, 1.0, impulses=4, duration=(0, four), **given),
        "bounded": js.tune(PLANT, 1.0, impulses=4, duration=fast, amplitudes="bounded", limit=1.0, **given),
    }
    own = {f"tuned, {name}": solution.shaper for name, solution in best.items()}
    return {**own, "first-order robust": js.design.energy.first_order_robust(PLANT, 1.0, 4)}


def curves(found: dict[str, js.Shaper], leaf: str) -> dict[str, np.ndarray]:
    """PRV (%) of each shaper over ``RATIOS`` of a leaf."""
    data = js.sweep(PLANT, found, 1.0, over={leaf: RATIOS}, estimate_error=False).residual_vibration
    return {name: 100 * data.sel(shaper=name).values for name in found}


def overshoots(found: dict[str, js.Shaper]) -> dict[str, np.ndarray]:
    """First overshoot (%) of each shaper with a damper, an array over ``MASSES`` and ``DAMPINGS``."""
    over = {"m2": MASSES, "damper.c": DAMPINGS}
    data = js.sweep(DAMPED, found, 1.0, over, metric="overshoot", relative=False, estimate_error=False).overshoot
    return {name: 100 * data.sel(shaper=name).values for name in found}


def at(values: np.ndarray, place: float, grid: np.ndarray = RATIOS) -> Any:
    """Values at a place that is on their first axis' grid."""
    return values[np.argmin(np.abs(grid - place))]


def rows_of_designs(found: dict[str, js.Shaper], peaks: np.ndarray) -> list[Row]:
    """Tables 1 and 2, and the numbers of Section 3."""
    shaper = {"α = 0.50": found["3-impulse"], "α = 1.00": found["2-impulse"], **found}
    rows = []
    for alpha, times, amplitudes in (
        ("0.45", "0, 0.847, 1.643", "0.225, 0.500, 0.275"),
        ("0.50", "0, 0.822, 1.643", "0.250, 0.500, 0.250"),
        ("0.55", "0, 0.796, 1.643", "0.275, 0.500, 0.225"),
        ("1.00", "0, 0.591", "0.500, 0.500"),
    ):
        half = "0.8215 s; 0.822 is half of the rounded 1.643" if alpha == "0.50" else ""
        rows.append(compare(f"α = {alpha}: t (s)", "Table 1", times, shaper[f"α = {alpha}"].times, half))
        rows.append(compare(f"α = {alpha}: A (m)", "Table 1", amplitudes, shaper[f"α = {alpha}"].amplitudes))
    kr = K3 / (2 * K1)
    balance = lambda a: 1 - 2 * a + kr / 2 * (1 - 3 * a + 3 * a**2 - 2 * a**3)
    rows += [
        compare("α for which the spring's forces at both rests are equal", "Eq. 28", "0.50", brentq(balance, 0.1, 0.9)),
        compare(
            "energy with k − 1 rests over energy with k, k = 1, 2, 3", "remark 3, Fig. 6", "6.7, 2.6, 1.9",
            peaks[:3] / peaks[1:4],
            "48/7 = 6.857 for the first; the peaks are 2.8125, 0.41015625, 0.15817901 and 0.08422852 J",
        ),
        compare("A2 for A1 = 0.25", "before Fig. 9", "0.3523", found["A1 = 0.25"].amplitudes[1]),
        compare("A2 for A1 = 0.40", "before Fig. 9", "0.1823", found["A1 = 0.40"].amplitudes[1]),
        compare("A1 = A2", "after Eq. 54", "0.3042", found["fast 3-impulse"].amplitudes[0]),
        compare(
            "A3 = 1 − A1 − A2", "after Eq. 54", "0.3916", found["fast 3-impulse"].amplitudes[2],
            "0.3916 is 1 − 2·0.3042; Table 2 has it right",
        ),
    ]  # fmt: skip
    for name, times, amplitudes, why in (
        ("linear ZVD", "0, 0.994, 1.987", "0.25, 0.50, 0.25", "π/√10 = 0.99346; 0.994 is half of the rounded 1.987"),
        ("2-impulse", "0, 0.591", "0.50, 0.50", ""),
        ("3-impulse", "0, 0.822, 1.643", "0.25, 0.50, 0.25", "0.8215 s; 0.822 is half of the rounded 1.643"),
        ("4-impulse", "0, 0.904, 1.809, 2.713", "0.167, 0.333, 0.333, 0.167", ""),
        ("fast 3-impulse", "0, 0.383, 0.926", "0.3042, 0.3042, 0.392", ""),
    ):
        rows.append(compare(f"{name}: t (s)", "Table 2", times, found[name].times, why))
        rows.append(compare(f"{name}: A (m)", "Table 2", amplitudes, found[name].amplitudes))
    return rows


def rows_of_speed(rises: dict[str, float]) -> list[Row]:
    """The statements about Fig. 10. ``rises``: 10 % to 90 %, s."""
    order = [rises[f"{n}-impulse"] for n in (2, 3, 4, 5, 6)]
    two, fast = rises["2-impulse"], rises["fast 3-impulse"]
    return [
        Row(
            "rise time of two impulses and of fast three (s)", "Fig. 10", "quite similar", f"{two:.4f}, {fast:.4f}",
            False, f"fast three takes {100 * (fast / two - 1):.0f} % longer; three impulses take {order[1]:.4f} s",
        ),
        Row(
            "rise time of 2 … 6 impulses (s)", "Fig. 10", "slower with more",
            ", ".join(f"{time:.4f}" for time in order), bool(np.all(np.diff(order) > 0)), "10 % to 90 %",
        ),
    ]  # fmt: skip


def rows_of_robustness(prv: dict[str, dict[str, np.ndarray]], damped: dict[str, np.ndarray], alphas: str) -> list[Row]:
    """Sections 4.1 and 4.2. ``prv``: leaf → shaper → curve; ``damped``: over payload and c."""
    mass, k3 = prv["m2"], prv["spring.k3"]
    maxima = lambda name: (mass[name].max(), at(damped[name].T, 0.1, DAMPINGS).max())
    gain = lambda of, ratio: 100 * (1 - at(of["fast 3-impulse"], ratio) / at(of["2-impulse"], ratio))
    k1 = prv["spring.k1"]
    strong = {name: at(at(damped[name], 1.0, MASSES), 0.6, DAMPINGS) for name in PRESENTED}
    plateau = [np.round(at(damped[name], 1.0, MASSES)) for name in PRESENTED[:2]]
    both = DAMPINGS[(plateau[0] == 23) & (plateau[1] == 17)]
    elsewhere = f"23 and 17 both hold for c from {both[0]:.2f} to {both[-1]:.2f}, where the curves are flat"
    k1_order = [at(k1[f"{n}-impulse"], 0.8) for n in (3, 4, 5, 6)]
    grows = bool(np.any(np.diff(k1_order) > 0))
    robust = [f"{n}-impulse" for n in (3, 4, 5, 6)]
    most = max(at(damped[name], 1.0, MASSES)[DAMPINGS < 0.61].max() for name in robust)
    poor = [max(mass[name].max() for name in group) for group in (PRESENTED[:2], robust)]
    return [
        Row(
            "the α of least vibration over the payload", "Fig. 5", "0.50", alphas, False,
            "0.50 is where the first-order sensitivity vanishes; over ±10 % and ±20 % others have the least maximum",
        ),
        Row(
            "four impulses: PRV at m2 × 0.6 (%)", "Fig. 11", "22", f"{maxima('4-impulse')[0]:.2f}", False,
            f"read off a curve, it seems; {maxima('4-impulse')[1]:.2f} with the damper, c = 0.1",
        ),
        *(
            Row(
                f"{name}: greatest PRV over 0.6 … 1.4 (%)", "Fig. 11", "less than 5", f"{maxima(name)[0]:.2f}", False,
                f"{maxima(name)[1]:.2f} with the damper, c = 0.1",
            )
            for name in ("5-impulse", "6-impulse")
        ),
        Row(
            "greatest PRV over the payload of two and fast three against three to six impulses (%)", "Fig. 11",
            "quite inferior", f"{poor[0]:.1f}, {poor[1]:.1f}", poor[0] > poor[1], "three impulses at m2 × 0.6 are 39.7",
        ),
        Row(
            "more impulses and k1: PRV of 3 … 6 at k1 × 0.8 (%)", "Fig. 12", "not ever less with more impulses",
            ", ".join(f"{value:.2f}" for value in k1_order), grows, "",
        ),
        Row(
            "fast three better than two impulses at k3 × 0.8, 1.2 (%)", "Fig. 13", "approximately 50",
            ", ".join(f"{gain(k3, ratio):.1f}" for ratio in (0.8, 1.2)),
            all(gain(k3, ratio) >= 50 for ratio in (0.8, 1.2)), "nearer 60: agrees as by half or more",
        ),
        Row(
            "the same at m2 × 0.8, 1.2 (%)", "Fig. 13", "approximately 50",
            ", ".join(f"{gain(mass, ratio):.1f}" for ratio in (0.8, 1.2)), False, "less than half; true of k3 only",
        ),
        compare(
            "two impulses at c = 0.6: PRV (%)", "Fig. 14", "23", strong["2-impulse"], elsewhere, 4
        ),
        compare(
            "fast three impulses at c = 0.6: PRV (%)", "Fig. 14", "17", strong["fast 3-impulse"], elsewhere, 4,
        ),
        Row(
            "three to six impulses: greatest PRV for c up to 0.6 (%)", "Fig. 14", "not exceeding 5", f"{most:.2f}",
            bool(most < 5), "at c = 0.6 "
            + ", ".join(f"{strong[name]:.2f}" for name in robust),
        ),
    ]  # fmt: skip


@jax.jit
def residuals(shaper: js.Shaper, masses: jax.Array) -> jax.Array:
    """PRV at each payload (kg), a fraction."""
    plant = lambda m2: js.plants.TwoMass(1.0, m2, spring=js.plants.Duffing(K1, K3))
    return jax.vmap(lambda m2: js.residual_vibration(plant(m2), shaper, 1.0, steps=64))(masses)


def minimax(spread: float) -> float:
    """The α whose greater vibration at both ends of m2 ± spread is least: where both are equal."""
    ends = jnp.array([1 - spread, 1 + spread])
    unequal = lambda alpha: -float(jnp.diff(residuals(js.design.energy.three_impulse(PLANT, 1.0, alpha), ends))[0])
    alpha: Any = brentq(unequal, 0.501, 0.62, xtol=1e-6)
    return alpha


def surpassed(found: dict[str, js.Shaper], energies: dict[str, np.ndarray]) -> list[Surpassed]:
    """jshape's designs against the paper's. ``energies``: left at ``TWENTY`` by each shaper, J, by jshape.

    The paper's figures are SciPy's alone; jshape's are jshape's, and SciPy's to verify them.
    """

    def least(name: str, paper: str, what: str, limits: str) -> Surpassed:
        return Surpassed(
            f"{what}: worst residual energy, m2 ± 20 %", worst(found[paper]), float(energies[name].max()), "J",
            "the worst of 41 payloads", worst(found[name]), 1e-8, limits, words(found[name]),
        )  # fmt: skip

    three, sooner = found["3-impulse"], found["tuned, at most"]
    return [
        least("tuned, same time", "3-impulse", "three impulses", "three positive impulses in 1.64298 s"),
        least("tuned, at most", "3-impulse", "three impulses, sooner", "three positive impulses, at most 1.64298 s"),
        Surpassed(
            "the same two: duration", float(three.duration), float(sooner.duration), "s",
            "the worst energy over the paper's", worst(sooner) / worst(three), 0.05, "as before", words(sooner), 0.0,
        ),
        Surpassed(
            "the same two: width of the payloads with less than 5 % vibration", width(lambda m2: vibration(three, m2)),
            width(lambda m2: float(residuals(sooner, jnp.array([m2, m2]))[0])), "kg",
            "the width, by a root finder", width(lambda m2: vibration(sooner, m2)), 1e-6, "as before", words(sooner),
            better="more",
        ),
        least(
            "first-order robust", "4-impulse", "four impulses in closed form",
            "four positive impulses, at most 2.71298 s",
        ),
        least("tuned, four", "4-impulse", "four impulses, sooner", "four positive impulses, at most 2.71298 s"),
        least("tuned, bounded", "fast 3-impulse", "as fast as fast three", "no impulse over 1 m either way, 0.92633 s"),
    ]  # fmt: skip


def words(shaper: js.Shaper) -> str:
    listed = lambda values: ", ".join(f"{float(value):.5f}" for value in values)
    return f"A = {listed(shaper.amplitudes)} at {listed(shaper.times)} s"


# The figures.


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
    drawn, axes = figure(1, 2, height=2.6)
    first = np.linspace(0.002, 0.498, 125)
    for kr, name, line in ((0.0, "linear", "-"), (5.0, "$k_r$ = 5", "--")):
        # Eq. 46.
        u = lambda x, kr=kr: x**2 + kr * x**4
        second = np.array([brentq(lambda y, x=x, u=u: u(x) + u(y) - u(1 - x - y), 0.0, 1 - x) for x in first])
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


def pictures(
    found: dict[str, js.Shaper], prv: dict[str, dict[str, np.ndarray]], damped: dict[str, np.ndarray]
) -> list[Picture]:
    """Every figure but the diagrams, Figs. 2, 3 and 7."""
    family = {"α = 0.50": found["3-impulse"], "α = 1.00": found["2-impulse"], **found}
    of = lambda leaf, names: {name: (RATIOS, prv[leaf][name]) for name in names}
    run = lambda name: js.simulate(PLANT, 1.0, found[name].pad(LONGEST), horizon=6.0, samples=401)
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
    return [
        Picture(f"paper_001_figure_{number}", drawn_, caption, number == "11")
        for number, (drawn_, caption) in drawn.items()
    ]


def results(draw: bool = True) -> Paper:
    """The whole paper; the figures only if they are wanted."""
    found = shapers()
    found |= designs(found)
    padded = {name: shaper.pad(LONGEST) for name, shaper in found.items()}
    metrics = ["residual_vibration", "residual_energy"]
    data = js.sweep(PLANT, padded, 1.0, over={"m2": RATIOS}, metric=metrics, estimate_error=False)
    energies = {name: data.residual_energy.sel(shaper=name).values[20:61] for name in found}
    presented = {name: padded[name] for name in PRESENTED}
    prv = {"m2": {name: 100 * data.residual_vibration.sel(shaper=name).values for name in found}}
    prv |= {leaf: curves(presented, leaf) for leaf in ("spring.k1", "spring.k3")}
    damped = overshoots(presented)
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *presented.values())
    rise = jax.jit(jax.vmap(lambda shaper: js.rise_time(PLANT, shaper, 1.0)))(stacked)
    robust = {f"{n}-impulse": padded[f"{n}-impulse"] for n in range(2, 6)}
    peaks = np.array([js.energy_profile(PLANT, s, 1.0, points=33).total.max() for s in robust.values()])
    alphas = f"{minimax(0.1):.4f} (±10 %), {minimax(0.2):.4f} (±20 %)"
    return Paper(
        "001",
        "On a generalized input shaping for residual vibration suppression in flexible system with nonlinear spring "
        "and damper",
        "Ittidej Moonmangmee and Withit Chatlatanagulchai, 2025.",
        [
            *rows_of_designs(found, peaks),
            *rows_of_speed(dict(zip(presented, np.asarray(rise).tolist(), strict=True))),
            *rows_of_robustness(prv, damped, alphas),
        ],
        pictures(found, prv, damped) if draw else [],
        surpassed(found, energies),
        NOTES,
    )


NOTES = (
    "Figs. 2, 3 and 7 are diagrams.",
    "Eq. 3 needs no denominator. Eq. 5 has the amplitudes reversed: [1, 2K, K²]/(1 + K)² is right.",
    "Eq. 6 prints the spring's energy as its force, which is k1 x + k3 x³.",
    "Eq. 10: α²x_d²/2 instead of αx_d²/2. Eq. 17 lacks a square that Eq. 18 has. In Eqs. 19 and 20 t3 is an interval.",
    "Eq. 37 has the amplitudes swapped: A/2, A, …, A, A/2 as in Eq. 31; T in it is the whole period.",
    "Eqs. 42 and 43: [1 − (y − 1)²][1 + κ(1 + (y − 1)²)]. Eqs. 51 and 52: the k3 term belongs inside k1/2{…}.",
    "An even number of equal steps is not robust to first order, which is why four impulses are worse than three at "
    "m2 × 1.2 (5.89 against 2.45 %): the residual is in proportion to the alternating sum of spring force times half "
    "period over the swings, and equal ones cancel in pairs only.",
)


if __name__ == "__main__":
    main(results)
