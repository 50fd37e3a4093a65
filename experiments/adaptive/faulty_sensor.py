"""A sensor with one of many faults: of a random size, from a random sample on."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jshape._types import Times
from jshape.moves import NoisySensor

FAULTS = (
    "none",
    "stays what it was, from some sample on",
    "nothing more comes, from some sample on",
    "readings are missing here and there",
    "reads 0, from some sample on",
    "a twentieth of the readings is off",
    "three readings are off",
    "more noise",
    "an offset",
    "an offset, from some sample on",
    "a drift",
    "another gain",
    "another gain, from some sample on",
    "the wrong sign",
    "late",
    "saturated",
    "coarse",
)
"""Sizes are even in their logarithm, from one to a thousand standard deviations of the sensor, either way. Gains lie
between a half and two, a delay is at most a quarter of what is seen before the plan, and saturation comes at any share
of the greatest reading until then."""


class FaultySensor(NoisySensor):
    """A sensor that is faulty in the moves that ``frozen`` marks.

    Attributes:
        kind: index of ``FAULTS``.
        seen: readings before the plan; a fault begins with one of them.
    """

    kind: Int[Array, ""] = eqx.field(default=0, converter=jnp.asarray)
    seen: int = eqx.field(default=2, static=True)

    def read(self, signal: Times, draw: Times, missing: Bool[Array, " times"], frozen: Bool[Array, " times"]) -> Times:
        fine = super().read(signal, draw, missing, jnp.zeros_like(frozen))
        keys = jax.random.split(jax.random.key(jnp.abs(1e6 * draw[0]).astype(jnp.uint32)), 3)
        number = jnp.arange(len(fine))
        begin, lag = jax.random.randint(keys[0], (2,), 1, jnp.array([self.seen, max(self.seen // 4, 2)]))
        share = jax.random.uniform(keys[1], minval=-1.0, maxval=1.0)
        size = jnp.sign(share) * self.std * 1000.0 ** jnp.abs(share)
        normal = jax.random.normal(keys[2], fine.shape)
        late, top = number >= begin, jnp.max(jnp.abs(fine), where=number < self.seen, initial=0.0)

        def where(condition: Bool[Array, " times"], value: Any) -> Times:
            return jnp.where(condition, value, fine)

        found = [
            fine, where(late, fine[begin - 1]), where(late, jnp.nan), where(normal > share, jnp.nan), where(late, 0.0),
            where(normal > 1.645, fine + size), where(abs(number - begin) < 2, fine + size), fine + size * normal,
            fine + size, where(late, fine + size), fine + size * number / self.seen, fine * 2.0**share,
            where(late, fine * 2.0**share), -fine, fine[jnp.maximum(number - lag, 0)],
            jnp.clip(fine, -top * abs(share), top * abs(share)), abs(size) * jnp.round(fine / abs(size)),
        ]  # fmt: skip
        return jnp.where(frozen, jnp.stack(found)[self.kind], fine)
