"""Zero residual energy on one plant: Levenberg–Marquardt on the state that is left, from many starts side by side."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jshape.compilation_cache import kept
from jshape.design.tuning.bounds import Rules
from jshape.design.tuning.evaluate import energy, residual
from jshape.design.tuning.task import Point, Task


def levenberg_marquardt(task: Task, rules: Rules, starts: Point, iterations: int) -> tuple[Point, np.ndarray]:
    """From each start (a leading axis): the design at the end, and the energies (J) after every iteration.

    The energies' first column is the start's. The amplitudes keep their sum, and with a fixed duration the gaps keep
    theirs; other rules are left to the caller to check.
    """
    fixed_amplitudes = bool(np.all(rules.lower == rules.upper))
    found, values = _run(task, starts, rules.fixed, fixed_amplitudes, iterations)
    return Point(*(np.asarray(part) for part in found)), np.asarray(values)


@kept
def _run(task: Task, starts: Point, fixed_duration: bool, fixed_amplitudes: bool, iterations: int):
    import lineax as lx
    import optimistix as optx

    def one(start: Point):
        amplitudes, gaps, leaves = start
        total = jnp.sum(gaps)
        free = (amplitudes[:0] if fixed_amplitudes else amplitudes[:-1], gaps[:-1] if fixed_duration else gaps, leaves)

        def build(y) -> Point:
            a = amplitudes if fixed_amplitudes else jnp.append(y[0], 1 - jnp.sum(y[0]))
            g = jnp.append(y[1], total - jnp.sum(y[1])) if fixed_duration else y[1]
            return Point(a, g, y[2])

        def function(y, _):
            return residual(task, build(y)), None

        # Interactive stepping, so that every iteration's energy is seen; tolerances play no part in a step.
        solver = optx.LevenbergMarquardt(rtol=1e-15, atol=1e-15, linear_solver=lx.QR())
        structure, aux = jax.eval_shape(lambda: function(free, None))
        state = solver.init(function, free, None, {}, structure, aux, frozenset())

        def advance(carry, _):
            y, state = carry
            y, state, _ = solver.step(function, y, None, {}, state, frozenset())
            return (y, state), energy(task, task.plant, build(y))

        dynamic, static = eqx.partition((free, state), eqx.is_array)

        def body(carry, _):
            new, value = advance(eqx.combine(carry, static), None)
            return eqx.filter(new, eqx.is_array), value

        # The first step only looks at the start.
        dynamic, values = jax.lax.scan(body, dynamic, None, length=iterations + 1)
        (y, _) = eqx.combine(dynamic, static)
        return build(y), values

    return jax.vmap(one)(jax.tree.map(jnp.asarray, starts))
