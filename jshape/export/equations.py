"""A function of JAX, written out in C: every array by its elements, every element by an elementary operation.

What is constant is computed here. Loops, branches and the solution of linear equations are not written out; a function
that has them is refused, and they are named.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

_CALLS = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "checkpoint", "remat2")
"""Operations that contain others."""

_ELEMENTARY = {
    **{"add": "{0} + {1}", "add_any": "{0} + {1}", "sub": "{0} - {1}", "mul": "{0} * {1}", "div": "{0} / {1}"},
    **{"neg": "-{0}", "square": "{0} * {0}", "rsqrt": "1.0 / sqrt({0})", "abs": "fabs({0})"},
    **{name: f"{name}({{0}})" for name in ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh")},
    **{name: f"{name}({{0}})" for name in ("asinh", "acosh", "atanh", "exp", "log", "log1p", "expm1", "sqrt", "cbrt")},
    **{name: f"{name}({{0}})" for name in ("floor", "ceil", "erf", "erfc")},
    **{"atan2": "atan2({0}, {1})", "pow": "pow({0}, {1})", "max": "fmax({0}, {1})", "min": "fmin({0}, {1})"},
    **{"gt": "{0} > {1}", "ge": "{0} >= {1}", "lt": "{0} < {1}", "le": "{0} <= {1}", "eq": "{0} == {1}"},
    **{"ne": "{0} != {1}", "and": "{0} && {1}", "or": "{0} || {1}", "not": "!{0}", "is_finite": "isfinite({0})"},
    **{"sign": "({0} > 0.0) - ({0} < 0.0)", "clamp": "fmin(fmax({1}, {0}), {2})"},
    **{"logistic": "1.0 / (1.0 + exp(-{0}))"},
}
"""Operations on elements, by their names in JAX."""

_REDUCTIONS = {"reduce_sum": "{0} + {1}", "reduce_max": "fmax({0}, {1})", "reduce_min": "fmin({0}, {1})"}
_REDUCTIONS |= {"reduce_and": "{0} && {1}", "reduce_or": "{0} || {1}"}

_SAME = ("copy", "copy_p", "stop_gradient", "reduce_precision", "optimization_barrier")

_MOVES = ("broadcast_in_dim", "reshape", "squeeze", "slice", "transpose", "rev", "expand_dims", "gather")
_MOVES += ("dynamic_slice", "split")
"""Operations that only place elements anew; further arguments, such as indices, must be constant."""


def number(value: Any) -> str:
    """A constant as C writes it."""
    if np.iscomplexobj(value):
        raise ValueError("complex numbers")
    value = float(value)
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return f"({value!r})" if value < 0 else repr(value)


class _Writer:
    """Elements as names of C variables, each defined once."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, str] = {}

    def define(self, expression: str) -> str:
        if expression not in self.names:
            self.names[expression] = f"v{len(self.names)}"
            self.lines.append(f"const double {self.names[expression]} = {expression};")
        return self.names[expression]

    def run(self, jaxpr: Any, constants: Any, arguments: list[np.ndarray]) -> list[np.ndarray]:
        """The results of a program: numbers where they are constant, else arrays of names."""
        values = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*map(np.asarray, constants), *arguments], strict=True))

        def read(atom):
            return np.asarray(atom.val) if hasattr(atom, "val") else values[atom]

        for equation in jaxpr.eqns:
            found = self.operation(equation, [read(atom) for atom in equation.invars])
            values |= dict(zip(equation.outvars, found, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def operation(self, equation: Any, given: list[np.ndarray]) -> list[np.ndarray]:
        kind, parameters = equation.primitive.name, equation.params
        if kind in _CALLS:
            inner = parameters.get("jaxpr") or parameters.get("call_jaxpr")
            closed = hasattr(inner, "consts")
            return self.run(inner.jaxpr if closed else inner, inner.consts if closed else (), given)
        if all(array.dtype != object for array in given):
            found = equation.primitive.bind(*map(jnp.asarray, given), **parameters)
            return [np.asarray(each) for each in (found if equation.primitive.multiple_results else [found])]
        cast = _cast(equation.invars[0].aval.dtype, parameters["new_dtype"]) if kind == "convert_element_type" else ""
        if kind in _SAME or cast is None:
            return given
        written = [array if array.dtype == object else _written(array) for array in given]
        if any(np.iscomplexobj(atom.aval.dtype.type(0)) for atom in [*equation.invars, *equation.outvars]):
            raise ValueError(f"{kind} of complex numbers")
        if cast:
            return [self.elementwise(cast.format, written)]
        if kind in _ELEMENTARY or kind in ("integer_pow", "select_n"):
            return [self.elementwise(_form(kind, parameters, len(given)), written)]
        if kind in _MOVES and all(array.dtype != object for array in given[1:]):
            places = jnp.arange(given[0].size).reshape(given[0].shape)
            found = equation.primitive.bind(places, *map(jnp.asarray, given[1:]), **parameters)
            found = found if equation.primitive.multiple_results else [found]
            return [_placed(written[0].ravel(), np.asarray(each)) for each in found]
        if kind == "concatenate":
            return [np.concatenate(written, axis=parameters["dimension"])]
        if kind == "stack":
            return [np.stack(written, parameters["axis"])]
        if kind == "pad":
            places = jnp.arange(1, given[0].size + 1).reshape(given[0].shape)
            found = np.asarray(equation.primitive.bind(places, jnp.zeros((), places.dtype), **parameters))
            return [_placed(np.r_[written[1].ravel(), written[0].ravel()], found)]
        if kind in _REDUCTIONS:
            return [self.total(written[0], tuple(parameters["axes"]), _REDUCTIONS[kind])]
        if kind == "dot_general":
            return [self.product(written[0], written[1], parameters["dimension_numbers"])]
        raise ValueError(kind)

    def elementwise(self, form: Callable[..., str], arrays: list[np.ndarray]) -> np.ndarray:
        shape = np.broadcast_shapes(*(array.shape for array in arrays))
        found = np.empty(shape, object)
        for place in np.ndindex(shape):
            found[place] = self.define(form(*(np.broadcast_to(array, shape)[place] for array in arrays)))
        return found

    def total(self, array: np.ndarray, axes: tuple[int, ...], form: str = "{0} + {1}") -> np.ndarray:
        """Sums, or greatest or least elements, over axes."""
        kept = [axis for axis in range(array.ndim) if axis not in axes]
        shape = [array.shape[axis] for axis in kept]
        rows = np.transpose(array, [*kept, *axes]).reshape(*shape, -1)
        found = np.empty(shape, object)
        for place in np.ndindex(*shape):
            found[place] = self.define(functools.reduce(form.format, rows[place]) if rows.shape[-1] else "0.0")
        return found

    def product(self, left: np.ndarray, right: np.ndarray, numbers: Any) -> np.ndarray:
        """A product of matrices or vectors."""
        ((of_left, of_right), batches) = numbers
        if any(map(len, batches)):
            raise ValueError("dot_general with batches")
        left = np.moveaxis(left, of_left, range(-len(of_left), 0))
        right = np.moveaxis(right, of_right, range(-len(of_right), 0))
        n, m = left.ndim - len(of_left), right.ndim - len(of_right)
        left = left.reshape(*left.shape[:n], *([1] * m), -1)
        right = right.reshape(*([1] * n), *right.shape[:m], -1)
        return self.total(self.elementwise(_ELEMENTARY["mul"].format, [left, right]), (n + m,))


def _placed(elements: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The elements at those places; an array of names even where it is only one."""
    found = np.empty(places.shape, object)
    found[...] = elements[places]
    return found


def _written(array: np.ndarray) -> np.ndarray:
    found = np.empty(array.shape, object)
    for place in np.ndindex(array.shape):
        found[place] = number(array[place])
    return found


def _cast(before: Any, after: Any) -> str | None:
    """How a number becomes one of another kind in C, which computes with doubles throughout, where that changes it."""
    if jnp.issubdtype(before, jnp.floating):
        if after == jnp.bool_:
            return "{0} != 0"
        if jnp.issubdtype(after, jnp.integer):
            return "trunc({0})"
        if jnp.finfo(after).bits < 64 and jnp.finfo(after).bits < jnp.finfo(before).bits:
            return "(double)(float)({0})"
    return None


def _form(kind: str, parameters: Any, count: int) -> Callable[..., str]:
    """How an operation on elements is written."""
    if kind == "integer_pow":
        power = parameters["y"]
        return (" * ".join(["{0}"] * power) if 1 <= power <= 4 else f"pow({{0}}, {float(power)!r})").format
    if kind == "select_n":
        if count != 3:
            raise ValueError("select_n of more than two cases")
        return "{0} ? {2} : {1}".format
    return _ELEMENTARY[kind].format


def written_out(function: Callable[..., Any], arguments: list[np.ndarray], example: list[Any]) -> tuple[list[str], Any]:
    """Lines of C that compute a function, and its results by their names there.

    Args:
        function: of arrays, with one array as its result.
        arguments: for each of its arguments the names of its elements in C.
        example: for each of them an array of its shape.

    Returns:
        Definitions of variables, one a line, and an array of expressions.

    Raises:
        ValueError: whose message is the name of an operation that cannot be written out.
    """
    closed = jax.make_jaxpr(function)(*example)
    writer = _Writer()
    (found,) = writer.run(closed.jaxpr, closed.consts, arguments)
    return writer.lines, found if found.dtype == object else _written(found)
