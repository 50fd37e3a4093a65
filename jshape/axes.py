"""Commands of several axes: a crane's trolley and its hoist, a tower crane's slewing, a robot's joints.

Each axis has a command of its own and, where it does not start with the others, a delay::

    command = js.Axes(trolley=js.Trapezoid(4.0, speed=1.0, acceleration=0.5), hoist=js.Trapezoid(-2.0, 0.4, 0.2),
                      delay={"hoist": 0.5})
    command(0.3), command.final                   # one value an axis

It is a piecewise polynomial, too, whose coefficients are vectors: its breaks are those of all axes.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Breaks, Coefficients, Scalar
from jshape.command import AbstractCommand, Distance, as_command, taylor_shift


class Rest(AbstractCommand):
    """An axis that does not move."""

    smoothness: ClassVar = 99

    def pieces(self) -> tuple[Breaks, Coefficients]:
        return jnp.zeros(1), jnp.zeros((1, 1))


class Axes(AbstractCommand):
    """The commands of several axes that move together.

    Args:
        delay: axis → s after which its command starts, not negative; the others start at once.
        **commands: axis → its command; a number is a step of that size.

    Raises:
        ValueError: without an axis, for what is no command, and for a delay that is negative or of an unknown axis.
    """

    commands: tuple[AbstractCommand, ...]
    delay: dict[str, Scalar]
    names: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, *, delay: Mapping[str, Any] | None = None, **commands: Any):
        if not commands:
            raise ValueError("commands: there must be one axis at least, such as Axes(trolley=Trapezoid(…))")
        delay = {} if delay is None else delay
        if not isinstance(delay, Mapping) or not set(delay) <= set(commands):
            raise ValueError(f"delay must be a mapping from some of the axes {', '.join(commands)} to s, not {delay!r}")
        self.names = tuple(commands)
        self.commands = tuple(as_command(command, name) for name, command in commands.items())
        for name, command in zip(self.names, self.commands, strict=True):
            if isinstance(command, Axes):
                raise ValueError(f"{name} must be the command of one axis, not of several: {', '.join(command.names)}")
        self.delay = {name: _check.scalar(value, f"delay of {name}") for name, value in delay.items()}

    def __check_init__(self):
        for name, value in self.delay.items():
            _check.not_negative(value, f"delay of {name}")

    @property
    def smoothness(self) -> int:
        """Order of the lowest derivative that jumps in any axis."""
        return min(command.smoothness for command in self.commands)

    def items(self) -> list[tuple[str, AbstractCommand]]:
        """Axes and their commands, in order."""
        return list(zip(self.names, self.commands, strict=True))

    def mapped(self, function: Callable[[str, AbstractCommand], AbstractCommand]) -> "Axes":
        """The same axes with other commands: ``function(axis, command)`` of each that moves."""
        some = {name: one if isinstance(one, Rest) else function(name, one) for name, one in self.items()}
        return Axes(delay=self.delay, **some)

    def pieces(self) -> tuple[Breaks, Float[Array, "breaks axes powers"]]:
        """The breaks of all axes (s, the first is 0), sorted, and each axis's coefficients after each of them."""
        moving = [self._delayed(name, one) for name, one in self.items() if not isinstance(one, Rest)]
        breaks = jnp.concatenate([breaks for breaks, _ in moving])
        order = jnp.argsort(breaks, stable=True)
        merged = breaks[order]
        owner = jnp.asarray(np.repeat(np.arange(len(moving)), [len(breaks) for breaks, _ in moving]))[order]
        powers = max(coefficients.shape[1] for _, coefficients in moving)
        rows = []
        for i, (breaks, coefficients) in enumerate(moving):
            # As in ``superpose``: the piece that is active follows from the order, never from comparing times.
            started = jnp.cumsum(owner == i)
            active = jnp.clip(started - 1, 0)
            padded = jnp.pad(coefficients, ((0, 0), (0, powers - coefficients.shape[1])))
            row = taylor_shift(padded[active], merged - breaks[active])
            rows.append(jnp.where((started > 0)[:, None], row, 0.0))
        row = iter(rows)
        still = jnp.zeros_like(rows[0])
        return merged, jnp.stack([still if isinstance(one, Rest) else next(row) for one in self.commands], axis=1)

    def _delayed(self, name: str, command: AbstractCommand) -> tuple[Breaks, Coefficients]:
        breaks, coefficients = command.pieces()
        if name not in self.delay:
            return breaks, coefficients
        begin = jnp.zeros_like(breaks[:1]), jnp.zeros_like(coefficients[:1])
        return jnp.concatenate([begin[0], breaks + self.delay[name]]), jnp.concatenate([begin[1], coefficients])


def for_axes(command: Any, axes: tuple[str, ...], plant: str, name: str = "distance") -> AbstractCommand:
    """A command as a plant takes it: a plain one for a plant of one axis, all axes in the plant's order for others.

    A plain command, or a number, moves the first axis; an axis that is not named rests.

    Args:
        command: any command; a number is a step of that size.
        axes: the plant's; none for one that takes a plain command.
        plant: its name, for messages.
        name: of the argument, for messages.

    Raises:
        ValueError: for an axis that the plant does not have, and for what is no command.
    """
    command = as_command(command, name)
    if not axes:
        if isinstance(command, Axes):
            words = f"{name}: {plant} has one axis and takes a plain command, not the axes {', '.join(command.names)}"
            raise ValueError(words)
        return command
    if not isinstance(command, Axes):
        command = Axes(**{axes[0]: command})
    unknown = [axis for axis in command.names if axis not in axes]
    if unknown:
        raise ValueError(f"{name}: {plant} has the axes {', '.join(axes)}, and no {', '.join(unknown)}")
    if command.names == axes:
        return command
    given = dict(command.items())
    return Axes(delay=command.delay, **{axis: given.get(axis, Rest()) for axis in axes})


def moving(plant: Any, distance: Distance) -> tuple[str, ...]:
    """The axes of a plant of several that a command moves to another place; where there is none, all of them."""
    if not getattr(plant, "axes", ()):
        return ()
    final = for_axes(distance, plant.axes, type(plant).__name__).final
    return tuple(axis for axis, way in zip(plant.axes, np.asarray(final), strict=True) if way != 0) or plant.axes
