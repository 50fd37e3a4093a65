"""A function of a vector as a function of its components.

``x, v = state`` and ``jnp.stack([v, a])`` take numbers apart and join them, and a loop that is written out on
components takes them apart again; under differentiation every such cut becomes a padded vector. Here a traced function
runs anew on the components, which stay apart while they are cut out, joined, turned and reshaped, and where an
operation works element by element. Functions within functions are written out: XLA leaves calls inside a stage apart.

Without that (and the sines of ``angles.py``) 22 double-pendulum cranes take 3.8 times as long, and their derivatives
twice (two cores, jax 0.10). Delete this file, and hand the equation to the integrator as it is, once XLA keeps vectors
of a few components in registers.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jax.extend import core
from jaxtyping import Array

from jshape.simulation import angles


class Components:
    """``function(*others, vector)``, a vector too, by components: ``components(captured, *others, parts)``.

    ``others`` and ``vector``: examples. ``captured``: the arrays that the function holds besides its arguments, as
    arguments, so that it can be differentiated with respect to them. ``same``: which components of the result are
    components of the vector, untouched. ``size``: how many operations it takes. Traced, and transformed, once, however
    often it is called.
    """

    captured: list[Any]
    same: dict[int, int]
    size: int

    def __init__(self, function: Callable[..., Array], *others: Array, vector: Array):
        traced = jax.make_jaxpr(function)(*others, vector)
        self.captured = traced.consts

        def run(captured, *arguments):
            *others, parts = arguments
            (result,) = _run(traced.jaxpr, [*captured, *others, _objects(parts)])
            return list(_apart(result))

        self._program = _linearised(run)
        inside = jax.make_jaxpr(run)(traced.consts, *others, parts_of(vector)).jaxpr
        given = inside.invars[-vector.size :]
        self.size = len(inside.eqns)
        self.same = {i: given.index(result) for i, result in enumerate(inside.outvars) if result in given}

    def __call__(self, captured: list[Any], *arguments: Any) -> list[Array]:
        return self._program(captured, *arguments)


def _linearised(function: Callable[..., list[Array]]) -> Callable[..., list[Array]]:
    """A function that is compiled as one program, and its derivative as two: the values that it needs, which do not
    depend on the tangents, and what is linear in them.

    In one program XLA would compute those values anew for every tangent: the derivatives of 22 double-pendulum cranes
    in seven variables then take 2.8 times as long (two cores, jax 0.10).
    """
    linear: dict[Any, core.Jaxpr] = {}
    plain = jax.jit(function)

    @functools.partial(jax.jit, static_argnums=0)
    def values(moving, *arguments):
        leaves, tree = jax.tree.flatten(arguments)
        given = [x for m, x in zip(moving, leaves, strict=True) if m]

        def of_given(*given):
            given = iter(given)
            return function(*tree.unflatten([next(given) if m else x for m, x in zip(moving, leaves, strict=True)]))

        result, along = jax.linearize(of_given, *given)
        traced = jax.make_jaxpr(along)(*given)
        linear[moving, _types(leaves)] = traced.jaxpr
        return result, traced.consts

    @functools.partial(jax.jit, static_argnums=0)
    def tangent(which, known, tangents):
        return core.jaxpr_as_fun(core.ClosedJaxpr(linear[which], known))(*tangents)

    @jax.custom_jvp
    def program(*arguments):
        return plain(*arguments)

    @functools.partial(program.defjvp, symbolic_zeros=True)
    def _(primals, tangents):
        leaves, along = jax.tree.leaves(primals), jax.tree.leaves(tangents)
        moving = tuple(map(moves, leaves, along))
        result, known = values(moving, *primals)
        which = moving, _types(leaves)
        return result, tangent(which, known, [t for m, t in zip(moving, along, strict=True) if m])

    return program


def moves(value: Any, tangent: Any) -> bool:
    """Whether a tangent may differ from zero."""
    return jnp.issubdtype(jnp.result_type(value), jnp.inexact) and not isinstance(tangent, SymbolicZero)


def _types(leaves: list[Any]) -> tuple[Any, ...]:
    return tuple(map(jax.typeof, leaves))


def parts_of(vector: Array) -> list[Array]:
    """The components of a vector."""
    return [jax.lax.index_in_dim(vector, i, keepdims=False) for i in range(len(vector))]


def _run(jaxpr: core.Jaxpr, given: list[Any]) -> list[Any]:
    """The results of a traced program; what is known by component is an array of objects, there and here."""
    known: dict[Any, Any] = dict(zip([*jaxpr.constvars, *jaxpr.invars], given, strict=True))

    def read(variable):
        return variable.val if isinstance(variable, core.Literal) else known[variable]

    for equation in jaxpr.eqns:
        name, parameters = equation.primitive.name, equation.params
        inputs = list(map(read, equation.invars))
        components = any(map(_is_apart, inputs))
        if name == "jit":
            results = _run(parameters["jaxpr"].jaxpr, [*parameters["jaxpr"].consts, *inputs])
        elif name in _MOVES and (components or _is_small(equation)) and not _is_empty(equation):
            results = _MOVES[name](*map(_apart, inputs), **parameters)
        elif components and name in _ELEMENTWISE and _is_small(equation):
            results = _each(equation, inputs)
        elif components and name == "reduce_sum" and _is_small(equation):
            results = _array(_apart(inputs[0]).sum(axis=parameters["axes"]))
        elif components and name == "dot_general" and _is_small_product(equation):
            first, second = map(_apart, inputs)
            results = _array(np.tensordot(first, second, parameters["dimension_numbers"][0]))
        else:
            results = _bound(equation, map(_joined, inputs))
        results = results if isinstance(results, list | tuple) else [results]
        known.update(zip(equation.outvars, results, strict=True))
    return list(map(read, jaxpr.outvars))


def _objects(parts: list[Any]) -> np.ndarray:
    kept = np.empty(len(parts), dtype=object)
    for i, part in enumerate(parts):
        kept[i] = part
    return kept


def _is_apart(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object


def _apart(value: Any) -> np.ndarray:
    if _is_apart(value):
        return value
    return _objects(parts_of(jnp.ravel(value)) if np.ndim(value) else [value]).reshape(np.shape(value))


def _joined(value: Any) -> Any:
    if not _is_apart(value):
        return value
    return jnp.stack(list(value.flat)).reshape(value.shape) if value.ndim else value.item()


def _bound(equation: core.JaxprEqn, inputs: Any) -> Any:
    """An operation on other inputs."""
    name, inputs = equation.primitive.name, list(inputs)
    if name in ("sin", "cos") and jnp.result_type(inputs[0]) == np.float64 and jax.default_backend() == "cpu":
        return getattr(angles, name)(*inputs)
    with equation.ctx.manager:
        return equation.primitive.bind(*inputs, **equation.primitive.get_bind_params(equation.params))


def _is_small(equation: core.JaxprEqn) -> bool:
    return all(0 < math.prod(_shape(variable)) <= _SMALL for variable in (*equation.outvars, *equation.invars))


def _is_empty(equation: core.JaxprEqn) -> bool:
    return any(math.prod(_shape(variable)) == 0 for variable in (*equation.outvars, *equation.invars))


def _shape(variable: Any) -> tuple[int, ...]:
    return variable.aval.shape


def _is_small_product(equation: core.JaxprEqn) -> bool:
    (contracted, _), batched = equation.params["dimension_numbers"]
    first = _shape(equation.invars[0])
    products = math.prod(_shape(equation.outvars[0])) * math.prod(first[axis] for axis in contracted)
    return batched == ((), ()) and products <= _SMALL


def _array(value: Any) -> np.ndarray:
    """An array of objects, also where it is a single one."""
    return value if isinstance(value, np.ndarray) else _objects([value]).reshape(())


def _each(equation: core.JaxprEqn, inputs: list[Any]) -> np.ndarray:
    """An operation element by element."""
    result = np.empty(_shape(equation.outvars[0]), dtype=object)
    columns = [np.broadcast_to(_apart(x), result.shape) for x in inputs]
    for place in np.ndindex(result.shape):
        result[place] = _bound(equation, [column[place] for column in columns])
    return result


def _slice(x, start_indices, limit_indices, strides):
    return x[tuple(map(slice, start_indices, limit_indices, strides or [1] * x.ndim))]


def _broadcast(x, shape, broadcast_dimensions, **_):
    sizes = np.ones(len(shape), dtype=int)
    sizes[list(broadcast_dimensions)] = x.shape
    return np.broadcast_to(x.reshape(sizes), shape)


_MOVES = {
    "slice": _slice,
    "squeeze": lambda x, dimensions: np.asarray(np.squeeze(x, dimensions)),
    "reshape": lambda x, new_sizes, **_: x.reshape(new_sizes),
    "broadcast_in_dim": _broadcast,
    "rev": lambda x, dimensions: np.flip(x, dimensions),
    "transpose": lambda x, permutation: x.transpose(permutation),
    "concatenate": lambda *parts, dimension: np.concatenate(parts, dimension),
    "stack": lambda *parts, axis: np.stack(parts, axis),
    "split": lambda x, sizes, axis: np.split(x, np.cumsum(sizes)[:-1], axis),
}
"""The operations that move numbers and change none, on arrays of any kind."""

_SMALL = 16
"""Numbers in an array, or products in a product of matrices, up to which operations go component by component."""

# fmt: off
_ELEMENTWISE = frozenset((
    "abs", "add", "and", "atan", "atan2", "convert_element_type", "cos", "cosh", "div", "eq", "exp", "ge", "gt",
    "integer_pow", "le", "log", "lt", "max", "min", "mul", "ne", "neg", "not", "or", "pow", "select_n", "sign", "sin",
    "sinh", "sqrt", "square", "sub", "tan", "tanh",
))
# fmt: on
"""Operations that work element by element; scalars among their inputs belong to every element."""
