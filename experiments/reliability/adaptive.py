"""Ten hours of sensor faults: does every adaptive strategy keep its command within its bound, and does it recover?

    python -m experiments.reliability.adaptive --hours 10 --seed 0      # writes adaptive.md beside itself

A flexible link makes a move every six seconds, in loops of ten minutes, while its load changes four times and its
sensors fail in every way of ``sensor_faults.py``: one or all four of them, for a sample or for minutes, up to three
faults at a time, with pauses of 20 to 60 s, the last two minutes being free of faults. Each loop is run a second time
with the same moves, loads and noise and without faults: a strategy has recovered with the first move that leaves at
most 1 % of its length more than the same move did there. Strategies that learn from whole moves follow
(``adaptive_moves.py``).

With ``--keep FOLDER`` what is done stays there, and the same command goes on from it.
"""

import argparse
import functools
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jshape as js
from experiments import markdown
from experiments.reliability import adaptive_moves
from experiments.reliability.sensor_faults import KINDS, LOADS, MINUTES, PERIOD, TIME, Loop, draw, pauses
from jshape._files import whole
from jshape.adaptive.closed_loop import metrics
from jshape.adaptive.closed_loop.loop import Faults
from jshape.adaptive.closed_loop.schedules import Schedule
from jshape.adaptive.identifiers.estimate import Estimate
from jshape.adaptive.strategies.paper_cases import BANDS, BLANK, OMEGA, ZETA
from jshape.adaptive.strategies.strategy import Decision, Readings

SIDE = 10
"""Loops side by side."""
AS_GOOD = 0.01
"""Of the move's length: what a move may leave more than the one without faults."""


class Paired(js.adaptive.AbstractStrategy):
    """An identifier of the strain gauge's vibration, and the shaper that follows it; the second mode's stays."""

    identifier: Any
    shaper: js.adaptive.AdaptiveShaper
    sample_time: float = eqx.field(static=True, default=TIME)

    def initial(self, reference: Any) -> Any:
        return self.shaper.start(reference), self.identifier.start(), jnp.zeros((), bool)

    def advance(self: Any, numbers: Any, state: Any, reference: Any, readings: Any) -> tuple[Any, Decision]:
        shaper, memory, steady = state
        memory, found = self.identifier.step(memory, readings.strain, steady)
        shaper, shaped = self.shaper.step(shaper, reference, _with_second(jnp, found))
        return (shaper, memory, shaped.steady), Decision(shaped.command, shaped.omega, shaped.zeta, 0)

    def online(self, reference: float = 0.0) -> Any:
        return OnlinePair(self, reference)


class OnlinePair:
    """The same from the identifier's and the shaper's online forms."""

    def __init__(self, pair: Paired, reference: float):
        self.parts, self.steady = (pair.shaper.online(reference), pair.identifier.online()), False

    @property
    def state(self) -> Any:
        return self.parts[0].state, self.parts[1].state

    def push(self, reference: float, readings: Any) -> Any:
        found = _with_second(np, self.parts[1].push(readings.strain, self.steady))
        shaped = self.parts[0].push(reference, found)
        self.steady = shaped.steady
        return Decision(shaped.command, found.omega, found.zeta, 0)


def _with_second(xp: Any, found: Estimate) -> Estimate:
    """An estimate of both modes, of which the second is none."""
    first = [xp.ravel(value)[0] for value in found]
    return Estimate(*(xp.stack([value, value]) for value in first[:-1]), valid=xp.stack([first[-1], first[-1] & False]))


def strategies() -> dict[str, Any]:
    """Every strategy, every identifier and every way of retuning."""
    part: Any = dict(sample_time=TIME, omega=OMEGA, zeta=ZETA, bands=BANDS, blank=BLANK)
    steady, fading = js.adaptive.AdaptiveShaper(**part), js.adaptive.AdaptiveShaper(**part, retune="crossfade")
    tracker = js.adaptive.FrequencyTracker(TIME, BANDS[0], 2e-3, 0.05, threshold=3e-3)
    others = {
        "frequency tracker": Paired(identifier=tracker, shaper=steady),
        "frequency tracker, cross-fade": Paired(identifier=tracker, shaper=fading),
        "decrement": Paired(identifier=js.adaptive.Decrement(TIME, BANDS[0], 5e-3), shaper=steady),
        "damped sinusoids": Paired(
            identifier=js.adaptive.DampedSinusoids(TIME, BANDS[0], 1, threshold=3e-3), shaper=steady
        ),
    }
    return {name: js.adaptive.case(name, TIME) for name in js.adaptive.CASES} | others


def stated(strategy: Any) -> tuple[float, np.ndarray]:
    """Bounds of the command, over the moves' amplitude, and of what a move from rest may leave, over a bare one's.

    A correction's impulses reach 1.5 times its size beyond either end of a move, which is twice the amplitude; the
    other shapers' amplitudes are positive. What is left is for the first mode with each of ``LOADS``.
    """
    if isinstance(strategy, js.adaptive.StateAware):
        reach = 1 + 2 * 1.5 * float(strategy.correction)
        return reach, np.array([strategy.bound(omega, ZETA[0]) for omega in omegas()])
    shaper = getattr(strategy, "shaper", None)
    if shaper is None:
        return 1.0, np.full(len(LOADS), np.inf)
    return 1.0, np.array([shaper.bound([omega, OMEGA[1]], ZETA)[0] for omega in omegas()])


def wave(amplitude: Any, duration: float = 60 * MINUTES) -> Schedule:
    return js.adaptive.square_wave(amplitude, PERIOD, duration, [(0.0, 0.0)], TIME)


def runner(strategy: Any) -> Callable[..., dict[str, jax.Array]]:
    """Some loops side by side, and what is kept of them."""
    link = js.adaptive.SampledLink(js.plants.FlexibleLink(), LOADS, TIME)
    unit = wave(1.0)

    def one(loop: tuple[Any, Any, Any, Any]) -> dict[str, jax.Array]:
        faults, which, amplitude, key = loop
        reference = amplitude * unit.reference
        (trace,) = js.adaptive.run(link, {"": strategy}, reference, which, faults=faults, key=key).values()

        def ends(value):
            return jnp.stack([jnp.min(value, axis=0), jnp.max(value, axis=0)])

        return dict(
            residual=metrics.residual(trace, unit) / amplitude,
            reach=jnp.max(jnp.abs(trace.command)) / amplitude,
            finite=jnp.all(jnp.isfinite(trace.command)) & jnp.all(jnp.isfinite(trace.deflection)),
            omega=ends(trace.omega),
            zeta=ends(trace.zeta),
            command=trace.command[:: round(1 / TIME)],
        )

    # A fit is made where it is due; side by side, with every sample.
    alone = isinstance(getattr(strategy, "identifier", None), js.adaptive.DampedSinusoids)
    several = functools.partial(jax.lax.map, one) if alone else jax.vmap(one)
    return jax.jit(lambda *loops: several(loops))


def looped(names: list[str], loops: int, seed: int, keep: Path | None) -> dict[str, list[dict[str, np.ndarray]]]:
    """Results of each strategy in all loops, with and without faults."""
    found, begun, done = {name: [] for name in names}, time.perf_counter(), 0
    for name in names:
        several = runner(strategies()[name])
        for first in range(0, loops, SIDE):
            numbers = range(first, min(first + SIDE, loops))
            compute = functools.partial(pair, several, numbers, seed)
            found[name].append(kept(keep, f"{name}.{seed}.{first}.{loops}", compute))
            done += len(numbers)
            left = (time.perf_counter() - begun) * (loops * len(names) / done - 1)
            print(f"{name}: {100 * done / loops / len(names):.0f} % done, {left:.0f} s left", flush=True)
    return {
        name: [{key: np.concatenate([part[f"{j}{key}"] for part in parts]) for key in KEPT} for j in (0, 1)]
        for name, parts in found.items()
    }


KEPT = ("residual", "reach", "finite", "omega", "zeta", "command")


def pair(several: Callable[..., dict[str, jax.Array]], numbers: range, seed: int) -> dict[str, np.ndarray]:
    """Some loops with faults (0) and without (1)."""
    drawn = [draw(seed, number) for number in numbers]
    keys = jnp.stack([noise_key(seed, number) for number in numbers])
    faults = Faults(*(jnp.asarray(np.stack(column)) for column in zip(*(loop.faults for loop in drawn), strict=True)))
    none = Faults(*map(jnp.zeros_like, faults))._replace(alive=jnp.ones_like(faults.alive))
    rest = np.stack([loop.which for loop in drawn]), np.array([loop.amplitude for loop in drawn]), keys
    both = several(faults, *rest), several(none, *rest)
    return {f"{j}{key}": np.asarray(value) for j, one in enumerate(both) for key, value in one.items()}


def noise_key(seed: int, number: int) -> Any:
    return jax.random.fold_in(jax.random.key(seed), number)


def kept(folder: Path | None, name: str, compute: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """A stored result, computed where there is none."""
    path = folder and folder / f"{name}.npz"
    if path and path.exists():
        with np.load(path) as arrays:
            return dict(arrays)
    found = compute()
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole(path) as file:
            np.savez(file, **cast(Any, found))
    return found


def omegas() -> np.ndarray:
    """Frequency of the first mode with each of ``LOADS``, rad/s."""
    link = js.plants.FlexibleLink().link
    return np.array([float(link.modes(jnp.asarray(load)).omega[0]) for load in LOADS])


def bare() -> np.ndarray:
    """The residual of an unshaped step with each of ``LOADS``, over its size; its envelope at the step itself."""
    link, unit = js.adaptive.SampledLink(js.plants.FlexibleLink(), LOADS, TIME), wave(1.0, PERIOD / 2)

    def one(load: Any) -> jax.Array:
        which = jnp.full(unit.reference.shape, load)
        return metrics.residual(
            js.adaptive.run(link, {"": js.adaptive.Unshaped(TIME)}, unit.reference, which)[""], unit
        )

    return np.asarray(jax.jit(jax.vmap(one))(jnp.arange(len(LOADS))))[:, 0] * np.exp(ZETA[0] * omegas() * 1.9)


def shares(residual: np.ndarray, bounds: np.ndarray, loops: list[Loop], step: np.ndarray) -> list[str]:
    """The greatest residual over its bound, and the most that a move adds over the bound of a move from rest.

    A move adds what it leaves beyond what the one before left, decayed. What it may leave is its bound from rest and
    what the one before might leave, decayed (``js.adaptive.AdaptiveShaper.bound`` with a spacing): that is counted from
    the last move during which or before which the load has changed, which is not looked at itself.
    """
    loads = np.array([loop.which.reshape(residual.shape[1], -1) for loop in loops])
    same = (loads == loads[..., :1]).all(-1)
    same[:, 1:] &= same[:, :-1] & (loads[:, 1:, 0] == loads[:, :-1, 0])
    decay = np.exp(-ZETA[0] * omegas()[loads[..., 0]] * PERIOD / 2)
    before = np.pad(residual, ((0, 0), (1, 0)))[:, :-1]
    alone = (bounds * step)[loads[..., 0]]
    may = np.zeros((len(residual), residual.shape[1] + 1))
    for move in range(residual.shape[1]):
        summed = decay[:, move] * may[:, move] + alone[:, move]
        may[:, move + 1] = np.where(same[:, move], summed, residual[:, move])
    added = (residual - decay * before) / alone
    return [f"{(residual / may[:, 1:])[same].max():.2f}", f"{added[same].max():.2f}"]


def row(strategy: Any, found: list[dict[str, np.ndarray]], loops: list[Loop], step: np.ndarray) -> list[object]:
    """A row of the table; ``step``: from ``bare``."""
    bad, fine = found
    reach, bounds = stated(strategy)
    both = [shares(one["residual"], bounds, loops, step) for one in found]
    excess = np.nan_to_num(bad["residual"] - fine["residual"], nan=np.inf)
    needed = []
    for loop, values in zip(loops, excess, strict=True):
        for moves in filter(len, pauses(loop)):
            good = values[moves.start : moves.stop] <= AS_GOOD
            needed.append(1 + np.argmax(good) if good.any() else np.inf)
    ranges = [
        f"{part[..., 0].min():.4g} to {part[..., 0].max():.4g}" for part in (bad["omega"], bad["zeta"]) if part.size
    ]
    return [
        int((~bad["finite"]).sum()),
        f"{bad['reach'].max():.6f} ({reach:g})",
        f"{100 * bad['residual'].max():.1f} / {100 * fine['residual'].max():.1f}",
        *(map(" / ".join, zip(*both, strict=True)) if bounds.max() < np.inf else "––"),
        *(ranges or ["–", "–"]),
        *adaptive_moves.recovery(needed, excess[:, -1] > AS_GOOD),
    ]


def online(strategy: Any, seed: int, command: np.ndarray) -> list[object]:
    """The first loop in the online form, beside the command of the functional form, once a second."""
    loop, unit = draw(seed, 0), wave(1.0)
    link = js.adaptive.SampledLink(js.plants.FlexibleLink(), LOADS, TIME)
    flow, entry, outputs, through = (np.asarray(a) for a in (link.flow, link.entry, link.outputs, link.through))
    sensors, reference = js.adaptive.Sensors(), loop.amplitude * np.asarray(unit.reference)
    noise = np.asarray(sensors.noise) * np.asarray(jax.random.normal(noise_key(seed, 0), (len(reference), 4)))
    body, push = np.asarray(link.plant.rest_state(reference[0])), (controller := strategy.online(reference[0])).push
    value, own = reference[0], np.asarray(sensors.resolution)
    values = outputs[loop.which[0]] @ body + through[loop.which[0]] * value
    commands, estimates, sizes = [], [], []
    with np.errstate(all="ignore"):
        for n, (angle, which, *fault) in enumerate(zip(reference, loop.which, *loop.faults, strict=True)):
            added, alive, missing, frozen, coarse = fault
            clean = rounded(outputs[which] @ body + through[which] * value + noise[n], own)
            values = np.where(frozen, values, rounded(alive * clean + added, coarse))
            decision = push(float(angle), Readings(*np.where(missing, np.nan, values).tolist()))
            value = decision.command
            body = flow[which] @ body + entry[which] * value
            commands.append(value)
            estimates.append((*decision.omega[:1], *decision.zeta[:1]))
            if n in (200, len(reference) - 1):
                sizes.append(sum(np.size(leaf) for leaf in jax.tree.leaves(controller.state)))
    ours = np.array(commands)
    apart = np.abs(ours[:: round(1 / TIME)] - command) / loop.amplitude
    return [
        int((~np.isfinite(ours)).sum()),
        f"{np.abs(ours).max() / loop.amplitude:.6f}",
        *(
            [f"{low:.4g} to {high:.4g}" for low, high in zip(np.min(estimates, 0), np.max(estimates, 0), strict=True)]
            or "––"
        ),
        f"{sizes[0]} / {sizes[1]}",
        f"{apart.max():.1e}",
    ]


def rounded(values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """``quantised`` without a call of JAX, of which the loop makes two a sample."""
    return np.where(steps > 0, steps * np.round(values / np.where(steps > 0, steps, 1.0)), values)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=10.0, help="of samples for each strategy")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    parser.add_argument("--keep", type=Path, help="folder for what is done, from which the same command goes on")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    count = max(round(given.hours * 60 / MINUTES), 1)
    several, loops = strategies(), [draw(given.seed, number) for number in range(count)]
    found = looped(list(several), count, given.seed, given.keep)
    step = bare()
    rows = [[n, *row(s, found[n], loops, step)] for n, s in several.items()]
    live = [[n, *online(s, given.seed, found[n][0]["command"][0])] for n, s in several.items()]
    moves = list(adaptive_moves.rows(given.hours, given.seed, functools.partial(kept, given.keep)))
    command = f"python -m experiments.reliability.adaptive --hours {given.hours:g} --seed {given.seed}"
    title = f"{given.hours:g} hours of adaptive samples with sensor faults"
    markdown.write_beside(__file__, title, command, report(given, loops, rows, live, moves))


def report(given: Any, loops: list[Loop], rows: list[Any], live: list[Any], moves: list[Any]) -> list[str]:
    spoilt = sum(over - begin for loop in loops for begin, over in loop.episodes) / 60 / MINUTES / len(loops)
    recovery = ["moves until as good again: median / 95 % / most", "pauses without", "loops without at their end"]
    head = [
        "strategy",
        "loops with a command that is not finite",
        "greatest command over the moves' amplitude (stated)",
    ]
    head += [
        "greatest residual, % of the move, with / without faults",
        "over its bound, the sum of what moves may leave",
        "most that a move adds, over the bound of a move from rest",
    ]
    head += ["first mode, rad/s", "its damping ratio", *recovery]
    moved = ["strategy", "moves", "spoilt records", "commands not finite", "command over the step"]
    moved += ["estimates out of their bounds", "greatest vibration, % of the step, with / without faults", *recovery]
    one = ["online form", "samples not finite", "greatest command", "estimate of the first mode, rad/s"]
    one += [
        "of its damping ratio",
        "numbers in its state after 1 s / at the end",
        "greatest difference from the functional form",
    ]
    return [
        f"{len(loops)} loops of {MINUTES:g} minutes at {1 / TIME:g} samples a second: "
        f"{len(loops) * len(loops[0].which):,} samples for each strategy, "
        f"{sum(loop.number for loop in loops):,} faults of {len(KINDS)} kinds, {100 * spoilt:.0f} % of the time "
        f"({', '.join(KINDS)}).",
        f"The first mode is sought between {BANDS[0][0]:g} and {BANDS[0][1]:g} rad/s, damping ratios from 0 to 0.1.",
        "As good again: a residual of at most 1 % of the move more than in the same loop without faults.",
        "",
        *markdown.table(head, rows),
        "",
        f"The first of these loops, {MINUTES:g} minutes, in the online form:",
        "",
        *markdown.table(one, live),
        "",
        f"Strategies that learn from whole moves, {given.hours:g} hours each, "
        f"{len(adaptive_moves.SPOILT)} kinds of faults in their records:",
        "",
        *markdown.table(moved, moves),
        "",
        f"jshape {version('jshape')}, jax {jax.__version__}.",
    ]


if __name__ == "__main__":
    main()
