"""The closed loop: a link whose load changes, its sensors, and strategies side by side, sample by sample.

    link = js.adaptive.SampledLink(js.plants.FlexibleLink(), loads=(0.0, 20.0), sample_time=0.005)
    strategies = {name: js.adaptive.case(name, 0.005) for name in ("unshaped", "state-aware")}
    traces = js.adaptive.run(link, strategies, reference, which)

Each strategy has a link of its own; all get the same noise and the same faults. A run is one scan, and ``vmap`` runs
hundreds of schedules side by side.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from jshape import _check
from jshape._types import ArrayLike
from jshape.adaptive.closed_loop.sampled_link import Readings, SampledLink, Sensors
from jshape.adaptive.strategies.strategy import AbstractStrategy
from jshape.quantisation import quantised


class Faults(NamedTuple):
    """Faults of the sensors, sample by sample: shape (samples,) for all four alike, (samples, 4) for one each."""

    added: Float[Array, "samples 4"]
    """Added to the readings, in their units and order: a knock, a hum."""
    alive: Float[Array, "samples ..."]
    """What the readings are multiplied with: 0 is a dead sensor."""
    missing: Bool[Array, "samples ..."]
    """The sample does not come: the reading is NaN."""
    frozen: Bool[Array, "samples ..."]
    """The reading stays what it was."""
    coarse: Float[Array, "samples ..."]
    """To what steps the readings are rounded, in their units; 0 for none."""

    @classmethod
    def none(cls, samples: int) -> "Faults":
        """Sensors that work."""
        never = jnp.zeros(samples, bool)
        return cls(jnp.zeros((samples, 4)), jnp.ones(samples), never, never, jnp.zeros(samples))


class Trace(NamedTuple):
    """The signals of a run, each with a leading axis of samples."""

    command: Float[Array, " samples"]
    """Of the motor's reference, rad."""
    payload: Float[Array, " samples"]
    """The payload's angle, rad."""
    deflection: Float[Array, " samples"]
    """The payload's angle against the motor's, rad."""
    tip: Float[Array, " samples"]
    """The acceleration that the tip's accelerometer should read, m/s²."""
    middle: Float[Array, " samples"]
    """The same in the middle."""
    omega: Float[Array, "samples modes"]
    """The frequencies that the shaper is tuned to, rad/s."""
    zeta: Float[Array, "samples modes"]
    rejected: Int[Array, " samples"]
    """How many samples or estimates the strategy has rejected so far."""


def run(
    link: SampledLink,
    strategies: Mapping[str, AbstractStrategy],
    reference: ArrayLike,
    which: Any,
    *,
    sensors: Sensors | None = None,
    faults: Faults | None = None,
    key: PRNGKeyArray | None = None,
) -> dict[str, Trace]:
    """Run all strategies on the same schedule.

    Args:
        link: the machine, with all loads that it will carry.
        strategies: by name.
        reference: the motor's reference angle at each sample, rad, shape (samples,); the link begins at rest at the
            first.
        which: index of the load that hangs at the tip at each sample, shape (samples,).
        sensors: noise and resolution; the defaults of ``Sensors``, unless given.
        faults: of the sensors; none, unless given.
        key: of the noise.

    Raises:
        ValueError: for lists of different lengths, an index that no load has, a reference that is not finite, or a
            strategy with another sample time than the link's.
    """
    reference, which = _check.as_array(reference, "reference"), jnp.asarray(which)
    _check_schedule(link, strategies, reference, which)
    sensors = Sensors() if sensors is None else sensors
    faults = Faults.none(len(reference)) if faults is None else faults
    draws = jax.random.normal(jax.random.key(0) if key is None else key, (len(reference), 4))

    def tick(state: Any, sample: Any) -> tuple[Any, Any]:
        angle, which, draw, fault = sample
        new, traces = {}, {}
        for name, strategy in strategies.items():
            body, memory, command, before = state[name]
            readings = sensors.read(link.truth(body, command, which), draw)
            values = quantised(fault.alive * jnp.stack(list(readings)) + fault.added, fault.coarse)
            values = jnp.where(fault.frozen, before, values)
            memory, decision = strategy.step(memory, angle, Readings(*jnp.where(fault.missing, jnp.nan, values)))
            truth = link.truth(body, decision.command, which)
            traces[name] = Trace(
                decision.command, truth.motor + truth.strain, truth.strain, truth.tip, truth.middle,
                decision.omega, decision.zeta, jnp.asarray(decision.rejected),
            )  # fmt: skip
            new[name] = link.step(body, decision.command, which), memory, decision.command, values
        return new, traces

    rest = link.plant.rest_state(reference[0])
    still = jnp.stack(list(link.truth(rest, reference[0], which[0])))
    state = {name: (rest, s.start(reference[0]), reference[0], still) for name, s in strategies.items()}
    return jax.lax.scan(tick, state, (reference, which, draws, faults))[1]


def _check_schedule(link: SampledLink, strategies: Mapping[str, AbstractStrategy], reference: Any, which: Any) -> None:
    if reference.ndim != 1 or reference.shape != which.shape or not len(reference):
        raise ValueError(
            f"reference and which must be lists of the same length, not of shapes {reference.shape} and {which.shape}"
        )
    _check.finite(reference, "reference")
    if _check.is_concrete(which):
        wrong = (np.asarray(which) < 0) | (np.asarray(which) >= len(link.loads))
        if np.any(wrong):
            raise ValueError(f"which must index the {len(link.loads)} loads, not be {np.asarray(which)[wrong][0]}")
    for name, strategy in strategies.items():
        if not isinstance(strategy, AbstractStrategy):
            raise ValueError(f"strategies: {name} must be a strategy, not {strategy!r}")
        if _check.is_concrete(link) and not np.isclose(strategy.sample_time, float(link.sample_time), rtol=1e-9):
            raise ValueError(
                f"strategies: {name} must have the link's sample time, {link.sample_time} s, "
                f"not {strategy.sample_time} s"
            )
