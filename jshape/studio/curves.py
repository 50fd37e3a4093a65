"""What a page draws of a state: computed by jshape's public functions, in stages, so that the newest state wins.

``stages(state)`` yields results, those together that are to be drawn in one picture; who draws them may stop between
two stages. While a slider moves, the sensitivity is drawn for fewer plants; where they take long at a larger tolerance,
too, and it says that it is a draft. Once the slider rests the last stages compute it for all plants at the tolerance of
every other command.
"""

import dataclasses
import functools
from collections.abc import Iterator

import numpy as np

from jshape.command import AbstractCommand, as_command
from jshape.memory import bound_memory
from jshape.metrics import residual_energy
from jshape.plants import AbstractOscillator, AbstractPlant, ModalPlant
from jshape.problems.problem import Problem
from jshape.reports.places import bent_along, motion_of
from jshape.reports.responses import shown_until
from jshape.shaper import Shaper, shaped
from jshape.simulation.response import Response
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import fastest, natural_frequencies, simulate
from jshape.simulation.steps import TOLERANCE
from jshape.studio.results import Ends, Linear, Moves, Numbers, Pinned, Result, Sensitivity
from jshape.studio.state import Files, Pin, State, check_sizes, problem
from jshape.sweeps.evaluate import side_by_side, study
from jshape.sweeps.leaves import changed, check_over
from jshape.vibration import percentage_vibration, spectrum

PLANTS = 1000
"""Of the uncertain set, in the sensitivity curve of a page that rests."""

MOVING = 200
"""Plants while a slider moves, and of each step of the curve after that."""

CHUNK = 50
"""The same, of plants that take long."""

DRAFTED = 32
"""Plants of a draft."""

DRAFT = 1e-5
"""Tolerance of a draft, relative to the greatest energy of the move."""

PICTURE = 0.04
"""Pause in which the browser draws what is looked at while a slider moves, s: on two cores it needs both."""

SAMPLES = 401
"""Of a response."""

FRAMES = 120
"""Of the drawing that moves."""

FREQUENCIES = 200
"""At which V and the spectrum of the response are computed."""

PERIODS = 1000
"""Of the fastest mode that are drawn: twenty times those with which any plant begins. With more a step of the
sensitivity of a crane takes ten seconds, in which no newer value is taken."""

ZETAS = (0.0, 0.05, 0.1)
"""Damping ratios for which V is drawn over the frequency."""

Shapers = Shaper | dict[str, Shaper]
"""One for all axes, or one for each."""


def shaper_of(shown: State | Pin) -> Shaper:
    """The shaper of a page or of a design; of several axes that have their own, the one of the axis that is shown.

    Raises:
        ValueError: if it is none.
    """
    return Shaper(shown.amplitudes, shown.times)


def shapers_of(shown: State | Pin) -> Shapers:
    """All shapers of a page or of a design.

    Raises:
        ValueError: if one is none.
    """
    if not shown.own:
        return shaper_of(shown)
    return {shown.axis: shaper_of(shown)} | {each.name: shaper_of(each) for each in shown.own}


def longest(shapers: Shapers) -> float:
    """The duration of the shaper that takes longest, s."""
    return max(float(each.duration) for each in (shapers.values() if isinstance(shapers, dict) else [shapers]))


@dataclasses.dataclass(frozen=True)
class Pair:
    """A shaper, or one for each axis, beside no shaping.

    Attributes:
        shaped: the shapers, with a number of impulses that is a power of two, at least 4, so that few programs are
            compiled.
        bare: no shaping, by as many shapers of as many impulses: one program runs both.
        duration: of the shaper that takes longest, s.
    """

    shaped: Shapers
    bare: Shapers
    duration: float

    def along(self, axis: str) -> Shaper:
        """The shaper of an axis."""
        return self.shaped[axis] if isinstance(self.shaped, dict) else self.shaped


def pair(shapers: Shapers) -> Pair:
    """Shapers beside no shaping."""
    each = shapers if isinstance(shapers, dict) else {"": shapers}
    count = max(4, 2 ** int(np.ceil(np.log2(max(len(shaper.times) for shaper in each.values())))))
    shaped, bare = {axis: shaper.pad(count) for axis, shaper in each.items()}, dict.fromkeys(each, _bare(count))
    alone = not isinstance(shapers, dict)
    return Pair(shaped[""] if alone else shaped, bare[""] if alone else bare, longest(shapers))


@functools.cache
def _bare(count: int) -> Shaper:
    """No shaping, by a shaper of so many impulses."""
    return Shaper([1.0], [0.0]).pad(count)


def stages(state: State) -> Iterator[tuple[Result, ...] | float]:
    """The results of a state by stages, what is drawn first comes first; of some nothing is drawn.

    A number is a pause, s.

    Raises:
        ValueError: for a machine or a shaper that cannot be.
    """
    bound_memory()
    check_sizes(state)
    yield from _own(state)
    for pin in state.pins:
        yield (pinned(state.text, pin, state.files),)


@functools.lru_cache(maxsize=64)
def pinned(text: str, pin: Pin, files: Files = ()) -> Pinned:
    """What is drawn of a design to compare.

    Args:
        text: of the problem file.
        pin: the design.
        files: that describe the machine.
    """
    asked, frequencies = _problem(text, files)
    both = pair(shapers_of(pin))
    # As many plants as in a step of the curve of the page's own shaper, for which there is a program already.
    plants = MOVING if _brief(asked.plant) else CHUNK
    over = sensitivity(asked, both, plants, TOLERANCE) if asked.over else None
    moved = moves(asked, both, frequencies, pin.axis)
    return Pinned(pin, text, moved, linear(asked, both, frequencies, moved, pin.axis), over, numbers(asked, both))


def _own(state: State) -> Iterator[tuple[Result, ...] | float]:
    """The results of the shaper that is changed."""
    asked, frequencies = _problem(state.text, state.files)
    both = pair(shapers_of(state))
    brief = _brief(asked.plant)
    moved = moves(asked, both, frequencies, state.axis)
    if asked.over and brief:
        yield moved, sensitivity(asked, both, MOVING, TOLERANCE)
    else:
        yield (moved,)
        if asked.over:
            yield (sensitivity(asked, both, DRAFTED, DRAFT),)
    yield PICTURE
    yield (linear(asked, both, frequencies, moved, state.axis),)
    yield (numbers(asked, both),)
    if not asked.over:
        return
    yield (ends(asked, both, moved),)
    parts, step = [], MOVING if brief else CHUNK
    for begin in range(0, PLANTS, step):
        parts.append(sensitivity(asked, both, PLANTS, TOLERANCE, slice(begin, begin + step)))
        yield ()
    yield (_joined(parts),)


def _brief(plant: AbstractPlant) -> bool:
    """Whether all plants of an uncertain set are computed while a slider moves."""
    return isinstance(plant, AbstractOscillator) and plant.drives()[0] == "displacement"


@functools.lru_cache(maxsize=16)
def _problem(text: str, files: Files) -> tuple[Problem, np.ndarray]:
    """A problem and its plant's natural frequencies, rad/s."""
    found = problem(text, files)
    return found, np.atleast_1d(np.asarray(natural_frequencies(found.plant), float))


def moves(asked: Problem, both: Pair, frequencies: np.ndarray, axis: str = "") -> Moves:
    """The responses of the nominal plant with and without a shaper.

    Args:
        asked: the problem.
        both: with and without.
        frequencies: the plant's natural ones, rad/s.
        axis: of several, that is shown.
    """
    plant, move = asked.plant, as_command(asked.distance)
    horizon = shown_until(plant, both.duration + float(move.duration), frequencies)
    runs = {
        name: _response(plant, move, each, horizon) for name, each in (("unshaped", both.bare), ("shaped", both.shaped))
    }
    at = plant.axes.index(axis) if axis else 0
    turns = plant.axis_unit(at) == "rad"
    size = 180 / np.pi if turns else 1.0
    driven = 180 / np.pi if plant.command_unit(at) == "rad" else 1.0

    def along(values):
        return np.asarray(values, float).reshape(len(values), -1)[:, at]

    position = {name: size * along(run.payload) for name, run in runs.items()}
    if plant.command_unit(at) == plant.axis_unit(at):
        # From where the payload hangs at first: the trolley of a tower crane begins at its radius.
        command = driven * along(runs["shaped"].command)
        position["command"] = command + (position["shaped"][0] - command[0])
    frames = np.linspace(0.0, horizon, FRAMES)
    kind, places = _places(plant, asked.files, runs, frames)
    return Moves(
        times=np.asarray(runs["shaped"].times, float),
        position=position,
        deflection={name: bent_along(plant, run, at)[0] for name, run in runs.items()},
        energy={name: np.asarray(run.energy, float) for name, run in runs.items()},
        unit="°" if turns else "m",
        bent=bent_along(plant, runs["shaped"], at)[1],
        scene={"kind": kind, "times": frames, "places": places},
        warning="; ".join(f"{name} {run.message}" for name, run in runs.items() if not run.converged),
    )


def _response(plant: AbstractPlant, move: AbstractCommand, shapers: Shapers, horizon: float) -> Response:
    """A response that is drawn.

    Raises:
        ValueError: for a plant that is too fast for that: with a spring of 1e300 N/m a single run took minutes.
    """
    frequency = fastest(plant, schedule(plant, move, shapers)) / (2 * np.pi)
    if not frequency * horizon <= PERIODS:
        raise ValueError(
            f"plant: its fastest mode, {frequency:.4g} Hz, makes {frequency * horizon:.4g} periods in the "
            f"{horizon:.4g} s that are drawn, of which the studio shows at most {PERIODS}"
        )
    return simulate(plant, move, shapers, horizon=horizon, samples=SAMPLES, method="fixed")


def ends(asked: Problem, both: Pair, moved: Moves) -> Ends:
    """The shaped move at both ends of the first uncertain leaf, as it is drawn.

    Args:
        asked: the problem, in which something is uncertain.
        both: with and without a shaper.
        moved: the responses of the nominal plant.
    """
    name, given = next(iter(asked.over.items()))
    move = as_command(asked.distance)
    frames, horizon = moved.scene["times"], float(moved.times[-1])
    at = np.asarray(check_over(asked.plant, {name: [np.min(given), np.max(given)]}, True, move)[name], float)
    places = {}
    for word, value in zip(("low", "high"), at, strict=True):
        plant, its_move = changed(asked.plant, move, {name: value})
        run = _response(plant, its_move, both.shaped, horizon)
        places[word] = _places(plant, asked.files, {"shaped": run}, frames)[1]["shaped"]
    return Ends(asked.labels[name], at, places)


def _places(
    plant: AbstractPlant, files: dict[str, bytes], runs: dict[str, Response], frames: np.ndarray
) -> tuple[str, dict[str, np.ndarray]]:
    """The kind of drawing, and by name where the parts are in every frame; lines between the bodies of a file."""
    if not files:
        motions = {name: motion_of(plant, run, frames) for name, run in runs.items()}
        return motions["shaped"].kind, {name: motion.places for name, motion in motions.items()}
    from jshape.reports.rendered import Scene

    seen = Scene(plant, next(iter(files.values())).decode(), runs, frames)
    lines = {name: [seen.lines(name, frame) for frame in range(len(frames))] for name in runs}
    return "bodies", {name: np.array(each).reshape(len(frames), -1, 2) for name, each in lines.items()}


def numbers(asked: Problem, both: Pair) -> Numbers:
    """What is left of the nominal plant's energy, with and without a shaper.

    Args:
        asked: the problem.
        both: with and without.
    """
    left, bare = (float(residual_energy(asked.plant, each, asked.distance)) for each in (both.shaped, both.bare))
    return Numbers(left, bare, both.duration, float(shaped(as_command(asked.distance), both.shaped).duration))


def linear(asked: Problem, both: Pair, frequencies: np.ndarray, moved: Moves, axis: str = "") -> Linear:
    """V(ω, ζ) of a shaper about the natural frequencies of a plant, and the spectrum of its deflection there.

    Args:
        asked: the problem, whose plant's own damping ratios are drawn where it has some.
        both: with and without a shaper.
        frequencies: the plant's natural ones, rad/s.
        moved: the responses.
        axis: of several, whose shaper it is.
    """
    plant, shaper = asked.plant, both.along(axis)
    modes = frequencies[np.isfinite(frequencies) & (frequencies > 0)]
    if not len(modes):
        modes = np.array([2 * np.pi / (float(shaper.duration) or 1.0)])
    omega = np.linspace(0.2 * modes.min(), 1.6 * modes.max(), FREQUENCIES)
    own = [float(zeta) for zeta in np.atleast_1d(np.asarray(plant.zeta))] if isinstance(plant, ModalPlant) else []
    zetas = sorted({*own, *ZETAS})
    values = np.asarray(percentage_vibration(shaper, omega[None, :], np.array(zetas)[:, None]))
    return Linear(
        omega / (2 * np.pi),
        dict(zip(zetas, values, strict=True)),
        (modes / (2 * np.pi)).tolist(),
        {name: np.asarray(spectrum(moved.times, bent, omega)) for name, bent in moved.deflection.items()},
        moved.bent,
    )


def sensitivity(asked: Problem, both: Pair, plants: int, tolerance: float, part: slice = slice(None)) -> Sensitivity:
    """Residual energies over the uncertain set along its first leaf, with and without a shaper.

    Args:
        asked: the problem, in which something is uncertain.
        both: with and without.
        plants: of the set, evenly between its ends.
        tolerance: relative to the greatest energy of each move.
        part: of those plants, which alone are computed.
    """
    name, given = next(iter(asked.over.items()))
    over = {name: np.linspace(np.min(given), np.max(given), plants)[part]}
    metric = "residual_vibration" if isinstance(asked.plant, AbstractOscillator) else "residual_energy"
    cut = study(asked.plant, [both.shaped, both.bare], asked.distance, over, (metric,))
    found = side_by_side(cut.evaluation, cut.points, len(over[name]), True, tolerance)[0]
    at = cut.points[name]
    return Sensitivity(
        asked.labels[name],
        at,
        {"shaped": found[0], "unshaped": found[1]},
        metric.replace("_", " "),
        tolerance > TOLERANCE,
    )


def _joined(parts: list[Sensitivity]) -> Sensitivity:
    """The curve of several parts of the set, one after the other."""
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values}
    return dataclasses.replace(parts[0], at=np.concatenate([part.at for part in parts]), values=values)
