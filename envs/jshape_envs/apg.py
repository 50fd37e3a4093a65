"""Analytic policy gradients: a policy trained by the exact derivatives of its rewards, through the physics.

Many environments make a window of moves together; the derivative of what those moves cost, with respect to the
policy's weights, goes through each move's physics and through the policy's memory back to the window's beginning, where
it is cut off (truncated back-propagation through time). Memory, vibration and payload go on into the next window::

    params = jshape_envs.parameters("DuffingPayload")
    trained = train(params, Recipe(moves=100_000), checkpoint="duffing.ckpt.npz")     # goes on where it was stopped
    trained.policy, trained.history.reward

What one move leaves for the next (the vibration, and what the sensor sees of it) counts as given. Its derivatives are
exact, too, but they grow from move to move wherever a payload vibrates strongly, and such a window then outweighs all
others: trained with them, the same policies need more moves and end worse, or diverge.

Adam on the gradient clipped in norm; the learning rate falls along half a cosine.
"""

import dataclasses
import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt32

from jshape import _check
from jshape._files import whole
from jshape_envs.core import EnvState, Params, reset
from jshape_envs.policy import GRUPolicy, advance_policy, sizes_of

FALL = 0.02
"""What is left of the learning rate in the end."""

EVERY = 50
"""Updates between two checkpoints."""


@dataclasses.dataclass(frozen=True)
class Recipe:
    """How to train. ``moves``: in all environments together, rounded up to whole updates; ``environments``: that move
    together; ``window``: moves between two updates; ``rate``: the learning rate at first; ``clip``: the greatest norm
    of a gradient (the costs' own unit); ``hidden``: size of the memory; ``seed``: of weights, payloads and noise.

    *Raises* ``ValueError`` for counts below 1 and a rate or clip that is not positive.
    """

    moves: int = 100_000
    environments: int = 16
    window: int = 8
    rate: float = 1e-2
    clip: float = 0.1
    hidden: int = 48
    seed: int = 0

    def __post_init__(self):
        for name in ("moves", "environments", "window", "hidden"):
            _check.count(getattr(self, name), name)
        _check.count(self.seed, "seed", least=0)
        _check.positive(self.rate, "rate")
        _check.positive(self.clip, "clip")

    @property
    def batch(self) -> int:
        """Moves an update."""
        return self.environments * self.window

    @property
    def updates(self) -> int:
        return -(-self.moves // self.batch)


class History(NamedTuple):
    """What each update saw, before it changed the policy: ``moves`` made until then, mean ``reward`` and ``regret`` of
    a move, norm of the ``gradient``."""

    moves: Int[np.ndarray, " updates"]
    reward: Float[np.ndarray, " updates"]
    regret: Float[np.ndarray, " updates"]
    gradient: Float[np.ndarray, " updates"]


class Trained(NamedTuple):
    """The policy and how it came to be."""

    policy: GRUPolicy
    history: History


class Training(eqx.Module):
    """Everything that the next update depends on; the lanes have a leading axis over environments."""

    policy: GRUPolicy
    optimiser: Any
    state: EnvState
    observation: Float[Array, "environments observation"]
    memory: Float[Array, "environments hidden"]
    update: Int[Array, ""]
    stream: UInt32[Array, " words"]
    """The key that every update's random numbers come from."""


def train(
    params: Params,
    recipe: Recipe | None = None,
    *,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int, float], None] | None = None,
) -> Trained:
    """A policy for an environment.

    ``checkpoint``: a file (npz) that keeps everything, written every ``EVERY`` updates, at the end, and when the
    training is interrupted (``KeyboardInterrupt``, which goes on to the caller). If it exists, training goes on from it
    and ends with the same bits as if it had never stopped. ``progress(update, updates, reward)``: called after each
    update with the mean reward of its moves.

    *Raises* ``ValueError`` if the checkpoint is of another training, and ``FloatingPointError`` if the rewards are no
    longer numbers.
    """
    recipe = Recipe() if recipe is None else recipe
    path = None if checkpoint is None else Path(checkpoint)
    # The seed is no part of the program: one is compiled for all seeds.
    program = dataclasses.replace(recipe, seed=0)
    training, records = _begin(jax.random.key(recipe.seed), params, program), []
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            training, records = _load(path, training, _digest(params, recipe))
    try:
        while len(records) < recipe.updates:
            following, figures = _update(training, params, program)
            figures = np.asarray(figures, float)
            if not np.isfinite(figures[0]):
                raise FloatingPointError(f"the mean reward of update {len(records)} is {figures[0]}")
            training, records = following, [*records, figures]
            if progress is not None:
                progress(len(records), recipe.updates, float(figures[0]))
            if path is not None and len(records) % EVERY == 0:
                _save(path, training, records, _digest(params, recipe))
    finally:
        if path is not None:
            _save(path, training, records, _digest(params, recipe))
    reward, regret, gradient = np.reshape(records, (-1, 3)).T
    return Trained(training.policy, History(recipe.batch * np.arange(len(records)), reward, regret, gradient))


def _optimiser(recipe: Recipe) -> optax.GradientTransformation:
    rate = optax.cosine_decay_schedule(recipe.rate, recipe.updates, FALL)
    return optax.chain(optax.clip_by_global_norm(recipe.clip), optax.adam(rate))


@eqx.filter_jit
def _begin(key: PRNGKeyArray, params: Params, recipe: Recipe) -> Training:
    weights, first, stream = jax.random.split(key, 3)
    policy = GRUPolicy(sizes_of(params), weights, hidden=recipe.hidden, dtype=params.period.dtype)
    keys = jax.random.split(first, recipe.environments)
    state, observation = jax.vmap(reset, in_axes=(0, None))(keys, params)
    memory = jnp.broadcast_to(policy.start(params), (recipe.environments, recipe.hidden))
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
    # A payload on the brink of being lost may have no derivative: that window then teaches nothing.
    gradient = jax.tree.map(lambda x: jnp.where(jnp.isfinite(norm), x, 0.0), gradient)
    change, optimiser = _optimiser(recipe).update(gradient, training.optimiser)
    policy = eqx.apply_updates(training.policy, change)
    after = Training(policy, optimiser, *carry, update=training.update + 1, stream=training.stream)
    return after, jnp.stack([-cost, regret, norm])


def _digest(params: Params, recipe: Recipe) -> str:
    """Of everything that a training depends on."""
    leaves, structure = jax.tree.flatten(params)
    # A function of the user's is told by its name: where it lies in memory is another place in every process.
    text = re.sub(" at 0x[0-9a-f]+", "", f"{recipe} {structure} ")
    text += " ".join(f"{np.asarray(x).dtype}{np.asarray(x).tolist()}" for x in leaves)
    return hashlib.sha256(text.encode()).hexdigest()


def _save(path: Path, training: Training, records: list[np.ndarray], digest: str) -> None:
    leaves = jax.tree.leaves(eqx.filter(training, eqx.is_array))
    arrays: dict[str, Any] = {f"leaf_{i:03d}": np.asarray(leaf) for i, leaf in enumerate(leaves)}
    with whole(path) as file:
        np.savez(file, allow_pickle=False, digest=digest, records=np.reshape(records, (-1, 3)), **arrays)


def _load(path: Path, like: Training, digest: str) -> tuple[Training, list[np.ndarray]]:
    """*Raises* ``ValueError`` unless the file is a checkpoint of this very training."""
    try:
        with np.load(path) as stored:
            found = {name: stored[name] for name in stored.files}
    except (OSError, ValueError):
        found = {}
    if str(found.get("digest")) != digest:
        raise ValueError(
            f"checkpoint: {path} is of another training (its environment or recipe differ); name another file"
        )
    dynamic, static = eqx.partition(like, eqx.is_array)
    structure = jax.tree.structure(dynamic)
    leaves = [jnp.asarray(found[f"leaf_{i:03d}"]) for i in range(structure.num_leaves)]
    return eqx.combine(jax.tree.unflatten(structure, leaves), static), list(found["records"])
