"""What a page draws of a state: computed by jshape's public functions, in stages, so that the newest state wins.

``stages(state)`` yields results one after the other; who draws them may stop between two of them. While a slider
moves, the sensitivity of plants that take long is drawn for fewer plants and at a larger tolerance, and says that it is
a draft; the last stage computes it for all of them at the tolerance of every other command.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import numpy as np

from jshape.command import as_command
from jshape.metrics import residual_energy
from jshape.plants import AbstractOscillator, AbstractPlant, ModalPlant
from jshape.problems.problem import Problem
from jshape.reports.places import bent_along, motion_of
from jshape.reports.responses import shown_until
from jshape.shaper import Shaper
from jshape.simulation.simulate import simulate
from jshape.simulation.steps import TOLERANCE
from jshape.studio.state import Pin, State, problem
from jshape.sweeps.evaluate import side_by_side, study
from jshape.sweeps.leaves import leaf
from jshape.vibration import percentage_vibration

PLANTS = 200
"""Of the uncertain set, in the sensitivity curve."""

CHUNK = 50
"""Plants of a draft, and of each step of the curve after it."""

DRAFT = 1e-5
"""Tolerance of a draft, relative to the greatest energy of the move."""

SAMPLES = 401
"""Of a response."""

FRAMES = 120
"""Of the drawing that moves."""

ZETAS = (0.0, 0.05, 0.1)
"""Damping ratios for which V is drawn over the frequency."""


@dataclasses.dataclass(frozen=True)
class Moves:
    """The responses with and without the shaper.

    Attributes:
        times: s.
        position: name → values in ``unit``: the command as it was given and as it is shaped, and the payloads.
        deflection: name → values in ``bent``.
        unit: of the positions.
        bent: of the deflections.
        scene: what the drawing shows: ``kind``, ``times`` and for each name the ``places`` of its parts.
        warning: what is wrong with a response, in words; empty where both converged.
    """

    times: np.ndarray
    position: dict[str, np.ndarray]
    deflection: dict[str, np.ndarray]
    unit: str
    bent: str
    scene: dict[str, Any]
    warning: str


@dataclasses.dataclass(frozen=True)
class Numbers:
    """What is left after the move.

    Attributes:
        shaped: residual energy of the nominal plant with the shaper, J; infinite where it diverged.
        unshaped: the same without it.
        duration: of the shaper, s.
        move_time: of the shaped command, s.
    """

    shaped: float
    unshaped: float
    duration: float
    move_time: float


@dataclasses.dataclass(frozen=True)
class Linear:
    """The linear residual vibration V(ω, ζ).

    Attributes:
        frequencies: Hz.
        values: damping ratio → V, fractions.
        modes: natural frequencies of the plant, Hz.
    """

    frequencies: np.ndarray
    values: dict[float, np.ndarray]
    modes: list[float]


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """Residual energies over the uncertain set, along one leaf.

    Attributes:
        leaf: its dotted path, with the unit if it is known.
        at: its values.
        values: name → residual vibration (a fraction) or residual energy (J) of each plant.
        quantity: which of both.
        draft: whether fewer plants at a larger tolerance were computed.
    """

    leaf: str
    at: np.ndarray
    values: dict[str, np.ndarray]
    quantity: str
    draft: bool


@dataclasses.dataclass(frozen=True)
class Pinned:
    """What a page draws of a design to compare.

    Attributes:
        pin: the design.
        text: the problem file of the machine for which it is computed.
        moves: its responses.
        linear: its V(ω, ζ).
        sensitivity: over the uncertain set; ``None`` where nothing is uncertain.
        numbers: what it leaves.
    """

    pin: Pin
    text: str
    moves: Moves
    linear: Linear
    sensitivity: Sensitivity | None
    numbers: Numbers


Result = Moves | Numbers | Linear | Sensitivity | Pinned | None


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


def stages(state: State) -> Iterator[Result]:
    """The results of a state, what is drawn first comes first.

    ``None`` stands for a step of which nothing is drawn.

    Raises:
        ValueError: for a machine or a shaper that cannot be.
    """
    yield from _own(state)
    for pin in state.pins:
        yield pinned(state.text, pin)


@functools.lru_cache(maxsize=64)
def pinned(text: str, pin: Pin) -> Pinned:
    """What is drawn of a design to compare.

    Args:
        text: of the problem file.
        pin: the design.
    """
    asked, frequencies = _problem(text)
    shaper = shapers_of(pin)
    # As many plants as in the curve of the page's own shaper, for which there is a program already.
    plants = PLANTS if _brief(asked.plant) else CHUNK
    over = sensitivity(asked, shaper, plants, TOLERANCE) if asked.over else None
    parts = (
        moves(asked, shaper, frequencies, pin.axis),
        linear(asked.plant, shaper_of(pin), frequencies),
        over,
        numbers(asked, shaper),
    )
    return Pinned(pin, text, *parts)


def _own(state: State) -> Iterator[Result]:
    """The results of the shaper that is changed."""
    asked, frequencies = _problem(state.text)
    shaper = shapers_of(state)
    yield moves(asked, shaper, frequencies, state.axis)
    yield linear(asked.plant, shaper_of(state), frequencies)
    if not asked.over:
        yield numbers(asked, shaper)
        return
    brief = _brief(asked.plant)
    yield sensitivity(asked, shaper, *((PLANTS, TOLERANCE) if brief else (CHUNK, DRAFT)))
    yield numbers(asked, shaper)
    if not brief:
        parts = []
        for begin in range(0, PLANTS, CHUNK):
            parts.append(sensitivity(asked, shaper, PLANTS, TOLERANCE, slice(begin, begin + CHUNK)))
            yield None
        yield _joined(parts)


def _brief(plant: AbstractPlant) -> bool:
    """Whether all plants of an uncertain set are computed while a slider moves."""
    return isinstance(plant, AbstractOscillator) and plant.drives()[0] == "displacement"


@functools.lru_cache(maxsize=16)
def _problem(text: str) -> tuple[Problem, np.ndarray]:
    """A problem and its plant's natural frequencies, rad/s."""
    found = problem(text)
    # A slider's movement waits for it; the derivative of a spring's force takes 13 ms unless it is compiled.
    natural = _natural(found.plant) if isinstance(found.plant, AbstractOscillator) else found.plant.natural_frequency()
    return found, np.atleast_1d(np.asarray(natural, float))


@eqx.filter_jit
def _natural(plant: AbstractPlant) -> Any:
    return plant.natural_frequency()


def padded(shapers: Shapers) -> Any:
    """The shapers with a number of impulses that is a power of two, at least 4, so that few programs are compiled."""
    each = shapers if isinstance(shapers, dict) else {"": shapers}
    most = max(len(shaper.times) for shaper in each.values())
    made = {axis: shaper.pad(max(4, 2 ** int(np.ceil(np.log2(most))))) for axis, shaper in each.items()}
    return made if isinstance(shapers, dict) else made[""]


def bare_like(shapers: Any) -> Any:
    """No shaping, by as many shapers of as many impulses."""
    if isinstance(shapers, dict):
        return {axis: bare_like(shaper) for axis, shaper in shapers.items()}
    return Shaper([1.0], [0.0]).pad(len(shapers.times))


def moves(asked: Problem, shaper: Shapers, frequencies: np.ndarray, axis: str = "") -> Moves:
    """The responses of the nominal plant with and without a shaper.

    Args:
        asked: the problem.
        shaper: the shaper, or one for each axis.
        frequencies: the plant's natural ones, rad/s.
        axis: of several, that is shown.
    """
    plant, move = asked.plant, as_command(asked.distance)
    horizon = shown_until(plant, longest(shaper) + float(move.duration), frequencies)
    shaper = padded(shaper)
    bare = bare_like(shaper)
    runs = {
        name: simulate(plant, move, each, horizon=horizon, samples=SAMPLES, method="fixed")
        for name, each in (("unshaped", bare), ("shaped", shaper))
    }
    at = plant.axes.index(axis) if axis else 0
    turns = plant.axis_unit(at) == "rad"
    size = 180 / np.pi if turns else 1.0
    driven = 180 / np.pi if plant.command_unit(at) == "rad" else 1.0
    along = lambda values: np.asarray(values, float).reshape(len(values), -1)[:, at]
    position = {name: size * along(run.payload) for name, run in runs.items()}
    if plant.command_unit(at) == plant.axis_unit(at):
        # From where the payload hangs at first: the trolley of a tower crane begins at its radius.
        command = driven * along(runs["shaped"].command)
        position["command"] = command + (position["shaped"][0] - command[0])
    frames = np.linspace(0.0, horizon, FRAMES)
    motions = {name: motion_of(plant, run, frames) for name, run in runs.items()}
    places = {name: motion.places for name, motion in motions.items()}
    return Moves(
        times=np.asarray(runs["shaped"].times, float),
        position=position,
        deflection={name: bent_along(plant, run, at)[0] for name, run in runs.items()},
        unit="°" if turns else "m",
        bent=bent_along(plant, runs["shaped"], at)[1],
        scene={"kind": motions["shaped"].kind, "times": frames, "places": places},
        warning="; ".join(f"{name} {run.message}" for name, run in runs.items() if not run.converged),
    )


def numbers(asked: Problem, shaper: Shapers) -> Numbers:
    """What is left of the nominal plant's energy, with and without a shaper.

    Args:
        asked: the problem.
        shaper: the shaper.
    """
    left, bare = (float(residual_energy(asked.plant, each, asked.distance)) for each in (padded(shaper), None))
    duration = longest(shaper)
    return Numbers(left, bare, duration, duration + float(as_command(asked.distance).duration))


def linear(plant: AbstractPlant, shaper: Shaper, frequencies: np.ndarray) -> Linear:
    """V(ω, ζ) of a shaper about the natural frequencies of a plant.

    Args:
        plant: the plant, whose own damping ratios are drawn where it has some.
        shaper: the shaper.
        frequencies: its natural frequencies, rad/s.
    """
    modes = frequencies[np.isfinite(frequencies) & (frequencies > 0)]
    if not len(modes):
        modes = np.array([2 * np.pi / (float(shaper.duration) or 1.0)])
    omega = np.linspace(0.2 * modes.min(), 1.6 * modes.max(), 300)
    own = [float(zeta) for zeta in np.atleast_1d(np.asarray(plant.zeta))] if isinstance(plant, ModalPlant) else []
    zetas = sorted({*own, *ZETAS})
    values = np.asarray(percentage_vibration(padded(shaper), omega[None, :], np.array(zetas)[:, None]))
    return Linear(omega / (2 * np.pi), dict(zip(zetas, values, strict=True)), (modes / (2 * np.pi)).tolist())


def sensitivity(
    asked: Problem, shaper: Shapers, plants: int, tolerance: float, part: slice = slice(None)
) -> Sensitivity:
    """Residual energies over the uncertain set along its first leaf, with and without a shaper.

    Args:
        asked: the problem, in which something is uncertain.
        shaper: the shaper.
        plants: of the set, evenly between its ends.
        tolerance: relative to the greatest energy of each move.
        part: of those plants, which alone are computed.
    """
    name, values = next(iter(asked.over.items()))
    over = {name: np.linspace(np.min(values), np.max(values), plants)[part]}
    metric = "residual_vibration" if isinstance(asked.plant, AbstractOscillator) else "residual_energy"
    found = {}
    for word, each in (("shaped", padded(shaper)), ("unshaped", Shaper([1.0], [0.0]))):
        cut = study(asked.plant, [each], asked.distance, over, (metric,))
        found[word] = side_by_side(cut.evaluation, cut.points, len(over[name]), True, tolerance)[0, 0]
    at = over[name] * float(leaf(asked.plant, name))
    return Sensitivity(asked.labels[name], at, found, metric.replace("_", " "), tolerance > TOLERANCE)


def _joined(parts: list[Sensitivity]) -> Sensitivity:
    """The curve of several parts of the set, one after the other."""
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values}
    return dataclasses.replace(parts[0], at=np.concatenate([part.at for part in parts]), values=values)
