"""Six kinds of sensor faults, as they come on real machines."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.adaptive.closed_loop.loop import Faults

KINDS = ("knock", "dead", "nan", "frozen", "dropped", "hum")

_KNOCK = (0.0, 0.2, 20.0, 20.0)
"""What a blow adds to encoder, strain gauge (rad) and accelerometers (m/s²): beyond all that the link does
by itself."""
_HUM = (0.0, 0.05, 5.0, 5.0)


def wild(kind: str, samples: int, sample_time: float, *, begin: float, end: float, omega: float = 57.0) -> Faults:
    """Faults of one kind.

    Args:
        kind: ``"knock"``, three samples of strain gauge and accelerometers far beyond their usual range; ``"dead"``,
            all read 0; ``"nan"``, no sample comes; ``"frozen"``, all stay as they are; ``"dropped"``, every fifth
            sample, at random, does not come; ``"hum"``, a vibration of ``omega`` in strain gauge and accelerometers, as
            large as that of an unshaped move.
        samples: of the run.
        sample_time: s.
        begin: of the faults, s.
        end: of the faults, s.
        omega: of the hum, rad/s; by default ten times the slowest resonance of the paper's link.

    Raises:
        ValueError: for a kind that is none, or times the wrong way round.
    """
    _check.one_of(kind, "kind", KINDS)
    if not 0 <= begin < end:
        raise ValueError(f"begin must be before end and not negative, not {begin} and {end}")
    at = np.arange(samples) * sample_time
    during = (at >= begin) & (at < end)
    none, first = Faults.none(samples), int(np.argmax(during))
    hum = np.where(during, np.sin(omega * at), 0.0)
    changes: dict[str, dict[str, Any]] = {
        "knock": dict(added=none.added.at[first : first + 3].set(jnp.array(_KNOCK))),
        "dead": dict(alive=jnp.where(during, 0.0, 1.0)),
        "nan": dict(missing=jnp.asarray(during)),
        "frozen": dict(frozen=jnp.asarray(during)),
        "dropped": dict(missing=during & jax.random.bernoulli(jax.random.key(5), 0.2, during.shape)),
        "hum": dict(added=jnp.asarray(hum[:, None] * np.array(_HUM))),
    }
    return none._replace(**changes[kind])
