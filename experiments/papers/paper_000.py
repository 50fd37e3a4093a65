"""Chatlatanagulchai, Moonmangmee and Intarawirat (2017): shapers by work and energy, and a flexible joint.

    python -m experiments.papers 000 --out out/papers

The plant of all numbers but the robot's: m2 = 1 kg, k1 = 10 N/m, k2 = 100 N/m³ (k3 in later papers), a move of 1 m. The
robot's parameters are not given; ``joint`` finds some with which a closed loop answers as in Fig. 7.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import jshape as js
from experiments.papers import frame
from experiments.papers.frame import Paper, Picture, Row, Surpassed, cannot, compare, figure, words
from experiments.papers.judge import K1, K3, TWENTY, after, duffing, potential, residual, worst, worst_case
from jshape.reports.style import COLOURS

C = 0.1
SPRING = js.plants.Duffing(K1, K3)
PLANT = js.plants.TwoMass(1.0, 1.0, spring=SPRING)
DAMPED = js.plants.TwoMass(1.0, 1.0, spring=SPRING, damper=js.plants.PowerDamper(C, 3))
LONGEST = 6
"""All shapers are padded to so many impulses, so that one compiled program serves them all."""

TRIAL = js.Shaper([0.525, 0.475], [0.0, 0.5935])
"""What the paper finds by trial and error for c = 0.1."""


# The judge: equations of its own, integrated by SciPy.


def highest(first: float, c: float) -> tuple[float, float]:
    """Time (s) and place (m) of the payload's first turn after a single step of the base to ``first`` (m)."""
    return turn(lambda t, y: duffing(t, y, first, c=c), np.zeros(2), 0, 1)


def turn(field: Callable[[float, np.ndarray], Any], start: np.ndarray, place: int, speed: int) -> tuple[float, float]:
    """Time and value of a coordinate's first turn in y' = field(t, y); ``place`` and ``speed``: its indices in y."""

    def turns(t: float, y: np.ndarray) -> float:
        # At the start it is at rest, too.
        return y[speed] if t > 0.01 else 1.0

    turns.terminal, turns.direction = True, -1  # pyright: ignore
    run = solve_ivp(field, (0.0, 2.0), start, "LSODA", events=turns, rtol=1e-11, atol=1e-13)
    return float(run.t_events[0][0]), float(run.y_events[0][0, place])


# The flexible joint: with J1 = 0.002 and J2 = 0.03 kg m² and a cubic part of 3 N m/rad³ stiffness and friction follow.

MOTOR, LINK, CUBIC, KP = 0.002, 0.03, 3.0, 20.0
STEP, PEAK, WHEN = np.radians(27.58), np.radians(39.25), 0.24
"""The step of the motor's reference (rad), the link's first peak (rad) and its time (s): Fig. 7."""
RECIPE = js.Shaper([STEP / PEAK, 1 - STEP / PEAK], [0.0, WHEN])
"""What the paper makes of these."""

LATER = 0.6
"""When the two shaped closed loops are compared, s."""


def loop(t: float, y: np.ndarray, reference: float, stiffness: float, friction: float) -> list[float]:
    """Eq. 1 and Fig. 2 with a proportional controller: y = (motor, link, and their speeds), rad and rad/s."""
    twist = y[1] - y[0]
    pull = stiffness * twist + CUBIC * twist**3
    return [y[2], y[3], (KP * (reference - y[0]) - friction * y[2] + pull) / MOTOR, -pull / LINK]


def first_peak(stiffness: float, friction: float) -> tuple[float, float]:
    """Time (s) and angle (rad) of the link's first turn after a step of ``STEP``."""
    return turn(lambda t, y: loop(t, y, STEP, stiffness, friction), np.zeros(4), 1, 3)


def identified() -> tuple[float, float]:
    """Stiffness (N m/rad) and motor friction (N m s/rad) with which the link peaks when and where Fig. 7 has it."""

    def misses(logs: np.ndarray) -> list[float]:
        when, where = first_peak(*np.exp(logs))
        return [when / WHEN - 1, where / PEAK - 1]

    stiffness, friction = np.exp(least_squares(misses, np.log([10.0, 1.5]), xtol=1e-12).x)
    return float(stiffness), float(friction)


def shaken(shaper: js.Shaper, stiffness: float, friction: float) -> float:
    """Energy of the closed loop ``LATER`` after a shaped step of ``PEAK`` began, J."""
    motor, link, *speeds = after(
        lambda t, y, u: loop(t, y, u, stiffness, friction), np.zeros(4).tolist(), shaper.times,
        PEAK * np.asarray(shaper.amplitudes), LATER,
    )[0]  # fmt: skip
    twist = link - motor
    held = stiffness * twist**2 / 2 + CUBIC * twist**4 / 4 + KP * (PEAK - motor) ** 2 / 2
    return float(held + (MOTOR * speeds[0] ** 2 + LINK * speeds[1] ** 2) / 2)


def later(plant: js.plants.AbstractPlant, shaper: js.Shaper, command: Any) -> jax.Array:
    """The same by jshape: an impulse of no size ends the move at that time."""
    amplitudes, times = jnp.append(shaper.amplitudes, 0.0), jnp.append(shaper.times, LATER)
    return js.residual_energy(plant, js.Shaper(amplitudes, times), command, steps=64)


# What jshape computes.


def shapers() -> dict[str, js.Shaper]:
    """The paper's, by name, and jshape's own for a payload known to 20 %."""
    energy = js.design.energy
    found = {f"{n} impulses": energy.robust(PLANT, 1.0, rests=n - 2) for n in range(2, 7)}
    found["negative"] = energy.negative(PLANT, 1.0)
    two, three = (float(found[f"{n} impulses"].duration) for n in (2, 3))
    given: dict[str, Any] = dict(over={"m2": TWENTY}, objective="worst", starts=8)
    best = {
        "as two": js.tune(PLANT, 1.0, impulses=4, duration=two, amplitudes="bounded", limit=1.0, **given),
        "as three": js.tune(PLANT, 1.0, impulses=4, duration=three, **given),
        "as negative": js.tune(PLANT, 1.0, duration=float(found["negative"].duration), amplitudes="unity", **given),
    }
    return found | {f"tuned, {name}": solution.shaper for name, solution in best.items()}


def rows_without_damper(found: dict[str, js.Shaper], over: dict[str, float]) -> list[Row]:
    """Figs. 4, 10 and 12. ``over``: overshoot with 20 % more payload, %."""
    two, zv = found["2 impulses"], js.design.linear.zv(np.sqrt(K1))
    linear = js.design.energy.two_impulse(js.plants.TwoMass(1.0, 1.0, spring=js.plants.LinearSpring(K1)), 1.0)
    off = abs(float(linear.times[1]) - float(zv.times[1]))
    when, where = highest(0.5, 0.0)
    several = [over[f"{n} impulses"] for n in (2, 4, 6)]
    return [
        Row(
            "linear spring: the ZV shaper, A1 = x_d/2, t2 = π/√(k/m2)", "after Eq. 4", "exactly",
            f"t2 differs by {off:.0e} s", off < 1e-12,
        ),
        compare("A1 (m)", "before Fig. 4", "0.5", two.amplitudes[0]),
        compare("t2 (s)", "before Fig. 4", "0.5912", two.times[1]),
        compare("first standstill of x2 after a step of 0.5 m: t (s)", "Fig. 4(a)", "0.5912", when),
        compare("first standstill of x2 after a step of 0.5 m: x2 (m)", "Fig. 4(a)", "1", where),
        Row(
            "vibration left", "Fig. 4(b)", "none", f"{residual(two):.0e} J", residual(two) < 1e-12,
            "exact times, by SciPy",
        ),
        Row(
            "2, 4, 6 impulses, m2 × 1.2: overshoot (%)", "Fig. 10", "lower with more",
            ", ".join(f"{value:.2f}" for value in several), bool(np.all(np.diff(several) < 0)),
            f"not so from 3 to 4 and from 5 to 6: {over['3 impulses']:.2f} and {over['5 impulses']:.2f} with 3 and 5",
        ),
        compare("negative shaper: A", "before Fig. 12", "1, -1, 1", found["negative"].amplitudes),
        compare("negative shaper: t (s)", "before Fig. 12", "0, 0.1079, 0.2158", found["negative"].times),
        compare(
            "arrival with positive and with negative impulses (s)", "Fig. 12", "0.5912, 0.2158",
            [two.duration, found["negative"].duration],
        ),
    ]  # fmt: skip


def rows_with_damper(exact: js.Shaper) -> list[Row]:
    """Fig. 5 and the integral after Eq. 5."""
    when, where = highest(0.525, C)
    two = js.design.energy.two_impulse(PLANT, 1.0)
    omega = np.pi / float(two.times[1])
    printed = C * omega**3 * (3 * np.pi / 16 / omega + np.sin(np.pi / omega) / 4 + np.sin(2 * np.pi / omega) / 32)

    def loss(shaper: js.Shaper) -> float:
        """The energy that the damper takes from the swing between the two levels, J."""
        first = float(shaper.amplitudes[0])
        return potential(first) - potential(1 - first)

    kinds = ("harmonic", "orbit")
    harmonic, orbit = (js.design.energy.two_impulse(DAMPED, 1.0, damping=kind) for kind in kinds)
    return [
        compare(
            "c = 0.1: A1 (m)", "before Fig. 5", "0.525", exact.amplitudes[0],
            "by trial and error in the paper; 0.5256 rounds to 0.526",
        ),
        compare(
            "c = 0.1: t2 (s)", "before Fig. 5", "0.5935", exact.times[1], "0.5935 belongs to A1 = 0.525, next row"
        ),
        compare("c = 0.1: when x2 is highest for A1 = 0.525 (s)", "Fig. 5(a)", "0.5935", when),
        Row(
            "c = 0.1: highest x2 for A1 = 0.525 (m)", "Fig. 5(a)", "1", f"{where:.6f}", False,
            "0.11 % short of the destination, less than a line's width",
        ),
        Row(
            "c = 0.1: energy left by A1 = 0.525, t2 = 0.5935 s (J)", "Fig. 5(b)", "none", f"{residual(TRIAL, c=C):.2e}",
            False, "not to be seen in a figure",
        ),
        Row(
            "c = 0.1: energy lost in a harmonic quarter cycle of amplitude x_d (J)", "after Eq. 5",
            "(3π/16ω + sin(π/ω)/4 + sin(2π/ω)/32) c x_d⁴ ω³", f"{loss(harmonic):.4f}", False,
            f"as printed {printed:.4f}: its terms have different dimensions; c x_d⁴ ω³ 3π/16 is right. The swing "
            f"itself, of amplitude x_d/2, loses {loss(exact):.6f}; the loss along the undamped orbit gives "
            f"A1 = {float(orbit.amplitudes[0]):.6f}",
        ),
    ]  # fmt: skip


def rows_of_the_robot() -> list[Row]:
    """The experiment: what can be computed from what was measured, and what cannot."""
    measured = "measured on the robot, whose parameters are not given"
    return [
        compare("A1, A2 from the angles", "after Fig. 7", "0.703, 0.297", np.array([27.58, 39.25 - 27.58]) / 39.25),
        cannot("angles of the motor's step and of the link's first peak (°)", "Fig. 7", "27.58, 39.25", measured),
        cannot("time of that peak (s)", "after Fig. 7", "0.24", measured),
        cannot("proportional gain", "before Fig. 8", "0.02", "its unit and the plant's are not given"),
    ]


def surpassed(
    found: dict[str, js.Shaper], worst_20: dict[str, float], exact: js.Shaper, robot: tuple[js.Solution, float, float]
) -> list[Surpassed]:
    """jshape's designs against the paper's: theirs by SciPy alone, jshape's by jshape and, to verify, by SciPy."""
    solution, stiffness, friction = robot

    def least(own: str, paper: str, what: str, limits: str) -> Surpassed:
        name = f"tuned, {own}"
        return worst_case(what, found[paper], found[name], worst_20[name], limits)

    six, sooner = found["6 impulses"], found["tuned, as three"]
    return [
        Surpassed(
            "two impulses, c = 0.1: residual energy", residual(TRIAL, c=C),
            float(js.residual_energy(DAMPED, exact, 1.0)), "J", "the energy left", residual(exact, c=C), 1e-14,
            "two impulses, in about 0.5935 s", words(exact),
        ),
        least("as two", "2 impulses", "in two impulses' time", "no impulse over 1 m either way, 0.59124 s"),
        least("as three", "6 impulses", "four impulses against six", "positive impulses, at most 4.79137 s"),
        Surpassed(
            "the same two: duration", float(six.duration), float(sooner.duration), "s",
            "the worst energy over the paper's", worst(sooner) / worst(six), 0.5, "as before", words(sooner), 0.0,
        ),
        least("as negative", "negative", "in the negative shaper's time", "impulses 1, −1, 1, in 0.21583 s"),
        Surpassed(
            "closed loop of the flexible joint: energy 0.6 s after the start", shaken(RECIPE, stiffness, friction),
            solution.objective, "J", "the energy then", shaken(solution.shaper, stiffness, friction), 1e-9,
            "two positive impulses in at most 0.24 s; a loop that answers as in Fig. 7", words(solution.shaper),
        ),
    ]  # fmt: skip


def joint(stiffness: float, friction: float) -> js.plants.FlexibleJoint:
    """The robot as ``identified``."""
    spring, controller = js.plants.Duffing(stiffness, CUBIC), js.plants.ProportionalController(KP)
    return js.plants.FlexibleJoint(MOTOR, LINK, spring, controller, motor_damping=friction)


# The figures.


def panels(runs: dict[str, js.Response], horizon: float, scale: float = 1.0, label: str = "(m)") -> Any:
    """x1 solid and x2 dotted, as the paper draws them, a panel a run."""
    drawn, axes = figure(len(runs), height=1.35, sharex=True)
    for axis, (title, run) in zip(axes[:, 0], runs.items(), strict=True):
        axis.step(run.times, scale * run.command, where="post", color="0.35", label="$x_1$")
        axis.plot(run.times, scale * run.payload, color=COLOURS[0], linestyle=":", linewidth=1.6, label="$x_2$")
        axis.set_title(title, loc="left")
        axis.set(xlim=(0, horizon), ylabel=f"displacement {label}")
    axes[-1, 0].set_xlabel("time (s)")
    drawn.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return drawn


def of_the_robot(runs: dict[str, js.Response]) -> tuple[Any, Any]:
    """Figs. 7 and 8 of a loop that was made to answer like the robot."""
    first, axes = figure(height=2.2)
    step = runs["step"]
    axes[0, 0].plot(step.times, np.degrees(step.states[:, 0]), color="0.35", linestyle=":", label="motor, $x_1$")
    axes[0, 0].plot(step.times, np.degrees(step.payload), color=COLOURS[0], label="link, $x_2$")
    axes[0, 0].set(xlabel="time (s)", ylabel="angle (°)", xlim=(0, 0.8))
    axes[0, 0].legend()
    second, axes = figure(2, height=1.7, sharex=True)
    for i, name in enumerate(("without shaper", "the paper's recipe", "jshape")):
        run = runs[name]
        axes[0, 0].plot(run.times, np.degrees(run.payload), color=COLOURS[i], label=name)
        axes[1, 0].plot(run.times, np.degrees(run.states[:, 3]), color=COLOURS[i])
    axes[0, 0].set(ylabel="link (°)", xlim=(0, 2))
    axes[1, 0].set(ylabel="link's speed (°/s)", xlabel="time (s)")
    second.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return first, second


def pictures(found: dict[str, js.Shaper], robot: tuple[js.Solution, float, float]) -> list[Picture]:
    """Every figure but the diagrams, Figs. 1 to 3, 9 and 11, and the drawing of the robot, Fig. 6."""

    def run(shaper: js.Shaper, m2: float = 1.0, c: float = 0.0, size: float = 1.0, horizon: float = 2.0) -> js.Response:
        plant = js.plants.TwoMass(1.0, m2, spring=SPRING, damper=js.plants.PowerDamper(c, 3))
        return js.simulate(plant, size, shaper.pad(LONGEST), horizon=horizon, samples=401)

    single = js.Shaper([1.0], [0.0])
    heavy = {
        f"({letter}) $n$ = {n}": run(found[f"{n} impulses"], 1.2, horizon=7.0)
        for letter, n in (("a", 2), ("b", 4), ("c", 6))
    }
    heavy["jshape, 4 impulses in 1.643 s"] = run(found["tuned, as three"], 1.2, horizon=7.0)
    solution, stiffness, friction = robot
    plant = joint(stiffness, friction)
    turned = {
        name: js.simulate(plant, size, shaper.pad(2), horizon=2.0, samples=401)
        for name, size, shaper in (
            ("step", STEP, single),
            ("without shaper", PEAK, single),
            ("the paper's recipe", PEAK, RECIPE),
            ("jshape", PEAK, solution.shaper),
        )
    }
    seventh, eighth = of_the_robot(turned)
    drawn = {
        "04": (
            panels({"(a)": run(single, size=0.5), "(b)": run(found["2 impulses"])}, 2.0),
            "Without damper: one amplitude, and both",
        ),
        "05": (
            panels({"(a)": run(single, c=C, size=0.525), "(b)": run(TRIAL, c=C)}, 2.0),
            "With damper, c = 0.1: the paper's amplitude and time",
        ),
        "07": (seventh, "Motor and link after a step (a loop made to answer like the robot)"),
        "08": (eighth, "Link with and without shaper (the same loop; the speed in °/s, not volts)"),
        "10": (
            panels(heavy, 7.0),
            "Fig. 10 of 2017, 20 % more payload than expected; below, jshape's four impulses",
        ),
        "12": (panels({"": run(found["negative"])}, 2.0), "The negative input shaper"),
    }
    return frame.pictures("000", drawn, "10")


def results(draw: bool = True) -> Paper:
    """The whole paper; the figures only if they are wanted."""
    found = shapers()
    padded = {name: shaper.pad(LONGEST) for name, shaper in found.items()}
    metrics = ["residual_energy", "overshoot"]
    data = js.sweep(PLANT, padded, 1.0, over={"m2": TWENTY}, metric=metrics, estimate_error=False)
    worst_20 = {name: float(data.residual_energy.sel(shaper=name).max()) for name in found}
    over = {name: 100 * float(data.overshoot.sel(shaper=name)[-1]) for name in found}
    exact = js.design.energy.two_impulse(DAMPED, 1.0)
    stiffness, friction = identified()
    tuned = js.tune(joint(stiffness, friction), PEAK, impulses=2, duration=(0, WHEN), metric=later, starts=8)
    robot = tuned, stiffness, friction
    return Paper(
        "000",
        "Input shaping for flexible system with nonlinear spring and damper",
        "Withit Chatlatanagulchai, Ittidej Moonmangmee and Pisit Intarawirat, IMECE2017-71345, 2017.",
        [*rows_without_damper(found, over), *rows_with_damper(exact), *rows_of_the_robot()],
        pictures(found, robot) if draw else [],
        surpassed(found, worst_20, exact, robot),
        [
            *NOTES,
            f"The robot's parameters are not given. A motor of {MOTOR} kg m², a link of {LINK} kg m², a spring of "
            f"{stiffness:.4f} θ + {CUBIC:g} θ³ N m, a gain of {KP:g} N m/rad and a motor friction of {friction:.4f} "
            "N m s/rad peak when and where Fig. 7 has it; Figs. 7 and 8 are drawn with these. The motor lags, so that "
            "the recipe of Fig. 7 is not exact in a closed loop, and an earlier second impulse is far better.",
        ],
    )


NOTES = (
    "Figs. 1 to 3, 9 and 11 are diagrams, Fig. 6 a drawing.",
    "Eq. 6: the lower limit is x_di − (x_di + A_i2), and after it A_i2 stands where A_12 is printed. In the formula of "
    "the speed after Eq. 9 m2 belongs inside the root.",
    "More impulses are not always better: three impulses beat four, for equal steps cancel "
    "errors in the mass to first order only for odd numbers of impulses.",
)
