"""Analytic policy gradients: a policy trained by the exact derivatives of its rewards, through the physics.

Many environments make a window of moves together; the derivative of what those moves cost, with respect to the
policy's weights, goes through each move's physics and through the policy's memory back to the window's beginning, where
it is cut off (truncated back-propagation through time). Memory, vibration and payload go on into the next window::

    params = jshape_envs.parameters("DuffingPayload")
    trained = train(params, Recipe(moves=100_000), checkpoint="duffing.ckpt.npz")     # goes on where it was stopped
    trained.policy, trained.history.reward

What one move leaves for the next (the vibration, and what the sensor measures of it) counts as given. Its derivatives
are exact, too, but they grow from move to move wherever a payload vibrates strongly, and such a window then outweighs
all others: trained with them, the same policies need more moves and end worse, or diverge.

Adam on the gradient clipped in norm; the learning rate falls along half a cosine.
"""

import dataclasses
import hashlib
import re
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt32

from jshape import _check
from jshape._files import read_arrays, write_arrays
from jshape._types import Progress
from jshape.moves import EnvState, Params, advance_policy, reset
from jshape.status import Result, Status
from jshape_envs.policy import GRUPolicy, named_arrays, sizes_of, with_arrays

FALL = 0.02
"""The last learning rate over the first."""

EVERY = 50
"""Number of updates between two checkpoints."""

FORMAT = "jshape-training 1"
"""Of the checkpoints."""


@dataclasses.dataclass(frozen=True)
class Recipe:
    """Settings of a training.

    Attributes:
        moves: in all environments together, rounded up to whole updates.
        environments: number of environments that move together.
        window: moves between two updates.
        learning_rate: of Adam, at first.
        clip: greatest norm of a gradient, in the unit of the costs.
        hidden: size of the policy's memory.
        seed: of weights, payloads and noise.

    Raises:
        ValueError: for counts below 1 and a learning rate or clip that is not positive.
    """

    moves: int = 100_000
    environments: int = 16
    window: int = 8
    learning_rate: float = 1e-2
    clip: float = 0.1
    hidden: int = 48
    seed: int = 0

    def __post_init__(self):
        for name in ("moves", "environments", "window", "hidden"):
            _check.count(getattr(self, name), name)
        _check.count(self.seed, "seed", least=0)
        _check.positive(self.learning_rate, "learning_rate")
        _check.positive(self.clip, "clip")

    @property
    def batch(self) -> int:
        """Number of moves an update."""
        return self.environments * self.window

    @property
    def updates(self) -> int:
        """Number of updates."""
        return -(-self.moves // self.batch)


class History(NamedTuple):
    """The course of a training, an entry an update, each measured before the policy changes.

    Attributes:
        moves: number of moves made until then.
        reward: mean of a move.
        regret: mean of a move.
        gradient: its norm.
    """

    moves: Int[np.ndarray, " updates"]
    reward: Float[np.ndarray, " updates"]
    regret: Float[np.ndarray, " updates"]
    gradient: Float[np.ndarray, " updates"]


@dataclasses.dataclass(frozen=True)
class Trained(Result):
    """A trained policy.

    Attributes:
        policy: after the last update.
        history: of the training.
        status: ``STOPPED`` when all moves are made, since nothing tests whether more would gain; ``DIVERGED`` where the
            rewards were no longer finite, with the policy before that.
        message: the same as a sentence.
    """

    policy: GRUPolicy
    history: History
    status: Status
    message: str


class Training(eqx.Module):
    """The state of a training between two updates: everything that the next one depends on.

    Attributes:
        policy: as it is.
        optimiser: its state.
        state: of the environments.
        observation: on which the policy acts next.
        memory: of the policy, in each environment.
        update: number of updates made.
        stream: the key of the random numbers of all updates.
    """

    policy: GRUPolicy
    optimiser: Any
    state: EnvState
    observation: Float[Array, "environments observation"]
    memory: Float[Array, "environments hidden"]
    update: Int[Array, ""]
    stream: UInt32[Array, " words"]


def train(
    params: Params,
    recipe: Recipe | None = None,
    *,
    checkpoint: str | Path | None = None,
    progress: Progress | None = None,
) -> Trained:
    """A policy trained for an environment by analytic gradients.

    Args:
        params: the environment.
        recipe: how to train.
        checkpoint: a file (npz) that keeps everything, written every ``EVERY`` updates, at the end, and when the
            training is interrupted (``KeyboardInterrupt``, which goes on to the caller). If it exists, training goes on
            from it and ends with the same bits as if it had never stopped.
        progress: called after each update; its ``best`` is the least mean cost of a move so far.

    Raises:
        ValueError: if the checkpoint is of another training.
    """
    recipe = Recipe() if recipe is None else recipe
    path = None if checkpoint is None else Path(checkpoint)
    # The seed is no part of the program: one is compiled for all seeds.
    program = dataclasses.replace(recipe, seed=0)
    digest = _digest(params, recipe)
    training, records = _begin(jax.random.key(recipe.seed), params, program), []
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            training, records = _load(path, training, digest)
    status = Status.STOPPED
    try:
        while len(records) < recipe.updates:
            following, record = _update(training, params, program)
            record = np.asarray(record, float)
            if not np.isfinite(record[0]):
                status = Status.DIVERGED
                break
            training, records = following, [*records, record]
            if progress is not None:
                progress("training, update", len(records), recipe.updates, -float(np.max(records, axis=0)[0]))
            if path is not None and len(records) % EVERY == 0:
                _save(path, training, records, digest)
    finally:
        if path is not None:
            _save(path, training, records, digest)
    reward, regret, gradient = np.reshape(records, (-1, 3)).T
    history = History(recipe.batch * np.arange(len(records)), reward, regret, gradient)
    message = f"made {len(records)} of {recipe.updates} updates"
    message += "; the mean reward of the next one is not finite" if status is Status.DIVERGED else ""
    return Trained(training.policy, history, status, message)


def _optimiser(recipe: Recipe) -> optax.GradientTransformation:
    learning_rate = optax.cosine_decay_schedule(recipe.learning_rate, recipe.updates, FALL)
    return optax.chain(optax.clip_by_global_norm(recipe.clip), optax.adam(learning_rate))


@eqx.filter_jit
def _begin(key: PRNGKeyArray, params: Params, recipe: Recipe) -> Training:
    """A training before its first update."""
    weights, first, stream = jax.random.split(key, 3)
    policy = GRUPolicy(sizes_of(params), weights, hidden=recipe.hidden, dtype=params.period.dtype)
    keys = jax.random.split(first, recipe.environments)
    state, observation = jax.vmap(reset, in_axes=(0, None))(keys, params)
    memory = jnp.broadcast_to(policy.init(params), (recipe.environments, recipe.hidden))
    optimiser = _optimiser(recipe).init(eqx.filter(policy, eqx.is_array))
    none = jnp.zeros((), jnp.int32)
    return Training(policy, optimiser, state, observation, memory, none, jax.random.key_data(stream))


@eqx.filter_jit
def _update(training: Training, params: Params, recipe: Recipe) -> tuple[Training, Float[Array, "3"]]:
    """One window in every environment and one step of the optimiser; mean reward and regret, norm of the gradient."""
    key = jax.random.fold_in(jax.random.wrap_key_data(training.stream), training.update)
    keys = jax.random.split(key, (recipe.environments, recipe.window))

    def loss(policy: GRUPolicy):
        def window(carry, keys):
            # A move's stages are computed again on the way back rather than kept.
            return jax.lax.scan(jax.checkpoint(advance), carry, keys)

        def advance(carry, key):
            state, observation, memory = carry
            state, observation = jax.lax.stop_gradient((state, observation))
            return advance_policy(key, policy, (state, observation, memory), params)

        carry, (rewards, info) = jax.vmap(window)((training.state, training.observation, training.memory), keys)
        return -jnp.mean(rewards), (carry, jnp.mean(info.evaluation.regret))

    (cost, (carry, regret)), gradient = eqx.filter_value_and_grad(loss, has_aux=True)(training.policy)
    norm = jnp.sqrt(sum(jnp.sum(x**2) for x in jax.tree.leaves(gradient)))
    # A move on the brink of divergence may have no derivative: its window then changes nothing.
    gradient = jax.tree.map(lambda x: jnp.where(jnp.isfinite(norm), x, 0.0), gradient)
    change, optimiser = _optimiser(recipe).update(gradient, training.optimiser)
    policy = eqx.apply_updates(training.policy, change)
    after = Training(policy, optimiser, *carry, update=training.update + 1, stream=training.stream)
    return after, jnp.stack([-cost, regret, norm])


def _digest(params: Params, recipe: Recipe) -> str:
    """A hash of everything that a training depends on."""
    leaves, structure = jax.tree.flatten(params)
    # A function of the user's is identified by its name: its address differs from process to process.
    text = re.sub(" at 0x[0-9a-f]+", "", f"{recipe} {structure} ")
    text += " ".join(f"{np.asarray(x).dtype}{np.asarray(x).tolist()}" for x in leaves)
    return hashlib.sha256(text.encode()).hexdigest()


def _save(path: Path, training: Training, records: list[np.ndarray], digest: str) -> None:
    """Write a checkpoint."""
    write_arrays(path, FORMAT, {"training": digest}, named_arrays(training) | {"records": np.reshape(records, (-1, 3))})


def _load(path: Path, like: Training, digest: str) -> tuple[Training, list[np.ndarray]]:
    """A training and its records from its checkpoint.

    Raises:
        ValueError: unless the file is a checkpoint of this very training.
    """
    about, found = read_arrays(path, FORMAT)
    if about != {"training": digest}:
        raise ValueError(
            f"checkpoint: {path} is of another training (its environment or recipe differ); name another file"
        )
    try:
        return with_arrays(like, found), list(found["records"].reshape(-1, 3))
    except KeyError as error:
        raise ValueError(f"checkpoint: {path} cannot be read: it has no {error}") from None
    except ValueError as error:
        raise ValueError(f"checkpoint: {path} cannot be read: {error}") from None
