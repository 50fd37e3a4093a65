"""What sensors do when they misbehave: six ways, as they come on real machines."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.adaptive.closed_loop.loop import Faults

_KNOCK = (0.0, 0.2, 20.0, 20.0)
"""What a blow adds to encoder, strain gauge (rad) and accelerometers (m/s²): beyond all that the link does by
itself."""
_HUM = (0.0, 0.05, 5.0, 5.0)


def wild(kind: str, samples: int, sample_time: float, *, begin: float, end: float, frequency: float = 57.0) -> Faults:
    """Faults of one kind from ``begin`` to ``end`` (s), for a run of so many ``samples``.

    ``kind``: ``"knock"``, three samples of strain gauge and accelerometers far beyond their usual range; ``"dead"``,
    all read 0; ``"nan"``, no sample comes; ``"frozen"``, all stay as they are; ``"dropped"``, every fifth sample, at
    random, does not come; ``"hum"``, a vibration of ``frequency`` (rad/s; ten times the slowest resonance of the
    paper's link) in strain gauge and accelerometers, as large as that of an unshaped move.

    *Raises* ``ValueError`` for a kind that is none, or times the wrong way round.
    """
    _check.one_of(kind, "kind", tuple(KINDS))
    if not 0 <= begin < end:
        raise ValueError(f"begin must be before end and not negative, not {begin} and {end}")
    at = np.arange(samples) * sample_time
    during = (at >= begin) & (at < end)
    none = Faults(jnp.zeros((samples, 4)), jnp.ones(samples), jnp.zeros(samples, bool), jnp.zeros(samples, bool))
    return KINDS[kind](none, during, at, frequency)


def _knock(none: Faults, during: np.ndarray, at: np.ndarray, frequency: float) -> Faults:
    del at, frequency
    first = int(np.argmax(during))
    return none._replace(added=none.added.at[first : first + 3].set(jnp.array(_KNOCK)))


def _hum(none: Faults, during: np.ndarray, at: np.ndarray, frequency: float) -> Faults:
    wave = np.where(during, np.sin(frequency * at), 0.0)
    return none._replace(added=jnp.asarray(wave[:, None] * np.array(_HUM)))


def _dropped(none: Faults, during: np.ndarray, at: np.ndarray, frequency: float) -> Faults:
    del at, frequency
    return none._replace(missing=during & jax.random.bernoulli(jax.random.key(5), 0.2, during.shape))


KINDS: dict[str, Callable[[Faults, Any, Any, float], Faults]] = {
    "knock": _knock,
    "dead": lambda none, during, at, frequency: none._replace(alive=jnp.where(during, 0.0, 1.0)),
    "nan": lambda none, during, at, frequency: none._replace(missing=jnp.asarray(during)),
    "frozen": lambda none, during, at, frequency: none._replace(frozen=jnp.asarray(during)),
    "dropped": _dropped,
    "hum": _hum,
}
