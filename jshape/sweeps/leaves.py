"""Uncertain plants: the same plant many times over, with some leaves changed.

A leaf is named by its dotted path: ``"m2"``, ``"spring.k1"``, ``"omega.0"`` (the first of several). An uncertain set
gives each named leaf a list of values, multiples of its nominal value unless ``relative=False``; several leaves make a
grid::

    over = {"m2": jnp.linspace(0.8, 1.2, 41), "spring.k1": [0.9, 1.0, 1.1]}     # 123 plants

Where a move is uncertain, too, its leaves follow ``command.``: ``"command.distance"``, of several axes
``"command.slew.distance"``, ``"command.delay.hoist"``.
"""

import itertools
import math
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape import _check
from jshape.axes import Axes
from jshape.command import AbstractCommand
from jshape.plants import AbstractPlant

MOVE = "command."
"""What the names of a command's leaves begin with."""

MOST_CORNERED = 6
"""Leaves at most whose set's corners, all combinations of least and greatest values, are checked."""


Tree = TypeVar("Tree", bound=eqx.Module)


def leaf_names(plant: eqx.Module) -> list[str]:
    """The dotted paths of all of a plant's leaves, entries of lists one by one."""
    names = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(plant):
        name = _dotted(path)
        names += [name] if jnp.ndim(leaf) == 0 else [f"{name}.{i}" for i in range(jnp.shape(leaf)[0])]
    return names


def _dotted(path: tuple[Any, ...]) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".")


def leaf(plant: eqx.Module, name: str) -> Array:
    """The value of the leaf of that dotted path.

    Raises:
        ValueError: for an unknown one; the message lists what there is.
    """
    where, index = _where(plant, name)
    value = jnp.asarray(where(plant))
    return value if index is None else value[index]


def as_names(leaves: str | tuple[str, ...]) -> tuple[str, ...]:
    """One dotted path or several as a tuple."""
    _check.instances(leaves, "leaves", str, "a name or several")
    return (leaves,) if isinstance(leaves, str) else tuple(leaves)


def positive_leaves(plant: AbstractPlant, leaves: tuple[str, ...]) -> Array:
    """The values of the leaves of those dotted paths.

    Raises:
        ValueError: for unknown ones, for none at all, and for values that are not positive.
    """
    if not leaves:
        raise ValueError("leaves is empty: there is nothing to adapt")
    values = jnp.stack([leaf(plant, name) for name in leaves])
    _check.positive(values, f"leaves {', '.join(leaves)}")
    return values


def with_leaves(plant: Tree, values: Mapping[str, Any]) -> Tree:
    """The plant with some leaves replaced.

    Args:
        plant: the nominal plant.
        values: leaf → its new value, which may be traced and is not checked.
    """
    for name, value in values.items():
        where, index = _where(plant, name)
        new = value if index is None else _with_entry(where(plant), index, value)
        plant = eqx.tree_at(where, plant, new)
    return plant


def _with_entry(array: Any, index: int, value: Any) -> Array:
    """The array with one entry replaced."""
    if not _check.is_concrete(array, value):
        return jnp.asarray(array).at[index].set(value)
    entries = np.array(array)
    entries[index] = value
    return _check.on_device(entries)


def changed(
    plant: AbstractPlant, command: AbstractCommand, values: Mapping[str, Any]
) -> tuple[AbstractPlant, AbstractCommand]:
    """The plant and the command with some leaves replaced; ``values``: as those of ``with_leaves``."""
    own = {name: value for name, value in values.items() if not name.startswith(MOVE)}
    if len(own) == len(values):
        return with_leaves(plant, own), command
    names = _of_command(command)
    moved = {names[name]: value for name, value in values.items() if name.startswith(MOVE)}
    return with_leaves(plant, own), with_leaves(command, moved)


def _of_command(command: AbstractCommand) -> dict[str, str]:
    """The numbers of a command: their names → their dotted paths."""
    found = {}
    for path, number in jax.tree_util.tree_leaves_with_path(command):
        place = name = _dotted(path)
        if isinstance(command, Axes) and place.startswith("commands."):
            _, index, rest = place.split(".", 2)
            name = f"{command.names[int(index)]}.{rest}"
        if jnp.ndim(number) == 0:
            found[MOVE + name] = place
    return found


def check_over(
    plant: AbstractPlant, over: Mapping[str, Any], relative: bool = True, command: AbstractCommand | None = None
) -> dict[str, Array]:
    """The absolute values of each named leaf of an uncertain set.

    Args:
        plant: the nominal plant.
        over: leaf → a list of values.
        relative: whether the values are multiples of nominal.
        command: the nominal move, whose leaves may be uncertain, too; ``None`` where they may not.

    Raises:
        ValueError: for an empty set, an unknown leaf, values that are not a list of finite numbers, multiples of a leaf
            that is 0, or values with which the plant itself cannot be (a negative mass).
    """
    if not isinstance(over, Mapping) or not over:
        raise ValueError(f"over must name at least one leaf and its values, not {over!r}")
    absolute, moves = {}, {} if command is None else _of_command(command)
    for name, values in over.items():
        if command is not None and isinstance(name, str) and name.startswith(MOVE) and name not in moves:
            raise ValueError(f"unknown leaf {name!r}: the command has {', '.join(moves) or 'none'}")
        tree: Any = command if name in moves else plant
        nominal = leaf(tree, place := moves.get(name, name))
        values = _check.as_array(values, f"over[{name!r}]")
        if values.ndim != 1 or not len(values):
            raise ValueError(f"over[{name!r}] must be a list of at least one value, not of shape {values.shape}")
        _check.finite(values, f"over[{name!r}]")
        if relative and _check.is_concrete(nominal) and float(nominal) == 0:
            raise ValueError(f"over[{name!r}]: {name} is 0, of which there are no multiples; give relative=False")
        xp = _check.numerics(values, nominal)
        absolute[name] = _check.on_device(xp.asarray(values) * xp.asarray(nominal)) if relative else values
        _check_construction(tree, place, absolute[name], name)
    _check_corners(plant, {name: values for name, values in absolute.items() if name not in moves})
    return absolute


def warn_if_absolute(plant: AbstractPlant, over: Mapping[str, Any], command: AbstractCommand | None = None) -> None:
    """Warn where multiples, as ``check_over`` takes them, look like absolute values: nominal is one, and 1 is not."""
    names = {} if command is None else _of_command(command)
    for name, values in over.items():
        tree: Any = command if name in names else plant
        nominal = leaf(tree, names.get(name, name))
        if not _check.is_concrete(values, nominal):
            continue
        if look_absolute(np.asarray(values), float(nominal)):
            least, greatest = float(np.min(values)), float(np.max(values))
            words = f"{least:g} to {greatest:g} are multiples of the nominal {nominal:g}, so that {name} is"
            words += f" {least * nominal:g} to {greatest * nominal:g}; give relative=False for absolute values"
            warnings.warn(f"over[{name!r}]: {words}", stacklevel=4)


def look_absolute(multiples: np.ndarray, nominal: float) -> bool:
    """Whether the nominal value is among multiples, and 1 is not."""
    least, greatest = float(np.min(multiples)), float(np.max(multiples))
    return least <= nominal <= greatest and not least <= 1 <= greatest


def grid(absolute: Mapping[str, Array | np.ndarray]) -> dict[str, Array]:
    """All combinations of the leaves' values, one entry a plant, the last leaf changing fastest.

    Raises:
        ValueError: for more than the memory holds.
    """
    _check.memory(len(absolute) * math.prod(map(len, absolute.values())), "over")
    xp = _check.numerics(absolute)
    mesh = xp.meshgrid(*(xp.asarray(values) for values in absolute.values()), indexing="ij")
    return {name: _check.on_device(values.reshape(-1)) for name, values in zip(absolute, mesh, strict=True)}


def _where(plant: eqx.Module, name: str) -> tuple[Callable[[Any], Any], int | None]:
    """What takes the leaf (or the array that it is an entry of) out of a plant, and the entry's index."""
    paths = {_dotted(path): path for path, _ in jax.tree_util.tree_leaves_with_path(plant)}
    if not isinstance(name, str) or name not in leaf_names(plant):
        raise ValueError(f"unknown leaf {name!r}: {type(plant).__name__} has {', '.join(leaf_names(plant))}")
    index = None
    if name not in paths:
        name, _, entry = name.rpartition(".")
        index = int(entry)

    def follow(tree: Any) -> Any:
        for key in paths[name]:
            match key:
                case jax.tree_util.GetAttrKey():
                    tree = getattr(tree, key.name)
                case jax.tree_util.DictKey():
                    tree = tree[key.key]
                case _:
                    tree = tree[key.idx]
        return tree

    return follow, index


def _check_construction(tree: Any, place: str, values: Array, name: str) -> None:
    """The checks of construction, which a leaf that is put in place later does not pass through, at both ends."""
    if not _check.is_concrete(tree, values):
        return
    for value in map(_check.on_device, (np.min(np.asarray(values)), np.max(np.asarray(values)))):
        try:
            _check.recheck(with_leaves(tree, {place: value}))
        except ValueError as error:
            raise ValueError(f"over[{name!r}]: {error}") from None


def _check_corners(plant: AbstractPlant, absolute: Mapping[str, Array]) -> None:
    """The same of several leaves together, at the corners of their set: a plant may allow each by itself alone."""
    if not 1 < len(absolute) <= MOST_CORNERED or not _check.is_concrete(plant, absolute):
        return
    ends = [(np.min(values), np.max(values)) for values in map(np.asarray, absolute.values())]
    for corner in itertools.product(*ends):
        together = dict(zip(absolute, map(_check.on_device, corner), strict=True))
        try:
            _check.recheck(with_leaves(plant, together))
        except ValueError as error:
            raise ValueError(
                f"over: {error}, with {', '.join(f'{name} {float(value):g}' for name, value in together.items())}"
            ) from None
