"""Every shaper that applies to a problem, side by side: what each leaves over the uncertainty.

``build`` evaluates the shapers; ``jshape.reports.report_files.write`` writes the folder.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jshape._types import silent
from jshape.axes import moving
from jshape.command import as_command
from jshape.design.closed_forms import closed_forms
from jshape.design.tuning.solution import Solution
from jshape.export.text import impulses
from jshape.metrics import residual_energy
from jshape.problems.problem import Problem
from jshape.reports import limits_kept
from jshape.reports.responses import responses
from jshape.shaper import Shaper, Shaping, shaped
from jshape.sweeps.evaluate import CHECKED, Study, alike_shapers, evaluate, run_first_chunk, study
from jshape.sweeps.leaves import leaf
from jshape.sweeps.quantities import as_metrics

BETWEEN = 100
"""Plants, about, among which the worst case of a single uncertain leaf is looked for."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One shaper's numbers.

    Attributes:
        name: of the shaper.
        shaper: the shaper, or axis → shaper.
        nominal_energy: residual energy of the nominal plant, J; NaN where it was not computed.
        worst_energy: greatest residual energy over the stated uncertainty, J, of a single leaf also between its values;
            ``None`` where nothing is uncertain.
        worst_vibration: likewise, the residual vibration, a fraction of the distance; of several axes the greatest.
        played: what a controller plays of a shaper whose impulses fall between its samples, of which the numbers are.
        exceeded: the limit on the move that it exceeds, in words.
    """

    name: str
    shaper: Shaper | dict[str, Shaper]
    nominal_energy: float
    worst_energy: float | None
    worst_vibration: float | None
    played: Shaper | None = None
    exceeded: str = ""

    @property
    def shapers(self) -> dict[str, Shaper]:
        """Axis → shaper; ``""`` → the shaper, where one shapes everything."""
        return self.shaper if isinstance(self.shaper, dict) else {"": self.shaper}

    @property
    def stem(self) -> str:
        """The name of its files."""
        return stem_of(self.name)

    @property
    def duration(self) -> float:
        """Of the shaper that takes longest, s."""
        return max(float(shaper.duration) for shaper in self.shapers.values())

    @property
    def impulses(self) -> int:
        """Of the shaper that has most."""
        return max(len(shaper.times) for shaper in self.shapers.values())


def _worst_energy(row: Row) -> float:
    return row.worst_energy or 0.0


def stem_of(name: str) -> str:
    """The name of a shaper's files."""
    return name.replace(",", "").replace(" ", "_").replace("-", "_")


@dataclasses.dataclass(frozen=True)
class Curves:
    """Sensitivity of each shaper's residual vibration to a leaf.

    Attributes:
        ratios: the leaf's values over nominal.
        values: the same in the leaf's unit.
        vibrations: of each shaper, fractions of the distance.
    """

    ratios: np.ndarray
    values: np.ndarray
    vibrations: dict[str, np.ndarray]


MOST_SAMPLES = 100_000
"""Of a closed-form shaper, at most, where its impulses are split between samples."""

ALIKE = 0.01
"""Durations that differ by less, as a part of them, count as the same."""


@dataclasses.dataclass(frozen=True)
class Report:
    """A problem's shapers compared.

    Attributes:
        problem: the problem.
        rows: of every shaper, the tuned one last.
        left_out: the closed forms that do not apply, and why.
        curves: leaf → sensitivity to it.
        solution: the tuned one, if there is one.
    """

    problem: Problem
    rows: list[Row]
    left_out: dict[str, str]
    curves: dict[str, "Curves"]
    solution: Solution | None

    def move_time(self, row: Row) -> float:
        """From the first impulse to the end of the shaped command, s."""
        move, shaper = as_command(self.problem.distance), placed(self.problem, row.played or row.shaper)
        if isinstance(shaper, Shaper):
            # An impulse of nothing takes no time.
            times = np.asarray(shaper.times)[np.asarray(shaper.amplitudes) != 0]
            return float(np.max(times, initial=0.0)) + float(move.duration)
        return float(shaped(move, shaper).duration)

    @property
    def advised(self) -> Row:
        """The shaper to go on with: the tuned one, or a closed form that takes no longer, exceeds no limit and leaves
        less of the worst case that was to be minimised."""
        tuned = self.rows[-1]
        if tuned.worst_energy is None or self.problem.objective != "worst":
            return tuned
        longest = tuned.duration * (1 + ALIKE)
        short = [row for row in self.rows if row.worst_energy is not None and row.duration <= longest]
        best = min((row for row in short if not row.exceeded), key=_worst_energy, default=tuned)
        return best if _worst_energy(best) < tuned.worst_energy else tuned

    def gains(self) -> list[str]:
        """The gain of tuning over the best closed form that takes no longer, in words, and what more time would bring;
        nothing where no worst cases are compared. Closed forms that exceed a limit on the move do not count."""
        tuned = next((row for row in self.rows if row.name == "tuned"), None)
        if tuned is None or tuned.worst_energy is None or self.problem.objective != "worst":
            return []
        others = [row for row in self.rows if row is not tuned]
        kept, longest = [row for row in others if not row.exceeded], tuned.duration * (1 + ALIKE)
        gains = self._gain(tuned, [row for row in others if row.duration <= longest])
        if not gains:
            return []
        allowed = self.problem.design.duration
        if isinstance(allowed, list) and tuned.duration > (1 - 1e-3) * max(allowed):
            gains.append(f"it takes all of the {max(allowed):g} s that [design] duration allows: more may leave less")
        least = min(kept, key=_worst_energy, default=tuned)
        if least.worst_energy is not None and least.worst_energy < tuned.worst_energy and least.duration > longest:
            more = self.move_time(least) - self.move_time(tuned)
            left = f"{least.worst_energy:.6g} {self.problem.plant.energy_unit}"
            gains.append(f"{least.name} leaves {left}, but takes {more:.3g} s longer")
        return gains

    @property
    def exceeding(self) -> str:
        """Which shapers exceed limits on the move, and which ones, in words; ``""`` where none does."""
        words = [f"{row.name} ({row.exceeded})" for row in self.rows if row.exceeded]
        return f"limits are exceeded by {', '.join(words)}" if words else ""

    def _gain(self, tuned: Row, others: list[Row]) -> list[str]:
        """Beside the best of the others, which take no longer, that keeps the limits, if it leaves something."""
        unit = self.problem.plant.energy_unit
        left = f"worst residual energy {tuned.worst_energy:.6g} {unit}"
        kept = [row for row in others if not row.exceeded]
        if not kept:
            return [f"{left}: no closed form that takes no longer keeps the limits"]
        best = min(kept, key=_worst_energy)
        if not best.worst_energy or not tuned.worst_energy or not np.isfinite(best.worst_energy):
            return []
        ratio = best.worst_energy / tuned.worst_energy
        words = f"{ratio:.3g} times less than" if ratio > 1 else f"{1 / ratio:.3g} times more than"
        known = f"{best.name}, the best closed form that takes at most {100 * ALIKE:g} % longer"
        if best.name == "unshaped":
            keeps = " and keeps the limits" if len(kept) < len(others) else ""
            worse = f"no closed form that takes no longer{keeps} leaves less"
            known = f"the bare command; {worse if len(others) > 1 else 'no closed form takes no longer'}"
        return [f"{left}: {words} the {best.worst_energy:.6g} {unit} of {known}"]


Step = Callable[[str], None]
"""Called with the name of what is being done."""


def interrupted(problem: Problem, solution: Solution) -> Report:
    """The report of an interrupted search, without any computation: its best shaper so far."""
    worst = solution.objective if problem.objective == "worst" else None
    return Report(problem, [Row("tuned", solution.shaping, np.nan, worst, None)], {}, {}, solution)


def build(
    problem: Problem,
    solution: Solution | None,
    step: Step = silent,
    closed: tuple[dict[str, Shaper], dict[str, str]] | None = None,
) -> Report:
    """Evaluate every shaper of a problem, the tuned one last, all on the machine as it was designed.

    Args:
        problem: the problem.
        solution: its tuned shaper, if there is one.
        step: called with what is being done.
        closed: what ``closed_forms`` returned, where that has been called already.
    """
    step("closed-form shapers")
    if solution is not None and solution.leaves:
        problem, closed = _as_designed(problem, solution), None
    found, left_out = closed_forms(problem.plant, problem.distance) if closed is None else closed
    exact: dict[str, Any] = {**found, **({} if solution is None else {"tuned": solution.shaping})}
    split = split_between(found, problem.design.sample_time)
    shapers = {name: placed(problem, shaper) for name, shaper in {**exact, **split}.items()}
    curves: dict[str, Curves] = {}
    energies: Any = [None] * len(shapers)
    vibrations: Any = [None] * len(shapers)
    if not problem.over:
        step("nominal residual energies")
        alike = alike_shapers(list(shapers.values()), problem.plant.axes)
        nominal = [float(residual_energy(problem.plant, shaper, problem.distance)) for shaper in alike]
    else:
        widths = {name: _wide(values) for name, values in problem.over.items()}
        alone = len(widths) == 1
        step("residual energies and vibrations over the uncertainty")
        judged, over = _judged(problem)
        energy, vibration = _swept(problem, shapers, over)
        nominal = energy[(slice(None), *(-1 for _ in over))].tolist()
        stated = (slice(None), *(slice(len(values)) for values in judged.values()))
        leaves = tuple(range(1, 1 + len(over)))
        energies, vibrations = (data[stated].max(axis=leaves) for data in (energy, vibration))
        if alone:
            closer = _swept(problem, shapers, _at_the_peaks(energy[stated], judged, over))
            energies, vibrations = (
                np.maximum(known, data.max(axis=1)) for known, data in zip((energies, vibrations), closer, strict=True)
            )
        energies, vibrations = energies.tolist(), vibrations.tolist()
        for name in problem.over:
            step(f"sensitivity to {name}")
            wide, along = widths[name], vibration[:, len(judged[name]) : -1]
            if not alone:
                # With all leaves, though the others do not vary: by the program that there is.
                only = {other: wide if other == name else [1.0] for other in problem.over}
                along = _swept(problem, shapers, only)[1].reshape(len(shapers), -1)
            curves[name] = Curves(wide, wide * float(leaf(problem.plant, name)), dict(zip(shapers, along, strict=True)))
    exceeded = [""] * len(shapers)
    if limits_kept.limits_of(problem).any:
        step("limits")
        exceeded = limits_kept.exceeded(problem, shapers)
    numbers = zip(exact, exact.values(), nominal, energies, vibrations, map(split.get, exact), exceeded, strict=True)
    rows = [Row(*values) for values in numbers]
    return Report(problem, rows, left_out, curves, solution)


def placed(problem: Problem, shaper: Shaping) -> Shaping:
    """A shaper on the axes that are to be shaped, where ``[design] shapers`` names some, as the tuned one stands there;
    one for each axis stays as it is."""
    axes = problem.design.shapers
    return dict.fromkeys(axes, shaper) if isinstance(axes, list) and isinstance(shaper, Shaper) else shaper


def _at_the_peaks(
    energies: np.ndarray, judged: dict[str, list[float]], over: dict[str, list[float]]
) -> dict[str, np.ndarray]:
    """Multiples of the single leaf around each shaper's worst one, between its neighbours; as many as before, so that
    the same program computes them.

    Args:
        energies: J, shape (shapers, multiples).
        judged: the leaf's multiples among which the worst were found.
        over: all that were computed.
    """
    ((name, values),) = judged.items()
    order, count = np.argsort(values), len(over[name])
    sorted_values, worst = np.asarray(values)[order], np.argmax(energies[:, order], axis=1)
    low, high = (sorted_values[np.clip(worst + by, 0, len(values) - 1)] for by in (-1, 1))
    share = np.arange(count) // len(energies) / max(1, (count - 1) // len(energies))
    which = np.arange(count) % len(energies)
    return {name: low[which] + share * (high - low)[which]}


def split_between(shapers: Mapping[str, Shaping], sample_time: float | None) -> dict[str, Shaper]:
    """Those shapers whose impulses fall between a controller's samples, s, each impulse split between the samples
    around it, as ``js.export`` does; where samples are so fine that none can tell, nothing is split."""
    split = {}
    for name, shaper in shapers.items():
        if sample_time is None or not isinstance(shaper, Shaper):
            continue
        if not 0 < float(shaper.duration) <= MOST_SAMPLES * sample_time:
            continue
        played = impulses(shaper.digitise(sample_time, "split"), sample_time)
        if len(played.times) != len(shaper.times) or not np.allclose(played.times, shaper.times, 1e-9, 0.0):
            split[name] = played
    return split


def _as_designed(problem: Problem, solution: Solution) -> Problem:
    """The problem with those parameters of the machine that were designed with the shaper."""
    words = ", ".join(f"{name} {value:.6g}" for name, value in solution.leaves.items())
    line = f"the machine as designed, for all shapers: {words}"
    return dataclasses.replace(problem, plant=solution.plant, understood=[*problem.understood, line])


def rehearse(problem: Problem, closed: dict[str, Shaper], tuned: Shaping) -> None:
    """Compile what ``build`` will run, while others search for the tuned shaper.

    This function stands for speed alone: it takes up to ten seconds from the first process of a problem.

    Args:
        problem: the problem.
        closed: its closed forms.
        tuned: any shaper of the tuned one's form.
    """
    shapers = {**closed, **split_between(closed, problem.design.sample_time), "tuned": tuned}
    shapers = {name: placed(problem, shaper) for name, shaper in shapers.items()}
    limits_kept.rehearse(problem, shapers)
    if problem.over:
        run_first_chunk(_study(problem, shapers, _judged(problem)[1]))
    *_, alike = alike_shapers(list(shapers.values()), problem.plant.axes)
    longest = max(float(shaper.duration) for shaper in closed.values())
    for _ in responses(problem, {"tuned": alike}, alike, longest + float(as_command(problem.distance).duration)):
        pass


def _judged(problem: Problem) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Multiples of each leaf among which the worst case is looked for; and all that are computed.

    The nominal plant rides along as the last value of every leaf; with a single leaf, plants between those that are
    stated and its curve before it, so that one program computes all.
    """
    alone = len(problem.over) == 1
    judged = {name: _between(values) if alone else list(values) for name, values in problem.over.items()}
    return judged, {
        name: [*values, *(_wide(problem.over[name]) if alone else ()), 1.0] for name, values in judged.items()
    }


def _study(problem: Problem, shapers: dict[str, Any], over: dict[str, Any]) -> Study:
    metrics = as_metrics(CHECKED, moving(problem.plant, problem.distance))
    return study(problem.plant, shapers.values(), problem.distance, over, tuple(metrics))


def _swept(problem: Problem, shapers: dict[str, Any], over: dict[str, Any]) -> list[np.ndarray]:
    """Energy and vibration of every shaper (the first axis) over a grid of multiples of the leaves (the others).

    Of several axes of the machine, the greatest vibration.
    """
    asked = _study(problem, shapers, over)
    shape = len(shapers), *(len(values) for values in asked.absolute.values())
    energies, *vibrations = evaluate(asked)
    return [energies.reshape(shape), np.max(vibrations, axis=0).reshape(shape)]


def _between(values: Any) -> list[float]:
    """The stated values and others evenly between them: a vibration may be greatest where none is stated."""
    ends = np.sort(np.asarray(values, float))
    times = max(1, round(BETWEEN / len(ends)))
    at = np.arange((len(ends) - 1) * times + 1) / times
    return [*values, *np.setdiff1d(np.interp(at, np.arange(len(ends)), ends), ends)]


def _wide(values: Any) -> np.ndarray:
    """The ratios of a sensitivity curve: twice as far as the stated uncertainty, from 1 or, where it does not hold 1,
    from its middle; none less than 0.2, or than half of the least that is stated."""
    least, greatest = float(min(values)), float(max(values))
    middle = 1.0 if least <= 1 <= greatest else (least + greatest) / 2
    floor = min(0.2, least / 2 if least > 0 else least)
    return np.linspace(max(2 * least - middle, floor), 2 * greatest - middle, 121)


def best(report: Report) -> Row:
    """The closed form that leaves the least: of its worst vibration, or of its energy where nothing is uncertain."""
    rows = [row for row in report.rows if row.name not in ("unshaped", "tuned")]
    if not rows:
        raise ValueError(f"no closed form applies to {report.problem.name}: {'; '.join(report.left_out.values())}")
    return min(rows, key=badness)


def badness(row: Row) -> float:
    """Worst vibration, or worst energy where a machine ends where it began, or nominal energy where nothing is
    uncertain."""
    left = row.nominal_energy if row.worst_energy is None else row.worst_energy
    if row.worst_vibration is not None and not np.isnan(row.worst_vibration):
        left = row.worst_vibration
    return left if np.isfinite(left) else np.inf
