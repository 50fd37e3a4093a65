"""Files of arrays that are read back, chunks of a store and policies: damaged, or with other arrays and their digest.

Each target makes an input and tries it, as those of ``fuzz`` do.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from experiments.reliability.damage import damaged
from jshape._files import read_arrays, write_arrays
from jshape.sweeps.checkpoint import in_chunks


def chunk_file(random: np.random.Generator, folder: Path) -> bool:
    """A chunk of a sweep's store, damaged: the results are the same, whatever was done to it."""
    return _spoilt_chunk(folder, random, lambda path: path.write_bytes(damaged(path.read_bytes(), random)))


def chunk_sealed_anew(random: np.random.Generator, folder: Path) -> bool:
    """The same, with other arrays and the right digest of those."""
    return _spoilt_chunk(folder, random, lambda path: _sealed_anew(path, "jshape-chunk 1", random))


def _spoilt_chunk(folder: Path, random: np.random.Generator, spoil: Callable[[Path], Any]) -> bool:
    store, results = folder / "store", {i: np.full((2, 3), float(i)) for i in range(3)}

    def stored() -> dict[int, np.ndarray]:
        made = in_chunks(
            lambda missing: [(i, results[i]) for i in missing],
            3,
            store,
            lambda: b"one",
            lambda index: results[index].shape,
        )
        return dict(made)

    stored()
    spoil(store / f"chunk_{random.integers(3):06d}.npz")
    found = stored()
    assert found.keys() == results.keys(), "other chunks"
    assert all(np.array_equal(found[i], results[i]) for i in results), "another result"
    return True


def policy_file(random: np.random.Generator, folder: Path) -> bool:
    """A shipped policy's file, damaged: refused, or the very same policy."""
    from jshape_envs.policy import POLICIES, load_policy, named_arrays

    original = sorted(POLICIES.glob("*.npz"))[0]
    path = folder / "policy.npz"
    path.write_bytes(damaged(original.read_bytes(), random))
    found, expected = (named_arrays(load_policy(each)) for each in (path, original))
    assert all(np.array_equal(found[name], value) for name, value in expected.items()), "another policy"
    return True


def policy_sealed_anew(random: np.random.Generator, folder: Path) -> bool:
    """A shipped policy's file with other arrays and the right digest of those: refused, or a policy that acts."""
    import jax.numpy as jnp
    import jshape_envs
    from jshape_envs.policy import FORMAT, POLICIES, load_policy

    path = folder / "policy.npz"
    path.write_bytes((POLICIES / "DuffingPayload_paper_hidden.npz").read_bytes())
    _sealed_anew(path, FORMAT, random)
    policy = load_policy(path)
    observation = jnp.zeros(policy.sizes.observation, jnp.float32)
    memory, action = policy.act(policy.init(jshape_envs.parameters("DuffingPayload")), observation)
    assert action.dtype == observation.dtype, f"an action of type {action.dtype}"
    assert np.all(np.isfinite(action)), "an action that is none"
    assert np.all(np.isfinite(memory)), "a memory that is none"
    return True


def _sealed_anew(path: Path, kind: str, random: np.random.Generator) -> None:
    """Write a file of arrays anew, one of them of another shape or type, missing, or under another name."""
    about, arrays = read_arrays(path, kind)
    name = str(random.choice(sorted(arrays)))
    value = arrays.pop(name)
    types = (np.float32, np.float64, np.complex128, bool, np.int8, "U8")
    others: list[dict[str, np.ndarray]] = [
        {}, {"other": value}, {name: value[..., :1]}, {name: value[None]}, {name: value.reshape(-1)},
        *({name: value.astype(each)} for each in types),
    ]  # fmt: skip
    write_arrays(path, kind, about, arrays | others[random.integers(len(others))])
