"""``parameters``: the ``Params`` of an environment that comes with the package, or of a machine of your own."""

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jshape import Shaper, _check
from jshape._files import read_arrays
from jshape._types import Scalar
from jshape.design.linear import multi_mode
from jshape.moves.actions import AbstractAction, ImpulseAction, ModalAction, ResidualAction
from jshape.moves.core import CONTEXTS, Params
from jshape.moves.design import design_table
from jshape.moves.machine import CASES, AbstractMachine
from jshape.moves.oracle import ShaperTable
from jshape.moves.physics import Steps, of_first_axis, plan_move, run_move, run_window
from jshape.moves.sensor import Sensor
from jshape.simulation.schedule import Schedule, schedule
from jshape.simulation.simulate import steps_for
from jshape_envs.presets import ENVIRONMENTS, Environment, Preset

ACTIONS = ("modal", "impulses", "residual")

TABLES = Path(__file__).parent / "tables"
"""The oracles of the presets, made by experiments/learning/oracles.py."""

TABLE_FORMAT = "jshape-oracle 1"

_TOLERANCE = 4e-7
"""Of ``steps_for``, for a machine of one's own: half a radian a step at most, by which the energy of a linear mode is
off by 2e-5 of itself after ten periods, its state by 2e-4."""

ENERGY_WEIGHT, TIME_WEIGHT = 1.0, 0.1
"""Cost of a normalised residual energy of 1, and of a shaper of one period, unless other weights are given."""


def parameters(
    environment: str | AbstractMachine,
    preset: str = "paper",
    *,
    action: str = "modal",
    context: str = "hidden",
    observation: str = "samples",
    tell_change: bool = False,
    payload: tuple[float, float] | None = None,
    distance: tuple[float, float] | None = None,
    change_rate: float | None = None,
    noise: float | None = None,
    resolution: float | None = None,
    reach: float | None = None,
    window: float | None = None,
    samples: int = 16,
    impulses: int | None = None,
    horizon: int = 64,
    carry: bool = True,
    track: float | None = None,
    energy_weight: float = ENERGY_WEIGHT,
    time_weight: float = TIME_WEIGHT,
    context_noise: float = 0.2,
    dtype: Any = jnp.float32,
) -> Params:
    """The parameters of an environment, ready for ``reset`` and ``step``.

    Oracles of the presets come with the package; other payloads, moves or weights have one designed, which takes some
    ten seconds, of two modes a minute. Each of their moves, unless it is a step, takes half as long again, since the
    bare one that its residual is counted by is simulated as well.

    Args:
        environment: a name of ``presets.ENVIRONMENTS``, or a machine, which has no presets.
        preset: ``"easy"``, ``"paper"``, ``"hard"`` or ``"out-of-distribution"``.
        action: ``"modal"``, ``"impulses"`` or ``"residual"``, on a ZVD (two modes: ZV) for the middle payload.
        context: whether the payload of the next move is ``"hidden"``, ``"observed"`` or ``"noisy"``.
        observation: ``"samples"`` or ``"features"`` of the vibration.
        tell_change: whether an observation holds how many moves ago the payload changed.
        payload: least and greatest, in the unit of the plant's leaf; needed for a machine.
        distance: shortest and longest move, m; needed for a machine.
        change_rate: probability that the payload is another one in the next move.
        noise: standard deviation of the sensor's noise, over its reach.
        resolution: the sensor's quantisation step, over its reach.
        reach: greatest deflection that the sensor measures, m (rad for an angle); for a machine the greatest after any
            of its moves without a shaper, from rest, unless given.
        window: how long the sensor measures after a move, s.
        samples: number of samples in the window.
        impulses: number of impulses of ``"impulses"`` actions.
        horizon: moves an episode.
        carry: whether the vibration left from one move is the beginning of the next.
        track: greatest distance from where the machine began, m; twice the longest move unless given.
        energy_weight: cost of a normalised residual energy of 1.
        time_weight: cost of a shaper of one nominal period.
        context_noise: standard deviation of a noisily observed payload, over half its range.
        dtype: of everything; ``float64`` needs JAX's 64 bits.

    Raises:
        ValueError: for an unknown name or word, ranges that are empty or not positive where they must be, and numbers
            out of range.
    """
    given: dict[str, Any] = dict(payload=payload, distance=distance, change_rate=change_rate)
    given |= dict(noise=noise, resolution=resolution)
    known, chosen, machine = _find(environment, preset, {k: v for k, v in given.items() if v is not None})
    _check.one_of(action, "action", ACTIONS)
    _check.one_of(context, "context", CONTEXTS)
    _check_numbers(chosen, energy_weight, time_weight, context_noise)
    horizon = _check.count(horizon, "horizon")
    if not jnp.issubdtype(dtype, jnp.floating):
        raise ValueError(f"dtype must be one of floating-point numbers, not {dtype!r}")
    longest_move = max(chosen.distance)
    track = 2 * longest_move if track is None else track
    if not track >= longest_move:
        raise ValueError(f"track must leave room for the longest move, {longest_move} m, not {track}")

    machine, payloads, distances = _cast((machine, np.asarray(chosen.payload), np.asarray(chosen.distance)), dtype)
    plants = [machine.plant(p, jnp.zeros((), jnp.int32)) for p in (*payloads, jnp.mean(payloads))]
    frequencies = np.array([np.atleast_1d(np.asarray(plant.natural_frequency())) for plant in plants])
    if not np.all(np.isfinite(frequencies) & (frequencies > 0)):
        found = ", ".join(_check.show(each) for each in frequencies)
        raise ValueError(
            f"payload: natural frequencies (rad/s) must be positive, not {found} with {payloads[0]:g}, {payloads[1]:g} "
            "and the mean of the two"
        )
    period = _cast(2 * np.pi / frequencies[-1].min(), dtype)
    if known is None:
        known = Environment(type(machine), longest_move, 1.25 * float(period), 3, 0.75 * float(period), (9, 9), {})
    window = known.window if window is None else window
    move_steps, window_steps = chosen.steps or _steps(
        machine, payloads, distances, known.longest, float(window), samples
    )
    steps = Steps(move_steps, window_steps)
    sensor = Sensor(known.reach, 0.0, 0.0, window, samples, observation)
    if reach is None:
        reach = known.reach if known.presets else _reach(machine, payloads, distances, _cast(sensor, dtype), steps)
    sensor = dataclasses.replace(sensor, reach=reach, noise=chosen.noise * reach, resolution=chosen.resolution * reach)
    weights = (_cast(energy_weight, dtype), _cast(time_weight, dtype))
    table = _shipped(environment, preset, chosen, energy_weight, time_weight)
    if table is None:
        table = design_table(machine, payloads, distances, weights, period, steps, known.grid)
        # It was not checked that this grid follows the bare move's energy, which is simulated with every move instead.
        table = dataclasses.replace(table, reference=None)
    table = _cast(table, dtype)
    impulses = known.impulses if impulses is None else impulses
    arrays = dict(
        machine=machine, payload=payloads, distance=distances, track=track, change_rate=chosen.change_rate,
        horizon=jnp.asarray(horizon, jnp.int32), carry=bool(carry), energy_weight=weights[0], time_weight=weights[1],
        period=period, context_noise=context_noise, sensor=sensor, oracle=table,
        action=_action(action, frequencies, table, known.longest, impulses),
    )  # fmt: skip
    return Params(**_cast(arrays, dtype), steps=steps, context=context, tell_change=bool(tell_change))


def _find(environment: Any, preset: str, given: dict[str, Any]) -> tuple[Environment | None, Preset, AbstractMachine]:
    """The environment (none for a machine), the preset with what is given in its place, and the machine."""
    if isinstance(environment, AbstractMachine):
        for name in ("payload", "distance"):
            if name not in given:
                raise ValueError(f"{name} (least, greatest) must be given for a machine of your own")
        plain: dict[str, Any] = dict(machine={}, change_rate=0.1, noise=0.005, resolution=0.002, steps=())
        return None, Preset(**(plain | given)), environment
    if not isinstance(environment, str):
        raise ValueError(f"environment must be a name or a machine, not {environment!r}")
    _check.one_of(environment, "environment", tuple(ENVIRONMENTS))
    known = ENVIRONMENTS[environment]
    _check.one_of(preset, "preset", tuple(known.presets))
    chosen = dataclasses.replace(known.presets[preset], **given)
    return known, chosen, known.machine(**chosen.machine)


def _check_numbers(chosen: Preset, energy_weight: float, time_weight: float, context_noise: float) -> None:
    """Raises ``ValueError`` for ranges and weights that make no sense."""
    for name in ("payload", "distance"):
        ends = getattr(chosen, name)
        _check.finite(np.asarray(ends, float), name)
        if len(ends) != 2 or not ends[0] < ends[1]:
            raise ValueError(f"{name} must be (least, greatest), not {ends!r}")
    _check.positive(chosen.distance[0], "distance")
    if not 0 <= chosen.change_rate <= 1:
        raise ValueError(f"change_rate must lie between 0 and 1, not {chosen.change_rate}")
    _check.positive(energy_weight, "energy_weight")
    _check.not_negative(time_weight, "time_weight")
    _check.not_negative(context_noise, "context_noise")


def _cast(tree: Any, dtype: Any) -> Any:
    """The pytree with all its floating-point leaves of that type."""
    arrays = jax.tree.map(jnp.asarray, tree)
    return jax.tree.map(lambda x: x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, arrays)


def _steps(
    machine: AbstractMachine,
    payloads: Float[Array, "2"],
    distances: Float[Array, "2"],
    gap: float,
    window: float,
    samples: int,
) -> list[int]:
    """Enough steps of a move, for gaps that long (s), and of the window, for the least and greatest moves of each kind.

    The longest segment is one of a long move, or what a short one leaves of the gap.
    """
    dtype = distances.dtype
    pair = Shaper(np.array([0.5, 0.5], dtype), np.array([0.0, gap], dtype))
    examples = [machine.example(case) for case in range(CASES)]
    found = []
    for payload, distance, (sign, moves) in itertools.product((*payloads, jnp.mean(payloads)), distances, examples):
        before = jnp.asarray(moves)
        plant, command = machine.plant(payload, before), machine.command(sign * distance, before)
        plan = schedule(plant, command, of_first_axis(plant, pair))
        still = Schedule(jnp.asarray([0.0, window / samples], dtype), plan.coefficients[-2:])
        found.append([steps_for(plant, part, "tsit5", _TOLERANCE) for part in (plan, still)])
    return np.max(found, axis=0).tolist()


def _reach(
    machine: AbstractMachine, payloads: Float[Array, "2"], distances: Float[Array, "2"], sensor: Sensor, steps: Steps
) -> float:
    """The greatest deflection in the window after moves of both kinds without a shaper, m (rad for an angle).

    The longest move, where a plant diverges or none leaves anything.
    """

    def left(payload: Scalar, distance: Scalar, moves: Int[Array, ""]) -> Scalar:
        plant = machine.plant(payload, moves)
        plan = plan_move(plant, machine.command(distance, moves), None, jnp.zeros_like(distance))
        state, _ = run_move(plant, plan, plant.rest_state(plant.zero_inputs()).astype(distance.dtype), steps)
        return jnp.max(jnp.abs(run_window(plant, plan, state, sensor, steps)[1]))

    spans = jnp.linspace(payloads[0], payloads[1], 5), jnp.linspace(distances[0], distances[1], 17)
    every, length = (each.ravel() for each in jnp.meshgrid(*spans))
    over = jax.jit(jax.vmap(left, (0, 0, None)))
    examples = [machine.example(case) for case in range(CASES)]
    greatest = float(np.max([over(every, sign * length, jnp.asarray(moves)) for sign, moves in examples]))
    return greatest if 0 < greatest < jnp.inf else float(distances[1])


def table_file(environment: str, preset: str) -> Path:
    """The file of the oracle's table of a preset."""
    return TABLES / f"{environment}_{preset}.npz"


def _shipped(environment: Any, preset: str, chosen: Preset, energy_weight: float, time_weight: float) -> Any:
    """The table that comes with the package, if it is for this very preset's payloads, moves and weights."""
    if not isinstance(environment, str) or (energy_weight, time_weight) != (ENERGY_WEIGHT, TIME_WEIGHT):
        return None
    own = ENVIRONMENTS[environment].presets[preset]
    path = table_file(environment, preset)
    if (own.payload, own.distance) != (tuple(chosen.payload), tuple(chosen.distance)) or not path.exists():
        return None
    _, stored = read_arrays(path, TABLE_FORMAT)
    return ShaperTable(**{name: jnp.asarray(values) for name, values in stored.items()})


def _action(
    kind: str, frequencies: Float[np.ndarray, "3 modes"], table: ShaperTable, longest: float, impulses: int
) -> AbstractAction:
    """The action of that kind, its ranges wide enough for all payloads."""
    if kind == "impulses":
        return ImpulseAction(longest, impulses)
    if kind == "residual":
        modes = [(omega, 0.0) for omega in frequencies[-1]]
        return ResidualAction(multi_mode(modes, "zvd" if len(modes) == 1 else "zv"))
    slowest, fastest = frequencies.min(axis=0), frequencies.max(axis=0)
    if len(slowest) == 1:
        # A nonlinear plant's half periods are not the linear ones; the oracle's are about them.
        swings = np.pi / np.asarray(table.times[..., 1])
        slowest, fastest = np.minimum(slowest, swings.min()), np.maximum(fastest, swings.max())
    return ModalAction(slowest / 1.25, fastest * 1.25)
