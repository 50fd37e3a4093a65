"""Families of shift: environments whose truth is not the one that a policy has been given.

A family takes an environment's declared params and returns the true ones. A further one is a function of a few lines::

    def rusty(params: Params) -> Params:
        return scaled(params, {"nominal.damping": 4.0, "nominal.damper.c": 4.0, "damping": 4.0})

    scores = evaluate(Declared(policy, params), rusty(params))
"""

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jshape._check import Argument, Checked, finite, positive
from jshape._types import Scalar
from jshape.command import AbstractCommand
from jshape.moves import (
    AbstractMachine,
    AbstractPolicy,
    Choice,
    EnvState,
    Observation,
    Params,
    RampProfile,
    Sensor,
    StepProfile,
    TrapezoidProfile,
    observation_names,
)
from jshape.plants import AbstractPlant
from jshape_envs.baselines.oracles import FullOracle, Oracle

Family = Callable[[Params], Params]
"""The true params for declared ones."""

DAMPING = ("nominal.damper.c", "nominal.damping", "nominal.zeta", "damping")
"""Leaves of a machine that damp it."""


class Declared(AbstractPolicy):
    """A policy that knows the declared environment, in one that may be another.

    Attributes:
        policy: acts as if the environment were the declared one.
        params: the declared environment.
    """

    policy: AbstractPolicy
    params: Params

    def init(self, params: Params) -> Any:
        return self.policy.init(self.params)

    def act(self, memory: Any, observation: Observation, params: Params, state: EnvState) -> Choice:
        return self.policy.act(memory, as_in(self.params, observation, params), self.params, state)


def informed(policy: AbstractPolicy, params: Params) -> AbstractPolicy:
    """A policy with what it knows when it is judged: an oracle the true environment, any other the declared one."""
    return policy if isinstance(policy, Oracle | FullOracle) else Declared(policy, params)


def as_in(declared: Params, observation: Observation, params: Params) -> Observation:
    """An observation of one environment, its distance and payload in the units of another, the declared one."""
    place = observation_names(params).index
    observation = observation.at[place("distance")].multiply(params.distance[1] / declared.distance[1])
    if params.context != "hidden":
        half, others = (jnp.diff(p.payload)[0] / 2 for p in (params, declared))
        payload = jnp.mean(params.payload) + half * observation[place("payload")]
        observation = observation.at[place("payload")].set((payload - jnp.mean(declared.payload)) / others)
    return observation


class Dropouts(Sensor):
    """A sensor some of whose samples are missing and read 0.

    Attributes:
        share: probability that a sample is missing.
    """

    share: Scalar = eqx.field(default=0.1, converter=Argument(positive))

    def read(self, deflection: Float[Array, " samples"], noise: Float[Array, " samples"]) -> Float[Array, " size"]:
        missing, _, others = _from_noise(noise, self.share)
        return super().read(jnp.where(missing, 0.0, deflection), jnp.where(missing, 0.0, others))


class Biased(Sensor):
    """A sensor whose zero has drifted.

    Attributes:
        offset: what it reads too much, m.
    """

    offset: Scalar = eqx.field(default=0.0, converter=Argument(finite))

    def read(self, deflection: Float[Array, " samples"], noise: Float[Array, " samples"]) -> Float[Array, " size"]:
        return super().read(deflection + self.offset, noise)


class Spiky(Sensor):
    """A sensor some of whose samples are anything within its reach.

    Attributes:
        share: probability that a sample is.
    """

    share: Scalar = eqx.field(default=0.05, converter=Argument(positive))

    def read(self, deflection: Float[Array, " samples"], noise: Float[Array, " samples"]) -> Float[Array, " size"]:
        spike, place, others = _from_noise(noise, self.share)
        anything = self.reach * (2 * place - 1)
        return super().read(jnp.where(spike, anything, deflection), jnp.where(spike, 0.0, others))


def _from_noise(noise: Float[Array, " samples"], share: Scalar) -> tuple[Bool[Array, " samples"], Array, Array]:
    """Independent numbers from one normal number a sample: whether what has the probability ``share`` comes to pass, a
    uniform number in [0, 1) where it does, and a normal one where it does not."""
    even = jax.scipy.stats.norm.cdf(noise)
    rest = jnp.clip((even - share) / (1 - share), 1e-6, 1 - 1e-6)
    return even < share, even / share, jax.scipy.stats.norm.ppf(rest)


class Stuck(Sensor):
    """A sensor that sticks in some of the windows: from some sample on it repeats what it read there.

    Attributes:
        share: probability that it sticks in a window.
    """

    share: Scalar = eqx.field(default=0.1, converter=Argument(positive))

    def read(self, deflection: Float[Array, " samples"], noise: Float[Array, " samples"]) -> Float[Array, " size"]:
        stuck, place, others = _from_noise(noise[:1], self.share)
        noise = noise.at[:1].set(jnp.where(stuck, noise[:1], others))
        count = len(noise)
        last = jnp.where(stuck, (place * count).astype(jnp.int32), count - 1)
        read = jnp.minimum(jnp.arange(count), last)
        return super().read(deflection[read], noise[read])


class Altered(AbstractMachine):
    """A machine that is another one in every move.

    Attributes:
        machine: before it was altered.
        share: how much of it is altered.
    """

    machine: AbstractMachine
    share: Scalar = eqx.field(converter=Argument(positive))

    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        return self.machine.plant(payload, moves)

    def command(self, distance: Scalar, moves: Int[Array, ""]) -> AbstractCommand:
        return self.machine.command(distance, moves)

    def case(self, distance: Scalar, moves: Int[Array, ""]) -> Int[Array, ""]:
        return self.machine.case(distance, moves)

    def example(self, case: int) -> tuple[float, int]:
        return self.machine.example(case)

    def known(self, moves: Int[Array, ""]) -> Float[Array, " known"]:
        return self.machine.known(moves)

    def payload_unit(self) -> str:
        return self.machine.payload_unit()


class Swaying(Altered):
    """A machine whose payload is another one in every move: more and less, as a sine over the moves, by ``share``."""

    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        return self.machine.plant(payload * (1 + self.share * jnp.sin(moves / 2.0)).astype(payload.dtype), moves)


class Ageing(Altered):
    """A machine whose stiffness falls from move to move, by ``share`` in the end: half of it after 22 moves."""

    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        return self._aged(moves).plant(payload, moves)

    def command(self, distance: Scalar, moves: Int[Array, ""]) -> AbstractCommand:
        return self._aged(moves).command(distance, moves)

    def _aged(self, moves: Int[Array, ""]) -> AbstractMachine:
        less = self.share * -jnp.expm1(-moves / 32.0)
        return scaled_machine(self.machine, _stiff(1 - less, 1 - less / 3))


class LaggedStep(Checked):
    """A step by an actuator that takes a while, at constant speed.

    Attributes:
        time: that a move takes, s.
    """

    time: Scalar = eqx.field(converter=Argument(positive))

    def __call__(self, distance: Scalar) -> AbstractCommand:
        return RampProfile(jnp.abs(distance) / self.time)(distance)


def scaled(params: Params, factors: Mapping[str, Any]) -> Params:
    """The params with leaves of the machine, by their dotted paths, times factors; paths that it lacks are left out."""
    return dataclasses.replace(params, machine=scaled_machine(params.machine, factors))


def scaled_machine(machine: AbstractMachine, factors: Mapping[str, Any]) -> AbstractMachine:
    """A machine with leaves, by their dotted paths, times factors; paths that it lacks are left out."""

    def times(path: Any, value: Array) -> Array:
        factor = factors.get(jax.tree_util.keystr(path, simple=True, separator="."), 1.0)
        return (value * factor).astype(value.dtype)

    return jax.tree_util.tree_map_with_path(times, machine)


def with_payloads(params: Params, least: Any, greatest: Any) -> Params:
    """The params with payloads between other ends."""
    return dataclasses.replace(params, payload=jnp.stack([least, greatest]))


def with_sensor(params: Params, **values: Any) -> Params:
    """The params with a sensor some of whose values are others."""
    return dataclasses.replace(params, sensor=dataclasses.replace(params.sensor, **values))


def stiffness(params: Params, spring: float, others: float) -> Params:
    """The params with a factor of a Duffing spring's cubic stiffness, and one of what else is stiff in a machine, or
    long in a crane: leaves whose change a payload does not explain away."""
    return scaled(params, _stiff(spring, others))


def _stiff(spring: Any, others: Any) -> dict[str, Any]:
    names = ("nominal.gravity", "nominal.link.omega", "low", "high")
    return {"nominal.spring.k3": spring, **dict.fromkeys(names, others)}


def damping(params: Params, factor: float) -> Params:
    """The params with a factor of the machine's damping."""
    return scaled(params, dict.fromkeys(DAMPING, factor))


def of_kind(params: Params, kind: type[Sensor], **values: Any) -> Params:
    """The params with a sensor of another kind, with those further values."""
    kept = {field.name: getattr(params.sensor, field.name) for field in dataclasses.fields(Sensor)}
    return dataclasses.replace(params, sensor=kind(**kept, **values))


def missing(params: Params, share: float) -> Params:
    """The params with a sensor of which such a share of the samples is missing."""
    return of_kind(params, Dropouts, share=jnp.asarray(share, params.period.dtype))


def heavier(params: Params) -> Params:
    """Payloads above the range, by up to half of its width."""
    least, greatest = params.payload
    return with_payloads(params, greatest, greatest + (greatest - least) / 2)


def farther(params: Params) -> Params:
    """Moves longer than the longest one, by up to a quarter."""
    return dataclasses.replace(params, distance=params.distance[1] * jnp.array([1.0, 1.25], params.period.dtype))


def swaying(params: Params) -> Params:
    """The payload differs in every move, by up to 15 %."""
    return dataclasses.replace(params, machine=Swaying(params.machine, jnp.full_like(params.period, 0.15)))


def lagging(params: Params) -> Params:
    """A step takes a twentieth of a period, as does a motor to be on, and accelerations are less by 30 %."""
    machine, time = params.machine, 0.05 * params.period
    profile = getattr(machine, "profile", None)
    if isinstance(profile, StepProfile):
        slower: Any = LaggedStep(time)
    elif isinstance(profile, RampProfile):
        slower = TrapezoidProfile(profile.speed, profile.speed / time)
    elif isinstance(profile, TrapezoidProfile):
        slower = TrapezoidProfile(profile.speed, 0.7 * profile.acceleration)
    else:
        raise ValueError(f"params: it is not known how a {type(profile).__name__} lags")
    return dataclasses.replace(params, machine=eqx.tree_at(lambda m: m.profile, machine, slower))


def lighter(params: Params) -> Params:
    """Payloads below the range, by up to a quarter of its width, and by no more than half of the least."""
    least, greatest = params.payload
    return with_payloads(params, jnp.maximum(least - (greatest - least) / 4, least / 2), least)


def nearer(params: Params) -> Params:
    """Moves shorter than the shortest one, down to half of it."""
    return dataclasses.replace(params, distance=params.distance[0] * jnp.array([0.5, 1.0], params.period.dtype))


def biased(params: Params) -> Params:
    """The sensor reads too much by a fiftieth of its reach: its zero has drifted."""
    return of_kind(params, Biased, offset=params.sensor.reach / 50)


def worn(params: Params) -> Params:
    """Softer, less damped and noisier, all at once."""
    found = damping(stiffness(params, 0.75, 0.92), 0.5)
    return with_sensor(found, noise=2 * params.sensor.noise)


def rusty(params: Params) -> Params:
    """Stiffer, more damped and noisier, all at once."""
    found = damping(stiffness(params, 1.25, 1.06), 4.0)
    return with_sensor(found, noise=2 * params.sensor.noise)


def ageing(params: Params) -> Params:
    """The stiffness falls from move to move, by a quarter in 64 moves."""
    return dataclasses.replace(params, machine=Ageing(params.machine, jnp.full_like(params.period, 0.3)))


def overloaded(params: Params) -> Params:
    """Payloads above the range, on what is softer."""
    return stiffness(heavier(params), 0.85, 0.95)


DECLARED: dict[str, Family] = {
    "none": lambda params: params,
    "heavier": heavier,
    "farther": farther,
    "stiffer": partial(stiffness, spring=1.5, others=1.1),
    "damped": partial(damping, factor=3.0),
    "undamped": partial(damping, factor=0.2),
    "hardly-damped": partial(damping, factor=0.1),
    "noisy": lambda params: with_sensor(params, noise=4 * params.sensor.noise),
    "missing": partial(missing, share=0.1),
    "swaying": swaying,
    "lagging": lagging,
    "softer": partial(stiffness, spring=0.6, others=0.88),
    "worn": worn,
    "spiky": lambda params: of_kind(params, Spiky, share=jnp.asarray(0.05, params.period.dtype)),
}
"""The families that the guard's first debt is calibrated on: payloads and moves beyond the range, another spring law,
other damping, noise, missing and wrong samples, a payload that changes in every move, a slow actuator. ``none`` is no
shift."""

HELD_OUT: dict[str, Family] = {
    "lighter": lighter,
    "nearer": nearer,
    "frictionless": partial(damping, factor=0.01),
    "biased": biased,
    "miscalibrated": lambda params: with_sensor(params, reach=params.sensor.reach / 1.2),
    "restless": lambda params: dataclasses.replace(params, change_rate=jnp.minimum(3 * params.change_rate, 1.0)),
    "patchy": partial(missing, share=0.4),
    "rusty": rusty,
    "ageing": ageing,
    "overloaded": overloaded,
    "stuck": lambda params: of_kind(params, Stuck, share=jnp.asarray(0.1, params.period.dtype)),
    "coarse": lambda params: with_sensor(params, resolution=16 * params.sensor.resolution),
}
"""The families that neither training nor calibration has used; for judging alone."""

FAMILIES = DECLARED | HELD_OUT
