"""Specified insensitivity: the shortest shaper that keeps V under a limit over a band of frequencies.

The band is whatever the modes may turn out to be, and the actuator says which amplitudes there are::

    band = (2 * np.pi * 0.45, 2 * np.pi * 0.70)
    s = js.design.insensitive.specified(band, 0.08, amplitudes="unity")        # on and off only
    d = js.design.insensitive.solve(band, 0.08, amplitudes="unity", samples=5)  # all that is known about it
    d.duration, d.bound, d.vibration, d.result

No guess is needed and no local optimum is taken on trust. With the duration fixed, impulses at every instant make the
problem a linear program (``_relax``): it says how many impulses are needed and about where, Newton's method does the
rest (``_polish``), and the program's dual proves that nothing shorter exists, on or off any grid. Limits between
samples of the frequency are certified by a bound on the second derivative (``_band``). For concrete numbers only.
"""

import dataclasses
from typing import Any

import numpy as np

from jshape import _check
from jshape.design.insensitive._band import Region, certified, region
from jshape.design.insensitive._relax import Kind
from jshape.design.insensitive._rounding import Rounded as Rounded
from jshape.design.insensitive._rounding import rounded as rounded
from jshape.design.insensitive._search import calmest, shortest
from jshape.design.insensitive._simultaneous import cancel as cancel
from jshape.shaper import Shaper
from jshape.vibration import transform

AMPLITUDES = ("positive", "unity", "bounded")


@dataclasses.dataclass(frozen=True)
class Specified:
    """A design and what is known about it.

    ``duration``: s. ``vibration``: the largest V over the whole band, certified (no more than 1e-12 too high), a
    fraction. ``sampled``: the largest V at the samples, if it was limited there alone, else ``None``.
    ``bound``: a proven lower bound on what was minimised, over any number of impulses: the duration (s), or V where
    the duration was given. ``optimal``: whether the design comes within 1e-6 (relative) of it.
    ``feasible``: whether it keeps the limit; if not, it is the design that came nearest. ``result`` says all that in
    words.
    """

    shaper: Shaper
    duration: float
    vibration: float
    sampled: float | None
    bound: float
    optimal: bool
    feasible: bool
    result: str


def specified(
    band: Any,
    vibration: float | None = None,
    zeta: Any = 0.0,
    amplitudes: str = "positive",
    impulses: int | None = None,
    *,
    duration: float | None = None,
    samples: int | None = None,
    limit: float | None = None,
    starts: int = 32,
    seed: int = 0,
) -> Shaper:
    """The shortest shaper whose V stays at or under ``vibration`` over the band; or the one of least V.

    ``band``: (low, high) in rad/s, or several of them; low = high is a mode known exactly. ``zeta``: a damping ratio or
    (low, high). ``amplitudes``: ``"positive"``, ``"unity"`` (1, −1, …, 1) or ``"bounded"`` (|A| ≤ ``limit``, 1 if it is
    not given; ``impulses`` must be). ``impulses``: at most so many; as many as the best design needs, if not given.
    ``duration``: of the shaper, s, instead of the vibration: V is made as small as that allows.
    ``samples``: V is limited only at so many equally spaced frequencies of each band (at each end of a damping range)
    as in the paper; without, over the whole band. ``starts``, ``seed``: of the random starts that are used where the
    linear program does not tell the design, that is where fewer impulses are allowed than it takes, or bounded ones.

    *Raises* ``ValueError`` for arguments that make no sense and for a request that is infeasible; it then says how near
    it came.

    *Source*: Singer and Seering (1992), frequency sampling; Peláez, Doval-Gandoy, Caparrini and García-Prada (2006),
    Eqs. 10 and 19.
    """
    design = solve(
        band,
        vibration,
        zeta,
        amplitudes,
        impulses,
        duration=duration,
        samples=samples,
        limit=limit,
        starts=starts,
        seed=seed,
    )
    if not design.feasible:
        raise ValueError(f"vibration: {vibration} is {design.result}")
    return design.shaper


def solve(
    band: Any,
    vibration: float | None = None,
    zeta: Any = 0.0,
    amplitudes: str = "positive",
    impulses: int | None = None,
    *,
    duration: float | None = None,
    samples: int | None = None,
    limit: float | None = None,
    starts: int = 32,
    seed: int = 0,
) -> Specified:
    """As ``specified``, with all that is known about the design; one that keeps no limit is told in its ``result``.

    *Raises* ``ValueError`` for arguments that make no sense, and for a vibration that hundreds of periods cannot reach.
    """
    where = region(band, zeta, samples)
    kind = _kind(amplitudes, impulses, limit)
    starts, seed = _check.count(starts, "starts"), _check.count(seed, "seed", least=0)
    if (vibration is None) == (duration is None):
        raise ValueError(f"vibration or duration must be given, one of both, not {vibration!r} and {duration!r}")
    # A time of 1 is what the band's middle takes for a radian: every number below is of the order of 1.
    middle = float(np.sqrt(where.low * where.high))
    near = where.scaled(1 / middle)
    if duration is None:
        if not 0 < float(_check.scalar(vibration, "vibration")) < 1:
            raise ValueError(f"vibration must lie between 0 and 1 (5 % is 0.05), not {vibration!r}")
        found = shortest(near, kind, float(_check.scalar(vibration, "vibration")), impulses, starts, seed)
        bound = found.bound / middle
    else:
        _check.positive(duration, "duration")
        found = calmest(near, kind, float(duration) * middle, impulses, starts, seed)
        bound = found.bound
    shaper = Shaper(found.design.amplitudes, found.design.times / middle)
    peak = certified(shaper.amplitudes, shaper.times, where.lines)
    sampled = _at_samples(shaper, where)
    length = float(shaper.duration)
    reached = found.design.vibration if duration is not None else length
    optimal = bool(found.feasible and reached - bound <= 1e-6 * reached)
    result = _words(
        found.feasible, optimal, duration is not None, len(shaper.times), found.design.vibration, bound, kind
    )
    return Specified(shaper, length, peak, sampled, bound, optimal, found.feasible, result)


def _kind(amplitudes: str, impulses: int | None, limit: float | None) -> Kind:
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


def _at_samples(shaper: Shaper, where: Region) -> float | None:
    if where.samples is None:
        return None
    return float(np.abs(transform(shaper.amplitudes, shaper.times, where.samples)).max())


def _words(feasible: bool, optimal: bool, calm: bool, impulses: int, reached: float, bound: float, kind: Kind) -> str:
    if not feasible:
        return (
            f"infeasible with so few impulses: the nearest that {impulses} came is {100 * reached:.6g} % "
            f"({reached:.9g}), the least of those found from all starts"
        )
    what = f"vibration below {bound:.9g}" if calm else f"shorter than {bound:.9g} s"
    rivals = (
        "any number of impulses" if kind.name != "bounded" else f"negative amplitudes up to {kind.negative:.6g} in all"
    )
    if optimal:
        return f"optimal: a linear program's dual proves that nothing, with {rivals}, is {what}"
    return f"the best found with {impulses} impulses; proven is only that nothing, with {rivals}, is {what}"
