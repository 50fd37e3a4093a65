"""The environments under Gymnasium: its own checker, the same moves alone and among others, autoreset, pictures."""

import subprocess
import sys
from typing import Any

import equinox as eqx
import gymnasium as gym
import jax
import jax.numpy as jnp
import jshape_envs
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from jshape_envs import ENVIRONMENTS, Machine, MoveEnv, MoveVectorEnv, parameters
from jshape_envs.batch import advance, advance_lanes

import jshape as js

DUFFING = "jshape/DuffingPayload-v0"


@pytest.fixture(scope="module")
def params():
    return parameters("DuffingPayload", horizon=3)


@pytest.mark.slow
def test_gymnasiums_checker_has_nothing_to_say():
    # Warnings are errors here, the passive checker's too.
    env: Any = gym.make(DUFFING, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.reset(seed=1)
    for _ in range(3):
        env.step(env.action_space.sample())
    env.close()
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(ENVIRONMENTS))
@pytest.mark.parametrize(
    "keywords",
    [
        dict(action="impulses", context="observed", tell_change=True),
        dict(action="residual", context="noisy", observation="features"),
        dict(preset="out-of-distribution"),
    ],
)
def test_every_environment_and_keyword_passes_the_checker(name, keywords):
    env: Any = gym.make(f"jshape_envs:jshape/{name}-v0", **keywords)
    check_env(env.unwrapped)
    names = jshape_envs.observation_names(env.unwrapped.params)
    assert env.observation_space.shape == (len(names),)
    assert ("payload" in names) == ("context" in keywords)


def episodes(env: Any, seed: int, moves: int, lane: int | None = None) -> list[np.ndarray]:
    """Observations and rewards of so many moves with the same actions whoever asks; ended episodes go on."""
    actions = np.random.default_rng(5).uniform(-1, 1, (moves, 3)).astype(np.float32)
    observation, _ = env.reset(seed=seed if lane is None else seed - lane)
    kept = [observation if lane is None else observation[lane]]
    for action in actions:
        if lane is None:
            observation, reward, terminated, truncated, _ = env.step(action)
            kept += [observation, np.float32(reward)]
            if terminated or truncated:
                kept.append(env.reset()[0])
        else:
            observation, reward, *_, info = env.step(np.tile(action, (env.num_envs, 1)))
            final = info.get("final_obs")
            kept += [observation[lane] if final is None else final[lane], reward[lane]]
            kept += [] if final is None else [observation[lane]]
    return kept


@pytest.mark.parametrize(("count", "lane"), [(3, 2), pytest.param(200, 150, marks=pytest.mark.slow)])
def test_the_same_seed_gives_the_same_moves_alone_and_among_others(params, count, lane):
    alone = episodes(gym.make("jshape/Moves-v0", environment=params), 1000, 8)
    many = MoveVectorEnv(count, params, autoreset_mode=AutoresetMode.SAME_STEP)
    among = episodes(many, 1000, 8, lane)
    assert len(alone) == len(among) == 17 + 2
    for x, y in zip(alone, among, strict=True):
        # In single precision, through the vibration that eight moves leave one another.
        np.testing.assert_allclose(x, y, atol=1e-5)
    again = episodes(gym.make("jshape/Moves-v0", environment=params), 1000, 8)
    assert all(np.array_equal(x, y) for x, y in zip(alone, again, strict=True))


@pytest.mark.slow
def test_autoreset_in_the_next_step(params):
    env: Any = gym.make_vec("jshape/Moves-v0", num_envs=4, environment=params)
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    env.reset(seed=0)
    actions = np.zeros(env.action_space.shape, np.float32)
    for k in range(9):
        _, reward, terminated, truncated, info = env.step(actions)
        assert not terminated.any()
        assert truncated.all() == (k % 4 == 2)
        resets = k % 4 == 3
        assert (reward == 0).all() == resets
        assert info["_residual"].all() != resets
        np.testing.assert_array_equal(info["evaluation"]["_regret"], info["_residual"])


@pytest.mark.slow
def test_autoreset_switched_off_begins_only_the_lanes_asked_for(params):
    env: Any = MoveVectorEnv(4, params, autoreset_mode="Disabled")
    first, _ = env.reset(seed=0)
    env.step(np.zeros((4, 3), np.float32))
    mask = np.array([True, False, True, False])
    observation, info = env.reset(options={"reset_mask": mask})
    moves = np.asarray(env._lanes.state.moves)
    np.testing.assert_array_equal(moves, [0, 1, 0, 1])
    assert not np.array_equal(observation[0], first[0])
    np.testing.assert_array_equal(info["_evaluation"], mask)


def test_nothing_is_compiled_during_a_run(params):
    env: Any = MoveVectorEnv(4, params)
    env.reset(seed=0)
    actions = np.zeros((4, 3), np.float32)
    env.step(actions)
    compiled: Any = advance_lanes
    before = compiled._cache_size()
    for _ in range(6):
        env.step(actions)
    assert compiled._cache_size() == before


def test_lost_payloads_end_the_episode():
    """A rod that turns over the top: terminated, finite numbers, and on to the next episode."""
    env: Any = gym.make("jshape/CranePayload-v0").unwrapped
    env.reset(seed=0)
    env._lane = eqx.tree_at(lambda lane: lane.state.plant, env._lane, jnp.asarray([0.0, 20.0], jnp.float32))
    observation, reward, terminated, truncated, info = env.step(np.zeros(3, np.float32))
    assert terminated
    assert not truncated
    assert info["lost"]
    assert np.isfinite(observation).all()
    assert info["residual"] == 4.0
    assert np.isfinite(reward)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(3, np.float32))
    env.reset()
    assert env._lane.state.moves == 0


def test_one_environment_computes_one_move(params):
    """No spare lanes: nothing that a step gives is larger than one observation."""
    env: Any = gym.make("jshape/Moves-v0", environment=params).unwrapped
    env.reset(seed=0)
    step = lambda lane, action: advance(lane, action, params, AutoresetMode.DISABLED)
    sizes = [leaf.size for leaf in jax.tree.leaves(jax.eval_shape(step, env._lane, np.zeros(3, np.float32)))]
    assert max(sizes) == env.observation_space.shape[0]


def test_max_episode_steps_is_the_horizon():
    env: Any = gym.make_vec(DUFFING, num_envs=2, max_episode_steps=2)
    env.reset(seed=0)
    ended = [env.step(np.zeros((2, 3), np.float32))[3].all() for _ in range(2)]
    assert ended == [False, True]


def test_bad_calls_are_told(params):
    env: Any = MoveVectorEnv(2, params)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros((2, 3)))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action must have shape"):
        env.step(np.zeros((3, 3)))
    with pytest.raises(ValueError, match="finite"):
        env.step(np.full((2, 3), np.nan))
    with pytest.raises(ValueError, match="num_envs"):
        MoveVectorEnv(0, params)
    with pytest.raises(ValueError, match="preset"):
        MoveVectorEnv(2, params, preset="hard")
    with pytest.raises(ValueError, match="render_mode"):
        MoveEnv(params, render_mode="ansi")


def test_hidden_payloads_are_told_for_evaluation_only(params):
    env: Any = gym.make("jshape/Moves-v0", environment=params)
    _, info = env.reset(seed=0)
    assert set(info) == {"evaluation"}
    *_, info = env.step(np.zeros(3, np.float32))
    assert set(info) == {"residual", "energy_cost", "time_cost", "duration", "move_time", "lost", "evaluation"}
    assert info["evaluation"]["payload"] > 0
    assert "payload" not in jshape_envs.observation_names(params)


@pytest.mark.slow
def test_a_plant_of_ones_own_becomes_an_environment():
    class SinhMass(js.plants.AbstractPlant):
        m: jax.Array
        k: jax.Array
        drive = "displacement"

        def vector_field(self, t, state, inputs):
            x, v = state
            return jnp.stack([v, -self.k / self.m * jnp.sinh(x - inputs)])

        def residual_energy(self, state, inputs):
            x, v = state
            return self.m * v**2 / 2 + self.k * (jnp.cosh(x - inputs) - 1)

        def rest_state(self, inputs):
            return jnp.stack([inputs, 0.0 * inputs])

    machine = Machine(SinhMass(jnp.asarray(1.0), jnp.asarray(10.0)), payload="m")
    env: Any = gym.make("jshape_envs:jshape/Moves-v0", environment=machine, payload=(0.7, 1.3), distance=(0.5, 2.0))
    env.reset(seed=0)
    *_, info = env.step(env.action_space.sample())
    params = env.unwrapped.params
    shaper = params.oracle.shaper(jnp.float32(1.0), jnp.float32(1.0), jnp.asarray(0))
    left = js.residual_energy(SinhMass(jnp.asarray(1.0), jnp.asarray(10.0)), shaper, 1.0)
    assert float(left) < 1e-3 * 10 * (np.cosh(1) - 1)
    assert 0 <= info["residual"] <= 4


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ENVIRONMENTS if name != "DuffingPayload"]


@pytest.mark.parametrize("name", ["DuffingPayload", *SLOW])
def test_pictures_show_machine_payload_and_tracks(name):
    env: Any = gym.make(f"jshape/{name}-v0", render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(env.action_space.sample())
    after = env.render()
    assert after.shape == before.shape == (480, 640, 3)
    assert after.dtype == np.uint8
    assert (after != before).any()
    # The payload's colour is somewhere in the upper half, and the machine fills its panel.
    assert (np.abs(after[:280].astype(int) - [0, 114, 178]).sum(axis=-1) < 30).sum() > 50
    panel = after[35:, :310] if name == "FlexibleLinkPayload" else after[35:255]
    drawn = np.argwhere((panel < 250).any(axis=-1))
    assert np.ptp(drawn, axis=0).max() > 180
    env.close()


@pytest.mark.slow
def test_frames_and_windows_work_without_a_screen():
    env: Any = gym.make(DUFFING, render_mode="rgb_array_list")
    env.reset(seed=0)
    *_, info = env.step(env.action_space.sample())
    frames = env.render()
    assert len(frames) == pytest.approx((info["move_time"] + 2.0) * 30, abs=1)
    env.close()
    human: Any = gym.make(DUFFING, render_mode="human")
    human.reset(seed=0)
    human.step(human.action_space.sample())
    assert human.render() is None
    human.close()


@pytest.mark.slow
def test_videos_are_recorded(tmp_path):
    pytest.importorskip("moviepy")
    env: Any = gym.make(DUFFING, render_mode="rgb_array", horizon=4)
    env: Any = gym.wrappers.RecordVideo(env, str(tmp_path / "videos"), disable_logger=True)
    env.reset(seed=0)
    for _ in range(4):
        env.step(env.action_space.sample())
    env.close()
    assert [p.stat().st_size > 1000 for p in tmp_path.glob("videos/*.mp4")] == [True]


def test_import_registers_and_leaves_jax_as_it_is():
    code = (
        "import jax, jshape_envs, gymnasium as gym;"
        "assert not jax.config.jax_enable_x64;"
        "ids = [i for i in gym.registry if i.startswith('jshape/')];"
        "assert len(ids) == 5, ids;"
        "[gym.spec(i).to_json() for i in ids]"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
