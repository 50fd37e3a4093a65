"""Every strategy of every environment on every preset, hidden payload: leaderboard.md beside it.

    python -m experiments.learning.leaderboard                                     # an hour or two on two cores
    python -m experiments.learning.leaderboard DuffingPayload --only guarded       # one environment, one strategy

What is done is kept in leaderboard.json: interrupted, it goes on from there; ``--again NAME`` judges a policy anew
(``trained``: the shipped ones). A policy that was trained on ``paper`` is judged on every preset as it is.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

from jshape_envs import ENVIRONMENTS, parameters  # noqa: E402
from jshape_envs.evaluate import evaluate, summary  # noqa: E402
from jshape_envs.strategies import strategies, strategy  # noqa: E402

from experiments.learning.record import keep, read  # noqa: E402
from experiments.markdown import table  # noqa: E402
from jshape.cli.evaluate import COLUMNS  # noqa: E402

HERE = Path(__file__).parent
RECORD = HERE / "leaderboard.json"
EPISODES, SEEDS = 64, 5

HEAD = """# Leaderboard

Written by `python -m experiments.learning.leaderboard`: hidden payload, {episodes} episodes of 64 moves for each of
{seeds} seeds, the same for every policy. Interquartile means over the seeds, 95 % intervals (bootstrap) in brackets.
*Residual*: energy left over the greatest of the bare move; *recovered*: moves until one leaves less than 5 % after the
payload has changed, and the changes in which one of the first two does; *regret*: cost of a move beyond the oracle's
from rest. The oracle itself pays some, because what one move leaves the next begins with; the full oracle sees that.
The rows of `guarded` are an earlier guard's, whose bank was coarser (`never_worse.md` has the present one's). Trainers
of others are judged by their learning curves, PPO with ten times the moves, SAC with as many: `learning.md`.
"""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=list(ENVIRONMENTS))
    parser.add_argument("--again", action="append", default=[])
    parser.add_argument("--only", action="append", default=[])
    chosen = parser.parse_args()
    for name in chosen.names:
        for preset in ENVIRONMENTS[name].presets:
            judge(name, preset, chosen.again, chosen.only)
            # Too many programs would not fit into the system's table of memory maps.
            jax.clear_caches()
            (HERE / "leaderboard.md").write_text(report(read(RECORD)), encoding="utf-8")


def judge(name: str, preset: str, again: list[str], only: list[str]) -> None:
    params = parameters(name, preset)
    for policy in only or strategies(name, params):
        if policy in read(RECORD).get(f"{name} {preset}", {}) and policy not in again:
            continue
        begin = time.process_time()
        made = strategy(policy, name, params)
        row = {key: list(value) for key, value in summary(evaluate(made, params, EPISODES, SEEDS)).items()}
        rows = read(RECORD).get(f"{name} {preset}", {})
        keep(RECORD, f"{name} {preset}", rows | {policy: row})
        print(
            f"{name} {preset} {policy}: regret {row['regret'][0]:.4f}, {time.process_time() - begin:.0f} s", flush=True
        )


def report(record: dict[str, Any]) -> str:
    """The whole page: a table for each environment and preset, the least regret at the top."""
    head = ["policy", *(title.replace("\n", " ") for title, _ in COLUMNS.values())]
    parts = [HEAD.format(episodes=EPISODES, seeds=SEEDS)]
    for where, rows in record.items():
        ordered = sorted(rows.items(), key=lambda item: item[1]["regret"][0])
        scores = [[cell(row[name], factor) for name, (_, factor) in COLUMNS.items()] for _, row in ordered]
        lines = table(head, [(policy, *cells) for (policy, _), cells in zip(ordered, scores, strict=True)])
        parts += [f"\n## {where}\n", *lines, verdict(rows)]
    if rest := missing(record):
        parts += ["", "## Not run yet", "", *table(["environment and preset", "policies"], rest)]
    return "\n".join(parts) + "\n"


def missing(record: dict[str, Any]) -> list[list[str]]:
    """The environments and presets on which policies have not been run, and which."""
    found = []
    for name, environment in ENVIRONMENTS.items():
        wanted = strategies(name, parameters(name))
        for preset in environment.presets:
            rest = [policy for policy in wanted if policy not in record.get(f"{name} {preset}", {})]
            shown = "all" if len(rest) == len(wanted) else ", ".join(rest)
            found += [[f"{name} {preset}", shown]] if rest else []
    return found


def verdict(rows: dict[str, Any]) -> str:
    """Whether the trained policy beats every baseline, by intervals that do not overlap."""
    if "trained" not in rows:
        return ""
    apart = ("trained", "guarded", "oracle", "full-oracle")
    others = {policy: row["regret"] for policy, row in rows.items() if policy not in apart}
    trained, best = rows["trained"]["regret"], min(others, key=lambda policy: others[policy][0])
    words = "as good as" if trained[1] <= others[best][2] and others[best][1] <= trained[2] else "worse than"
    words = "better than" if trained[2] < others[best][1] else words
    ratio = trained[0] / rows["i-d-e"]["regret"][0]
    return (
        f"\nThe trained policy is {words} the best baseline, `{best}`; its regret is {ratio:.2f} times that of I-D-E."
    )


def cell(values: list[float], factor: float) -> str:
    middle, low, high = (f"{factor * x:.2f}" for x in values)
    return f"{middle} ({low} … {high})"


if __name__ == "__main__":
    main()
