"""``js.identify_duffing`` and ``js.identify_payloads``: a hardening or softening spring from its motions, by gradient.

    found = js.identify_duffing(times, position, mass=1.2)     # a ring-down of the payload
    found.parameters, found.interval()                          # {"k1": …, "k3": …, "c": …}, N/m, N/m³, N s/m
    js.design.energy.three_impulse(found.plant, 1.0)
    both = js.identify_payloads([(times, light), (times, heavy)], masses=[1.2, None])      # one law, two payloads

The start comes from the equation of motion itself, which is linear in the unknowns; then Levenberg and Marquardt's
method fits the simulated motion to the measured one, over a part of the record that grows from a few periods to all. A
record of no more than those is fitted from a linear spring as well.
"""

import dataclasses
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from jshape import _check
from jshape._blas import one_thread
from jshape._types import ArrayLike
from jshape.identification._motion import BETWEEN, Fit, Law, Problem, fit, oscillator
from jshape.identification._start import prepared, start
from jshape.identification.motion import HIDDEN, IdentifiedMotion, concluded
from jshape.identification.records import Record, Where, row
from jshape.plants import AbstractPlant, Duffing, ForcedMass, FrictionDamper, LinearDamper, PowerDamper, TwoMass

DRIVES = ("displacement", "force")


@dataclasses.dataclass(frozen=True)
class IdentifiedDuffing(IdentifiedMotion):
    """A Duffing oscillator as fitted: ``k1`` (N/m), ``k3`` (N/m³), ``c`` (N s/m, or N s³/m³) and what else was sought.

    Attributes:
        plant: the machine.
        times: s, shape (rows,).
        values: the measured position, m, shape (rows,).
        predicted: the fitted position, m, shape (rows,).
        noise: standard deviation of the difference, m.
    """

    plant: AbstractPlant
    times: np.ndarray
    values: np.ndarray
    predicted: np.ndarray
    noise: float


@dataclasses.dataclass(frozen=True)
class IdentifiedPayloads(IdentifiedMotion):
    """One spring and damper under several payloads, as fitted; masses that were sought are ``mass_1``, ``mass_2`` …

    Attributes:
        plants: the machine with each payload.
        masses: of each payload, kg, as given or found.
        predicted: the fitted positions of each record, m.
        noise: standard deviation of each record, m.
    """

    plants: list[AbstractPlant]
    masses: list[float]
    predicted: list[np.ndarray]
    noise: list[float]


@one_thread()
def identify_duffing(
    times: ArrayLike,
    values: Any,
    *,
    mass: float = 1.0,
    inputs: Any = None,
    drive: str = "displacement",
    power: int = 1,
    friction: bool = False,
    friction_width: float | None = None,
    delay: bool = False,
    between: str = "line",
    where: Where = row,
) -> IdentifiedDuffing:
    """A payload on a spring k1 x + k3 x³ and a damper c v (or c v³), from its measured position.

    Where the sensor's zero is, and how the motion began, is fitted, too; where nothing drives it and it rests at first,
    the motion is fitted from the release, or the blow, on.

    Args:
        times: s, even, shape (rows,).
        values: the payload's position, m, shape (rows,).
        mass: of the payload, kg; a motion without a measured force determines only the ratios to it, and with one it
            is fitted as well, from this start.
        inputs: what drove it meanwhile, shape (rows,); a free vibration unless given.
        drive: what ``inputs`` are, ``"displacement"`` of the base, m, or ``"force"`` on the payload, N.
        power: of the damper, 1 or 3.
        friction: whether dry friction is fitted, ``friction`` (N): Coulomb's, smoothed.
        friction_width: the speed over which it changes its sign, m/s; a hundredth of the greatest unless given.
        delay: whether the time is fitted by which the base, or the force, is behind ``inputs``, ``delay`` (s).
        between: how ``inputs`` move between rows: ``"line"``, ``"spline"`` or ``"hold"``.
        where: says where a row stands, for messages.

    Raises:
        RecordError: a ``ValueError``, for a record that cannot be used or a motion that no such spring explains.
        ValueError: for wrong arguments.
    """
    forced = _checked(drive, power, friction, friction_width, between, [mass], [inputs], delay)
    options = _Options(Law(forced, power, delay), friction, friction_width, between)
    found = _identified([(times, values, inputs)], [mass], [forced], options, [where])
    data = found.problem.records[0]
    return IdentifiedDuffing(
        **found.common,
        plant=found.plants[0],
        times=found.records[0].axis,
        values=data.values,
        predicted=data.values + found.fitted.residuals[0],
        noise=float(found.fitted.noise[0]),
    )


@one_thread()
def identify_payloads(
    records: Sequence[tuple[Any, ...]],
    masses: Sequence[float | None],
    *,
    drive: str = "displacement",
    power: int = 1,
    friction: bool = False,
    friction_width: float | None = None,
    delay: bool = False,
    between: str = "line",
) -> IdentifiedPayloads:
    """One spring and damper from several motions with several payloads, whose masses are known or not.

    What belongs to the machine, spring, damper, friction and delay, is the same in all records; each record has a
    beginning, a sensor's zero and a noise of its own.

    Args:
        records: of each motion the times (s, even), the payload's position (m) and, unless it is free, the inputs.
        masses: of each payload, kg; ``None`` where it is sought. Without a measured force at least one must be known:
            the motions determine only the ratios.
        drive: what inputs are, as in ``identify_duffing``.
        power: of the damper, 1 or 3.
        friction: whether dry friction is fitted.
        friction_width: the speed over which it changes its sign, m/s.
        delay: whether the delay of the inputs is fitted.
        between: how inputs move between rows.

    Raises:
        RecordError: a ``ValueError``, for a record that cannot be used or motions that no such spring explains.
        ValueError: for wrong arguments.
    """
    _check.instances(records, "records", Collection, "a list of motions")
    _check.instance(masses, "masses", Collection, "a list")
    if not records or any(len(record) not in (2, 3) for record in records):
        raise ValueError("records must be (times, values) or (times, values, inputs), at least one of them")
    if len(masses) != len(records):
        raise ValueError(f"masses must be one for each of the {len(records)} records, or None, not {masses!r}")
    triples = [(record[0], record[1], record[2] if len(record) == 3 else None) for record in records]
    forced = _checked(drive, power, friction, friction_width, between, masses, [each[2] for each in triples], delay)
    if not forced and all(mass is None for mass in masses):
        raise ValueError("masses: one must be known at least: motions without a measured force give only ratios")
    options = _Options(Law(forced, power, delay), friction, friction_width, between)
    wheres = [_of(number) for number in range(1, len(records) + 1)]
    found = _identified(triples, masses, [mass is None for mass in masses], options, wheres)
    return IdentifiedPayloads(
        **found.common,
        plants=found.plants,
        masses=[each["mass"] for each in found.values],
        predicted=[
            data.values + left for data, left in zip(found.problem.records, found.fitted.residuals, strict=True)
        ],
        noise=found.fitted.noise.tolist(),
    )


@dataclasses.dataclass(frozen=True)
class _Options:
    law: Law
    friction: bool
    width: float | None
    between: str


class _Found(NamedTuple):
    """A fit; ``values`` of everything in ``NAMES`` for each record, and the fields that all results share."""

    records: list[Record]
    problem: Problem
    fitted: Fit
    values: list[dict[str, float]]
    plants: list[AbstractPlant]
    common: dict[str, Any]


def _of(number: int) -> Where:
    return lambda place: f"record {number}, row {place}: "


def _checked(
    drive: str,
    power: int,
    friction: bool,
    width: float | None,
    between: str,
    masses: Sequence[float | None],
    inputs: Sequence[Any],
    delay: bool,
) -> bool:
    """Whether inputs are forces.

    Raises:
        ValueError: for wrong arguments.
    """
    _check.one_of(drive, "drive", DRIVES)
    _check.one_of(between, "between", BETWEEN)
    for mass in masses:
        if mass is not None:
            _check.positive(float(_check.scalar(mass, "mass")), "mass")
    if power not in (1, 3):
        raise ValueError(f"power must be 1 or 3, not {power!r}")
    if friction and power != 1:
        raise ValueError(f"friction: goes with a damper of power 1, not {power}")
    if width is not None:
        _check.positive(width, "friction_width")
    if drive == "force" and any(each is None for each in inputs):
        raise ValueError('inputs must be given for drive="force": the force, N')
    if delay and all(each is None for each in inputs):
        raise ValueError("delay: a free vibration has none; inputs must be given")
    _check.warn_if_single()
    return drive == "force"


def _identified(
    triples: Sequence[tuple[Any, Any, Any]],
    masses: Sequence[float | None],
    sought: Sequence[bool],
    options: _Options,
    wheres: Sequence[Where],
) -> _Found:
    """The law that fits the records best; ``sought``: of each, whether its mass is fitted."""
    law = options.law
    parts = [prepared(*each, options.between, where) for each, where in zip(triples, wheres, strict=True)]
    starts = [
        start(
            data.values, driven, float(data.times[1]), 1.0 if mass is None else float(mass), law,
            friction=options.friction, width=options.width,
        )
        for (_, data, driven), mass in zip(parts, masses, strict=True)
    ]  # fmt: skip
    names = ("k1", "k3", "c", *(["friction"] if options.friction else []), *(["delay"] if law.delayed else []))
    own = [(*(("mass",) if seek else ()), *HIDDEN) for seek in sought]
    model = oscillator(law, max(each.width for each in starts))
    data, records = [part[1] for part in parts], [part[0] for part in parts]
    first = [max(16, int(4 * each.period / float(part.times[1]))) for each, part in zip(starts, data, strict=True)]
    known = [each.values for each in starts]
    if len(parts) > 1:
        # Each alone to begin with: a mass is then the ratio of two stiffnesses that are known well.
        alone = [(*(("mass",) if law.forced else ()), *HIDDEN)]
        singles = [Problem(model, [d], [values], names, alone) for d, values in zip(data, known, strict=True)]
        fits = [_best(single, rows).unknowns for single, rows in zip(singles, first, strict=True)]
        known = [single.values(found)[0] for single, found in zip(singles, fits, strict=True)]
    problem = Problem(model, data, _scaled(known, masses, law.forced), names, own)
    fitted = _best(problem, first[0]) if len(parts) == 1 else fit(problem, max(len(each.times) for each in data))
    values = problem.values(fitted.unknowns)
    notes = [note for record in records for note in record.notes]
    common = concluded(problem, fitted, notes, "no spring k1 x + k3 x³ explains this motion")
    width = max(each.width for each in starts)
    plants = [_plant(each, options, width) for each in values]
    return _Found(records, problem, fitted, values, plants, common)


def _best(problem: Problem, first: int) -> Fit:
    """The fit from where the equation of motion says; of a short record, all of which is fitted at once, or from a
    linear spring without a damper, if that leaves less: derivatives of few rows can lead to another minimum."""
    fits = [fit(problem, first)]
    if first >= max(len(each.times) for each in problem.records):
        linear = [values | {"k3": 0.0, "c": 0.0} for values in problem.known]
        fits.append(fit(dataclasses.replace(problem, known=linear), first))
    return min(fits, key=_left)


def _left(fitted: Fit) -> float:
    return float(sum(np.sum(left**2) for left in fitted.residuals))


def _scaled(found: list[dict[str, float]], masses: Sequence[float | None], forced: bool) -> list[dict[str, float]]:
    """Values that agree on the law: the mean of those whose mass is known; of the others the mass follows from k1."""
    sure = [each for each, mass in zip(found, masses, strict=True) if forced or mass is not None]
    law = {name: float(np.mean([each[name] for each in sure])) for name in ("k1", "k3", "c", "friction", "delay")}
    scaled = []
    for each, mass in zip(found, masses, strict=True):
        if mass is None and not forced:
            law_mass = each["mass"] * law["k1"] / each["k1"]
        else:
            law_mass = each["mass"] if mass is None or len(found) == 1 else float(mass)
        scaled.append({**each, **law, "mass": law_mass})
    return scaled


def _plant(values: dict[str, float], options: _Options, width: float) -> AbstractPlant:
    spring, c = Duffing(values["k1"], values["k3"]), values["c"]
    damper = LinearDamper(c) if options.law.power == 1 else PowerDamper(c, options.law.power)
    damper = FrictionDamper(c, values["friction"], width) if options.friction else damper
    mass = values["mass"]
    return ForcedMass(mass, spring, damper) if options.law.forced else TwoMass(m2=mass, spring=spring, damper=damper)
