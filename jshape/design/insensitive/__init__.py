"""Specified insensitivity: the shortest shaper that keeps V under a limit over a band of frequencies.

The band is whatever the modes may turn out to be, and the actuator says which amplitudes there are::

    band = (2 * np.pi * 0.45, 2 * np.pi * 0.70)
    s = js.design.insensitive.specified(band, 0.08, amplitudes="unity")        # on and off only
    d = js.design.insensitive.solve(band, 0.08, amplitudes="unity", samples=5)  # with status and bounds
    d.duration, d.bound, d.vibration, d.status, d.message

No initial guess is needed and no local optimum is taken on trust. With the duration fixed, impulses at every instant
make the problem a linear program (``_linear_program``): it gives the number of impulses and roughly their times,
Newton's method on the conditions of optimality does the rest (``_optimality``), and the program's dual (``_dual``)
proves that nothing shorter exists, on or off any grid. Between samples of the frequency V is bounded by its second
derivative (``_band``). For concrete numbers only.

- ``_specification``: the specification and a candidate design.
- ``_band``: the region of poles, and a proven bound on V there.
- ``_search``: the global search; begin here.
- ``_linear_program``: the relaxed design, all instants allowed.
- ``_dual``: its dual, and the bounds that it proves.
- ``_slsqp``: a candidate improved to about six digits.
- ``_optimality``: Newton's method on the first-order conditions, to rounding.
- ``_simultaneous``: zero vibration of several modes at once.
- ``_rounding``: times rounded to a controller's samples.
"""

import dataclasses

import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.design.insensitive._band import certified, region, sampled_vibration
from jshape.design.insensitive._dual import Kind
from jshape.design.insensitive._rounding import Rounded as Rounded
from jshape.design.insensitive._rounding import rounded as rounded
from jshape.design.insensitive._search import least_vibration, shortest
from jshape.design.insensitive._simultaneous import cancel as cancel
from jshape.design.insensitive._specification import Specification
from jshape.shaper import Shaper
from jshape.status import Result, Status

AMPLITUDES = ("positive", "unity", "bounded")


@dataclasses.dataclass(frozen=True)
class Specified(Result):
    """A shaper of specified insensitivity, and what is proven about it.

    Attributes:
        shaper: the shaper.
        duration: of the shaper, s.
        vibration: the largest V over the whole band, a fraction; an upper bound, tight to 1e-12.
        sampled: the largest V at the samples, if it was limited there alone, else None.
        bound: a proven lower bound on what was minimised, over any number of impulses: the duration (s), or V where the
            duration was given.
        optimal: whether the design comes within 1e-6 (relative) of the bound.
        feasible: whether it keeps the limit; if not, it is the design of least V that was found.
        message: how it ended, in a sentence.
    """

    shaper: Shaper
    duration: float
    vibration: float
    sampled: float | None
    bound: float
    optimal: bool
    feasible: bool
    message: str

    @property
    def status(self) -> Status:
        """CONVERGED if proven optimal, STOPPED if feasible alone, else INFEASIBLE."""
        if not self.feasible:
            return Status.INFEASIBLE
        return Status.CONVERGED if self.optimal else Status.STOPPED


def specified(
    band: ArrayLike,
    vibration: float | None = None,
    zeta: ArrayLike = 0.0,
    amplitudes: str = "positive",
    impulses: int | None = None,
    *,
    duration: float | None = None,
    samples: int | None = None,
    limit: float | None = None,
    starts: int = 32,
    seed: int = 0,
) -> Shaper:
    """The shortest shaper whose V stays at or under a limit over a band of frequencies; or the one of least V.

    Args:
        band: (low, high) in rad/s, or several of them; low = high is a mode known exactly.
        vibration: the limit on V, a fraction.
        zeta: a damping ratio or (low, high).
        amplitudes: ``"positive"``, ``"unity"`` (1, −1, …, 1) or ``"bounded"`` (magnitudes up to ``limit``; needs
            ``impulses``).
        impulses: the most impulses; as many as the best design needs, if not given.
        duration: of the shaper, s, in the place of ``vibration``: V is minimised.
        samples: V is limited only at so many equally spaced frequencies of each band (at each end of a range of damping
            ratios), as in the paper; without, over the whole band.
        limit: the greatest magnitude of bounded amplitudes; 1 if not given.
        starts: random starts, used where the linear program does not determine the design: where fewer impulses are
            allowed than it takes, or bounded ones.
        seed: of the random starts.

    Raises:
        ValueError: for arguments that make no sense and for a request that is infeasible, with the least V found.

    Source: Singer and Seering (1992), frequency sampling; Peláez, Doval-Gandoy, Caparrini and García-Prada (2006),
    Eqs. 10 and 19.
    """
    options = dict(duration=duration, samples=samples, limit=limit, starts=starts, seed=seed)
    design = solve(band, vibration, zeta, amplitudes, impulses, **options)  # pyright: ignore[reportArgumentType]
    if not design.feasible:
        raise ValueError(f"vibration: {vibration} is {design.message}")
    return design.shaper


def solve(
    band: ArrayLike,
    vibration: float | None = None,
    zeta: ArrayLike = 0.0,
    amplitudes: str = "positive",
    impulses: int | None = None,
    *,
    duration: float | None = None,
    samples: int | None = None,
    limit: float | None = None,
    starts: int = 32,
    seed: int = 0,
) -> Specified:
    """The design of ``specified`` with its status and proven bounds; an infeasible request is no error.

    Args:
        band, vibration, zeta, amplitudes, impulses, duration, samples, limit, starts, seed: as ``specified``.

    Returns:
        The design. If the limit cannot be kept with so few impulses, its status is INFEASIBLE and its shaper the one of
        least V that was found.

    Raises:
        ValueError: for arguments that make no sense, and for a vibration that is not reached within 400 periods of the
            lowest frequency.
    """
    where = region(band, zeta, samples)
    kind = _kind(amplitudes, impulses, limit)
    starts, seed = _check.count(starts, "starts"), _check.count(seed, "seed", least=0)
    if (vibration is None) == (duration is None):
        raise ValueError(f"vibration or duration must be given, one of both, not {vibration!r} and {duration!r}")
    # Frequencies over their geometric mean: every number below is of the order of 1.
    middle = float(np.sqrt(where.low * where.high))
    scaled = region(np.asarray(band, float) / middle, zeta, samples)
    if duration is None:
        vibration = float(_check.scalar(vibration, "vibration"))
        if not 0 < vibration < 1:
            raise ValueError(f"vibration must lie between 0 and 1 (5 % is 0.05), not {vibration!r}")
        found = shortest(Specification(scaled, kind, vibration=vibration), impulses, starts, seed)
        bound, reached = found.bound / middle, found.design.duration / middle
    else:
        _check.positive(duration, "duration")
        longest = float(duration) * middle
        found = least_vibration(Specification(scaled, kind, duration=longest), impulses, starts, seed)
        bound, reached = found.bound, found.design.vibration
    shaper = Shaper(found.design.amplitudes, found.design.times / middle)
    optimal = bool(found.feasible and reached - bound <= 1e-6 * reached)
    if found.feasible:
        limited = f"shorter than {bound:.9g} s" if duration is None else f"vibration below {bound:.9g}"
        message = _message(optimal, len(shaper.times), limited, kind)
    else:
        least = found.design.vibration
        message = (
            f"infeasible with so few impulses: the least vibration found with {len(shaper.times)} is "
            f"{100 * least:.6g} % ({least:.9g})"
        )
    arrays = np.asarray(shaper.amplitudes, float), np.asarray(shaper.times, float)
    return Specified(
        shaper,
        duration=float(shaper.duration),
        vibration=certified(*arrays, where.lines),
        sampled=sampled_vibration(*arrays, where),
        bound=bound,
        optimal=optimal,
        feasible=found.feasible,
        message=message,
    )


def _kind(amplitudes: str, impulses: int | None, limit: float | None) -> Kind:
    """The amplitudes allowed, checked."""
    _check.one_of(amplitudes, "amplitudes", AMPLITUDES)
    if impulses is not None:
        _check.count(impulses, "impulses", least=2)
        if amplitudes == "unity" and impulses % 2 == 0:
            raise ValueError(f"impulses must be odd for amplitudes='unity' (1, −1, …, 1 sum to 1), not {impulses}")
    if amplitudes != "bounded":
        if limit is not None:
            raise ValueError(f"limit is for amplitudes='bounded' only, not {amplitudes!r}")
        return Kind(amplitudes)
    if impulses is None:
        raise ValueError("impulses must be given for amplitudes='bounded': enough of them add up to any amplitude")
    limit = 1.0 if limit is None else float(_check.scalar(limit, "limit"))
    _check.positive(limit, "limit")
    if limit * impulses < 1:
        raise ValueError(f"limit must be at least 1/{impulses} for {impulses} impulses to sum to 1, not {limit}")
    return Kind("bounded", limit, impulses)


def _message(optimal: bool, impulses: int, limited: str, kind: Kind) -> str:
    """The message of a feasible design: the proven optimality."""
    rivals = "any number of impulses"
    if kind.name == "bounded":
        rivals = f"negative amplitudes up to {kind.negative:.6g} in all"
    if optimal:
        return f"optimal: a linear program's dual proves that nothing, with {rivals}, is {limited}"
    return f"the best found with {impulses} impulses; proven is only that nothing, with {rivals}, is {limited}"
