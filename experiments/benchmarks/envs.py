"""Moves a second: the environments' functional core and Gymnasium face, beside CartPole's and Pendulum's.

    python -m experiments.benchmarks.envs        # a minute; writes envs.json and envs.md beside this file

1,024 environments with random actions; every observation and reward is summed up, so that nothing can be left out of
the computation. A step of the others is one Euler step of two or four equations; a step here is a whole move, so
integration steps a second are reported, too. The errors are the worst over 128 random moves, against double precision
with eight times the steps (or the same closed form), over the energy of the bare move. Times are the least of several
rounds. Needs gymnax for its row.
"""

import os
import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
from jshape_envs import ENVIRONMENTS, Params, parameters, reset, step

from experiments.benchmarks.record import about, keep
from experiments.markdown import table
from jshape.moves import Steps
from jshape.moves.physics import of_first_axis
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule

ENVS, MOVES, ROUNDS, JUDGED = 1024, 32, 5, 128


def main() -> None:
    rows = []
    for name in ENVIRONMENTS:
        params = parameters(name)
        steps = integration_steps(params)
        rows.append(row(f"{name}, core under scan", *core(params), steps))
    duffing = parameters("DuffingPayload")
    ours = gym.make_vec("jshape_envs:jshape/Moves-v0", num_envs=ENVS, environment=duffing)
    rows.append(row("DuffingPayload, gym.make_vec", *steps_of(ours), integration_steps(duffing)))
    rows.append(row("CartPole-v1, gym.make_vec", *steps_of(gym.make_vec("CartPole-v1", num_envs=ENVS)), 1))
    rows += gymnax_rows()
    errors = {name: error(parameters(name)) for name in ENVIRONMENTS}
    print("errors", errors)
    write(rows, errors)


def row(what: str, seconds: float, processor: float, steps: int) -> dict[str, Any]:
    """``seconds``, ``processor``: of ``ENVS`` × ``MOVES`` steps, on the wall and on all processors."""
    per_second, microseconds = ENVS * MOVES / seconds, 1e6 * processor / ENVS / MOVES
    print(f"{what:36s} {per_second:12.0f} a second, {microseconds:.2f} µs of processor time each")
    return dict(what=what, rate=per_second, processor_microseconds=microseconds, substeps=per_second * steps)


def fastest(run: Callable[[], Any]) -> tuple[float, float]:
    run()
    best = (np.inf, np.inf)
    for _ in range(ROUNDS):
        begin, busy = time.perf_counter(), time.process_time()
        run()
        best = min(best, (time.perf_counter() - begin, time.process_time() - busy))
    return best


def under_scan(reset: Callable[..., Any], step: Callable[..., Any], size: int, bound: float) -> tuple[float, float]:
    """Times of random actions under one compiled scan.

    Args:
        reset: keys → states.
        step: keys, states and actions → states, and what is summed up so that all of it is computed.
        size: entries of an action.
        bound: of each entry.
    """

    @jax.jit
    def run(key):
        first, key = jax.random.split(key)

        def advance(carry, key):
            states, total = carry
            draw, key = jax.random.split(key)
            actions = jax.random.uniform(draw, (ENVS, size), minval=-bound, maxval=bound)
            states, outcome = jax.vmap(step)(jax.random.split(key, ENVS), states, actions)
            return (states, total + sum(jnp.sum(x) for x in outcome)), None

        states = jax.vmap(reset)(jax.random.split(first, ENVS))
        return jax.lax.scan(advance, (states, 0.0), jax.random.split(key, MOVES))[0]

    return fastest(lambda: jax.block_until_ready(run(jax.random.key(0))))


def core(params: Params) -> tuple[float, float]:
    """Times of the functional core."""

    def advance(key, state, action):
        state, observation, reward, _, _, info = step(key, state, action, params)
        return state, (observation, reward, info.residual)

    return under_scan(lambda key: reset(key, params)[0], advance, params.action.size, 1.0)


def steps_of(env: Any) -> tuple[float, float]:
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(MOVES)]

    def run() -> float:
        total = 0.0
        for action in actions:
            observation, reward, *_ = env.step(action)
            total += float(observation.sum()) + float(reward.sum())
        return total

    return fastest(run)


def gymnax_rows() -> list[dict[str, Any]]:
    try:
        import gymnax  # pyright: ignore[reportMissingImports]
    except ImportError:
        print("gymnax is not installed: its row is left out")
        return []
    env, params = gymnax.make("Pendulum-v1")

    def advance(key, state, action):
        observation, state, reward = env.step(key, state, action, params)[:3]
        return state, (observation, reward)

    found = under_scan(lambda key: env.reset(key, params)[1], advance, 1, 2.0)
    return [row("gymnax Pendulum-v1, under scan", *found, 1)]


def integration_steps(params: Params) -> int:
    """Runge–Kutta steps of one move and its window; 0 for a plant in closed form."""
    shaper = jax.eval_shape(params.action.shaper, jnp.zeros(params.action.size))
    none = jnp.zeros((), jnp.int32)
    plant, command = params.machine.plant(params.payload[0], none), params.machine.command(params.distance[1], none)
    if plant.coast() is not None and schedule(plant, command).coefficients.shape[-1] == 1:
        return 0
    one = Shaper(jnp.ones_like(shaper.times) / len(shaper.times), jnp.zeros_like(shaper.times))
    segments = len(schedule(plant, command, of_first_axis(plant, one)).breaks) - 1
    return segments * params.steps.move + params.sensor.samples * params.steps.window


def error(params: Params) -> float:
    """The worst error of a residual energy, over the bare move's; in a process with 64 bits."""
    with jax.enable_x64(True):
        actions = np.random.default_rng(0).uniform(-1, 1, (JUDGED, params.action.size)).astype(np.float32)
        keys = jax.random.split(jax.random.key(0), JUDGED)
        states, _ = jax.vmap(reset, in_axes=(0, None))(keys, params)

        def wide(tree: Any) -> Any:
            """The pytree in double precision."""
            return jax.tree.map(lambda x: x.astype(jnp.float64) if x.dtype == jnp.float32 else x, tree)

        finer = eqx.tree_at(
            lambda p: p.steps, wide(params), Steps(8 * params.steps.move, 8 * params.steps.window),
            is_leaf=lambda x: isinstance(x, Steps),
        )  # fmt: skip

        @jax.jit
        def infos(states: Any, actions: Any, params: Params) -> Any:
            return jax.vmap(step, in_axes=(0, 0, 0, None))(keys, states, actions, params)[5]

        found, exact = infos(states, actions, params), infos(wide(states), actions.astype(float), finer)
        bare = exact.evaluation.energy / exact.residual
        worst = jnp.where(
            exact.lost | found.lost, 0.0, jnp.abs(found.evaluation.energy - exact.evaluation.energy) / bare
        )
        return float(jnp.max(worst))


def write(rows: list[dict[str, Any]], errors: dict[str, float]) -> None:
    fine = [f"{r['substeps'] / 1e6:.3g} million" if r["substeps"] else "closed form" for r in rows]
    cells = [(r["what"], f"{r['rate']:,.0f}", f"{r['processor_microseconds']:.2f}") for r in rows]
    head = ("1,024 environments", "steps a second", "µs of processor time", "integration steps a second")
    lines = [*table(head, [(*c, f) for c, f in zip(cells, fine, strict=True)]), ""]
    head = ("residual energy", "worst error over the bare move's energy")
    lines += table(head, [(name, f"{value:.1e}") for name, value in errors.items()])
    device = jax.devices()[0]
    where = f"{os.cpu_count()} cores" + ("" if device.platform == "cpu" else f", {device}")
    gymnax = ["gymnax"] if any("gymnax" in r["what"] for r in rows) else []
    ran = about(where, "jax", "gymnasium", "numpy", *gymnax) | dict(environments=ENVS)
    keep(__file__, dict(about=ran, rows=rows, errors=errors), lines)


if __name__ == "__main__":
    main()
