"""Moonmangmee and Chatlatanagulchai (2025): general, robust and fast shapers by energy, and how sensitive they are.

    python -m experiments.papers 001 --out out/papers

The plant of all numbers: m1 = m2 = 1 kg, k1 = 10 N/m, k3 = 100 N/m³, a move of 1 m. PRV is the paper's percentage
residual vibration, the first overshoot over the distance. ``paper_001_designs`` computes, ``paper_001_figures`` draws.
"""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

import jshape as js
from experiments.papers.frame import Paper, Row, Surpassed, compare, words
from experiments.papers.judge import K1, K3, vibration, width, worst, worst_case
from experiments.papers.paper_001_designs import (
    DAMPINGS,
    LONGEST,
    MASSES,
    PLANT,
    PRESENTED,
    RATIOS,
    at,
    curves,
    designs,
    minimax,
    overshoots,
    residuals,
    shapers,
)
from experiments.papers.paper_001_figures import pictures


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

    def balance(a: float) -> float:
        """Eq. 28."""
        return 1 - 2 * a + kr / 2 * (1 - 3 * a + 3 * a**2 - 2 * a**3)

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
    maxima = {name: (mass[name].max(), at(damped[name].T, 0.1, DAMPINGS).max()) for name in PRESENTED}

    def gain(of: dict[str, np.ndarray], ratio: float) -> float:
        """By how much fast three impulses leave less than two, %."""
        return 100 * (1 - at(of["fast 3-impulse"], ratio) / at(of["2-impulse"], ratio))

    k1 = prv["spring.k1"]
    strong = {name: at(at(damped[name], 1.0, MASSES), 0.6, DAMPINGS) for name in PRESENTED}
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
            "four impulses: PRV at m2 × 0.6 (%)", "Fig. 11", "22", f"{maxima['4-impulse'][0]:.2f}", False,
            f"read off a curve, it seems; {maxima['4-impulse'][1]:.2f} with the damper, c = 0.1",
        ),
        *(
            Row(
                f"{name}: greatest PRV over 0.6 … 1.4 (%)", "Fig. 11", "less than 5", f"{maxima[name][0]:.2f}", False,
                f"{maxima[name][1]:.2f} with the damper, c = 0.1",
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
            "two impulses at c = 0.6: PRV (%)", "Fig. 14", "23", strong["2-impulse"], _flat(damped), 4
        ),
        compare(
            "fast three impulses at c = 0.6: PRV (%)", "Fig. 14", "17", strong["fast 3-impulse"], _flat(damped), 4,
        ),
        Row(
            "three to six impulses: greatest PRV for c up to 0.6 (%)", "Fig. 14", "not exceeding 5", f"{most:.2f}",
            bool(most < 5), "at c = 0.6 "
            + ", ".join(f"{strong[name]:.2f}" for name in robust),
        ),
    ]  # fmt: skip


def _flat(damped: dict[str, np.ndarray]) -> str:
    """Where the figure's two values of two and fast three impulses hold."""
    plateau = [np.round(at(damped[name], 1.0, MASSES)) for name in PRESENTED[:2]]
    both = DAMPINGS[(plateau[0] == 23) & (plateau[1] == 17)]
    return f"23 and 17 both hold for c from {both[0]:.2f} to {both[-1]:.2f}, where the curves are flat"


def surpassed(found: dict[str, js.Shaper], energies: dict[str, np.ndarray]) -> list[Surpassed]:
    """jshape's designs against the paper's. ``energies``: left at ``TWENTY`` by each shaper, J, by jshape.

    The paper's figures are SciPy's alone; jshape's are jshape's, and SciPy's to verify them.
    """

    def least(name: str, paper: str, what: str, limits: str) -> Surpassed:
        return worst_case(what, found[paper], found[name], float(energies[name].max()), limits)

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
