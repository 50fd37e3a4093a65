"""Pictures of a move: the machine and its payload above, what was commanded and what the payload did below.

Artists are made once and given new data for every frame. The figure draws into memory and needs no screen; only
``play`` opens a window, where there is one.
"""

import time
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from jaxtyping import Array
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jshape.moves import EnvState, Params, bare_energy_and_oracle_cost, plan_move, run_move, watch_move
from jshape.reports.style import COLOURS, STYLE
from jshape_envs.scene import Scene, scene_of

FPS = 30
SAMPLES = 121
"""Instants of a move that are drawn, from its beginning to the end of the sensor's window."""


class Renderer:
    """Draws moves of one environment.

    Args:
        params: the environment.
        window: whether ``play`` shows them on the screen.
    """

    def __init__(self, params: Params, window: bool = False):
        self.params = params
        plant = params.machine.plant(jnp.mean(params.payload), jnp.zeros((), jnp.int32))
        with mpl.rc_context(STYLE | {"figure.constrained_layout.use": False}):
            self.figure = _window() if window else Figure()
            self.figure.set_size_inches(6.4, 4.8)
            self.figure.set_dpi(100)
            if not window:
                FigureCanvasAgg(self.figure)
            above = self.figure.add_axes((0.09, 0.44, 0.88, 0.5))
            below = self.figure.add_axes((0.09, 0.1, 0.88, 0.28))
            self.scene: Scene = scene_of(plant)(above, params)
            (self.command,) = below.step([], [], where="post", color="0.35", linewidth=1.0, label="command")
            (self.payload,) = below.plot([], [], color=COLOURS[0], linewidth=1.6, label="payload")
            self.impulses = below.vlines([], 0, 1, color=COLOURS[1], linewidth=0.8, linestyle=":", label="impulses")
            self.now = below.axvline(0.0, color="0.7", linewidth=0.8)
            below.set(xlabel="time (s)", ylabel=self.scene.unit)
            below.legend(loc="upper left", ncols=3)
            self.below = below
            self.title = self.figure.text(0.09, 0.955, "", fontsize=9)
        self._move: tuple[np.ndarray, ...] = ()

    def take(self, state: EnvState, action: Array | None) -> None:
        """The move to draw: from this state, with this action (none: the machine stands before its first move)."""
        given = jnp.zeros(self.params.action.size) if action is None else action
        found = tuple(np.asarray(x) for x in _watch(state, given.astype(self.params.period.dtype), self.params))
        if action is None:
            found = (*(np.repeat(x[:1], 2, axis=0) for x in found[:4]), np.zeros(0), found[5])
        self._move = found
        times, command, payload, states, impulses, residual = found
        self.scene.take(command, payload, states)
        low, high = (f(np.concatenate([command, payload])) for f in (np.nanmin, np.nanmax))
        self.below.set_xlim(0.0, max(float(times[-1]), 1e-3))
        self.below.set_ylim(low - 0.1 * (high - low) - 1e-3, high + 0.35 * (high - low) + 1e-3)
        ends = self.below.get_ylim()
        self.impulses.set_segments([np.array([[t, ends[0]], [t, ends[1]]]) for t in impulses])
        number, distance = int(state.moves), float(state.distance)
        outcome = "next" if action is None else f"residual energy {100 * float(residual):.2f} %"
        self.title.set_text(
            f"move {number + 1}: {distance:+.2f} {self.scene.short}, payload {float(state.payload):.3g}; {outcome}"
        )

    def still(self) -> np.ndarray:
        """The whole move in one picture, height × width × 3, uint8."""
        return self._draw(len(self._move[0]) - 1)

    def frames(self) -> list[np.ndarray]:
        """The move in frames of 1/30 s."""
        times = self._move[0]
        instants = np.arange(0.0, times[-1], 1 / FPS) if times[-1] > 0 else times[:1]
        return [self._draw(int(np.searchsorted(times, t))) for t in instants]

    def play(self) -> None:
        """The frames on the screen, at their pace; without a screen one of them is drawn and nothing shown."""
        if not getattr(self.figure.canvas, "required_interactive_framework", None):
            self._draw(0)
            return
        for index in range(0, len(self._move[0]), 2):
            self._draw(index)
            self.figure.canvas.flush_events()
            time.sleep(1 / FPS)

    def close(self) -> None:
        """Gives the figure back, and closes its window."""
        manager: Any = self.figure.canvas.manager
        if manager is not None:
            import matplotlib.pyplot as plt

            plt.close(self.figure)

    def _draw(self, index: int) -> np.ndarray:
        times, command, payload, *_ = self._move
        self.scene.draw(index)
        until = slice(0, index + 1)
        self.command.set_data(times[until], command[until])
        self.payload.set_data(times[until], payload[until])
        self.now.set_xdata([times[index], times[index]])
        canvas: Any = self.figure.canvas
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3] if hasattr(canvas, "buffer_rgba") else np.zeros(0)


@jax.jit
def _watch(state: EnvState, action: Array, params: Params) -> tuple[Array, ...]:
    """Times, command, payload and states along the move, times of the impulses, normalised residual energy.

    The last of a crane's states is the length of its cable, m.
    """
    machine = params.machine
    plant, shaper = machine.plant(state.payload, state.moves), params.action.shaper(action)
    plan = plan_move(plant, machine.command(state.distance, state.moves), shaper, state.position)
    horizon = plan.breaks[-1] + params.sensor.window
    steps = max(2, params.steps.window * params.sensor.samples * 2 // SAMPLES)
    times, command, payload, states = watch_move(plant, plan, state.plant, horizon, SAMPLES, steps)
    cable = getattr(plant, "cable_length", None)
    if cable is not None:
        # A crane's cable is as long as its hoist lets it be; of the axes the first is drawn.
        length = cable + (command[:, 1] if plant.axes else jnp.zeros_like(times))
        states = jnp.concatenate([states, length[:, None]], axis=1)
    if plant.axes:
        command, payload = command[:, 0], payload[:, 0]
    reference, _ = bare_energy_and_oracle_cost(state, params)
    _, energy = run_move(plant, plan, state.plant, params.steps)
    return times, command, payload, states, shaper.times, energy / reference


def _window() -> Any:
    import matplotlib.pyplot as plt

    return plt.figure()
