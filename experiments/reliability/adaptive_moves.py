"""Faults in the records of whole moves, for the strategies that learn from move to move; ``adaptive.py`` runs them.

A Duffing pair makes steps of 1 m whose records of 151 or 200 samples are spoilt in three moves of ten, in one of
``SPOILT``; in the middle of its run its payload and damping change.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

import jshape as js

MOVES, SHARE, SIDE = 60, 0.3, 10
"""Moves of a machine, share of them whose record is spoilt, machines side by side."""
SPOILT = (
    "nan",
    "half nan",
    "dropped",
    "infinite",
    "huge",
    "large",
    "frozen",
    "dead",
    "sign",
    "scale",
    "knock",
    "spikes",
)
SPOILT += ("offset", "drift", "noise", "coarse")
KEPT = ("vibration", "amplitudes", "inside")


def spoil(record: Any, key: Any) -> Any:
    """A record with a fault of a random kind, of random size, from a random sample on."""
    kinds, place, size, draws, few = jax.random.split(key, 5)
    at = jnp.arange(len(record))
    begin, u = jax.random.randint(place, (), 0, len(record)), jax.random.uniform(size, minval=-1.0, maxval=1.0)
    late, noise = at >= begin, jax.random.normal(draws, record.shape)
    rare = jax.random.bernoulli(few, 0.05, record.shape)

    def either(condition, value):
        return jnp.where(condition, value, record)

    found = [
        jnp.full_like(record, jnp.nan), either(late, jnp.nan), either(noise > u, jnp.nan), either(rare, jnp.inf),
        either(rare, 1e300), either(rare, 1e8), either(late, record[begin]), 0.0 * record, -record,
        record * 10.0**u, either(abs(at - begin) < 2, 50.0), either(rare, 5.0 * noise), record + u,
        record + u * at / len(at), record + 10.0 ** (u - 1) * noise, jnp.round(record / (0.2 + u**2)) * (0.2 + u**2),
    ]  # fmt: skip
    return jnp.stack(found)[jax.random.randint(kinds, (), 0, len(SPOILT))]


class FaultySensor(js.adaptive.NoisySensor):
    """A sensor whose record of a move is spoilt where ``missing`` says so."""

    def read(self, signal: Any, draw: Any, missing: Any, frozen: Any) -> Any:
        record = super().read(signal, draw, frozen, frozen)
        key = jax.random.key(jnp.abs(1e6 * draw[0]).astype(jnp.uint32))
        return jnp.where(missing[0], spoil(record, key), record)


def adapting() -> Callable[..., dict[str, Any]]:
    """``Adapting`` on several machines: of their keys, and of which moves (machines, moves) are spoilt."""
    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0), damper=js.plants.LinearDamper(0.4))
    task = js.adaptive.TwoMassMoves(plant, ("spring.k1", "spring.k3", "damper.c"), horizon=6.0, samples=151)
    strategy = js.adaptive.Adapting(task, js.adaptive.NoisySensor(0.001, 0.0005), spread=0.5, drift=0.5)

    def one(key: Any, spoilt: Any) -> dict[str, Any]:
        drawn, noise = jax.random.split(key)
        moves = js.adaptive.random_payloads(drawn, task, moves=MOVES, change=MOVES // 2).moves
        moves = moves._replace(missing=jnp.broadcast_to(spoilt[:, None], moves.missing.shape))
        trace = js.adaptive.run_moves(task, strategy, moves, FaultySensor(0.001, 0.0005), noise)
        found = trace.memory.posterior
        inside = (found.parameters >= task.lower) & (found.parameters <= task.upper)
        return dict(vibration=trace.vibration, amplitudes=trace.shaper.amplitudes, inside=inside.all(1))

    return jax.vmap(one)


def seeking() -> Callable[..., dict[str, Any]]:
    """``GradientSeeking`` likewise; each move begins at rest."""
    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))
    strategy = js.adaptive.GradientSeeking(plant, ("spring.k1", "spring.k3", "m2"), horizon=4.0, noise=0.005)

    def one(key: Any, spoilt: Any) -> dict[str, Any]:
        drawn, noise = jax.random.split(key)
        masses = jnp.log(jax.random.uniform(drawn, (2,), minval=0.6, maxval=1.4))

        def move(state: Any, item: Any) -> tuple[Any, dict[str, Any]]:
            number, key, bad = item
            logs = jnp.stack([0.0, 0.0, 1.0]) * masses[number // (MOVES // 2)]
            shaper = js.design.energy.three_impulse(cast(js.plants.TwoMass, strategy.model(state)), 1.0)
            truth = strategy.model(state._replace(logs=logs))
            vibration = js.residual_vibration(truth, shaper, 1.0)
            record = strategy.predict(logs, shaper, 1.0)
            record = record + 0.005 * jax.random.normal(key, record.shape)
            state, fit = strategy.step(state, shaper, 1.0, jnp.where(bad, spoil(record, key), record))
            ratio = fit.parameters / strategy.nominal
            inside = jnp.all((ratio >= 0.999 / strategy.factor) & (ratio <= 1.001 * strategy.factor))
            return state, dict(vibration=vibration, amplitudes=shaper.amplitudes, inside=inside)

        items = jnp.arange(MOVES), jax.random.split(noise, MOVES), spoilt
        return jax.lax.scan(move, strategy.start(), items)[1]

    return jax.vmap(one)


def rows(hours: float, seed: int, kept: Callable[..., dict[str, Any]]) -> Iterator[list[object]]:
    """A row of a table for each strategy, as each is done; ``kept(name, compute)`` computes only what is not kept."""
    for name, run, seconds in (("Adapting", adapting, 6.0), ("GradientSeeking", seeking, 4.0)):
        chunks = max(round(3600 * hours / seconds / MOVES / SIDE), 1)
        keys = jax.random.split(jax.random.key(seed), chunks * SIDE)
        spoilt = np.random.default_rng(seed).random((chunks * SIDE, MOVES)) < SHARE
        # Whether they recover is seen in ten moves without faults, and the change is seen at all.
        spoilt[:, -10:] = False
        compiled, parts, begun = jax.jit(run()), [], time.perf_counter()
        for i in range(0, len(keys), SIDE):
            some = slice(i, i + SIDE)
            compute = partial(_pair, compiled, keys[some], spoilt[some])
            parts.append(kept(f"{name}.{seed}.{i}.{len(keys)}", compute))
            left = (time.perf_counter() - begun) * (len(keys) / (i + SIDE) - 1)
            print(f"{name}: {100 * (i + SIDE) / len(keys):.0f} % done, {left:.0f} s left", flush=True)
        bad, fine = ({k: np.concatenate([part[f"{j}{k}"] for part in parts]) for k in KEPT} for j in (0, 1))
        yield [name, *_row(bad, fine, spoilt)]


def _pair(compiled: Any, keys: Any, spoilt: np.ndarray) -> dict[str, Any]:
    """Some machines with spoilt records (0) and without (1)."""
    both = compiled(keys, jnp.asarray(spoilt)), compiled(keys, jnp.zeros(spoilt.shape, bool))
    return {f"{j}{key}": np.asarray(one[key]) for j, one in enumerate(both) for key in KEPT}


def _row(bad: dict[str, Any], fine: dict[str, Any], spoilt: np.ndarray) -> list[object]:
    levels = np.cumsum(bad["amplitudes"], axis=-1)
    # The record of a move affects the next one; a vibration that is no number counts as infinite.
    excess = np.nan_to_num(bad["vibration"] - fine["vibration"], nan=np.inf)
    needed = []
    for machine, flags in zip(excess, spoilt, strict=True):
        for last in np.flatnonzero(flags[:-1] & ~flags[1:]):
            after = np.flatnonzero(flags[last + 1 :])
            good = machine[last + 1 : last + 2 + after[0] if len(after) else None] <= 0.01
            needed.append(1 + np.argmax(good) if good.any() else np.inf)
    return [
        spoilt.size,
        int(spoilt.sum()),
        int((~np.isfinite(bad["amplitudes"])).any(-1).sum()),
        f"{levels.min():.3g} to {levels.max():.3g}",
        int((~bad["inside"]).sum()),
        f"{100 * np.nanmax(bad['vibration']):.3g} / {100 * np.nanmax(fine['vibration']):.3g}",
        *recovery(needed, excess[:, -1] > 0.01),
    ]


def recovery(needed: list[Any], last: np.ndarray) -> list[object]:
    """Cells of a row: moves that each recovery took, recoveries that did not end, runs that end without one."""
    found = np.array(needed)
    ended = found[np.isfinite(found)]
    return [
        f"{np.median(ended):.0f} / {np.quantile(ended, 0.95):.0f} / {ended.max():.0f}",
        f"{int(np.isinf(found).sum())} of {len(found)}",
        int(last.sum()),
    ]
