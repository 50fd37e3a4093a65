"""Faults of a flexible link's sensors in every way, one over another, and loads that change; for ``adaptive.py``.

Strategies take no time stamps: samples that come late or twice are ``stutter``.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, cast

import numpy as np

from jshape.adaptive.closed_loop.faults import KINDS as PLAIN
from jshape.adaptive.closed_loop.loop import Faults

TIME, MINUTES, PERIOD, QUIET = 0.005, 10.0, 12.0, 120.0
"""s from sample to sample, minutes of a loop, s of a move there and back, s without faults at the loop's end."""
SIZES = np.array([0.5, 0.2, 20.0, 20.0])
"""What encoder, strain gauge (rad) and accelerometers (m/s²) read in an unshaped move."""
LOADS = (0.0, 5.0, 10.0, 15.0, 20.0)

STRANGE: dict[str, Callable[[Any, Any, Any], dict[str, Any]]] = {
    # Of the times since the fault began (s), a random generator and the sensors' sizes.
    "nan": lambda t, rng, size: dict(missing=True),
    "dropped": lambda t, rng, size: dict(missing=rng.random((len(t), 1)) < rng.uniform(0.05, 0.9)),
    "infinite": lambda t, rng, size: dict(added=rng.choice([-np.inf, np.inf])),
    "huge": lambda t, rng, size: dict(added=rng.choice([-1e300, 0.0, 1e300], (len(t), 1))),
    "large": lambda t, rng, size: dict(added=rng.choice([-1, 1]) * 10.0 ** rng.uniform(3, 9)),
    "frozen": lambda t, rng, size: dict(frozen=True),
    "stutter": lambda t, rng, size: dict(frozen=rng.random((len(t), 1)) < rng.uniform(0.05, 0.9)),
    "dead": lambda t, rng, size: dict(alive=0.0),
    "sign": lambda t, rng, size: dict(alive=-1.0),
    "scale": lambda t, rng, size: dict(alive=10.0 ** rng.uniform(-1, 1)),
    "knock": lambda t, rng, size: dict(added=np.where(np.arange(len(t)) < 3, 1.0, 0.0)[:, None] * size),
    "spikes": lambda t, rng, size: dict(added=5 * size * (rng.random((len(t), 1)) < 0.02) * rng.choice([-1, 1], 4)),
    "offset": lambda t, rng, size: dict(added=5 * size * rng.uniform(-1, 1, 4)),
    "drift": lambda t, rng, size: dict(added=t[:, None] * size * rng.uniform(-0.2, 0.2, 4)),
    "hum": lambda t, rng, size: dict(added=np.sin(10.0 ** rng.uniform(0, 2.5) * t)[:, None] * size / 4),
    "noise": lambda t, rng, size: dict(added=10.0 ** rng.uniform(-2, 0.5) * size * rng.normal(size=(len(t), 4))),
    "coarse": lambda t, rng, size: dict(coarse=10.0 ** rng.uniform(-2, 0) * size),
}  # fmt: skip
KINDS = tuple(STRANGE)
assert set(PLAIN) <= set(KINDS)


class Loop(NamedTuple):
    """The faults and loads of one loop."""

    faults: Faults
    which: Any
    """Of ``LOADS``, at each sample."""
    amplitude: Any
    """Of the moves, rad."""
    episodes: list[tuple[float, float]]
    """s between which there are faults."""
    number: int
    """Of faults."""


def draw(seed: int, number: int) -> Loop:
    """The faults and loads of a loop."""
    rng, samples = np.random.default_rng([seed, number]), round(60 * MINUTES / TIME)
    end = 60 * MINUTES - QUIET
    parts: dict[str, Any] = {name: np.zeros((samples, 4)) for name in ("added", "missing", "frozen", "coarse")}
    parts["alive"] = np.ones((samples, 4))
    episodes, count, begin = [], 0, rng.uniform(2, 20)
    while begin < end:
        over = begin
        for _ in range(rng.integers(1, 4)):
            first = int(rng.uniform(begin, max(over, begin + 0.1)) / TIME)
            last = min(first + int(10.0 ** rng.uniform(np.log10(TIME), np.log10(120.0)) / TIME) + 1, int(end / TIME))
            fault(parts, rng, first, last)
            over, count = max(over, last * TIME), count + (last > first)
        episodes.append((begin, over))
        begin = over + rng.uniform(20, 60)
    changes = np.sort(rng.uniform(0, end, 4))
    which = rng.integers(0, len(LOADS), 5)[np.searchsorted(changes, np.arange(samples) * TIME)]
    parts["missing"], parts["frozen"] = parts["missing"] > 0, parts["frozen"] > 0
    return Loop(Faults(**cast(Any, parts)), which, np.radians(rng.uniform(10, 30)), episodes, count)


def fault(parts: dict[str, np.ndarray], rng: np.random.Generator, first: int, last: int) -> None:
    """Add a fault of a random kind, of one sensor or of all, from sample ``first`` to before ``last``."""
    if last <= first:
        return
    times = np.arange(last - first) * TIME
    here = np.ones(4) if rng.random() < 0.4 else np.eye(4)[rng.integers(4)]
    for name, value in STRANGE[KINDS[rng.integers(len(KINDS))]](times, rng, SIZES).items():
        value, part = np.broadcast_to(value, (len(times), 4)), parts[name][first:last]
        at = here > 0
        if name == "alive":
            part[:, at] *= value[:, at]
        elif name == "added":
            with np.errstate(invalid="ignore", over="ignore"):
                part[:, at] += value[:, at]
        else:
            part[:, at] = np.maximum(part[:, at], value[:, at])


def pauses(loop: Loop) -> Iterator[range]:
    """The whole moves of each pause between faults."""
    begins = [begin for begin, _ in loop.episodes[1:]] + [60 * MINUTES]
    for (_, over), begin in zip(loop.episodes, begins, strict=True):
        yield range(int(np.ceil((over - TIME) / (PERIOD / 2))), int((begin - TIME) / (PERIOD / 2)))
