"""The experiment of paper_002, Figs. 7 to 11, run again: cases I, I-D and I-D-E; and jshape's state-aware strategy.

The square wave is that of ``jshape adapt paper_002``, whose problem file says what the paper leaves open: a clock of
5 ms, sensors with noise, and changes of the payload half a second into a move. Random schedules show how soon a
strategy has recovered from a change that nobody announces.
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import jshape as js
from experiments.papers import paper_002_judge as judge
from experiments.papers.frame import Row, Surpassed, cannot
from experiments.papers.paper_002_link import TICK
from jshape.adaptive.closed_loop import loop_figures as figures
from jshape.adaptive.closed_loop import report
from jshape.problems import problem

SCHEDULES, SEED = 50, 0
"""Of the random schedules; experiments/adaptive has 500."""


def experiment() -> report.Experiment:
    """400 s of a square wave of ±30° and 20 s with 20, 10, 0 and 20 coins, every case with a link of its own."""
    return report.experiment(problem.load("paper_002").adapting(schedules=0))


def carried(run: report.Experiment) -> np.ndarray:
    """The number of coins on the link at each tick."""
    return np.asarray(run.schedule.loads)[np.asarray(run.schedule.which)]


def _spectra(run: report.Experiment, name: str, signal: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (s), frequencies (rad/s) and DFT magnitudes (m/s²) of an acceleration, ``tip`` or ``middle``."""
    given, mode = run.problem.adapt, ("tip", "middle").index(signal)
    return figures.spectra(getattr(run.traces[name], signal), given.bands[mode], given.sample_time, given.points)


def _magnitudes(run: report.Experiment, name: str, signal: str) -> list[float]:
    """The highest DFT magnitude within 1 rad/s (first mode) or 6 (second) of the truth as each payload leaves, m/s²."""
    mode, near = {"tip": (0, 1.0), "middle": (1, 6.0)}[signal]
    time, omega, magnitude = _spectra(run, name, signal)
    found = []
    for coins, _, last in run.loads():
        row = int(np.searchsorted(time, last * run.problem.adapt.period / 2)) - 1
        found.append(float(np.max(magnitude[row][np.abs(omega - judge.modes(coins)[mode]) < near])))
    return found


def rows_of_adaption(run: report.Experiment) -> list[Row]:
    """The statements of the paper about Figs. 7 to 11."""
    return [*rows_of_frequencies(run), *rows_of_vibration(run), *rows_of_settling(run)]


def _listed(values: Any, digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _last_ticks(run: report.Experiment) -> list[int]:
    """The last tick with each payload."""
    return [int(np.flatnonzero(np.asarray(run.schedule.move) == last - 1)[-1]) for _, _, last in run.loads()]


def rows_of_frequencies(run: report.Experiment) -> list[Row]:
    """Figs. 7 to 9: what the DFT finds."""
    omega = np.asarray(run.traces["I-D-E"].omega)[_last_ticks(run)]
    point = 2 * np.pi / run.problem.adapt.points / run.problem.adapt.sample_time
    tip, middle = ({name: _magnitudes(run, name, part) for name in ("I", "I-D-E")} for part in ("tip", "middle"))
    most = {name: float(np.max(_spectra(run, name, "middle")[2])) for name in ("I", "I-D-E")}
    true = np.array([judge.modes(float(coins)) for coins in run.schedule.loads])[np.asarray(run.schedule.which)]
    apart = np.sqrt(np.mean((np.asarray(run.traces["I-D-E"].omega) - true) ** 2, axis=0))

    def passed(tuned: float) -> float:
        """The share of the second mode that a filter for that frequency passes, %."""
        return 100 * float(js.percentage_vibration(js.design.linear.zvd(tuned, 0.017), 66.0, 0.019))

    several = [passed(tuned) for tuned in np.linspace(5.4, 6.0, 61)]
    return [
        Row(
            "first mode found by the DFT, 20, 10 and 0 coins (rad/s), in I-D-E", "Figs. 8(c), 9(a)",
            "approximately 5.7, 7.3, 8.5", _listed(omega[:3, 0], 3),
            bool(np.all(np.abs(omega[:3, 0] - [5.7, 7.3, 8.5]) < point)),
            f"in the last move with each; within a point of 3,000 at 5 ms, {point:.3f} rad/s",
        ),
        Row(
            "second mode found by the DFT, 20, 10, 0 and 20 coins (rad/s), in I-D-E", "Figs. 8(d), 9(c)", "65 to 75",
            _listed(omega[:, 1], 2), bool(np.all((omega[:, 1] > 65) & (omega[:, 1] < 75))),
            "in the last move with each",
        ),
        Row(
            "departure of the first and of the second mode's frequency from the truth, rms (rad/s)", "Fig. 9",
            "the second fluctuates more", _listed(apart, 2), bool(apart[1] > apart[0]), "all 400 s of I-D-E",
        ),
        Row(
            "DFT magnitude of a_p near the first mode, in I and in I-D-E, 20, 10 and 0 coins (m/s²)",
            "Figs. 7, 8(a), (c)", "higher in I", f"{_listed(tip['I'][:3], 0)}; {_listed(tip['I-D-E'][:3], 0)}",
            bool(np.all(np.array(tip["I"][:2]) > 2 * np.array(tip["I-D-E"][:2]))),
            "as each payload leaves; at 0 coins case I is tuned well already, as the paper says",
        ),
        Row(
            "DFT magnitude of a_m near the second mode, in I and in I-D-E, 20, 10 and 0 coins (m/s²)",
            "Figs. 7, 8(b), (d)", "lower in I-D-E, less obviously",
            f"{_listed(middle['I'][:3], 1)}; {_listed(middle['I-D-E'][:3], 1)}",
            bool(np.all(np.array(middle["I-D-E"][:3]) < middle["I"][:3])),
            "the fixed filter for 70 rad/s is near enough, and what is left depends on where the first mode's happens "
            f"to have its notches: at 66 rad/s one for 9 rad/s passes {passed(9.0):.0f} %, those for 5.4 to 6 rad/s "
            f"{min(several):.0f} to {max(several):.0f} %; soon after a change I-D-E leaves more, "
            f"{most['I-D-E']:.0f} m/s² at most, I {most['I']:.0f}",
        ),
    ]  # fmt: skip


def rows_of_vibration(run: report.Experiment) -> list[Row]:
    """Fig. 10: the accumulated vibration, and the damping ratios."""
    loads, total = run.loads(), {name: float(values.sum()) for name, values in run.accumulated.items()}
    zeta = np.asarray(run.traces["I-D-E"].zeta)[_last_ticks(run)]
    drifting = np.ptp(np.asarray(run.traces["I-D-E"].zeta), axis=0)
    measured = "a measurement on a link with friction; the simulated one has only its sensors' noise to leave behind"

    def whole(name: str, i: int) -> float:
        """The mean over all moves with a payload, m/s."""
        return float(np.mean(run.accumulated[name][loads[i][1] : loads[i][2]]))

    def late(name: str, i: int) -> float:
        """The mean over the last five moves with it, m/s."""
        return float(np.mean(run.accumulated[name][loads[i][2] - 5 : loads[i][2]]))

    def less(mean: Callable[[str, int], float], i: int) -> float:
        """By how much I-D-E has less than I, %."""
        return 100 * (1 - mean("I-D-E", i) / mean("I", i))

    return [
        Row(
            "accumulated vibration without shaping over that of I, I-D, I-D-E", "section 'experimental results'",
            "far worse", _listed([total["unshaped"] / total[name] for name in ("I", "I-D", "I-D-E")], 1),
            bool(total["unshaped"] > 5 * total["I"]), "Eq. 6 over the whole 400 s",
        ),
        Row(
            "accumulated vibration: I-D-E less than I, 20 coins (%)", "Fig. 10", "33",
            f"{less(whole, 0):.0f}; {less(late, 0):.0f} over the last five moves", False, measured,
        ),
        Row(
            "accumulated vibration: I-D-E less than I, 10 coins (%)", "Fig. 10", "25",
            f"{less(whole, 1):.0f}; {less(late, 1):.0f} over the last five moves", False, measured,
        ),
        Row(
            "accumulated vibration: I-D-E less than I, 0 coins (%)", "Fig. 10", "not reduced much",
            f"{round(less(whole, 2))}; {less(late, 2):.0f} over the last five moves", bool(abs(less(whole, 2)) < 15),
        ),
        Row(
            "accumulated vibration of I-D-E and of I-D, all 400 s (m/s)", "Figs. 10(a), (b)", "less with I-D-E",
            f"{total['I-D-E']:.1f}, {total['I-D']:.1f}", bool(total["I-D-E"] < 0.99 * total["I-D"]),
            f"the damping ratios wander by {drifting[0]:.4f} and {drifting[1]:.4f}, which changes V by less than "
            "0.07 % each",
        ),
        Row(
            "damping ratios of both modes in I-D-E as each payload leaves", "Figs. 9(b), (d)",
            "adapted in the same way", f"{_listed(zeta[:, 0], 4)}; {_listed(zeta[:, 1], 4)}",
            None,
            "printed is one perturbation of 2 rad/s for both, which cannot but move them alike; here the second has "
            "2.6, both in rad a move, so that each follows its own gradient and meets its own cost",
        ),
        Row(
            "accumulated vibration of case I in the unit that makes it 0.3 with 20 coins: 10 coins", "Fig. 10(c)",
            "0.2", f"{0.3 * late('I', 1) / late('I', 0):.3f}", None,
            f"measured, in a unit not given; one of {late('I', 0) / 0.3:.0f} m/s makes it 0.3, the moves included",
        ),
        Row(
            "accumulated vibration of I-D-E in that unit, 20 and 10 coins", "Fig. 10(a)", "0.2, 0.15",
            ", ".join(f"{0.3 * late('I-D-E', i) / late('I', 0):.3f}" for i in (0, 1)), None,
            "measured; over the last five moves with each payload",
        ),
    ]  # fmt: skip


def rows_of_settling(run: report.Experiment) -> list[Row]:
    """Fig. 11: the settling time; and what was chosen."""
    loads = run.loads()
    settled = {name: np.array([run.settling[name][last - 1] for _, _, last in loads]) for name in ("I", "I-D-E")}
    first = next(i + 1 for i in range(loads[0][1], loads[0][2]) if run.settling["I-D-E"][i] < 1.5)
    return [
        Row(
            "settling time of case I, 20 coins (s)", "Fig. 11(b)", "10.5", f"not within {settled['I'][0]:.0f}", None,
            "measured, by a criterion not given; to 2 % of the move here, and a half period of the reference is 10 s",
        ),
        Row(
            "settling time of I-D-E, 20 coins (s)", "Fig. 11(a)", "1.5", f"{settled['I-D-E'][0]:.2f}", None,
            f"measured, by a criterion not given; to 2 % of the move here, below 1.5 s from the {first}th move on",
        ),
        Row(
            "settling time reduced by at least (%), 20 coins", "Fig. 11", "around 85",
            f"{100 * (1 - settled['I-D-E'][0] / settled['I'][0]):.0f}",
            bool(80 < 100 * (1 - settled["I-D-E"][0] / settled["I"][0]) < 90),
            "at least: case I has not settled when the next move begins",
        ),
        cannot(
            "amplitudes and gains of extremum seeking", "section 'applying'", "0.0001, 0.00015, −0.007, −0.01",
            "chosen; used here as printed, with perturbations of 2 and 2.6 rad a move and the unit of 75 m/s for the "
            "cost",
        ),
        cannot(
            "magnitudes from which a peak counts", "section 'applying'", "7, 10",
            "the unit of |A_p| and |A_m| is not given; in m/s² the sensors' noise and the first mode's side lobes "
            "pass, too, and put wrong frequencies in the place of right ones: 150 and 20 m/s² are used here",
        ),
    ]  # fmt: skip


def surpassed() -> tuple[Surpassed, str]:
    """Random schedules with one unannounced change of payload: what is left in the second move that begins after it.

    Also a note with the shares of schedules. Both strategies are judged by the commands that they gave in the schedule
    in which they left most.
    """
    strategies = {name: js.adaptive.case(name, TICK) for name in ("I-D", "state-aware")}
    plant = js.plants.FlexibleLink()
    found = js.adaptive.study(plant, strategies, schedules=SCHEDULES, seed=SEED, chunk=25)
    second = found.residual.sel(move=2)

    @jax.jit
    def again(key: Any) -> tuple[Any, ...]:
        drawn, noise = jax.random.split(key)
        schedule, first = js.adaptive.random_moves(drawn, sample_time=TICK)
        link = js.adaptive.SampledLink(plant, schedule.loads, TICK)
        traces = js.adaptive.run(link, strategies, schedule.reference, schedule.which, key=noise)
        return {name: trace.command for name, trace in traces.items()}, schedule, first

    judged = {}
    for name in strategies:
        worst = int(np.argmax(second.sel(strategy=name).values))
        commands, schedule, first = again(jax.random.split(jax.random.key(SEED), SCHEDULES)[worst])
        coins = np.asarray(schedule.loads)[np.asarray(schedule.which)]
        judged[name] = judge.residual(
            np.asarray(commands[name]), np.asarray(schedule.reference), coins, TICK, int(first) + 1
        )
    ours = second.sel(strategy="state-aware").values
    below = {name: int((second.sel(strategy=name) < 0.05).sum()) for name in strategies}
    claim = Surpassed(
        "largest residual of the second move that begins after a change of payload, over the move", judged["I-D"],
        float(ours.max()), "", "SciPy: the link under the commands of the worst schedule", judged["state-aware"], 1e-7,
        f"{SCHEDULES} random schedules, noisy sensors, changes unannounced; theirs is I-D",
        "the state-aware strategy: least squares while moving, each move begun from the vibration that is there",
    )  # fmt: skip
    note = (
        f"Of {SCHEDULES} random schedules the state-aware strategy leaves less than 5 % of the move in the second move "
        f"after the change in {below['state-aware']} (median {100 * np.median(ours):.2f} %, largest "
        f"{100 * ours.max():.2f} %), I-D in {below['I-D']} (median "
        f"{100 * float(second.sel(strategy='I-D').median()):.2f} %). experiments/adaptive has 500."
    )
    return claim, note
