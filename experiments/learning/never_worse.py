"""The guarded policies beside the best fixed shapers, on every preset and under families of shift: never_worse.md.

    python -m experiments.learning.never_worse declared       # presets and declared families
    python -m experiments.learning.never_worse held-out       # the held-out families, once at the end

Names of environments after that: only theirs. Fixed shapers, the bank of models and the guard know the declared
environment alone. What is done is kept in never_worse.json: interrupted, it goes on from there.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from jshape_envs import ENVIRONMENTS, AbstractPolicy, Params, parameters  # noqa: E402
from jshape_envs.baselines import baseline  # noqa: E402
from jshape_envs.evaluate import episode_costs, named_policy  # noqa: E402
from jshape_envs.families import DECLARED, HELD_OUT, Declared  # noqa: E402
from jshape_envs.guard import COUNTED, calibrated, guarded  # noqa: E402
from jshape_envs.policy import policy_file  # noqa: E402

from experiments.learning.record import keep, read  # noqa: E402
from experiments.markdown import table  # noqa: E402

HERE = Path(__file__).parent
RECORD = HERE / "never_worse.json"
EPISODES = {"DuffingPayload": 32, "CranePayload": 20, "FlexibleLinkPayload": 64, "HoistingCrane": 20}
"""A row. Fewer where a move takes longer to compute."""
CALIBRATED = 40
"""Episodes of each family in a calibration, at least: of so many one may cost more than with the fallback."""
FIRST_SEED = 3_000_000
CLASSICAL = ("best-energy", "best-fixed", "model-bank")
FIXED = CLASSICAL[:2]

HEAD = """# Never worse

Written by `python -m experiments.learning.never_worse declared` and `… held-out`: episodes of 64 moves, the same for
every policy: {episodes}.
*Cost beyond the oracle's* (regret) in thousandths a move, mean over the episodes. *Pays more*: episodes in which the
guarded policy costs more than the better of the two fixed shapers (`best-energy`, `best-fixed`: the one of least mean
cost in that row); *worst*: by how much, in thousandths a move, in the worst of them. Every policy knows the declared
environment alone; in a family of shift the true one differs. `trained` is the same policy without a guard. The
first debt (`jshape_envs.guard.Guard`) is calibrated on the declared families of `paper`, on other episodes; where it is
infinite no debt of the list was enough in every family, and the fallback acts alone. The held-out families were run
once, after the guard was final. Of the declared ones some were held out until an earlier guard cost more than the
better fixed shaper in more than a tenth of their episodes: `undamped` (78 % on DuffingPayload: the bank knew more
damping but not less), `hardly-damped` (28 % there: the samples did not correct the state), and `softer`, `worn` and
`spiky` (16, 13 and 16 % on FlexibleLinkPayload: a bank too coarse in stiffness, and spikes that counted as vibration).
"""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("which", choices=("declared", "held-out"))
    parser.add_argument("names", nargs="*", default=list(ENVIRONMENTS))
    chosen = parser.parse_args()
    shifts = DECLARED if chosen.which == "declared" else HELD_OUT
    for name in chosen.names:
        # The calibration comes first, and is on "paper".
        others = [preset for preset in ENVIRONMENTS[name].presets if preset != "paper"]
        for preset in ("paper", *(others if chosen.which == "declared" else ())):
            wanted = [family for family in shifts if preset == "paper" or family == "none"]
            if rest := [family for family in wanted if f"{name} {preset} {family}" not in read(RECORD)]:
                judge(name, preset, {family: shifts[family] for family in rest})
            # Too many programs would not fit into the system's table of memory maps.
            jax.clear_caches()
            (HERE / "never_worse.md").write_text(report(read(RECORD)), encoding="utf-8")


def contenders(name: str, params: Params) -> dict[str, AbstractPolicy]:
    """The classical strategies, the trained policy and the guarded one, by their names."""
    trained = named_policy(str(policy_file(name)), params)
    found = {each: baseline(each, params) for each in CLASSICAL}
    debt = read(RECORD).get(f"{name} debt", 0.0)
    guard = guarded(params, trained, found["best-energy"], debt, found["best-fixed"])
    if f"{name} debt" not in read(RECORD):
        guard = calibrated(guard, params, DECLARED, episodes=max(CALIBRATED, EPISODES[name]))
        keep(RECORD, f"{name} debt", float(guard.debt))
        print(f"{name}: first debt {float(guard.debt)}", flush=True)
    return found | {"trained": trained, "guarded": guard}


def judge(name: str, preset: str, shifts: dict[str, Any]) -> None:
    """Keep a row for every family."""
    params = parameters(name, preset)
    policies = contenders(name, params)
    keys = jax.random.split(jax.random.key(FIRST_SEED), EPISODES[name])
    for family, shift in shifts.items():
        begin, true = time.process_time(), shift(params)
        costs = {each: episode_costs(keys, Declared(policy, params), true) for each, policy in policies.items()}
        keep(RECORD, f"{name} {preset} {family}", row_of(costs))
        print(
            f"{name} {preset} {family}: {time.process_time() - begin:.0f} s", read(RECORD)[f"{name} {preset} {family}"]
        )


def row_of(costs: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, Any]:
    """Mean regrets, and how the guarded policy compares with the better fixed shaper, episode by episode.

    Args:
        costs: mean cost of a move and mean regret, an entry an episode, by the policies' names.
    """
    fixed = min(FIXED, key=lambda each: costs[each][0].mean())
    beyond = {each: costs[each][0] - costs[fixed][0] for each in ("guarded", "trained")}
    return {
        "regret": {each: round(float(1e3 * regret.mean()), 3) for each, (_, regret) in costs.items()},
        "fixed": fixed,
        "more": {each: float(np.mean(excess > COUNTED)) for each, excess in beyond.items()},
        "worst": {each: round(float(1e3 * excess.max()), 2) for each, excess in beyond.items()},
    }


def report(record: dict[str, Any]) -> str:
    """The whole page: the calibration, then a table of presets and declared families and one of held-out families."""
    lines = [HEAD.format(episodes=", ".join(f"{count} a row on {name}" for name, count in EPISODES.items()))]
    debts = {key.split()[0]: row for key, row in record.items() if key.endswith(" debt")}
    lines += ["## Calibration\n", *table(["environment", "first debt"], debts.items())]
    for title, chosen in (("Presets and declared families", DECLARED), ("Held-out families", HELD_OUT)):
        rows = {key: row for key, row in record.items() if key.split()[-1] in chosen}
        lines += [f"\n## {title}\n", *table(HEADINGS, [cells(key, row) for key, row in rows.items()]), verdict(rows)]
    return "\n".join(lines) + "\n"


HEADINGS = ("environment, preset, family", *CLASSICAL, "trained", "guarded")
HEADINGS += ("gain kept (%)", "pays more (%)", "worst", "unguarded pays more (%)")


def cells(key: str, row: dict[str, Any]) -> list[str]:
    """A line of the table."""
    regrets = [f"{row['regret'][each]:.2f}" for each in (*CLASSICAL, "trained", "guarded")]
    kept, more = gain_kept(row), [f"{100 * row['more'][each]:.1f}" for each in ("guarded", "trained")]
    return [
        key,
        *regrets,
        "–" if kept is None else f"{100 * kept:.0f}",
        more[0],
        f"{row['worst']['guarded']:.1f}",
        more[1],
    ]


def gain_kept(row: dict[str, Any]) -> float | None:
    """The guarded policy's gain over the better fixed shaper, over the unguarded one's; none where that has no gain."""
    fixed, trained, guarded_one = (row["regret"][each] for each in (row["fixed"], "trained", "guarded"))
    return (fixed - guarded_one) / (fixed - trained) if trained < fixed else None


def verdict(rows: dict[str, Any]) -> str:
    """The figures that miss the goals."""
    if not rows:
        return ""
    shares = [row["more"]["guarded"] for row in rows.values()]
    overall = np.average(shares, weights=[EPISODES[key.split()[0]] for key in rows])
    many = {key: row["more"]["guarded"] for key, row in rows.items() if row["more"]["guarded"] > 0.1}
    best = {key: min(CLASSICAL, key=row["regret"].get) for key, row in rows.items()}
    behind = {key: row for key, row in rows.items() if row["regret"]["guarded"] > row["regret"][best[key]]}
    words = [f"\nThe guarded policy costs more than the better fixed shaper in {100 * overall:.1f} % of all episodes."]
    words += [f"More than 10 %: {key}, {100 * share:.1f} %." for key, share in many.items()]
    for key, row in behind.items():
        figures = f"{row['regret']['guarded']:.2f} beside {row['regret'][best[key]]:.2f} of `{best[key]}`"
        words.append(f"Not below the best of the classical strategies above: {key}, {figures}.")
    return "\n".join(words)


if __name__ == "__main__":
    main()
