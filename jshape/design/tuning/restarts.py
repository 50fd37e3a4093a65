"""Local searches begun anew: from around the best design, and from elsewhere where there are many basins.

Source: Lourenço, Martin and Stützle (2003), iterated local search.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from jshape.design.tuning.epigraph import Vector
from jshape.design.tuning.evaluate import LOOSEST
from jshape.design.tuning.local_search import KNOWN, RADIUS, Descent, distinct, side_by_side
from jshape.design.tuning.scenarios import Point

AROUND, AGAIN, OFTEN = 26, 4, 8
"""Iterations of a search from around the best design, and how often those are repeated while they find better ones, at
most, and where evaluations cost next to nothing."""

RELOCATED, MOST_TRIED, FIRST, RETURNED = 3, 15, 6, 0.3
"""Where fewer than this share (the last) of the searches from around the best design, and from elsewhere, end there,
there are many basins: so many designs with impulses elsewhere are tried by value for each pair of searches (of each
search, with so many others at most), and how many iterations one gets before the best of those go on."""

CLOSER = 1e-5
"""The part of the objective by which another design is a better one there."""

SURE, TWICE = 0.75, 2
"""The share of the searches from around the best design that come back to it, and how many starts that met there, from
which it is not looked elsewhere."""

AS_GOOD = 1e-3
"""The part of the objective by which a search may end above the best one and count as having come back to it."""

ENOUGH = 4
"""Searches from around the best design that say something of how many basins there are."""


class Around(NamedTuple):
    """What local searches from around the best design, and from elsewhere, say of it.

    Attributes:
        descents: all searches.
        back: how many of the last ones from around it ended where the objective is that of the best.
        begun: how many those were.
        met: how many of the last ones from elsewhere did.
        sent: how many those were.
    """

    descents: list[Descent]
    back: int
    begun: int
    met: int = 0
    sent: int = 0

    @property
    def few(self) -> bool:
        """Whether so few ended there, or none from around it, that there are many basins, of which a better one may not
        have been met."""
        some = RETURNED * (self.begun + self.sent)
        return self.begun >= ENOUGH and (self.back == 0 or self.back + self.met < some)

    @property
    def alone(self) -> bool:
        """Whether none came from elsewhere: what one search alone has met is one of more basins than were counted."""
        return self.sent >= ENOUGH and self.met == 0

    @property
    def doubtful(self) -> bool:
        """Whether either speaks against the best design."""
        return self.few or self.alone


def around(
    descents: list[Descent],
    start: Callable[[Point], Descent],
    count: int,
    random: np.random.Generator,
    thorough: bool = False,
) -> Around:
    """Add so many local searches from around the best design, and again while they find a better one.

    Next to a good basin there is often a better one that few starting points meet (iterated local search); and where
    there is a good one, there often is another one like it, played backwards. Where there are many basins, those come
    after them that share most of the best one's impulses: two that all but cancel, say, however the rest stand.

    Args:
        descents: so far.
        start: begins one at a design.
        count: how many at a time.
        random: where.
        thorough: whether it is looked elsewhere, too, where not nearly all come back to the best design, or one start
            alone led there, and oftener.
    """
    found = Around(descents, 0, 0)
    rounds = (OFTEN if thorough else AGAIN) if count > 0 else 0
    for i in range(rounds):
        best = distinct(found.descents)[0]
        bounds = best.search.problem.bounds
        more = [bounds.reversed(best.point), *(bounds.near(best.point, random) for _ in range(count - 1))]
        more = [start(point) for point in more]
        list(side_by_side(more, AROUND, KNOWN))
        descents = [*found.descents, *more]
        least = distinct(descents)[0].merit
        found = Around(descents, _as_good(more, least), count)
        if least <= best.merit * (1 - CLOSER):
            continue
        doubtful = found.back < SURE * count or best.met < TWICE
        if i + 1 == rounds or not (found.few or (thorough and doubtful)):
            break
        more = _elsewhere(found.descents, start, count, random)
        found = found._replace(descents=[*found.descents, *more], met=_as_good(more, least), sent=len(more))
        if distinct(found.descents)[0].merit > least * (1 - CLOSER):
            break
    return found


def _as_good(descents: list[Descent], least: float) -> int:
    """How many searches ended where the objective is the least, J."""
    return sum(one.merit - least <= AS_GOOD * abs(least) for one in descents)


def _elsewhere(
    descents: list[Descent], start: Callable[[Point], Descent], count: int, random: np.random.Generator
) -> list[Descent]:
    """Local searches from where one or two impulses of the best three designs are elsewhere, and from random designs.

    Of many such designs those of least merit are begun with that lie apart.
    """
    known = distinct(descents)[:3]
    best, number = known[0], RELOCATED * count * min(count - 1, MOST_TRIED)
    search, bounds = best.search, best.search.problem.bounds
    tried = [bounds.relocated(known[i % len(known)].point, random) for i in range(number)]
    tried += [(bounds.clustered, bounds.random)[i % 2](random) for i in range(number)]
    tried = sorted(tried, key=lambda one: search.merit(one, LOOSEST))
    chosen = apart([best.x, *map(search.vector, tried)], 2 * count)
    more = [start(search.point(x)) for x in chosen[1:]]
    list(side_by_side(more, FIRST, KNOWN))
    more = distinct(more)[: count // 2]
    list(side_by_side(more, AROUND, KNOWN))
    return more


def apart(designs: Iterable[Vector], most: int) -> list[Vector]:
    """The first so many of some designs that lie apart from one another."""
    left, chosen = np.array(list(designs)), list[Vector]()
    while len(left) and len(chosen) < most:
        chosen.append(left[0])
        left = left[np.abs(left - left[0]).max(axis=1) > RADIUS]
    return chosen
