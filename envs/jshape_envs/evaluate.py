"""Scores of a policy: the cost of its moves, its recovery from a change of payload, its regret against the oracle.

    scores = evaluate(policy, params, episodes=64, seeds=5)
    interval(scores.regret)                # interquartile mean over the seeds, with its 95 % interval

A seed is a set of episodes of its own, the same for every policy: payloads, moves and changes do not depend on what a
policy does (but where the plant diverges, which ends the episode).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key
from scipy import stats

from jshape import _check
from jshape.moves import AbstractPolicy, Choice, EnvState, Info, Observation, Params, observation_names, rollout
from jshape_envs.baselines import baseline
from jshape_envs.families import as_in
from jshape_envs.parameters import parameters
from jshape_envs.policy import GRUPolicy, read_policy

LIMIT = 0.05
"""The normalised residual energy under which a machine has recovered from a change."""
WITHIN = 2
"""Moves within which it should have."""
FIRST_SEED = 1_000_000
"""Far from the seeds of trainings."""
NUMBERS = 40
"""Of a move that are kept until all of them are made."""
LONGEST = 16
"""Number of moves after which an unfinished recovery counts, as so many and one more."""


class Scores(NamedTuple):
    """Means over all moves, and over all changes of the payload, an entry a seed. NaN where nothing changed.

    Attributes:
        reward: of a move.
        residual: normalised residual energy of a move.
        move_time: of the shaped command, s.
        regret: cost of a move beyond the oracle's.
        lost: fraction of moves in which the plant diverged.
        recovery: moves after a change until one leaves less than 5 % (1: the first one with the new payload does).
        recovered: fraction of changes in which one of the first two moves does.
    """

    reward: np.ndarray
    residual: np.ndarray
    move_time: np.ndarray
    regret: np.ndarray
    lost: np.ndarray
    recovery: np.ndarray
    recovered: np.ndarray


class Interval(NamedTuple):
    """An interquartile mean with its 95 % confidence interval.

    Attributes:
        middle: the mean.
        low: the interval's lower end.
        high: its upper end.
    """

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
    """The scores of a policy over several sets of episodes.

    Args:
        policy: one for all seeds, or one for each (that were trained with different seeds).
        params: the environment; its horizon is the length of an episode.
        episodes: number of episodes a set.
        seeds: number of sets.
        seed: of the first set; the others follow.

    Raises:
        ValueError: for counts that are not positive, or policies that are not one for each seed.
    """
    episodes, seeds = _check.count(episodes, "episodes"), _check.count(seeds, "seeds")
    moves = int(params.horizon)
    _check.memory(NUMBERS * seeds * episodes * moves, "seeds, with their episodes and moves,")
    keys = jnp.stack([jax.random.split(jax.random.key(seed + i), episodes) for i in range(seeds)])
    if isinstance(policy, AbstractPolicy):
        rewards, info = _rollouts(keys.reshape(-1), policy, params, moves)
    else:
        if len(policy) != seeds:
            raise ValueError(f"policy must be one, or one for each of {seeds} seeds, not {len(policy)}")
        found = [_rollouts(keys[i], one, params, moves) for i, one in enumerate(policy)]
        rewards, info = jax.tree.map(lambda *x: jnp.concatenate(x), *found)

    def split(x: Array) -> np.ndarray:
        return np.asarray(x, float).reshape(seeds, episodes, moves)

    def mean(x: Array) -> np.ndarray:
        return split(x).mean(axis=(1, 2))

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
    keys: Key[Array, " episodes"], policy: AbstractPolicy, params: Params, moves: int
) -> tuple[Float[Array, "episodes moves"], Info]:
    return jax.vmap(lambda key: rollout(key, policy, params, moves))(keys)


def episode_costs(
    keys: Key[Array, " episodes"], policy: AbstractPolicy, params: Params
) -> tuple[np.ndarray, np.ndarray]:
    """The mean cost of a move and its mean regret, an entry for the key of each episode.

    The same keys make the same payloads and moves for every policy, so that policies can be compared by episodes.
    """
    rewards, info = _rollouts(keys, policy, params, int(params.horizon))
    return -np.asarray(rewards, float).mean(axis=1), np.asarray(info.evaluation.regret, float).mean(axis=1)


def recovery_times(
    residual: Float[np.ndarray, "episodes moves"], age: np.ndarray, changed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The moves after every change until one leaves less than 5 %, and whether that was observed.

    Where the payload changes again, or the episode ends, before the machine has recovered, the time is censored.

    Args:
        residual: normalised residual energies.
        age: number of moves made before with this payload, episodes × moves.
        changed: whether it was the first with a new one, episodes × moves.
    """
    times, observed = [], []
    for row, ages, firsts in zip(residual, age, changed, strict=True):
        starts = np.flatnonzero(ages == 0)
        for start, end in zip(starts, [*starts[1:], len(row)], strict=True):
            if firsts[start]:
                below = np.flatnonzero(row[start:end] < LIMIT)
                times.append(below[0] + 1 if len(below) else end - start)
                observed.append(len(below) > 0)
    return np.array(times, int), np.array(observed, bool)


def survival(times: np.ndarray, observed: np.ndarray) -> Float[np.ndarray, " moves"]:
    """The fraction of changes that are not recovered after 1, 2, … moves; NaN where there are no changes.

    Args:
        times: of recovery, moves.
        observed: whether the recovery was observed; else the time is censored.

    Source: Kaplan and Meier (1958), as SciPy computes it.
    """
    moves = np.arange(1, LONGEST + 1)
    if not len(times):
        return np.full(len(moves), np.nan)
    if not observed.any():
        return np.ones(len(moves))
    data = stats.CensoredData(uncensored=times[observed], right=times[~observed])
    return np.asarray(stats.ecdf(data).sf.evaluate(moves))


def mean_recovery(times: np.ndarray, observed: np.ndarray) -> float:
    """The mean number of moves until recovered, 17 for a change that is not after 16; see ``survival``."""
    return float(1 + survival(times, observed).sum())


def interquartile_mean(values: np.ndarray, axis: int = -1) -> Any:
    """The mean of the middle half of the values."""
    return stats.trim_mean(values, 0.25, axis=axis)


def interval(values: np.ndarray) -> Interval:
    """The interquartile mean over the seeds, with its 95 % interval by the percentile bootstrap.

    Raises:
        ValueError: for no values.

    Source: Agarwal, Schwarzer, Castro, Courville and Bellemare (2021).
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
    """A policy on an environment with other params than those it was trained with.

    Its actions mean what they meant there, and distances and payloads come to it in the same units. Both environments
    must have the same sensor and observe the same, but for the last action.

    Attributes:
        policy: the trained one.
        home: the environment that it was trained on.
    """

    policy: GRUPolicy
    home: Params

    def init(self, params: Params) -> Any:
        return self.policy.init(self.home), jnp.zeros(self.home.action.size, self.home.period.dtype)

    def act(self, memory: Any, observation: Observation, params: Params, state: EnvState) -> Choice:
        # The shaper is none of this environment's actions: what the policy did last, it observes from its memory.
        (memory, last), place = memory, params.sensor.size
        scaled = as_in(self.home, observation, params)
        parts = scaled[:place], last.astype(observation.dtype), scaled[place + params.action.size :]
        scaled = jnp.concatenate(parts)
        memory, action = self.policy.act(memory, scaled, self.home, state)
        return (memory, action), self.home.action.shaper(action)


def named_policy(name: str, params: Params) -> AbstractPolicy:
    """A baseline by its name, or a trained policy from its file (a name that ends in ``.npz``), ``Transferred``.

    Raises:
        ValueError: as ``baselines.baseline`` and ``load_policy``, and for a policy of another sensor or other
            observations.
    """
    if not name.endswith(".npz"):
        return baseline(name, params)
    policy, about = read_policy(Path(name))
    try:
        home = parameters(about["environment"], about["preset"], context=about["context"], action=about["action"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{name}: does not say which environment it is for ({error})") from None
    if not _alike(home, params):
        raise ValueError(
            f"{name}: is for {about['environment']}, payload {about['context']}; this environment observes otherwise"
        )
    return Transferred(policy, home)


def _alike(home: Params, params: Params) -> bool:
    """Whether observations mean the same in both environments, but for the last action and the ranges."""

    def observed(params: Params) -> list[str]:
        return [name for name in observation_names(params) if not name.startswith("last action")]

    def sensor(params: Params) -> tuple[float, float]:
        return float(params.sensor.reach), float(params.sensor.window)

    return observed(home) == observed(params) and np.allclose(sensor(home), sensor(params))
