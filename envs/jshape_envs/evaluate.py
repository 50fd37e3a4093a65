"""How good a policy is: what its moves cost, how soon it recovers from a change, what it pays beyond the oracle.

    scores = evaluate(policy, params, episodes=64, seeds=5)
    interval(scores.regret)                # interquartile mean over the seeds, with its 95 % interval

A seed is a set of episodes of its own, the same for every policy: payloads, moves and changes do not depend on what a
policy does (but where it loses a payload, and the episode with it).
"""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from scipy import stats

from jshape import _check
from jshape_envs.baselines import baseline
from jshape_envs.core import EnvState, Info, Params
from jshape_envs.parameters import parameters
from jshape_envs.policy import AbstractPolicy, load_policy, rollout

LIMIT = 0.05
"""The normalised residual energy under which a machine has recovered from a change."""
WITHIN = 2
"""Moves within which it should have."""
FIRST_SEED = 1_000_000
"""Far from the seeds that anybody trains with."""
LONGEST = 16
"""Moves after which nobody waits any longer: a payload that is never recovered counts as so many and one more."""


class Scores(NamedTuple):
    """Of each seed: means over all moves, and over all changes of the payload.

    ``reward``; ``residual``: normalised residual energy; ``move_time``: of the shaped command, s; ``regret``: cost
    beyond the oracle's; ``lost``: fraction of moves that lost the payload. Of changes: ``recovery``: moves until one
    leaves less than 5 % (1: the first one with the new payload does); ``recovered``: fraction in which one of the first
    two moves does. NaN where nothing changed.
    """

    reward: np.ndarray
    residual: np.ndarray
    move_time: np.ndarray
    regret: np.ndarray
    lost: np.ndarray
    recovery: np.ndarray
    recovered: np.ndarray


class Interval(NamedTuple):
    """``middle``: interquartile mean; ``low``, ``high``: of its 95 % confidence interval."""

    middle: float
    low: float
    high: float


def evaluate(
    policy: AbstractPolicy | Sequence[AbstractPolicy],
    params: Params,
    episodes: int = 64,
    seeds: int = 5,
    seed: int = FIRST_SEED,
) -> Scores:
    """The scores of a policy over ``seeds`` sets of so many episodes, each of the params' horizon.

    ``policy``: one for all seeds, or one for each (that were trained with different seeds). ``seed``: of the first set,
    the others follow.

    *Raises* ``ValueError`` for counts that are not positive, or policies that are not one for each seed.
    """
    episodes, seeds = _check.count(episodes, "episodes"), _check.count(seeds, "seeds")
    moves = int(params.horizon)
    keys = jnp.stack([jax.random.split(jax.random.key(seed + i), episodes) for i in range(seeds)])
    if isinstance(policy, AbstractPolicy):
        rewards, info = _rollouts(keys.reshape(-1), policy, params, moves)
    else:
        if len(policy) != seeds:
            raise ValueError(f"policy must be one, or one for each of {seeds} seeds, not {len(policy)}")
        found = [_rollouts(keys[i], one, params, moves) for i, one in enumerate(policy)]
        rewards, info = jax.tree.map(lambda *x: jnp.concatenate(x), *found)
    split = lambda x: np.asarray(x, float).reshape(seeds, episodes, moves)
    mean = lambda x: split(x).mean(axis=(1, 2))
    age = split(info.evaluation.since_change).astype(int)
    changed, residual = split(info.evaluation.changed).astype(bool), split(info.residual)
    waits = [recovery_times(*rows) for rows in zip(residual, age, changed, strict=True)]
    return Scores(
        reward=mean(rewards),
        residual=residual.mean(axis=(1, 2)),
        move_time=mean(info.move_time),
        regret=mean(info.evaluation.regret),
        lost=mean(info.lost),
        recovery=np.array([mean_recovery(*wait) for wait in waits]),
        recovered=np.array([1 - survival(*wait)[WITHIN - 1] for wait in waits]),
    )


@eqx.filter_jit
def _rollouts(
    keys: PRNGKeyArray, policy: AbstractPolicy, params: Params, moves: int
) -> tuple[Float[Array, "episodes moves"], Info]:
    return jax.vmap(lambda key: rollout(key, policy, params, moves))(keys)


def recovery_times(
    residual: Float[np.ndarray, "episodes moves"], age: np.ndarray, changed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of every change: moves until one leaves less than 5 %, and whether that was seen at all.

    ``age``: moves made before with this payload; ``changed``: whether it was the first with a new one. Where the
    payload changes again, or the episode ends, before the machine has recovered, it is known only that it took longer.
    """
    times, seen = [], []
    for row, ages, firsts in zip(residual, age, changed, strict=True):
        starts = np.flatnonzero(ages == 0)
        for start, end in zip(starts, [*starts[1:], len(row)], strict=True):
            if firsts[start]:
                below = np.flatnonzero(row[start:end] < LIMIT)
                times.append(below[0] + 1 if len(below) else end - start)
                seen.append(len(below) > 0)
    return np.array(times, int), np.array(seen, bool)


def survival(times: np.ndarray, seen: np.ndarray) -> Float[np.ndarray, " moves"]:
    """The fraction of changes that are not recovered after 1, 2, … moves, from times some of which were cut short.

    *Source*: Kaplan and Meier (1958), as SciPy computes it. NaN where there are no changes.
    """
    moves = np.arange(1, LONGEST + 1)
    if not len(times):
        return np.full(len(moves), np.nan)
    if not seen.any():
        return np.ones(len(moves))
    data = stats.CensoredData(uncensored=times[seen], right=times[~seen])
    return np.asarray(stats.ecdf(data).sf.evaluate(moves))


def mean_recovery(times: np.ndarray, seen: np.ndarray) -> float:
    """Mean moves until recovered; 17 for a payload that is not after 16."""
    return float(1 + survival(times, seen).sum())


def interquartile_mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """The mean of the middle half."""
    return stats.trim_mean(values, 0.25, axis=axis)


def interval(values: np.ndarray) -> Interval:
    """Interquartile mean over the seeds, with its 95 % interval by the percentile bootstrap.

    *Raises* ``ValueError`` for no values. *Source*: Agarwal, Schwarzer, Castro, Courville and Bellemare (2021).
    """
    values = np.asarray(values, float)
    if values.ndim != 1 or not len(values):
        raise ValueError(f"values must be a list of at least one number, not of shape {values.shape}")
    middle = float(interquartile_mean(values))
    if len(values) == 1 or not np.all(np.isfinite(values)):
        return Interval(middle, float("nan"), float("nan"))
    found = stats.bootstrap(
        (values,), interquartile_mean, n_resamples=9999, method="percentile", rng=np.random.default_rng(0)
    ).confidence_interval
    return Interval(middle, float(found.low), float(found.high))


def summary(scores: Scores) -> dict[str, Interval]:
    """The interval of every score, by its name."""
    return {name: interval(values) for name, values in scores._asdict().items()}


class Transferred(AbstractPolicy):
    """A policy on an environment with other params than its own (``home``): its actions mean what they meant there, and
    distances come to it in the unit that it knows.

    Both environments must have the same sensor and as many entries in an action.
    """

    policy: AbstractPolicy
    home: Params

    def start(self, params: Params) -> Any:
        return self.policy.start(self.home)

    def choose(self, memory: Any, observation: Observation, params: Params, state: EnvState) -> Choice:
        place = params.sensor.size + params.action.size
        known = observation.at[place].multiply(params.distance[1] / self.home.distance[1])
        return self.policy.choose(memory, known, self.home, state)


def named_policy(name: str, params: Params) -> AbstractPolicy:
    """A baseline by its name, or a trained policy from its file (a name that ends in ``.npz``), which acts as on the
    environment that it was trained on.

    *Raises* ``ValueError`` as ``baselines.baseline`` and ``load_policy``.
    """
    if not name.endswith(".npz"):
        return baseline(name, params)
    policy = load_policy(name)
    with np.load(name) as stored:
        about = json.loads(str(stored["header"]))["about"]
    home = parameters(about["environment"], about["preset"], context=about["context"], action=about["action"])
    return Transferred(policy, home)
