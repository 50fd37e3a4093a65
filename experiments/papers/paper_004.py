"""Dhanda, Vaughan and Singhose: bang-bang filters and moves from states that are not rest.

    python -m experiments.papers 004 --out out/papers

Inputs are limited to |u| ≤ 1. The filters of Fig. 2 are for ω = 1 rad/s, ζ = 0 and x(0) = [0.1, −0.1], the move of
Fig. 5 for ω = 10 rad/s and 100 m, the crane of Fig. 4 has a cable of 1.15 m and swings by 5°.
"""

import dataclasses

import numpy as np

import jshape as js
from experiments.papers.frame import Paper, Picture, Row, Surpassed, cannot, compare, draw, figure
from experiments.papers.judge import after
from jshape.design import switching
from jshape.design.switching import Switched
from jshape.reports.style import COLOURS, LINES

X0 = [0.1, -0.1]
CABLE, GRAVITY, WAY = 1.15, 9.81, 0.30
"""The crane: m, m/s² and m."""

SWING = np.sqrt(GRAVITY / CABLE)
"""Its frequency, rad/s."""

SPEED = 0.2
"""The trolley's speed in Fig. 4, m/s: assumed, it is not printed."""

LARGE, PUSH, FAR = np.radians(30.0), 2.0, 1.0
"""A large swing of that crane: rad, m/s² and m."""

TOLERABLE = 0.05
"""Sensitivity up to which a frequency counts as inside a filter's band."""


# The judge: equations of its own, integrated by SciPy.


def mode(t: float, y: np.ndarray, u: float, omega: float) -> list[float]:
    """Eq. 1 without damping."""
    return [y[1], u - omega**2 * y[0]]


def whole(t: float, y: np.ndarray, u: float, omega: float) -> list[float]:
    """Eqs. 1 and 19: the mode, then the rigid body."""
    return [y[1], u - omega**2 * y[0], y[3], u]


def crane(t: float, y: np.ndarray, acceleration: float) -> list[float]:
    """A point mass on the cable, the trolley's acceleration given: l θ'' + g sin θ + s'' cos θ = 0, and the trolley."""
    return [y[1], -(GRAVITY * np.sin(y[0]) + acceleration * np.cos(y[0])) / CABLE, y[3], acceleration]


def carried(t: float, y: np.ndarray, speed: float) -> list[float]:
    """The same with the trolley's speed given: y = (θ, θ' + speed · cos θ / l), which does not jump with the speed."""
    angular = y[1] - speed * np.cos(y[0]) / CABLE
    return [angular, -(GRAVITY * np.sin(y[0]) + speed * np.sin(y[0]) * angular) / CABLE]


def sensitivity(design: Switched, omega: float) -> float:
    """Eq. 13 by simulation: what is left, over what the bare step from the same state leaves."""
    amplitudes = []
    for times, jumps in ((design.times, design.amplitudes), (np.zeros(1), np.ones(1))):
        x, v = after(lambda t, y, u: mode(t, y, u, omega), X0, times, jumps, design.duration)[0]
        amplitudes.append(np.hypot(x - 1 / omega**2, v / omega))
    return amplitudes[0] / amplitudes[1]


def ringing(design: Switched, omega: float) -> float:
    """Amplitude of the acceleration ω² x that is left at the end of a move, m/s²."""
    x, v, _, _ = after(
        lambda t, y, u: whole(t, y, u, omega), [0.0] * 4, design.times, design.amplitudes, design.duration
    )[0]  # fmt: skip
    return float(omega**2 * np.hypot(x, v / omega))


def angle(theta: float, angular: float) -> float:
    """The amplitude (degrees) of the crane's swing from that state, its trolley at rest."""
    lift = angular**2 * CABLE / (2 * GRAVITY) + 2 * np.sin(theta / 2) ** 2
    return float(np.degrees(2 * np.arcsin(min(np.sqrt(lift / 2), 1.0))))


# What jshape computes.


def band(design: Switched) -> tuple[float, float]:
    """The frequencies around 1 rad/s at which the sensitivity stays tolerable."""
    omega = np.linspace(0.6, 1.5, 90001)
    over = omega[design.sensitivity(omega) > TOLERABLE]
    return float(over[over < 1].max()), float(over[over > 1].min())


def recovery() -> tuple[Switched, Switched, Switched]:
    """Fig. 5: the closed-form move, the same with its first filter's end 10 % late, and what the redesign makes of it.

    As in the paper only the second filter is redesigned, for the state that the error left when it begins.
    """
    move = switching.preloaded(10.0, 0.0, 100.0)
    late = move.times.copy()
    late[2] *= 1.1
    wrong = dataclasses.replace(move, times=late, optimal=None, message="an error of 10 % in the third time")
    turn = float(move.times[3])
    second = switching.transition(10.0, 0.0, wrong.state_at(turn)[1:], start=1.0, final=-1.0)
    third = switching.transition(10.0, 0.0, start=-1.0, final=0.0)
    return move, wrong, wrong.followed_by(second, turn).followed_by(third, float(move.times[6]))


def hops(robust: bool) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and jumps (m/s) of the trolley's speed, 30 cm, from 5° at rest: a filter for each of two transitions.

    The mode x'' + ω² x = u moves the load by θ = −SPEED x'/l.
    """
    first = switching.transition(SWING, 0.0, [0.0, -CABLE * np.radians(5.0) / SPEED], robust=robust)
    second = switching.transition(SWING, 0.0, start=1.0, final=0.0, robust=robust)
    begin = WAY / SPEED + first.amplitudes @ first.times + second.amplitudes @ second.times
    if begin < first.duration:
        raise ValueError(f"SPEED must be lower: {WAY} m at {SPEED} m/s leave no room for two filters")
    return (
        np.concatenate([first.times, begin + second.times]),
        SPEED * np.concatenate([first.amplitudes, second.amplitudes]),
    )


def peak_to_peak(times: np.ndarray, jumps: np.ndarray, degrees: float) -> float:
    """Of the swing after those speeds, from that deflection at rest, degrees."""
    theta, angular = after(carried, [np.radians(degrees), 0.0], times, jumps, float(times[-1]))[0]
    return 2 * angle(theta, angular)


def switches(design: Switched | switching.Tuned, digits: int = 6) -> str:
    """The switching times of a design."""
    return "switches at " + ", ".join(f"{t:.{digits}f}" for t in design.switches) + " s"


def rows_of_filters(filters: dict[str, Switched]) -> list[Row]:
    """The filters: every number in print, and every equation whose print can be tested by numbers."""
    zv, zvd = filters["ZV"], filters["ZVD"]
    times, jumps = zvd.times, zvd.amplitudes
    # C − jS against C0 − jS0 = ω² x1(0) − j ω x2(0).
    misfit = max(abs(np.sum(f.amplitudes * np.exp(-1j * f.times)) - complex(X0[0], -X0[1])) for f in filters.values())
    slope = abs(-1j * np.sum(jumps * times * np.exp(-1j * times)) + 1j * X0[1] - 2 * X0[0])
    digital = {
        (name, step): switching.digital_filter(1.0, 0.0, X0, step, name == "ZVD").steps
        for name in filters
        for step in (0.05, 0.01)
    }
    # The first two jumps of a filter for ω = 2, by Eq. 12 and by simulation: x about rest at the level −1.
    two = switching.time_optimal_filter(2.0)
    by_print = abs(np.sum(two.amplitudes[:2] * np.exp(-2j * two.times[:2]))) / 2
    x, v = after(lambda t, y, u: mode(t, y, u, 2.0), [0.0, 0.0], two.times[:2], two.amplitudes[:2], two.times[1])[0]
    by_judge = np.hypot(x + 1 / 2**2, v / 2)
    return [
        Row("jumps of the filters", "Eq. 5", "1, −2, 2, …, 2",
            "; ".join(f"{name} " + ", ".join(f"{a:g}" for a in f.amplitudes) for name, f in filters.items()),
            all(np.allclose(np.abs(f.amplitudes[1:]), 2) and f.amplitudes[0] == 1 for f in filters.values())),
        Row("the ZV filter of Fig. 2 is time-optimal", "Eqs. 2, 14", "optimal", switches(zv, 10),
            zv.optimal, "proved by its switching function"),
        Row("the ZVD filter of Fig. 2 is time-optimal", "Eqs. 2, 15", "optimal", switches(zvd, 10),
            zvd.optimal, "proved by its switching function"),
        Row("C = C0 and S = S0", "Eqs. 9–11", "0", f"{misfit:.1e}", bool(misfit < 1e-9)),
        Row("sensitivity at ω = 1, ZV and ZVD", "Fig. 2", "0, 0",
            ", ".join(f"{float(f.sensitivity(1.0)):.1e}" for f in filters.values()),
            all(float(f.sensitivity(1.0)) < 1e-9 for f in filters.values())),
        Row("slope over ω of the ZVD's, at ω = 1", "Eq. 15", "0", f"{slope:.1e}", bool(slope < 1e-9)),
        Row("amplitude left by a filter's first two jumps, ω = 2", "Eq. 12", f"{by_print:.9f}",
            f"{by_judge:.9f}", False, "Eq. 12 is the velocity's amplitude, ω times the position's"),
        compare("C0d, S0d for Fig. 2", "Eq. 17", "-0.1, 0.2",
                [np.sum(jumps * times * np.cos(times)), np.sum(jumps * times * np.sin(times))],
                "dC/dω and dS/dω give C0d = 2ζω x1(0) + x2(0) and S0d = −2 ωd x1(0)"),
        Row("steps of the digital filters at 0.05 and 0.01 s", "Eq. 3", "an approximate solution",
            "; ".join(f"{name} {digital[name, 0.05]}, {digital[name, 0.01]}" for name in filters),
            all(f.duration <= digital[name, d] * d < f.duration + 2 * d for name, f in filters.items()
                for d in (0.05, 0.01)),
            "none shorter than the filter that may switch at any time, none longer by two steps"),
    ]  # fmt: skip


def rows_of_moves(move: Switched, closed: tuple[Switched, Switched, Switched]) -> list[Row]:
    """The moves and the crane, likewise."""
    moving = switching.rest_to_rest(10.0, 0.0, 100.0, [[1.0, 0.3], [0.0, 0.0]])
    sums = [float(moving.amplitudes @ moving.times**power) for power in (1, 2)]
    _, wrong, mended = closed
    off = np.array([2.0, 8.0])
    shaped = {robust: [peak_to_peak(*hops(robust), d) for d in off] for robust in (False, True)}
    bare = np.array([0.0, WAY / SPEED]), SPEED * np.array([1.0, -1.0])
    return [
        Row("x(T) of a move from rest to rest", "Eq. 19", "[1/ω², 0]",
            "[" + ", ".join(f"{abs(x):.0e}" for x in move.final_state[1]) + "]", False,
            "the input ends at 0, where the mode rests at 0"),
        Row("jumps of the shaped command", "Eq. 20", "1, −2, 2, …, 1", ", ".join(f"{a:g}" for a in move.amplitudes),
            bool(np.allclose(move.amplitudes, [1, -2, 2, -2, 1])), switches(move, 10)),
        compare("Σ I t for y(0) = [1, 0.3]", "Eq. 21", "-0.3", sums[0], "y2(0) with the other sign"),
        compare("Σ I t² for y(0) = [1, 0.3], 100 m", "Eq. 21", "199", sums[1], "it is 2 (y_ref − y1(0))"),
        Row("the filtered command only approximates the optimum", "section III", "slower",
            f"{closed[0].duration:.10f} s, optimum {move.duration:.10f} s", closed[0].duration > move.duration),
        Row("a first filter that ends 10 % late excites the mode", "section VI, Fig. 5", "cumulative vibrations",
            f"{ringing(wrong, 10.0):.9f} m/s²", bool(ringing(wrong, 10.0) > 0.1)),
        Row("the second filter, redesigned, cancels that", "section VI, Fig. 5", "perfectly",
            f"{ringing(mended, 10.0):.1e} m/s²", bool(ringing(mended, 10.0) < 1e-9),
            "it switches after " + ", ".join(f"{t - mended.times[3]:.8f}" for t in mended.times[4:6]) + " s"),
        compare("swing of the crane at first, ° peak to peak", "section V", "10", 2 * angle(np.radians(5.0), 0.0)),
        cannot("swing after the ZV and ZVD moves, ° peak to peak", "section V", "3.12, 2.73",
               "measurements; the ideal crane keeps nothing, and the trolley's speed limit is not printed"),
        Row("an error of the assumed deflection degrades both filters", "section V, Fig. 4", "it does",
            "; ".join(f"{name} {a:.3f}° from 2°, {b:.3f}° from 8°"
                      for name, (a, b) in zip(("ZV", "ZVD"), shaped.values(), strict=True)),
            min(min(pair) for pair in shaped.values()) > 1,
            "peak to peak: twice the error, whatever the speed, as a linear mode adds both; the measured rest "
            "stands for an error of 1.6° and 1.4°"),
        Row("neither excites more than the unshaped move", "section V, Fig. 4", "never",
            f"unshaped {peak_to_peak(*bare, 0.0):.2f}° from 0°, {peak_to_peak(*bare, 10.0):.2f}° from 10°", None,
            f"depends on the speed, which is not printed; drawn for {SPEED} m/s"),
    ]  # fmt: skip


def _sensitivities(filters: dict[str, Switched]) -> Picture:
    drawn, axes = figure()
    axis = axes[0, 0]
    inset = axis.inset_axes((0.34, 0.64, 0.4, 0.34))
    for i, (name, design) in enumerate(filters.items()):
        for place, omega in ((axis, np.linspace(0.5, 1.5, 301)), (inset, np.linspace(0.95, 1.05, 61))):
            place.plot(omega, design.sensitivity(omega), color=COLOURS[i], linestyle=LINES[i], label=name)
    axis.set(xlim=(0.5, 1.5), ylim=(0, 1.5))
    inset.set_ylim(0, 0.1)
    axis.set(xlabel="frequency ω (rad/s)", ylabel="vibration sensitivity S")
    axis.legend(loc="upper left")
    return Picture("paper_004_figure_02", drawn, "Fig. 2: sensitivity of the ZV and ZVD filters, x(0) = [0.1, −0.1].")


def _crane() -> Picture:
    drawn, axes = figure()
    degrees, unshaped = np.linspace(0.0, 10.0, 11), (np.array([0.0, WAY / SPEED]), SPEED * np.array([1.0, -1.0]))
    moves = {f"unshaped, {SPEED} m/s": unshaped, "ZV": hops(False), "ZVD": hops(True)}
    curves = {name: (degrees, [peak_to_peak(*move, d) for d in degrees]) for name, move in moves.items()}
    draw(axes[0, 0], curves, xlabel="initial deflection (°)", ylabel="residual swing (°, peak to peak)")
    axes[0, 0].set_ylim(bottom=0)
    words = f"Fig. 4 without its measurements: designed for 5°; {SPEED} m/s is assumed. ZV and ZVD coincide."
    return Picture("paper_004_figure_04", drawn, words)


def _acceleration(move: Switched, wrong: Switched, mended: Switched) -> Picture:
    drawn, axes = figure(2, 1, height=1.7, sharex=True)
    times = np.linspace(0.0, 22.0, 1201)
    for axis, (name, design), colour in zip(
        axes[:, 0], {"designed for rest": wrong, "second filter redesigned": mended}.items(), COLOURS, strict=False
    ):
        ideal = [100 * move.state_at(t)[1, 0] for t in times]
        axis.plot(times, ideal, color="0.6", linestyle="--", label="without the error")
        axis.plot(times, [100 * design.state_at(t)[1, 0] for t in times], color=colour, linewidth=0.8, label=name)
        axis.set_ylabel("acceleration (m/s²)")
        axis.legend(loc="upper right", handlelength=1.2)
    axes[1, 0].set_xlabel("time (s)")
    words = "Fig. 5: the first filter ends 10 % late; the second as designed for rest, and for the state that it meets."
    return Picture("paper_004_figure_05", drawn, words, shown=True)


def tuned_crane() -> tuple[Switched, switching.Tuned, list[np.ndarray]]:
    """The fastest move of the linear mode, the same tuned on the crane itself, and the states that both end with."""
    state = [[0.0, 0.0], [-CABLE * LARGE, 0.0]]  # x = −l θ follows the trolley's acceleration as Eq. 1 says
    plain = switching.rest_to_rest(SWING, 0.0, FAR, state, PUSH)
    tuned = switching.tuned(
        js.plants.Crane(CABLE, 1.0, GRAVITY), plain.switches, [LARGE, 0.0], PUSH, distance=FAR,
        first=float(plain.levels[0]),
    )  # fmt: skip
    ends = [
        after(crane, [LARGE, 0.0, 0.0, 0.0], times, np.diff(levels, prepend=0.0), float(times[-1]))[0]
        for times, levels in ((plain.times, plain.levels), (tuned.times, tuned.levels))
    ]
    return plain, tuned, ends


def highest(design: Switched, ends: tuple[float, float]) -> float:
    """The greatest sensitivity in a band."""
    return max(sensitivity(design, w) for w in np.linspace(ends[0], ends[1], 41))


def detuned(design: Switched) -> float:
    """The greater acceleration left, m/s², if ω is one per cent off either way."""
    return max(ringing(design, 9.9), ringing(design, 10.1))


def surpassed(filters: dict[str, Switched], move: Switched, closed: Switched) -> tuple[list[Surpassed], list[str]]:
    """Robust in less time, wider in the same, moves, and the swinging crane as it is."""
    zvd, (low, high) = filters["ZVD"], band(filters["ZVD"])
    short = switching.time_optimal_filter(1.0, 0.0, X0, (low, high, TOLERABLE))
    wider = (1 - 1.36 * (1 - low), 1 + 1.36 * (high - 1))
    wide = switching.time_optimal_filter(1.0, 0.0, X0, (*wider, TOLERABLE))
    near = (9.5, 10.5)
    brief, sure = switching.preloaded(10.0, 0.0, 5.0), switching.rest_to_rest(10.0, 0.0, 5.0, robust=(*near, 0.1))
    robust = switching.rest_to_rest(10.0, 0.0, 100.0, robust=True)
    off = np.linspace(*near, 41)
    plain, tuned, ends = tuned_crane()
    swings = [angle(end[0], end[1]) for end in ends]
    rest = "SciPy: Eq. 19 from rest, acceleration left at ω = 10"
    items = [
        Surpassed(
            "length of a filter for the band in which the ZVD stays below 5 %", zvd.duration, short.duration, "s",
            "SciPy: Eq. 1 at 41 frequencies, largest S", highest(short, (low, high)), 1e-9,
            f"|u| ≤ 1, x(0) = [0.1, −0.1], S ≤ 5 % from {low:.4f} to {high:.4f} rad/s", switches(short), TOLERABLE,
        ),
        Surpassed(
            "band with S ≤ 5 % in no more time than the ZVD", high - low, wider[1] - wider[0], "rad/s",
            "SciPy: Eq. 1 at 41 frequencies, largest S", highest(wide, wider), 1e-9,
            f"|u| ≤ 1, x(0) = [0.1, −0.1], {zvd.duration:.5f} s (this one takes {wide.duration:.5f} s)", switches(wide),
            TOLERABLE, "more",
        ),
        Surpassed(
            "100 m, at rest at the end", closed.duration, move.duration, "s", rest, ringing(move, 10.0), 1e-8,
            "|u| ≤ 1, ω = 10; theirs is the closed form of Fig. 5", switches(move), 0.0,
        ),
        Surpassed(
            "acceleration left after 5 m if ω is anywhere from 9.5 to 10.5", max(ringing(brief, w) for w in off),
            float(np.max(sure.sensitivity(off))), "m/s²", "SciPy: Eq. 19 at 41 frequencies",
            max(ringing(sure, w) for w in off), 1e-9,
            f"|u| ≤ 1; theirs, the closed form, takes {brief.duration:.5f} s, ours {sure.duration:.5f} s",
            switches(sure),
        ),
        Surpassed(
            "swing left after 1 m from 30°, nonlinear", swings[0], angle(0.0, np.sqrt(2 * tuned.residual) / CABLE), "°",
            "SciPy: the crane's nonlinear equation", swings[1], 1e-7,
            f"|a| ≤ {PUSH:g} m/s², cable {CABLE} m; theirs is the optimal filter of the linear mode "
            f"({plain.duration:.5f} s), ours takes {tuned.duration:.5f} s",
            f"tuned on the crane itself, {switches(tuned)}",
        ),
    ]  # fmt: skip
    notes = [
        f"The trolley of the tuned move ends at {ends[1][2]:.12f} m with {abs(ends[1][3]):.0e} m/s.",
        "Less time is not all: over 100 m, one per cent off in ω either way, the closed form leaves at most "
        f"{detuned(closed):.3f} m/s², the fastest move {detuned(move):.3f} and the fastest one whose slope over ω is "
        f"zero ({robust.duration:.4f} s) {detuned(robust):.3f}: a derivative that vanishes does not reach far where a "
        "move lasts 30 periods; a band does (the row for 5 m).",
        "Not drawn: Fig. 1 (a sketch), Fig. 3 (a photograph) and the measurements in Fig. 4. The axes' ranges are not "
        "in the text.",
    ]
    return items, notes


def results(draw: bool = True) -> Paper:
    """The whole paper; the figures only if they are wanted."""
    filters = {
        "ZV": switching.time_optimal_filter(1.0, 0.0, X0),
        "ZVD": switching.time_optimal_filter(1.0, 0.0, X0, robust=True),
    }
    move = switching.rest_to_rest(10.0, 0.0, 100.0)
    closed = recovery()
    items, notes = surpassed(filters, move, closed[0])
    return Paper(
        "004",
        "Optimal filters for non-zero initial states",
        "A. Dhanda, J. Vaughan and W. Singhose: *Optimal Input Shaping Filters for Non-Zero Initial States*.",
        [*rows_of_filters(filters), *rows_of_moves(move, closed)],
        [_sensitivities(filters), _crane(), _acceleration(*closed)] if draw else [],
        items,
        notes,
    )
