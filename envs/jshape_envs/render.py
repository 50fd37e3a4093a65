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

from jshape.moves import EnvState, Params, bare_energy_and_oracle_cost, plan_move, run_move
from jshape.plants import AbstractPlant
from jshape.reports.film import Put, view_of
from jshape.reports.places import motion_of
from jshape.reports.style import COLOURS, STYLE
from jshape.shaper import Shaper
from jshape_envs.film import as_response, watched

FPS = 30


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
            self.figure.set_size_inches(6.4, 4.8)
            self.figure.set_dpi(100)
            if not window:
                FigureCanvasAgg(self.figure)
        self.times = np.zeros(1)
        self.puts: list[Put] = []

    def take(self, state: EnvState, action: Array | None) -> None:
        """The move to draw: from this state, with this action (none: the machine stands before its first move)."""
        given = jnp.zeros(self.params.action.size) if action is None else action
        plant, shaper, watched_move, residual = _watch(state, given.astype(self.params.period.dtype), self.params)
        run = as_response(watched_move)
        end = 0.0 if action is None else float(run.times[-1])
        self.times = np.append(np.arange(0.0, end, 1 / FPS), end)
        motion = motion_of(plant, run, self.times)
        outcome = "next" if action is None else f"residual energy {100 * float(residual):.2f} %"
        unit, distance = plant.axis_unit(), float(state.distance)
        payload = f"{float(state.payload):.3g} {self.params.machine.payload_unit()}".rstrip()
        words = f"move {int(state.moves) + 1}: {distance:+.2f} {unit}, payload {payload}; {outcome}"
        with mpl.rc_context(STYLE | {"figure.constrained_layout.use": False}):
            self.figure.clear()
            above = self.figure.add_axes((0.09, 0.44, 0.88, 0.5))
            draw, view = view_of([motion], way=(-float(self.params.track), float(self.params.track)))
            above.set_axis_off()
            above.set(xlim=view[0], ylim=view[1], aspect="equal")
            self.puts = [draw(above, motion.places, view, COLOURS[0])]
            below = self.figure.add_axes((0.09, 0.1, 0.88, 0.28))
            below.set(xlabel="time (s)", ylabel="angle (rad)" if unit == "rad" else f"position ({unit})")
            self.puts.append(_positions(below, run, [] if action is None else shaper.times, self.times))
            self.figure.text(0.09, 0.955, words, fontsize=9)

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


def _positions(axes: Axes, run: Any, impulses: Any, times: np.ndarray) -> Put:
    """Command and payload along the first axis until now, and when the impulses come."""
    command, payload = (np.reshape(values, (len(run.times), -1))[:, 0] for values in (run.command, run.payload))
    (commanded,) = axes.step([], [], where="post", color="0.35", linewidth=1.0, label="command")
    (reached,) = axes.plot([], [], color=COLOURS[0], linewidth=1.6, label="payload")
    low, high = (of(np.concatenate([command, payload])) for of in (np.nanmin, np.nanmax))
    ends = low - 0.1 * (high - low) - 1e-3, high + 0.35 * (high - low) + 1e-3
    axes.vlines(impulses, *ends, color=COLOURS[1], linewidth=0.8, linestyle=":", label="impulses")
    axes.set(xlim=(0.0, max(times[-1], 1e-3)), ylim=ends)
    axes.legend(loc="upper left", ncols=3)
    now = axes.axvline(0.0, color="0.7", linewidth=0.8)

    def put(frame: int) -> None:
        until = run.times <= times[frame]
        commanded.set_data(run.times[until], command[until])
        reached.set_data(run.times[until], payload[until])
        now.set_xdata([times[frame], times[frame]])

    return put


@jax.jit
def _watch(state: EnvState, action: Array, params: Params) -> tuple[AbstractPlant, Shaper, dict[str, Array], Array]:
    """The plant, the shaper, the trajectory along the move, the normalised residual energy."""
    machine = params.machine
    plant, shaper = machine.plant(state.payload, state.moves), params.action.shaper(action)
    plan = plan_move(plant, machine.command(state.distance, state.moves), shaper, state.position)
    reference, _ = bare_energy_and_oracle_cost(state, params)
    _, energy = run_move(plant, plan, state.plant, params.steps)
    return plant, shaper, watched(plant, state, shaper, params), energy / reference


def _window() -> Any:
    import matplotlib.pyplot as plt

    return plt.figure()
