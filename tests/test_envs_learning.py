"""Learning: gradients beside differences, training that learns and resumes bit for bit, policies in files and in C."""

import shutil
import subprocess

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from jshape_envs import observation_names, parameters, rollout
from jshape_envs.apg import EVERY, Recipe, _digest, train
from jshape_envs.baselines import Oracle
from jshape_envs.baselines.observed import observed
from jshape_envs.evaluate import evaluate
from jshape_envs.export_c import policy_to_c
from jshape_envs.policy import FORMAT, POLICIES, GRUPolicy, Sizes, load_policy, named_arrays, save_policy, sizes_of

from experiments.reliability.damage import damaged
from jshape._files import write_arrays
from jshape.moves import reset, step
from jshape.status import Status

RECIPE = Recipe(moves=64 * (EVERY + 12), environments=16, window=4, hidden=16)


@pytest.fixture(scope="module")
def params():
    return parameters("DuffingPayload")


@pytest.fixture(scope="module")
def trained(params):
    return train(params, RECIPE)


def same(a, b) -> bool:
    first, second = (jax.tree.leaves(eqx.filter(x, eqx.is_array)) for x in (a, b))
    return len(first) == len(second) and all(np.array_equal(x, y) for x, y in zip(first, second, strict=True))


# --- the policy -------------------------------------------------------------------------------------------------------


def by_hand(policy, observations):
    """The network in NumPy, from the definition of a gated recurrent unit (Cho et al., 2014), in double precision."""
    wide = lambda x: np.asarray(x, float)
    sigmoid = lambda x: 1 / (1 + np.exp(-x))
    cell, (layer, last) = policy.cell, policy.head.layers
    memory, actions = np.zeros(cell.hidden_size), []
    for observation in wide(observations):
        features = observation.copy()
        features[: policy.sizes.sensed] = np.arcsinh(policy.gain * features[: policy.sizes.sensed])
        r, z, n = np.split(wide(cell.weight_ih) @ features + wide(cell.bias), 3)
        r_own, z_own, n_own = np.split(wide(cell.weight_hh) @ memory, 3)
        r, z = sigmoid(r + r_own), sigmoid(z + z_own)
        n = np.tanh(n + r * (n_own + wide(cell.bias_n)))
        memory = (1 - z) * n + z * memory
        both = np.concatenate([memory, features])
        middle = np.tanh(wide(layer.weight) @ both + wide(layer.bias))
        actions.append(np.tanh(wide(last.weight) @ middle + wide(last.bias)))
    return np.array(actions)


def observations_of(policy, count=12, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (count, policy.sizes.observation)).astype(np.float32)


@pytest.mark.slow
def test_a_policy_is_the_network_that_its_weights_say(trained):
    policy = trained.policy
    observations = observations_of(policy)
    step = lambda memory, observation: policy.act(memory, observation)
    memory = jnp.zeros(policy.cell.hidden_size, jnp.float32)
    actions = jax.jit(lambda x: jax.lax.scan(step, memory, x)[1])(observations)
    np.testing.assert_allclose(actions, by_hand(policy, observations), atol=2e-6)


def test_a_sample_that_did_not_come_counts_as_zero(params):
    """What a memory takes in stays there."""
    network = GRUPolicy(sizes_of(params), jax.random.key(0))
    known = jnp.asarray(observations_of(network, 1)[0]).at[3].set(0.0)
    torn, memory = known.at[3].set(jnp.nan), network.init(params)
    assert eqx.tree_equal(network.act(memory, torn), network.act(memory, known))
    assert eqx.tree_equal(observed(torn, params), observed(known, params))


@pytest.mark.slow
def test_rollout_makes_the_moves_that_step_makes_and_forgets_after_an_episode(params, trained):
    """Beside a loop over ``step`` in Python, through the end of an episode."""
    short = eqx.tree_at(lambda p: p.horizon, params, jnp.asarray(3, jnp.int32))
    policy, key = trained.policy, jax.random.key(5)
    rewards, info = eqx.filter_jit(rollout)(key, policy, short, 5)
    advance, act, begin = eqx.filter_jit(step), eqx.filter_jit(policy.act), eqx.filter_jit(reset)
    first, key = jax.random.split(key)
    state, observation = begin(first, short)
    memory = policy.init(short)
    for i, each in enumerate(jax.random.split(key, 5)):
        here, again = jax.random.split(each)
        memory, action = act(memory, observation)
        state, observation, reward, _, truncated, _ = advance(here, state, action, short)
        np.testing.assert_allclose(rewards[i], reward, atol=2e-6)
        assert bool(truncated) == (i == 2)
        if truncated:
            state, observation = begin(again, short)
            memory = policy.init(short)
    assert info.residual.shape == (5,)


@pytest.mark.slow
def test_a_policy_refuses_an_environment_of_other_sizes(params, trained):
    with pytest.raises(ValueError, match="observation=23"):
        trained.policy.init(parameters("DuffingPayload", tell_change=True, samples=18))
    with pytest.raises(ValueError, match="hidden must be a whole number of at least 1, not 0"):
        GRUPolicy(sizes_of(params), jax.random.key(0), hidden=0)


# --- files ------------------------------------------------------------------------------------------------------------


def test_a_policy_is_kept_and_read_back_whole(trained, tmp_path):
    save_policy(trained.policy, tmp_path / "mine.npz", {"environment": "DuffingPayload"})
    assert eqx.tree_equal(load_policy(tmp_path / "mine.npz"), trained.policy)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]


def test_a_policy_of_double_precision_acts_in_an_environment_of_single(params, tmp_path):
    policy = GRUPolicy(sizes_of(params), jax.random.key(0), hidden=4, width=4, dtype=jnp.float64)
    save_policy(policy, tmp_path / "mine.npz", {"environment": "DuffingPayload"})
    again = load_policy(tmp_path / "mine.npz")
    assert again.cell.weight_hh.dtype == jnp.float64
    assert eqx.tree_equal(again, policy)
    rewards, _ = rollout(jax.random.key(1), again, params, moves=2)
    assert rewards.dtype == params.period.dtype == jnp.float32
    assert np.all(np.isfinite(rewards))


def test_what_is_no_policy_is_refused(trained, tmp_path):
    np.savez(tmp_path / "other.npz", numbers=np.zeros(3))
    (tmp_path / "broken.npz").write_bytes(b"PK")
    (tmp_path / "empty.npz").write_bytes(b"")
    header = dict(sizes=trained.policy.sizes._asdict(), made=dict(hidden=16, width=64, gain=20.0), about={})
    arrays = named_arrays(trained.policy)
    write_arrays(tmp_path / "cut.npz", FORMAT, header, {**arrays, ".cell.bias_n": np.zeros(3)})
    write_arrays(tmp_path / "nan.npz", FORMAT, header, {**arrays, ".cell.bias_n": np.full(16, np.nan, np.float32)})
    write_arrays(tmp_path / "old.npz", "jshape-policy 1", header, arrays)
    # With a right digest: a size that no number holds, and one that is none.
    for name, size in {"huge": {"observation": 10**400}, "word": {"sensed": "x"}}.items():
        write_arrays(tmp_path / f"{name}.npz", FORMAT, header | {"sizes": header["sizes"] | size}, arrays)
    for name, kind in {"truths": np.bool_, "complex": np.complex64, "wide": np.float64}.items():
        write_arrays(tmp_path / f"{name}.npz", FORMAT, header, {**arrays, ".cell.bias_n": np.ones(16, kind)})
    for name, words in {
        **dict.fromkeys(("other", "broken", "empty"), "cannot be read"),
        "cut": "has shape",
        "truths": "has entries of type bool, not float32",
        "complex": "has entries of type complex64, not float32",
        "wide": "has entries of type float64, not float32",
        "nan": "'.cell.bias_n' is not finite",
        "old": "its format is 'jshape-policy 1'",
        "huge": "observation must be at most",
        "word": "sensed must be a whole number",
    }.items():
        with pytest.raises(ValueError, match=words) as caught:
            load_policy(tmp_path / f"{name}.npz")
        assert str(caught.value).startswith(f"{tmp_path / name}.npz: ")
    with pytest.raises(ValueError, match="there is no policy 'DuffingPayload_paper_noisy'"):
        load_policy("DuffingPayload", context="noisy")


def test_damaged_policies_and_checkpoints_are_named_in_a_line(params, trained, tmp_path):
    random = np.random.default_rng(0)
    path, checkpoint = tmp_path / "mine.npz", tmp_path / "checkpoint.npz"
    save_policy(trained.policy, path, {"environment": "DuffingPayload"})
    write_arrays(checkpoint, "jshape-training 1", {"training": "another"}, {"records": np.zeros((1, 3))})
    readers = {path: load_policy, checkpoint: lambda path: train(params, RECIPE, checkpoint=path)}
    for file, read in readers.items():
        content, messages = file.read_bytes(), []
        for _ in range(300 if file == path else 20):
            file.write_bytes(damaged(content, random))
            try:
                assert eqx.tree_equal(read(file), trained.policy)
            except ValueError as error:
                messages.append(str(error))
        assert len(messages) >= 20
        assert all(str(file) in words and "\n" not in words for words in messages)


@pytest.mark.parametrize("path", sorted(POLICIES.glob("*.npz")), ids=lambda path: path.stem)
def test_policies_that_come_with_the_package_are_small_and_fit_their_environments(path):
    name, preset, context = path.stem.split("_")
    policy = load_policy(name, preset, context)
    assert sizes_of(parameters(name, preset, context=context)) == policy.sizes
    assert path.stat().st_size < 300e3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["CranePayload", "DuffingPayload"])
def test_policies_that_know_the_payload_leave_no_more_than_the_oracle_does(name):
    """In the same episodes, where a move begins with what the last one left: the oracle's shapers are made for rest."""
    params = parameters(name, context="observed")
    policies = load_policy(name, context="observed"), Oracle()
    mine, oracles = (float(evaluate(each, params, episodes=32, seeds=1).residual[0]) for each in policies)
    assert mine < 1.1 * oracles
    assert mine < 1e-4


# --- training ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_gradient_of_a_moves_cost_is_that_of_differences():
    """Through one move's physics and the network, in double precision, for some weights of every layer."""
    exact = parameters("DuffingPayload", noise=0.0, resolution=0.0, dtype=jnp.float64)
    policy = GRUPolicy(sizes_of(exact), jax.random.key(1), hidden=8, dtype=jnp.float64)
    dynamic, static = eqx.partition(policy, eqx.is_array)
    flat, restore = ravel_pytree(dynamic)

    @jax.jit
    def cost(weights):
        return -jnp.sum(rollout(jax.random.key(3), eqx.combine(restore(weights), static), exact, 1)[0])

    slope = jax.jit(jax.grad(cost))(flat)
    for i in np.random.default_rng(0).choice(len(flat), 12, replace=False):
        nudge = jnp.zeros_like(flat).at[i].set(1e-5)
        assert abs(float(slope[i]) - float(cost(flat + nudge) - cost(flat - nudge)) / 2e-5) < 1e-8
    assert float(jnp.linalg.norm(slope)) > 1e-3


def test_training_learns(trained):
    """Beside the same policy before: a tenth less is paid after 4,000 moves already."""
    reward = trained.history.reward
    assert len(reward) == RECIPE.updates == EVERY + 12
    np.testing.assert_array_equal(trained.history.moves, 64 * np.arange(len(reward)))
    assert reward[-15:].mean() > 0.9 * reward[:5].mean()
    assert np.all(np.isfinite(trained.history.gradient))


def test_an_interrupted_training_ends_with_the_same_bits(params, trained, tmp_path):
    path, calls = tmp_path / "new" / "checkpoint.npz", []

    def stop_at(last):
        def progress(stage, done, total, best):
            calls.append((done, total, best))
            if done == last:
                raise KeyboardInterrupt

        return progress

    for last in (EVERY + 5, EVERY + 6):
        with pytest.raises(KeyboardInterrupt):
            train(params, RECIPE, checkpoint=path, progress=stop_at(last))
    again = train(params, RECIPE, checkpoint=path)
    assert same(again.policy, trained.policy)
    assert same(again.history, trained.history)
    assert [done for done, _, _ in calls] == list(range(1, EVERY + 7))
    np.testing.assert_array_equal(
        [best for *_, best in calls], -np.maximum.accumulate(trained.history.reward[: EVERY + 6])
    )
    ended = train(params, RECIPE, checkpoint=path, progress=stop_at(1))
    assert same(ended.policy, trained.policy)
    assert same(ended.history, trained.history)
    assert ended.status is Status.STOPPED


def test_a_training_that_diverges_ends_with_the_policy_before(params, tmp_path):
    """Weights that are no numbers from the first update on: nothing is learned from them, and the status says so."""
    path = tmp_path / "checkpoint.npz"
    broken = eqx.tree_at(lambda p: p.time_weight, params, jnp.asarray(jnp.nan, jnp.float32))
    found = train(broken, RECIPE, checkpoint=path)
    assert found.status is Status.DIVERGED
    assert not found.converged
    assert "made 0 of" in found.message
    assert len(found.history.reward) == 0
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(eqx.filter(found.policy, eqx.is_array)))


def test_another_trainings_checkpoint_is_refused(params, tmp_path):
    path = tmp_path / "checkpoint.npz"
    write_arrays(path, "jshape-training 1", {"training": "another"}, {"records": np.zeros((1, 3))})
    with pytest.raises(ValueError, match="is of another training"):
        train(params, RECIPE, checkpoint=path)
    # Of this training, with a right digest, and without its weights.
    write_arrays(path, "jshape-training 1", {"training": _digest(params, RECIPE)}, {"records": np.zeros((1, 3))})
    with pytest.raises(ValueError, match=r"checkpoint\.npz cannot be read: it has no "):
        train(params, RECIPE, checkpoint=path)
    path.write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"checkpoint\.npz: cannot be read: "):
        train(params, RECIPE, checkpoint=path)
    assert path.read_bytes() == b"nothing"


@pytest.mark.parametrize("name", ["moves", "environments", "window", "hidden", "learning_rate", "clip", "seed"])
def test_bad_recipes_are_refused(name):
    with pytest.raises(ValueError, match=f"{name} must .* not -1"):
        Recipe(**{name: -1})


# --- C ----------------------------------------------------------------------------------------------------------------

DRIVER = """
#include <stdio.h>
#include "policy.h"
int main(void) {
    static policy_memory memory;
    float observation[POLICY_OBSERVATIONS], action[POLICY_ACTIONS];
    int i;
    policy_start(&memory);
    for (;;) {
        for (i = 0; i < POLICY_OBSERVATIONS; i++) {
            if (scanf("%f", &observation[i]) != 1) return 0;
        }
        policy_step(&memory, observation, action);
        for (i = 0; i < POLICY_ACTIONS; i++) printf("%.9g ", (double)action[i]);
        printf("\\n");
    }
}
"""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_a_policy_in_c_acts_as_the_network_does(params, trained, tmp_path):
    names = observation_names(params)
    header = policy_to_c(trained.policy, names)
    assert f"{len(names) - 1}  {names[-1]}" in header
    (tmp_path / "policy.h").write_text(header, encoding="utf-8")
    (tmp_path / "main.c").write_text(DRIVER, encoding="utf-8")
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow"]
    sanitized = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = ["gcc", *strict, *sanitized, "main.c", "-o", "main", "-lm"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    observations = observations_of(trained.policy, 200, seed=1)
    observations[[5, 9, 30], [3, 0, -1]] = np.nan, np.inf, -np.inf
    orders = "\n".join(" ".join(f"{x:.9g}" for x in row) for row in observations)
    done = subprocess.run(["./main"], cwd=tmp_path, input=orders, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = np.array([line.split() for line in done.stdout.splitlines()], float)
    known = np.where(np.isfinite(observations), observations, 0.0)
    np.testing.assert_allclose(found, by_hand(trained.policy, known), atol=1e-6)


def test_c_wants_names_that_fit(trained):
    with pytest.raises(ValueError, match="name must"):
        policy_to_c(trained.policy, name="2 policies")
    with pytest.raises(ValueError, match="entries must be"):
        policy_to_c(trained.policy, ["one"])


# --- stable-baselines3 ------------------------------------------------------------------------------------------------


def test_the_adapter_gives_stable_baselines3_what_the_environments_give(params):
    pytest.importorskip("stable_baselines3")
    from jshape_envs import MoveVectorEnv
    from jshape_envs.sb3 import MoveVecEnv

    short = eqx.tree_at(lambda p: p.horizon, params, jnp.asarray(3, jnp.int32))
    adapted, plain = MoveVecEnv(short, 4, seed=9), MoveVectorEnv(4, short, autoreset_mode="SameStep")
    np.testing.assert_array_equal(adapted.reset(), plain.reset(seed=9)[0])
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 4, params.action.size)).astype(np.float32)
    total, infos, info = np.zeros(4), [], {}
    for i, action in enumerate(actions):
        observation, reward, done, infos = adapted.step(action)
        wanted, paid, _, _, info = plain.step(action)
        np.testing.assert_array_equal(observation, wanted)
        np.testing.assert_array_equal(reward, paid)
        total += paid
        assert done.all() == (i == 2)
    for lane, own in enumerate(infos):
        np.testing.assert_array_equal(own["terminal_observation"], info["final_obs"][lane])
        assert own["TimeLimit.truncated"]
        assert own["episode"]["l"] == 3
        np.testing.assert_allclose(own["episode"]["r"], total[lane] / 3, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo", "jax-ppo", "sac", "jax-sac"])
def test_recipes_for_other_trainers_run_and_are_judged(params, name):
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("sbx")
    from experiments.learning.trainers import RECIPES, run

    # sbx takes single precision only.
    with jax.enable_x64(False):
        found = run(RECIPES[name]._replace(moves=4_096), params, seed=0)
    assert found["moves"][-1] >= 4_096
    assert np.all(np.isfinite(found["reward"]))


def test_sizes_are_named(params):
    assert sizes_of(params) == Sizes(observation=20, sensed=16, action=3)
