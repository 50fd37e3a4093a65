"""Checks of arguments: concrete values are checked, traced ones pass.

Every public constructor and entry point uses these, so that a wrong number is met with an error which names
the argument and its value, while the same code runs under ``jit``, ``vmap`` and ``grad``. A function calls them one by
one; a module declares them with its fields::

    class Spring(Checked):
        k: Scalar = eqx.field(converter=Argument(positive))
        preload: Scalar = eqx.field(default=0.0, converter=Argument(finite))
"""

import dataclasses
import os
import warnings
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from jshape._rules import RULES

MOST_SAMPLES = 10_000_000
"""Samples that a shaper may last."""

NUMBER = int | float | np.number | np.ndarray | jax.Array
"""Kinds of which a single number may be."""

MOST_MEMORY = 2**34
"""Bytes that the numbers of one call may take."""


def is_concrete(*trees: Any) -> bool:
    """Whether no leaf of the trees is traced by JAX."""
    return not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def numerics(*trees: Any) -> Any:
    """NumPy for concrete leaves, ``jax.numpy`` for traced ones: a few numbers are no reason to compile programs."""
    return np if is_concrete(*trees) else jnp


def on_device(value: Any) -> Array:
    """``value`` as a JAX array; NumPy's without ``jnp.asarray``, which compiles a program for each of their shapes."""
    return jax.device_put(value) if isinstance(value, np.ndarray | np.generic) else jnp.asarray(value)


def as_array(value: Any, name: str) -> Array:
    """``value`` as an array of floats: its own float type if it has one, JAX's default otherwise.

    Raises:
        ValueError: for a value that is not numeric, or complex.
    """
    if isinstance(value, bool | str | bytes):
        raise ValueError(f"{name} must be a number, not {quoted(value)}")
    dtype = getattr(value, "dtype", None)
    if dtype is not None and jnp.issubdtype(dtype, jnp.complexfloating):
        raise ValueError(f"{name} must be real, not {show(value) if is_concrete(value) else value}")
    try:
        if dtype is not None and jnp.issubdtype(dtype, jnp.floating):
            return on_device(value)
        if not isinstance(value, jax.Array) and is_concrete(value) and (plain := np.asarray(value)).dtype.kind in "iuf":
            return on_device(plain.astype(float))
        return jnp.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be numeric, not {quoted(value)}") from None


def plain_array(value: Any, name: str, dimensions: int = 1) -> np.ndarray:
    """``value``, a list or a table of numbers, as NumPy's array of floats; raises ``ValueError`` for what is none."""
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be numeric, not {quoted(value)}") from None
    if array.ndim != dimensions:
        raise ValueError(f"{name} must be a {('', 'list', 'table')[dimensions]} of numbers, not {quoted(value)}")
    return array


def scalar(value: Any, name: str) -> Array:
    """``value`` as a zero-dimensional float array.

    Raises:
        ValueError: for a concrete array of one or more dimensions, and for a value that is not numeric.
    """
    array = as_array(value, name)
    if array.ndim and is_concrete(array):
        raise ValueError(f"{name} must be a single number, not an array of shape {array.shape}")
    return array


def require(value: Any, name: str, holds: Callable[[np.ndarray], Any], words: str) -> None:
    """Raises ``ValueError`` unless a concrete value is numeric and every entry of it passes; an empty list has none.

    What compares with ``<`` twice in one expression takes a single number only.
    """
    if is_concrete(value):
        try:
            passes = np.all(holds(np.asarray(value)))
        except (TypeError, ValueError):
            passes = None
        if passes is None or (isinstance(value, list) and not value):
            raise ValueError(f"{name} must be numeric, not {quoted(value)}")
        if not passes:
            raise ValueError(f"{name} must {words}, not {show(value)}")


def finite(value: Any, name: str) -> None:
    """Raises ``ValueError`` if a concrete value holds a NaN or an infinity."""
    require(value, name, np.isfinite, "be finite")


def positive(value: Any, name: str) -> None:
    """Raises ``ValueError`` unless every concrete value is finite and greater than 0."""
    finite(value, name)
    require(value, name, *RULES["positive"])


def not_negative(value: Any, name: str) -> None:
    """Raises ``ValueError`` unless every concrete value is finite and at least 0."""
    finite(value, name)
    require(value, name, *RULES["not_negative"])


def above_one(value: Any, name: str) -> None:
    """Raises ``ValueError`` unless every concrete value is finite and greater than 1."""
    finite(value, name)
    require(value, name, lambda x: x > 1, "be greater than 1")


def not_zero(value: Any, name: str) -> None:
    """Raises ``ValueError`` if a concrete value is 0 or not finite."""
    finite(value, name)
    if is_concrete(value) and not np.all(RULES["not_zero"][0](np.asarray(value))):
        raise ValueError(f"{name} must {RULES['not_zero'][1]}")


def damping_ratio(value: Any, name: str = "zeta") -> None:
    """Raises ``ValueError`` unless every concrete value lies in [0, 1)."""
    finite(value, name)
    require(value, name, *RULES["damping_ratio"])


def instance(value: Any, name: str, kind: Any, words: str) -> None:
    """Raises ``ValueError`` unless ``value`` is of a class, or of one of several, which ``words`` describe."""
    if not isinstance(value, kind):
        raise ValueError(f"{name} must be {words}, not {quoted(value)}")


def instances(values: Any, name: str, kind: Any, words: str) -> None:
    """Raises ``ValueError`` unless ``values`` is a collection of which each is of a class; ``words`` describe it."""
    instance(values, name, Collection, words)
    for value in values:
        instance(value, name, kind, words)


def function(value: Any, name: str) -> None:
    """Raises ``ValueError`` unless ``value`` can be called, or is ``None``."""
    instance(value, name, Callable | None, "a function")


def path(value: Any, name: str = "path") -> Path:
    """``value`` as a path; raises ``ValueError`` unless it is one, or a text."""
    instance(value, name, str | os.PathLike, "a path")
    return Path(value)


def one_of(value: str, name: str, allowed: tuple[str, ...]) -> None:
    """Raises ``ValueError`` if ``value`` is not among the allowed words."""
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, not {quoted(value)}")


def count(value: Any, name: str, least: int = 1, most: int = 2**31 - 1) -> int:
    """``value`` as an int; raises ``ValueError`` unless it is a whole number from ``least`` to ``most``."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} must be a whole number of at least {least}, not {quoted(value)}")
    if value > most:
        raise ValueError(f"{name} must be at most {most}, not {quoted(value)}")
    return int(value)


def memory(numbers: int, name: str) -> None:
    """Raises ``ValueError`` where so many numbers, of 8 bytes, take more than ``MOST_MEMORY``."""
    if 8 * numbers > MOST_MEMORY:
        size, most = (value / 2**30 for value in (8 * numbers, MOST_MEMORY))
        raise ValueError(f"{name} asks for {numbers:.3g} numbers, which take {size:.3g} GiB, more than {most:g}")


def samples(duration: float, sample_time: float) -> None:
    """Raises ``ValueError`` where a duration (s) has more than ten million samples."""
    if duration / sample_time > MOST_SAMPLES:
        least = duration / MOST_SAMPLES
        raise ValueError(f"sample_time must be at least {least:.3g} s for {duration:.6g} s, not {sample_time:.6g}")


def instants(values: Array, name: str) -> None:
    """Raises ``ValueError`` if concrete times (s, one at least) do not begin at 0, or decrease."""
    if is_concrete(values):
        plain = np.asarray(values)
        if plain[0] != 0:
            raise ValueError(f"{name} must begin at 0, not {plain[0]}")
        if np.any(np.diff(plain) < 0):
            raise ValueError(f"{name} must not decrease, not {show(plain)}")


def as_given(value: Any, name: str) -> Any:
    """``value`` unchanged: for fields that are no arrays."""
    del name
    return value


def real(value: Any, name: str) -> Any:
    """``value`` unchanged, where it is one plain number: for fields that are part of a program.

    Raises:
        ValueError: for anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise ValueError(f"{name} must be a number, not {quoted(value)}")
    scalar(value, name)
    return value


class Argument:
    """The converter of a field: converts what is given for it and checks it, under the field's own name.

    Args:
        *checks: called with the converted value and the name; each raises ``ValueError`` for what it does not accept.
        convert: from what is given and the name to the field's value; a scalar unless another is named.
        optional: whether ``None`` is accepted, and stays.
    """

    name = "value"

    def __init__(
        self,
        *checks: Callable[[Any, str], None],
        convert: Callable[[Any, str], Any] = scalar,
        optional: bool = False,
    ):
        self.checks, self.convert, self.optional = checks, convert, optional

    def __call__(self, value: Any) -> Any:
        if value is None and self.optional:
            return None
        value = self.convert(value, self.name)
        for check in self.checks:
            check(value, self.name)
        return value


def choice(*allowed: str) -> Argument:
    """The converter of a field that is one of the allowed words."""
    return Argument(lambda value, name: one_of(value, name, allowed), convert=as_given)


class Checked(eqx.Module):
    """A module whose fields are checked at construction: an ``Argument`` as converter learns its field's name here.

    Fields without one are left as they are, and what concerns several fields stands in ``__check_init__``, which runs
    after the converters. Type checkers count a variable annotated with equinox's ``AbstractVar`` among the arguments of
    every constructor below it, but not a ``ClassVar``; abstract classes therefore import the latter under that name
    where types are checked.
    """

    def __init_subclass__(cls, **kwargs: Any):
        super().__init_subclass__(**kwargs)
        for name, value in vars(cls).items():
            converter = value.metadata.get("converter") if isinstance(value, dataclasses.Field) else None
            if isinstance(converter, Argument):
                converter.name = name

    def __repr__(self) -> str:
        fields = (f"{field.name}={_printed(getattr(self, field.name))}" for field in dataclasses.fields(self))
        return f"{type(self).__name__}({', '.join(fields)})"


def _printed(value: Any) -> str:
    """A field's value, where it is known and a number or a few; else its type and shape."""
    if not eqx.is_array_like(value) or isinstance(value, bool):
        return repr(value)
    if not is_concrete(value):
        return eqx.tree_pformat(value)
    return f"{float(value):.8g}" if np.ndim(value) == 0 else show(value)


def recheck(module: eqx.Module) -> None:
    """Checks a module and its parts, also those in dictionaries and tuples, as construction does: for leaves replaced
    since."""
    for field in dataclasses.fields(module):
        value, converter = getattr(module, field.name), field.metadata.get("converter")
        if isinstance(converter, Argument):
            converter(value)
        parts = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
        for part in parts:
            if isinstance(part, eqx.Module):
                recheck(part)
    for kind in type(module).__mro__:
        if "__check_init__" in vars(kind):
            vars(kind)["__check_init__"](module)


def show(value: Any) -> str:
    """A value as an error message prints it: at most twelve entries, eight digits."""
    return " ".join(np.array2string(np.asarray(value), precision=8, threshold=12, separator=", ").split())


def quoted(value: Any) -> str:
    """Whatever a value is, in a line of at most 300 characters."""
    return " ".join(repr(value).split())[:300]


def warn_if_single() -> None:
    """Warns, once for each calling line, that JAX is in its 32-bit mode, so that results carry about seven digits.

    To compute in single precision on purpose, turn on 64 bits and pass ``float32`` arrays: their type is kept.
    """
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        warnings.warn(
            "JAX is in its 32-bit mode, so jshape computes with about seven digits. Call "
            'jax.config.update("jax_enable_x64", True) before the first array for full accuracy.',
            stacklevel=3,
        )
