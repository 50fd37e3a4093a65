"""``jshape train``: a policy that adapts to a hidden payload, trained through the physics."""

import math
from pathlib import Path
from typing import Annotated

import typer

from jshape.cli import _shared
from jshape.cli._shared import explained, progress_line, results_folder, say


@explained()
def train(
    environment: _shared.Environment,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; NAME-policy unless given.")] = None,
    preset: _shared.Preset = "paper",
    context: _shared.Context = "hidden",
    action: Annotated[str, typer.Option(help="How a shaper is written: modal, impulses or residual.")] = "modal",
    moves: Annotated[int, typer.Option(help="To train with, in all environments together.")] = 100_000,
    environments: Annotated[int, typer.Option(help="Environments that move together.")] = 16,
    window: Annotated[int, typer.Option(help="Moves between two updates.")] = 8,
    learning_rate: Annotated[float, typer.Option(help="Learning rate at first.")] = 1e-2,
    hidden: Annotated[int, typer.Option(help="Size of the policy's memory.")] = 48,
    seed: Annotated[int, typer.Option(help="Of weights, payloads and noise.")] = 0,
) -> None:
    """Train a policy by analytic gradients. After Ctrl-C the same command resumes from the checkpoint in its folder."""
    _shared.need_environments()
    _shared.prepare_jax()
    import numpy as np
    from jshape_envs.apg import Recipe
    from jshape_envs.apg import train as trained_by
    from jshape_envs.evaluate import evaluate
    from jshape_envs.parameters import parameters
    from jshape_envs.policy import save_policy

    from jshape._files import whole, write_results
    from jshape.reports import plot
    from jshape.status import Status

    folder = results_folder(out, f"{environment}-policy", checkpoint="checkpoint.npz")
    chosen = dict(environment=environment, preset=preset, context=context, action=action)
    params = parameters(environment, preset, context=context, action=action)
    recipe = Recipe(moves, environments, window, learning_rate, hidden=hidden, seed=seed)
    checkpoint = folder / "checkpoint.npz"
    if not checkpoint.exists():
        write_results(folder, {**chosen, "ended": False})
    with progress_line() as (step, progress):
        step("the program is compiled")
        try:
            found = trained_by(
                params,
                recipe,
                checkpoint=checkpoint,
                # Without a best value, which the line would show in J.
                progress=lambda stage, done, total, best: progress(stage, done, total, math.inf),
            )
        except KeyboardInterrupt:
            # Before the first update there is nothing to keep.
            if checkpoint.exists():
                say(f"the training so far is in {checkpoint}; the same command resumes it", err=True)
            raise
        if found.status is Status.DIVERGED:
            raise ValueError(f"training diverged: {found.message}")
        step("the policy is judged")
        scores = evaluate(found.policy, params, episodes=64, seeds=1, seed=1_000_000)
    scores = {name: float(value[0]) for name, value in scores._asdict().items()}
    about = {**chosen, "moves": recipe.updates * recipe.batch, "seed": seed}
    save_policy(found.policy, folder / "policy.npz", about)
    columns = found.history._asdict()
    rows = np.stack(list(columns.values()), axis=1)
    with whole(folder / "history.csv") as file:
        np.savetxt(file, rows, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    write_results(folder, {**about, "ended": True, "scores": scores})
    plot.save(plot.learning(columns["moves"], columns["reward"], columns["regret"]), folder / "learning.png")
    say(
        f"mean reward {scores['reward']:.4f}, regret against the oracle {scores['regret']:.4f}, "
        f"residual {100 * scores['residual']:.2f} %, under 5 % within two moves after "
        f"{100 * scores['recovered']:.0f} % of the changes"
    )
    say(f"results in {folder}: policy.npz, history.csv, learning.png, learning.pdf, results.json")
    given = "" if (preset, context) == ("paper", "hidden") else f" --preset {preset} --context {context}"
    made = folder / "policy.npz"
    say(f"Next: jshape evaluate {environment}{given} --policy {made} --policy zvd --policy oracle")
    if not given:
        say(f"or watch it: jshape animate {environment} --policy {made}")
