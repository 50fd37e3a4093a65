"""The attack's judge: DOP853, or a closed form where a family has one."""

import itertools
from operator import itemgetter
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.integrate import solve_ivp
from scipy.integrate._ivp import dop853_coefficients as dop853

from experiments.benchmarks.attack_families import Case, Family, Row, pick
from jshape.simulation.replay import field_of
from jshape.simulation.schedule import inputs_at, schedule
from jshape.simulation.simulate import initial, with_arrays

JUDGES = (3e-14, 2e-13)
"""Relative tolerances of the judge; the first is the truth."""

MOST_STEPS = 200_000
"""Of the judge, in a segment."""

MOST_SLOPES = 100_000
"""Of SciPy's, in a segment: some seconds."""

_STAGES = dop853.N_STAGES
_A, _B, _C = dop853.A[:_STAGES, :_STAGES], dop853.B, dop853.C[:_STAGES]
_E3, _E5 = dop853.E3, dop853.E5


class Verdict(NamedTuple):
    """The judgement: the energy at the end, the greatest at any break, whether the plant had diverged, and whether
    the judge got to the end."""

    energy: Array | np.ndarray
    scale: Array | np.ndarray
    diverged: Array | np.ndarray
    done: Array | np.ndarray


def _controlled(k: Array, h: Array, scale: Array, finite: Array) -> tuple[Array, Array]:
    """Whether a step of size h and slopes k keeps the tolerance, and by what the next one is longer."""
    e5, e3 = (jnp.sum((jnp.asarray(e) @ k / scale) ** 2) for e in (_E5, _E3))
    bottom = e5 + 0.01 * e3
    error = jnp.where(bottom > 0, h * e5 / jnp.sqrt(jnp.where(bottom > 0, bottom, 1.0) * len(scale)), 0.0)
    factor = jnp.clip(0.9 * jnp.maximum(error, 1e-20) ** (-1 / 8), 0.2, 8.0)
    return (error < 1) & finite, jnp.where(jnp.isfinite(error) & finite, factor, 0.1)


def judge(case: Case, rtol: Any) -> Verdict:
    """One move by DOP853."""
    plant, shaper, command, state = case
    plant = with_arrays(plant)
    plan, state = schedule(plant, command, shaper), initial(plant, state)
    field = field_of(plant)

    def inputs(segment, local):
        return inputs_at(plant, segment.coefficients, segment.age + local)

    def advance_segment(carry, segment):
        y, largest, fine = carry

        def slope(t, y):
            return field(t, y, segment)

        begin = plant.residual_energy(y, inputs(segment, 0.0))

        def step(inside):
            t, h, y, largest, count, _ = inside
            h = jnp.minimum(h, segment.duration - t)

            def stage(i, k):
                return k.at[i].set(slope(t + jnp.asarray(_C)[i] * h, y + h * (jnp.asarray(_A)[i] @ k)))

            k = jax.lax.fori_loop(0, _STAGES, stage, jnp.zeros((_STAGES, len(y))))
            new = y + h * (jnp.asarray(_B) @ k)
            k = jnp.concatenate([k, slope(t + h, new)[None]])
            sizes = jnp.maximum(jnp.maximum(largest, jnp.abs(y)), jnp.abs(new))
            good, factor = _controlled(k, h, rtol * sizes + 1e-290, jnp.all(jnp.isfinite(new)))

            def pick(a, b):
                return jnp.where(good, a, b)

            after = pick(t + h, t)
            after = jnp.where(good & (h >= segment.duration - t), segment.duration, after)
            stuck = (h < 1e-14 * segment.duration) | (count > MOST_STEPS)
            return after, h * factor, pick(new, y), pick(sizes, largest), count + 1, ~stuck

        inside = (jnp.zeros(()), segment.duration * 1e-2, y, largest, jnp.zeros((), jnp.int32), fine)

        def going(inside):
            return (inside[0] < segment.duration) & inside[5]

        t, _, y, largest, _, still = jax.lax.while_loop(going, step, inside)
        fine = fine & (still | (t >= segment.duration))
        end = plant.residual_energy(y, inputs(segment, segment.duration))
        away = plant.diverged(y, inputs(segment, segment.duration))
        return (y, largest, fine), (jnp.stack([begin, end]), away)

    carry = (state, jnp.abs(state), jnp.asarray(True))
    (y, _, done), (energies, away) = jax.lax.scan(advance_segment, carry, plan.segments())
    last = plan.final_inputs(plant)
    energy = plant.residual_energy(y, last)
    energies = jnp.append(energies, energy)
    scale = jnp.max(jnp.where(jnp.isfinite(energies), jnp.abs(energies), 0.0))
    diverged = jnp.where(done, plant.diverged(y, last), away[-1])
    return Verdict(energy, scale, diverged, done)


def scipy_energy(case: Case, rtol: float = 1e-13) -> float:
    """The same by ``solve_ivp``; NaN where it fails, or asks for too many slopes."""
    plant, shaper, command, state = case
    plant = with_arrays(plant)
    plan, state = schedule(plant, command, shaper), np.asarray(initial(plant, state), float)
    field, segments = jax.jit(field_of(plant)), plan.segments()
    largest = np.max(np.abs(state), initial=0.0)
    for i in range(len(segments.begin)):
        segment = jax.tree.map(itemgetter(i), segments)
        if float(segment.duration) == 0:
            continue
        asked = itertools.count()

        def slope(t, y, segment=segment, asked=asked):
            return np.asarray(field(t, y, segment)) if next(asked) < MOST_SLOPES else np.full_like(y, np.nan)

        span = (0.0, float(segment.duration))
        atol = rtol * np.maximum(np.abs(state), 1e-3 * largest + 1e-12)
        run = solve_ivp(slope, span, state, "DOP853", rtol=rtol, atol=atol, max_step=span[1])
        if not run.success:
            return np.nan
        state, largest = run.y[:, -1], max(largest, np.max(np.abs(run.y)))
    return float(plant.residual_energy(jnp.asarray(state), plan.final_inputs(plant)))


def verdicts(family: Family, rows: Row, count: int) -> tuple[Verdict, np.ndarray]:
    """The truth of all rows, and by how much the judge's second tolerance differs from it."""
    double = {name: np.asarray(value, float) for name, value in rows.items()}
    if family.exact:
        # Springs that hold at any deflection: nothing diverges.
        energy, scale = family.exact(double)
        never = np.zeros(count, bool)
        return Verdict(energy, scale, never, ~never), np.zeros(count)
    found, chunk = [], 64
    batch = jax.jit(jax.vmap(lambda row, rtol: judge(family.build(row), rtol), in_axes=(0, None)))
    for rtol in JUDGES:
        parts = [batch(pick(double, np.arange(i, i + chunk) % count), rtol) for i in range(0, count, chunk)]
        found.append(Verdict(*(np.concatenate([np.asarray(x) for x in p])[:count] for p in zip(*parts, strict=True))))
    truth, second = found
    with np.errstate(invalid="ignore"):
        return truth, np.abs(truth.energy - second.energy)
