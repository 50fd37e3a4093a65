"""The machines as they are drawn: a base and a payload on a spring, a crane, a link, or any other plant."""

import abc
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from jshape.moves import Params
from jshape.plants import AbstractCrane, AbstractPlant, BobRodPendulum, FlexibleLink
from jshape.reports.style import COLOURS


class Scene(abc.ABC):
    """A drawing on one pair of axes: ``take`` a move's trajectory, ``draw`` it at one of its instants."""

    unit = "position (m)"
    short = "m"

    def __init__(self, axes: Axes, params: Params):
        self.axes, self.params, self.travel = axes, params, float(params.track)
        axes.set_axis_off()
        (self.path,) = axes.plot([], [], color=COLOURS[5], linewidth=1.0, alpha=0.8, zorder=1)
        self.prepare()

    @abc.abstractmethod
    def prepare(self) -> None:
        """Makes the artists and sets the view."""

    @abc.abstractmethod
    def places(self, command: np.ndarray, payload: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where machine and payload are drawn, x and y a row each."""

    @abc.abstractmethod
    def put(self, machine: np.ndarray, load: np.ndarray) -> None:
        """Moves the artists there."""

    def take(self, command: np.ndarray, payload: np.ndarray, states: np.ndarray) -> None:
        self.machine, self.load = self.places(command, payload, states)

    def draw(self, index: int) -> None:
        self.put(self.machine[index], self.load[index])
        self.path.set_data(*self.load[: index + 1].T)

    def add(self, patch: Any) -> Any:
        return self.axes.add_patch(patch)


class Blocks(Scene):
    """A base that follows the command and a payload on a spring, both on a floor; for any plant."""

    def prepare(self) -> None:
        wide = self.travel
        self.size = 0.09 * wide
        self.axes.set(xlim=(-1.15 * wide, 1.35 * wide), ylim=(-0.3 * wide, 0.8 * wide), aspect="equal")
        self.axes.axhline(0.0, color="0.5", linewidth=1.0)
        rounded = f"round,pad=0,rounding_size={0.25 * self.size}"
        self.base = self.add(FancyBboxPatch((0, 0), self.size, 2 * self.size, boxstyle=rounded, color="0.35"))
        self.box = self.add(FancyBboxPatch((0, 0), 2 * self.size, 2 * self.size, boxstyle=rounded, color=COLOURS[0]))
        (self.spring,) = self.axes.plot([], [], color="0.2", linewidth=1.2, zorder=1)
        self.gap = 0.35 * wide

    def places(self, command, payload, states):
        level = np.full_like(command, self.size)
        return np.stack([command, level], 1), np.stack([payload + self.gap, level], 1)

    def put(self, machine: np.ndarray, load: np.ndarray) -> None:
        self.base.set_x(machine[0] - self.size)
        self.box.set_x(load[0])
        along = np.linspace(0.0, 1.0, 14)
        zigzag = np.concatenate([[0.0], 0.45 * self.size * (-1.0) ** np.arange(12), [0.0]])
        self.spring.set_data(machine[0] + (load[0] - machine[0]) * along, self.size + zigzag)

    def draw(self, index: int) -> None:
        super().draw(index)
        # On a line the path would be a line: it is shown above the payload, rising with time.
        rise = np.linspace(0.0, 0.5 * self.travel, len(self.load))[: index + 1]
        self.path.set_data(self.load[: index + 1, 0] + self.size, 2.3 * self.size + rise)


class CraneScene(Scene):
    """A trolley on its track and what hangs from it."""

    def prepare(self) -> None:
        wide, plant = self.travel, self.params.machine.plant(self.params.payload[1], jnp.zeros((), jnp.int32))
        self.rod = float(plant.bob_position) if isinstance(plant, BobRodPendulum) else 0.0
        deep = self.rod or 1.2 * float(self.params.payload[1] + getattr(self.params.machine, "low", 0.0))
        self.size = 0.05 * max(wide, 2 * deep)
        self.axes.set(
            xlim=(-1.1 * wide - deep, 1.1 * wide + deep),
            ylim=(-1.1 * deep - self.size, (deep if self.rod else 0.0) + 3 * self.size),
            aspect="equal",
        )
        self.axes.axhline(0.0, color="0.5", linewidth=2.5, zorder=0)
        self.trolley = self.add(Rectangle((0, 0), 3 * self.size, self.size, color="0.3", zorder=3))
        self.bob = self.add(Circle((0, 0), 0.8 * self.size, color=COLOURS[0], zorder=4))
        (self.cable,) = self.axes.plot([], [], color="0.2", linewidth=1.4, zorder=2)

    def places(self, command, payload, states):
        angle = states[:, 0]
        length = np.full_like(angle, self.rod) if self.rod else states[:, -1]
        top = np.stack([command, np.zeros_like(command)], 1)
        return top, np.stack([command + length * np.sin(angle), -length * np.cos(angle)], 1)

    def put(self, machine: np.ndarray, load: np.ndarray) -> None:
        self.trolley.set_xy((machine[0] - 1.5 * self.size, -0.5 * self.size))
        self.bob.set_center((load[0], load[1]))
        self.cable.set_data([machine[0], load[0]], [machine[1], load[1]])


class LinkScene(Scene):
    """A link that a motor turns, seen from above, bent as its tip's angle says."""

    unit = "angle (rad)"
    short = "rad"

    def prepare(self) -> None:
        self.axes.set(xlim=(-1.9, 1.9), ylim=(-0.35, 1.15), aspect="equal")
        self.add(Circle((0, 0), 0.1, color="0.35", zorder=3))
        self.coins = self.add(Circle((0, 0), 0.06, color=COLOURS[0], zorder=4))
        (self.link,) = self.axes.plot([], [], color="0.2", linewidth=2.5, zorder=2)

    def places(self, command, payload, states):
        # The motor's angle and the tip's, about straight up.
        return np.stack([states[:, 0], payload], 1), np.stack([-np.sin(payload), np.cos(payload)], 1)

    def put(self, machine: np.ndarray, load: np.ndarray) -> None:
        along = np.linspace(0.0, 1.0, 20)
        angle = machine[0] + (machine[1] - machine[0]) * along
        self.link.set_data(-along * np.sin(angle), along * np.cos(angle))
        self.coins.set_center((load[0], load[1]))


def scene_of(plant: AbstractPlant) -> type[Scene]:
    """How a plant is drawn."""
    if isinstance(plant, AbstractCrane) and plant.angles == 1:
        return CraneScene
    return LinkScene if isinstance(plant, FlexibleLink) else Blocks
