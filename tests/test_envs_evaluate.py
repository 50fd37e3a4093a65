"""Scores of policies: beside plain means, statistics by hand, the command line and its files."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import typer
from jshape_envs import Params, parameters, reset, rollout
from jshape_envs.baselines import fixed_linear
from jshape_envs.evaluate import (
    LONGEST,
    Transferred,
    evaluate,
    interquartile_mean,
    interval,
    mean_recovery,
    named_policy,
    recovery_times,
    summary,
    survival,
)
from jshape_envs.policy import GRUPolicy, load_policy, save_policy, sizes_of
from typer.testing import CliRunner

from jshape.cli.evaluate import evaluate as command


@pytest.fixture(scope="module")
def duffing() -> Params:
    return parameters("DuffingPayload")


# --- statistics -------------------------------------------------------------------------------------------------------


def test_recovery_times_by_hand():
    residual = np.array([[0.5, 0.01, 0.3, 0.2, 0.01, 0.3, 0.3, 0.01], [0.01, 0.02, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9]])
    changed = np.array([[0, 0, 1, 0, 0, 1, 1, 0], [0, 0, 1, 0, 0, 0, 0, 0]], bool)
    age = np.array([[0, 1, 0, 1, 2, 0, 0, 1], [0, 1, 0, 1, 2, 3, 4, 5]])
    times, observed = recovery_times(residual, age, changed)
    # The third move on; cut short by the next change; the second move; cut short by the end.
    assert times.tolist() == [3, 1, 2, 6]
    assert observed.tolist() == [True, False, True, False]


def test_survival_is_kaplan_and_meiers():
    times, observed = np.array([3, 1, 2, 6, 1]), np.array([True, False, True, False, True])
    curve = survival(times, observed)
    # At 1: 5 at risk, 1 recovers; at 2: 3 at risk, 1 recovers; at 3: 2 at risk, 1 recovers; then none.
    by_hand = np.array([4 / 5, 4 / 5 * 2 / 3, 4 / 5 * 2 / 3 / 2])
    np.testing.assert_allclose(curve[:3], by_hand)
    np.testing.assert_allclose(curve[3:], by_hand[2])
    np.testing.assert_allclose(mean_recovery(times, observed), 1 + by_hand[:2].sum() + (LONGEST - 2) * by_hand[2])
    assert np.all(survival(np.array([4, 4]), np.array([False, False])) == 1)
    assert np.all(np.isnan(survival(np.zeros(0, int), np.zeros(0, bool))))
    assert mean_recovery(np.array([1, 1]), np.array([True, True])) == 1.0


def test_interval_is_that_of_a_bootstrap_by_hand():
    values = np.array([0.3, 0.1, 0.9, 0.2, 0.25])
    assert interquartile_mean(values) == pytest.approx((0.2 + 0.25 + 0.3) / 3)
    found = interval(values)
    draws = np.sort(np.random.default_rng(8).choice(values, (20000, 5)), axis=1)[:, 1:4].mean(axis=1)
    assert found.middle == pytest.approx(0.25)
    np.testing.assert_allclose([found.low, found.high], np.quantile(draws, [0.025, 0.975]), atol=0.01)
    assert np.isnan(interval(np.array([1.0])).low)
    with pytest.raises(ValueError, match="values"):
        interval(np.zeros(0))


# --- policies ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_scores_are_the_means_of_rollouts():
    # Not the Duffing payload: some of its moves amplify the rounding of single precision to 1e-3, a crane's do not.
    crane = parameters("CranePayload")
    policy = fixed_linear(crane, "zvd")
    scores = evaluate(policy, crane, episodes=2, seeds=2, seed=11)
    keys = jnp.stack([jax.random.split(jax.random.key(s), 2) for s in (11, 12)])
    rewards, info = eqx.filter_jit(jax.vmap(jax.vmap(lambda key: rollout(key, policy, crane, 64))))(keys)
    mean = lambda x: np.asarray(x, float).mean(axis=(1, 2))
    np.testing.assert_allclose(scores.reward, mean(rewards), rtol=1e-5)
    np.testing.assert_allclose(scores.residual, mean(info.residual), rtol=1e-4)
    np.testing.assert_allclose(scores.move_time, mean(info.move_time), rtol=1e-6)
    np.testing.assert_allclose(scores.regret, -mean(rewards) - mean(info.evaluation.oracle_cost), rtol=1e-4)
    one = evaluate([policy], crane, episodes=4, seeds=1, seed=11)
    exact = evaluate(policy, crane, episodes=4, seeds=1, seed=11)
    np.testing.assert_array_equal(one.reward, exact.reward)
    assert np.all(scores.lost == 0)
    with pytest.raises(ValueError, match="policy must be one, or one for each of 2 seeds, not 1"):
        evaluate([policy], crane, episodes=2, seeds=2)
    with pytest.raises(ValueError, match="episodes"):
        evaluate(policy, crane, episodes=0)
    with pytest.raises(ValueError, match=r"seeds, with their episodes and moves, asks for .* GiB, more than 16"):
        evaluate(policy, crane, episodes=64, seeds=2**31 - 1)


@pytest.mark.slow
@pytest.mark.parametrize("context", ["hidden", "observed"])
def test_a_policy_abroad_acts_as_at_home(context, tmp_path):
    home, away = (parameters("DuffingPayload", preset, context=context) for preset in ("paper", "hard"))
    policy = GRUPolicy(sizes_of(home), jax.random.key(0))
    about = dict(environment="DuffingPayload", preset="paper", context=context, action="modal")
    save_policy(policy, tmp_path / "p.npz", about)
    found = named_policy(str(tmp_path / "p.npz"), away)
    assert isinstance(found, Transferred)
    state, observation = reset(jax.random.key(3), away)
    act = eqx.filter_jit(lambda policy, memory, given, params: policy.act(memory, given, params, state))
    (memory, action), shaper = act(found, found.init(away), observation, away)
    # At home the same move is a greater share of the longest one, 1 m; here that is 1.2 m.
    at_home = observation.at[16 + away.action.size].multiply(1.2)
    if context == "observed":
        # The same payload, in halves of the range at home from its middle.
        least, greatest = np.asarray(home.payload)
        at_home = at_home.at[-1].set(2 * (state.payload - (least + greatest) / 2) / (greatest - least))
        assert abs(float(at_home[-1] - observation[-1])) > 0.1
    same_memory, same = act(policy, policy.init(home), at_home, home)
    np.testing.assert_allclose(action, same, atol=1e-6)
    exact = home.action.shaper(same)
    np.testing.assert_allclose(shaper.times, exact.times, rtol=1e-5)
    assert float(jnp.abs(away.action.shaper(action).times[-1] - exact.times[-1])) > 1e-3
    # In the next move it observes what it did, which no action here stands for.
    (_, action), _ = act(found, (memory, action), observation, away)
    _, same = act(policy, same_memory, at_home.at[16 : 16 + away.action.size].set(same), home)
    np.testing.assert_allclose(action, same, atol=1e-6)


def test_a_policy_acts_where_the_actions_are_others_and_is_refused_where_observations_are(tmp_path):
    """``jshape train --action impulses``, and then the command that it names: four numbers where there are three."""
    home, away = parameters("DuffingPayload", action="impulses"), parameters("DuffingPayload")
    policy = GRUPolicy(sizes_of(home), jax.random.key(0), hidden=2, width=2)
    about = dict(environment="DuffingPayload", preset="paper", context="hidden", action="impulses")
    save_policy(policy, tmp_path / "p.npz", about)
    found = named_policy(str(tmp_path / "p.npz"), away)
    state, observation = reset(jax.random.key(3), away)
    act = eqx.filter_jit(lambda policy, memory, given: policy.act(memory, given, away, state))
    (_, action), shaper = act(found, found.init(away), observation)
    _, same = act(policy, policy.init(home), np.insert(observation, 16, 0.0))
    np.testing.assert_allclose(action, same, atol=1e-6)
    np.testing.assert_allclose(shaper.times, home.action.shaper(same).times, rtol=1e-5)
    for name, context in (("DuffingPayload", "observed"), ("CranePayload", "hidden")):
        with pytest.raises(ValueError, match=r"p\.npz: is for DuffingPayload, payload hidden; this"):
            named_policy(str(tmp_path / "p.npz"), parameters(name, context=context))


# --- the command ------------------------------------------------------------------------------------------------------


def invoke(*arguments: str):
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, [*arguments])


@pytest.mark.slow
def test_command_writes_what_evaluate_finds(tmp_path):
    out = tmp_path / "out"
    small = ("--episodes", "2", "--seeds", "2", "--out", str(out))
    done = invoke("DuffingPayload", "--policy", "zvd", "--policy", "ei", "--policy", "trained", *small)
    assert done.exit_code == 0, done.output
    assert {p.name for p in out.iterdir()} == {"results.json", "regret.png", "regret.pdf"}
    assert "regret" in done.output
    record = json.loads((out / "results.json").read_text(encoding="utf-8"))
    params = parameters("DuffingPayload")
    policy = fixed_linear(params, "zvd")
    scores = evaluate(policy, params, episodes=2, seeds=2)
    np.testing.assert_allclose(scores.move_time, policy.shaper.times[-1], rtol=1e-6)  # a step takes no time itself
    found = summary(scores)
    np.testing.assert_allclose(record["policies"]["zvd"]["regret"], found["regret"], rtol=1e-4)
    assert record["policies"]["ei"]["regret"][0] != record["policies"]["zvd"]["regret"][0]
    found = summary(evaluate(load_policy("DuffingPayload"), params, episodes=2, seeds=2))
    np.testing.assert_allclose(record["policies"]["trained"]["regret"], found["regret"], rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("Duffing",), "environment"),
        (("DuffingPayload", "--preset", "soft"), "preset"),
        (("DuffingPayload", "--policy", "pid"), "guarded, trained or one of zv"),
        (("DuffingPayload", "--policy", "none.npz"), "none.npz: cannot be read: No such file"),
        (("DuffingPayload", "--context", "noisy", "--policy", "trained"), "no trained policy"),
        (("DuffingPayload", "--seeds", "0"), "--seeds"),
        (("DuffingPayload", "--family", "odd"), "--family must be one of 'none', 'heavier'"),
        (("DuffingPayload", "--context", "noisy", "--policy", "guarded"), "no trained policy"),
    ],
)
def test_command_reports_what_is_wrong_in_a_line(arguments, words, tmp_path):
    done = invoke(*arguments, "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert words in done.output
    assert "Traceback" not in done.output
