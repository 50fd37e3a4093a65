"""Trained policies: a small recurrent network, and the files that policies are kept in::

policy = jshape_envs.load_policy("DuffingPayload")
rewards, info = jshape_envs.rollout(jax.random.key(0), policy, params, moves=64)
"""

from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jshape import _check
from jshape._files import read_arrays, write_arrays
from jshape.moves import AbstractPolicy, Observation, Params, observation_names

POLICIES = Path(__file__).parent / "policies"
"""Trained policies that come with the package, made by experiments/learning/train.py."""

FORMAT = "jshape-policy 2"


class Sizes(NamedTuple):
    """Numbers of entries that a policy is made for.

    Attributes:
        observation: of an observation.
        sensed: of those that come from the sensor; they are the first.
        action: of an action.
    """

    observation: int
    sensed: int
    action: int


def sizes_of(params: Params) -> Sizes:
    """The sizes of an environment."""
    return Sizes(len(observation_names(params)), params.sensor.size, params.action.size)


class GRUPolicy(AbstractPolicy):
    """A small recurrent network: a gated recurrent unit over the observations, and one layer between it and the action.

    Its memory is the unit's state. The sensor's entries are spread by asinh(``gain`` x) first: what distinguishes
    payloads is small beside the sensor's reach. The action passes through tanh. An entry that is not finite counts as
    0, as a sensor's does (``moves.Sensor``): it would stay in the memory for good.

    Args:
        sizes: of the environment that it is for.
        key: of its first weights.
        hidden: size of the memory.
        width: of the layer.
        gain: of the sensor's entries.
        dtype: of the weights.

    Raises:
        ValueError: for sizes below 1 or a gain that is not positive, and by ``init`` for an environment whose
            observations or actions have other sizes.

    Source: Cho et al. (2014).
    """

    cell: eqx.nn.GRUCell
    head: eqx.nn.MLP
    sizes: Sizes = eqx.field(static=True)
    gain: float = eqx.field(static=True)

    def __init__(
        self,
        sizes: Sizes,
        key: PRNGKeyArray,
        *,
        hidden: int = 48,
        width: int = 64,
        gain: float = 20.0,
        dtype: Any = jnp.float32,
    ):
        _check.count(hidden, "hidden")
        _check.count(width, "width")
        _check.positive(gain, "gain")
        # A file may say anything of them.
        observation = _check.count(sizes.observation, "observation")
        _check.count(sizes.sensed, "sensed", 0, observation)
        _check.count(sizes.action, "action")
        first, second = jax.random.split(key)
        self.cell = eqx.nn.GRUCell(sizes.observation, hidden, dtype=dtype, key=first)
        head = eqx.nn.MLP(hidden + sizes.observation, sizes.action, width, 1, jnp.tanh, dtype=dtype, key=second)
        # Actions begin near 0, where tanh is steep.
        self.head = eqx.tree_at(lambda h: h.layers[-1].weight, head, 0.1 * head.layers[-1].weight)
        self.sizes, self.gain = sizes, float(gain)

    def init(self, params: Params) -> Float[Array, " hidden"]:
        if (wanted := sizes_of(params)) != self.sizes:
            raise ValueError(f"params: the policy is for {self.sizes}, this environment has {wanted}")
        return jnp.zeros(self.cell.hidden_size, self.cell.weight_hh.dtype)

    def act(
        self, memory: Float[Array, " hidden"], observation: Observation, params: Any = None, state: Any = None
    ) -> tuple[Float[Array, " hidden"], Float[Array, " size"]]:
        observation = jnp.where(jnp.isfinite(observation), observation, 0.0)
        sensed, others = observation[: self.sizes.sensed], observation[self.sizes.sensed :]
        features = jnp.concatenate([jnp.arcsinh(self.gain * sensed), others])
        memory = self.cell(features, memory)
        return memory, jnp.tanh(self.head(jnp.concatenate([memory, features]))).astype(observation.dtype)


def save_policy(policy: GRUPolicy, path: str | Path, about: dict[str, Any]) -> None:
    """Write a policy's weights as npz.

    Args:
        policy: to be written.
        path: of the file; its folder is made.
        about: what the policy is for, as JSON can hold it; ``evaluate.named_policy`` reads ``environment``,
            ``preset``, ``context`` and ``action``.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    dtype = policy.cell.weight_hh.dtype.name
    made = dict(hidden=policy.cell.hidden_size, width=policy.head.width_size, gain=policy.gain, dtype=dtype)
    header = dict(sizes=policy.sizes._asdict(), made=made, about=about)
    write_arrays(path, FORMAT, header, named_arrays(policy))


def load_policy(name: str | Path, preset: str = "paper", context: str = "hidden") -> GRUPolicy:
    """A trained policy from its file.

    Args:
        name: of an environment, for the policy that comes with the package, or of a file (it ends in ``.npz``).
        preset: that the policy was trained on.
        context: whether it was trained with a ``"hidden"`` or an ``"observed"`` payload.

    Raises:
        ValueError: if there is none, or the file holds something else.
    """
    path = Path(name) if str(name).endswith(".npz") else policy_file(str(name), preset, context)
    if not path.exists():
        there = ", ".join(sorted(repr(each.stem) for each in POLICIES.glob("*.npz")))
        raise ValueError(
            f"name: there is no policy {path if path == Path(name) else repr(path.stem)}; there are {there}"
        )
    return read_policy(path)[0]


def read_policy(path: Path) -> tuple[GRUPolicy, dict[str, Any]]:
    """A policy from its file, and what it is for, as ``save_policy`` was given it.

    Raises:
        ValueError: that names the file, if it holds no policy, or weights that are not finite.
    """
    header, found = read_arrays(path, FORMAT)
    try:
        blank = eqx.filter_eval_shape(GRUPolicy, Sizes(**header["sizes"]), jax.random.key(0), **header["made"])
        policy, about = with_arrays(blank, found), dict(header["about"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: holds no policy ({error})") from None
    for name, value in named_arrays(policy).items():
        if not np.all(np.isfinite(value)):
            raise ValueError(f"{path}: holds no policy ({name!r} is not finite)")
    return policy, about


def policy_file(environment: str, preset: str = "paper", context: str = "hidden") -> Path:
    """The file of the policy that comes with the package, or would, for an environment."""
    return POLICIES / f"{environment}_{preset}_{context}.npz"


def named_arrays(tree: Any) -> dict[str, np.ndarray]:
    """The arrays of a pytree by their paths, for a file."""
    leaves = jax.tree_util.tree_leaves_with_path(eqx.filter(tree, eqx.is_array))
    return {jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in leaves}


def with_arrays(blank: Any, named: dict[str, np.ndarray]) -> Any:
    """The pytree with arrays from a file in the place of its own, or of their shapes; the rest stays.

    Raises:
        KeyError: where one is missing.
        ValueError: where one has another shape, or entries of another type.
    """

    def leaf(path: Any, own: Any) -> Any:
        if not eqx.is_array(own) and not isinstance(own, jax.ShapeDtypeStruct):
            return own
        name = jax.tree_util.keystr(path)
        if named[name].shape != own.shape:
            raise ValueError(f"{name} has shape {named[name].shape}, not {own.shape}")
        # With 32 bits alone, JAX takes numbers of 64 as such.
        if jax.dtypes.canonicalize_dtype(named[name].dtype) != own.dtype:
            raise ValueError(f"{name} has entries of type {named[name].dtype}, not {own.dtype}")
        return jnp.asarray(named[name])

    return jax.tree_util.tree_map_with_path(leaf, blank)
