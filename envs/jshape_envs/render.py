"""Pictures of a move: the machine and its payload above, what was commanded and what the payload did below.

The figure draws into memory and needs no screen; only ``play`` opens a window, where there is one.
"""

import time
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jshape.moves import EnvState, Params, bare_energy_and_oracle_cost, bounded_residual, plan_move, run_move
from jshape.plants import AbstractPlant
from jshape.reports.drawings import Put, view_of
from jshape.reports.places import motion_of
from jshape.reports.style import COLOURS, STYLE
from jshape.shaper import Shaper
from jshape.simulation.response import Response
from jshape_envs.film import described, watched

FPS = 30
SIZE = 6.4, 4.8
"""Of the figure, inches of 100 pixels."""
ABOVE = (0.0, 0.46, 1.0, 0.48), (0.1, 0.1, 0.87, 0.28)
BESIDE = (0.01, 0.02, 0.5, 0.91), (0.62, 0.11, 0.35, 0.74)
"""Left, bottom, width and height of the machine and of the curves, as shares of the figure."""


class Renderer:
    """Draws moves of one environment.

    Args:
        params: the environment.
        window: whether ``play`` shows them on the screen.
    """

    def __init__(self, params: Params, window: bool = False):
        self.params = params
        with mpl.rc_context(STYLE | {"figure.constrained_layout.use": False}):
            self.figure = _window() if window else Figure()
            self.figure.set_size_inches(*SIZE)
            self.figure.set_dpi(100)
            if not window:
                FigureCanvasAgg(self.figure)
        self.times = np.zeros(1)
        self.puts: list[Put] = []

    def take(self, state: EnvState, action: Array | None) -> None:
        """The move to draw: from this state, with this action (none: the machine stands before its first move)."""
        given = jnp.zeros(self.params.action.size) if action is None else action
        plant, shaper, watched_move, residual = _watch(state, given.astype(self.params.period.dtype), self.params)
        run = jax.device_get(watched_move)
        end = float(run.times[-1])
        whole = np.append(np.arange(0.0, end, 1 / FPS), end)
        self.times = whole[:1] if action is None else whole
        # The view is that of the whole move, also before it.
        motion = motion_of(plant, run, whole)
        outcome = "next" if action is None else f"residual energy {100 * float(residual):.2f} %"
        with mpl.rc_context(STYLE | {"figure.constrained_layout.use": False}):
            self.figure.clear()
            machine, curves = BESIDE if motion.kind in ("link", "above") else ABOVE
            drawing, below = self.figure.add_axes(machine), self.figure.add_axes(curves)
            draw, view = view_of([motion])
            view = (*filling(view[:2], SIZE[0] * machine[2] / (SIZE[1] * machine[3])), *view[2:])
            drawing.set_axis_off()
            drawing.set(xlim=view[0], ylim=view[1], aspect="equal")
            self.puts = [draw(drawing, motion.places, view, COLOURS[0])]
            unit = plant.axis_unit()
            below.set(xlabel="time (s)", ylabel="angle (rad)" if unit == "rad" else f"position ({unit})")
            self.puts.append(_positions(below, run, [] if action is None else shaper.times, self.times))
            words = f"move {int(state.moves) + 1}: {described(state, self.params)}; {outcome}"
            self.figure.text(0.02, 0.955, words, fontsize=9)

    def still(self) -> np.ndarray:
        """The whole move in one picture, height × width × 3, uint8."""
        return self._draw(len(self.times) - 1)

    def frames(self) -> list[np.ndarray]:
        """The move in frames of 1/30 s."""
        return [self._draw(frame) for frame in range(max(len(self.times) - 1, 1))]

    def play(self) -> None:
        """The frames on the screen, at their pace; without a screen one of them is drawn and nothing shown."""
        if not getattr(self.figure.canvas, "required_interactive_framework", None):
            self._draw(0)
            return
        for frame in range(len(self.times)):
            self._draw(frame)
            self.figure.canvas.flush_events()
            time.sleep(1 / FPS)

    def close(self) -> None:
        """Gives the figure back, and closes its window."""
        manager: Any = self.figure.canvas.manager
        if manager is not None:
            import matplotlib.pyplot as plt

            plt.close(self.figure)

    def _draw(self, frame: int) -> np.ndarray:
        for put in self.puts:
            put(frame)
        canvas: Any = self.figure.canvas
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3] if hasattr(canvas, "buffer_rgba") else np.zeros(0)


def filling(view: tuple[Any, ...], shape: float) -> list[tuple[float, float]]:
    """The view made wider or higher, to both sides, until it fills a panel.

    Args:
        view: limits of both axes, m.
        shape: width of the panel over its height.
    """
    width, height = (float(np.ptp(ends)) for ends in view)
    wanted = max(width, height * shape), max(height, width / shape)
    return [(np.mean(ends) - size / 2, np.mean(ends) + size / 2) for ends, size in zip(view, wanted, strict=True)]


def _positions(axes: Axes, run: Any, impulses: Any, times: np.ndarray) -> Put:
    """Command and payload along the first axis until now, and when the impulses come."""
    command, payload = (np.reshape(values, (len(run.times), -1))[:, 0] for values in (run.command, run.payload))
    (commanded,) = axes.step([], [], where="post", color="0.35", linewidth=1.0, label="command")
    (reached,) = axes.plot([], [], color=COLOURS[0], linewidth=1.6, label="payload")
    low, high = (of(np.concatenate([command, payload])) for of in (np.nanmin, np.nanmax))
    ends = low - 0.1 * (high - low) - 1e-3, high + 0.1 * (high - low) + 1e-3
    axes.vlines(impulses, *ends, color=COLOURS[1], linewidth=0.8, linestyle=":", label="impulses")
    axes.set(xlim=(0.0, run.times[-1]), ylim=ends)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=3)
    now = axes.axvline(0.0, color="0.7", linewidth=0.8)

    def put(frame: int) -> None:
        until = run.times <= times[frame]
        commanded.set_data(run.times[until], command[until])
        reached.set_data(run.times[until], payload[until])
        now.set_xdata([times[frame], times[frame]])

    return put


@jax.jit
def _watch(state: EnvState, action: Array, params: Params) -> tuple[AbstractPlant, Shaper, Response, Array]:
    """The plant, the shaper, the response along the move, the normalised residual energy."""
    machine = params.machine
    plant, shaper = machine.plant(state.payload, state.moves), params.action.shaper(action)
    plan = plan_move(plant, machine.command(state.distance, state.moves), shaper, state.position)
    reference, _ = bare_energy_and_oracle_cost(state, params)
    _, energy = run_move(plant, plan, state.plant, params.steps)
    residual = bounded_residual(energy, reference, ~jnp.isfinite(energy))
    return plant, shaper, watched(plant, state, shaper, params), residual


def _window() -> Any:
    import matplotlib.pyplot as plt

    return plt.figure()
