"""The recovery of adaptive shapers from a load that changes unannounced: 500 random schedules, and wild signals.

    python -m experiments.adaptive.recovery        # about five minutes; writes recovery.md and recovery.svg beside it

The paper's flexible link makes twelve moves of random size and direction, 20 to 60°, with dwells of 5 to 10 s; its
load, uniform between 0 and 20 coins, changes once, at a random moment, to another. Strain gauge, encoder and
accelerometers have noise and resolution (``js.adaptive.Sensors``). The residual of a move is the largest deflection
from 1.9 s after its edge to the next, over its size. Move 1 is the first that begins after the change.

Case I is the paper's shaper for two modes, which stays at 9 and 70 rad/s; I-D takes the frequencies from two DFTs,
I-D-E the damping ratios from extremum seeking besides. ``state-aware`` and ``replanning`` are ``StateAware`` with
``replans=0`` and ``replans=3``: the first mode is identified while it moves, each move begins with a shaper that takes
the vibration away that is left, and ``replanning`` plans the impulses still to come anew within the move.
"""

import time
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np

import jshape as js
from experiments.markdown import explained, table, write_beside
from jshape.adaptive.closed_loop import metrics
from jshape.adaptive.closed_loop.faults import KINDS
from jshape.adaptive.figures import recovery

HERE = Path(__file__).parent
TIME = 0.005
NAMES = ("I", "I-D", "I-D-E", "state-aware", "replanning")
SCHEDULES = 500


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    strategies = {name: js.adaptive.case(name, TIME) for name in NAMES}
    begun = time.perf_counter()

    def progress(stage: str, done: int, total: int, best: float) -> None:
        print(f"{done}/{total}, {time.perf_counter() - begun:.0f} s")

    link = js.plants.FlexibleLink()
    found = js.adaptive.study(link, strategies, schedules=SCHEDULES, chunk=25, progress=progress)
    figure = recovery(found, "residual", "residual (% of move)", 100.0)
    figure.savefig(HERE / "recovery.svg", metadata={"Date": None})
    below = 100 * js.adaptive.recovered(found)
    head = ("below 5 % (% of schedules)", *(f"move {m}" for m in below.move.values))
    lines = table(head, [(n, *(f"{v:.1f}" for v in below.sel(strategy=n).values)) for n in NAMES])
    for move in (1, 2):
        values = np.quantile(100 * found.residual.sel(move=move, strategy=list(NAMES)), [0.5, 0.95, 1.0], axis=1).T
        rows = [(name, *(f"{value:.2f}" for value in row)) for name, row in zip(NAMES, values, strict=True)]
        lines += ["", *table((f"residual of move {move} (% of move)", "median", "95 % quantile", "largest"), rows)]
    lines += ["", *wild(strategies), "", f"jshape {version('jshape')}, jax {jax.__version__}, {SCHEDULES} schedules."]
    command = "python -m experiments.adaptive.recovery"
    write_beside(__file__, "Recovery from a load that changes", command, [*explained(__doc__), *lines])


def wild(strategies: dict[str, js.adaptive.AbstractStrategy]) -> list[str]:
    """Residuals while a signal goes wild, from 3 to 63 s of a run with 20 coins whose shapers begin at 9 rad/s."""
    schedule = js.adaptive.square_wave(np.radians(30), 20.0, 100.0, [(0.0, 20.0)], TIME)
    link = js.adaptive.SampledLink(js.plants.FlexibleLink(), schedule.loads, TIME)

    @jax.jit
    def residuals(faults: js.adaptive.Faults) -> dict[str, jax.Array]:
        traces = js.adaptive.run(link, strategies, schedule.reference, schedule.which, faults=faults)
        return {name: metrics.residual(trace, schedule) for name, trace in traces.items()}

    bounds = []
    for name in NAMES[3:]:
        aware = strategies[name]
        assert isinstance(aware, js.adaptive.StateAware)
        bounds.append(f"{100 * aware.bound(5.7, 0.017):.0f} % ({name})")
    lines = [
        "Wild signals: largest residual of moves 2 to 6, during the fault, and of the last, after it (% of move). "
        f"Stated bounds, of what a bare step leaves: {', '.join(bounds)}.",
        "",
    ]
    rows = []
    for kind in KINDS:
        left = residuals(js.adaptive.wild(kind, len(schedule.reference), TIME, begin=3.0, end=63.0))
        rows.append((kind, *(f"{100 * left[n][1:6].max():.2f} / {100 * left[n][-1]:.2f}" for n in NAMES)))
    return lines + table(("", *NAMES), rows)


if __name__ == "__main__":
    main()
