"""``jshape train``: a policy that adapts to a payload which nobody tells about, trained through the physics."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jshape.cli._shared import explained, need_environments, prepare_jax, progress

if TYPE_CHECKING:
    from jshape_envs.apg import History


def train(
    environment: Annotated[
        str, typer.Argument(help="DuffingPayload, CranePayload, FlexibleLinkPayload, HoistingCrane.")
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; NAME-policy unless given.")] = None,
    preset: Annotated[str, typer.Option(help="easy, paper, hard or out-of-distribution.")] = "paper",
    context: Annotated[str, typer.Option(help="Is the payload hidden, observed or noisy?")] = "hidden",
    action: Annotated[str, typer.Option(help="How a shaper is written: modal, impulses or residual.")] = "modal",
    moves: Annotated[int, typer.Option(help="To train with, in all environments together.")] = 100_000,
    environments: Annotated[int, typer.Option(help="Environments that move together.")] = 16,
    window: Annotated[int, typer.Option(help="Moves between two updates.")] = 8,
    rate: Annotated[float, typer.Option(help="Learning rate at first.")] = 1e-2,
    hidden: Annotated[int, typer.Option(help="Size of the policy's memory.")] = 48,
    seed: Annotated[int, typer.Option(help="Of weights, payloads and noise.")] = 0,
) -> None:
    """Train a policy by analytic gradients. After Ctrl-C the same command goes on from the checkpoint in its folder."""
    with explained():
        need_environments()
        prepare_jax()
        from jshape_envs.apg import Recipe
        from jshape_envs.apg import train as trained_by
        from jshape_envs.evaluate import evaluate
        from jshape_envs.parameters import parameters
        from jshape_envs.policy import save_policy

        from jshape._files import MARKER, check_writable
        from jshape.status import Status

        folder = out or Path(f"{environment}-policy")
        check_writable(folder)
        chosen = dict(environment=environment, preset=preset, context=context, action=action)
        params = parameters(environment, preset, context=context, action=action)
        recipe = Recipe(moves, environments, window, rate, hidden=hidden, seed=seed)
        folder.mkdir(parents=True, exist_ok=True)
        write = lambda record: (folder / "results.json").write_text(
            json.dumps({"format": MARKER, **chosen, **record}, indent=2) + "\n", encoding="utf-8"
        )
        checkpoint = folder / "checkpoint.npz"
        if not checkpoint.exists():
            write({"ended": False})
        with progress() as (step, tell):
            step("the program is compiled")
            try:
                found = trained_by(
                    params,
                    recipe,
                    checkpoint=checkpoint,
                    # Without a best value, which the line would show in J.
                    progress=lambda stage, done, total, best: tell(stage, done, total, float("inf")),
                )
            except KeyboardInterrupt:
                typer.echo(f"what is learned lies in {checkpoint}; the same command goes on from there", err=True)
                raise
            if found.status is Status.DIVERGED:
                raise ValueError(f"training diverged: {found.message}")
            step("the policy is judged")
            scores = evaluate(found.policy, params, episodes=64, seeds=1, seed=1_000_000)
        figures = {name: float(value[0]) for name, value in scores._asdict().items()}
        save_policy(
            found.policy, folder / "policy.npz", {**chosen, "moves": recipe.updates * recipe.batch, "seed": seed}
        )
        write_history(found.history, folder)
        write({"ended": True, "moves": recipe.updates * recipe.batch, "seed": seed, "scores": figures})
        typer.echo(
            f"mean reward {figures['reward']:.4f}, regret against the oracle {figures['regret']:.4f}, "
            f"residual {100 * figures['residual']:.2f} %, under 5 % within two moves after "
            f"{100 * figures['recovered']:.0f} % of the changes"
        )
        typer.echo(f"results in {folder}: policy.npz, history.csv, learning.png, learning.pdf, results.json")


def write_history(history: "History", folder: Path) -> None:
    """The learning curve as CSV and as a figure."""
    import matplotlib.pyplot as plt
    import numpy as np

    from jshape.reports.plot import COLOURS, STYLE, WIDTH, save

    columns: dict[str, Any] = history._asdict()
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(folder / "history.csv", rows, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    # The mean of the last few updates tells more than each one's own, which depends on the payloads drawn.
    few = max(1, min(20, len(rows) // 5))
    total = np.cumsum(np.concatenate([[0.0], history.reward]))
    smooth = (total[few:] - total[:-few]) / few
    with plt.style.context(STYLE):
        drawn, axes = plt.subplots(figsize=(WIDTH, 0.7 * WIDTH))
        axes.plot(history.moves, history.reward, color=COLOURS[0], alpha=0.25, linewidth=0.6)
        axes.plot(history.moves[few - 1 :], smooth, color=COLOURS[0], label=f"mean of {few} updates")
        axes.plot(
            history.moves[few - 1 :],
            smooth + np.convolve(history.regret, np.ones(few) / few, "valid"),
            color="0.3",
            linestyle="--",
            label="oracle",
        )
        axes.set_xlabel("moves")
        axes.set_ylabel("mean reward of a move")
        axes.legend()
        save(drawn, folder / "learning.png")
