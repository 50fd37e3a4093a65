"""A guarded policy: a trained one proposes, and a fixed shaper stands in for it while the evidence is against it.

policy = guarded(params, load_policy("DuffingPayload"))
rewards, info = rollout(jax.random.key(0), policy, params, moves=64)
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jshape import Shaper, _check
from jshape._types import Scalar
from jshape.moves import (
    AbstractMachine,
    AbstractPolicy,
    Choice,
    EnvState,
    Observation,
    Params,
    bare_energy_and_oracle_cost,
    bounded_residual,
    plan_move,
    reset,
    run_move,
    run_window,
)
from jshape.moves.retuning import retuned
from jshape_envs.baselines import baseline
from jshape_envs.baselines.model_based import BankState
from jshape_envs.baselines.observed import middle, observed, sensor_deviation
from jshape_envs.baselines.posterior import FixedPayload, Hedge, tuned_shaper
from jshape_envs.evaluate import episode_costs
from jshape_envs.families import Declared, Family, damping, stiffness
from jshape_envs.state_estimation import corrected, predicted_window

PAYLOADS = 41
"""Payloads of the bank, over their declared range and a quarter of it to either side."""
VARIANTS = ((1.0, 1.0), (0.8, 1.0), (0.9, 1.0), (1.12, 1.0), (1.25, 1.0), (1.0, 2.5), (1.0, 0.4))
"""Factors of stiffness and damping (``families``) of the bank's plants; first the declared one."""
BEYOND = 0.1
"""Prior probability of a payload beyond the declared range, and of a stiffness or damping that is not the declared."""
ROBUSTNESSES = (0.0, 0.25, 0.5, 1.0)
"""Of the hedges of the bank's own shaper."""
TOLERANCE = 1e-5
"""Cost a move that a proposal may have beyond the fallback's in the long run; also how fast a debt is forgiven."""
PLAUSIBLE = 2
"""Variants on whose plants all shapers are compared: the most probable ones."""
FORESIGHT = 3.0
"""Weight of a predicted residual beside a paid one: what one move leaves, the next one begins with."""
SPIKE = 10.0
"""Greatest square of a sample, over the median of all, that counts in full; of a vibration it is about two."""
CREDIT = 0.2
"""Greatest sum of costs saved that can be set against later excess."""
DEBTS = (0.0, 0.01, 0.03, 0.1, float("inf"))
"""Debts with which an episode may begin, for ``calibrated`` to choose from; with the last the fallback acts alone."""
COUNTED = 1e-6
"""Least excess of an episode's mean cost that counts: less than that is rounding."""
CALIBRATION_SEED = 2_000_000
"""Far from the seeds of trainings and evaluations."""


class GuardState(NamedTuple):
    """The memory of ``Guard``.

    Attributes:
        proposal: memory of the policy that proposes.
        fallback: memory of the fallback.
        other: memory of the other fixed policy.
        bank: of the bank of plausible plants: the last move, and the plants' probabilities.
        debt: of the proposing policy, of the bank's own shaper and of the other fixed one.
        chosen: who made the last move: 0 the fallback, 1 the proposing policy, 2 the bank, 3 the other fixed shaper.
        saved: what the chosen shaper of the last move cost less than the fallback's by its duration alone.
        residuals: normalised residual energy that the fallback's shaper would have left in the last move, a plant each.
        references: energy by which residuals are normalised in the last move, J, a plant each.
    """

    proposal: Any
    fallback: Any
    other: Any
    bank: BankState
    debt: Float[Array, "3"]
    chosen: Int[Array, ""]
    saved: Scalar
    residuals: Float[Array, " plants"]
    references: Float[Array, " plants"]


class Guard(AbstractPolicy):
    """Switching between a proposing policy and a fallback by conformal control of the cost beyond the fallback's.

    Every plant of a bank (payloads in and beyond the declared range, several stiffnesses and dampings) has a
    probability that follows from how well it explains all samples so far, which correct its state, too
    (``state_estimation``). Before a move, those of the two most probable stiffnesses and dampings predict the cost of
    the proposal, of the fallback, of another fixed shaper and of the bank's own, one of which cancels the vibration
    that is there. A shaper is used in the fallback's place only where its mean predicted cost is less by more than its
    proposer's *debt*. After the move, the samples give the residual that was really left, and the bank, with the last
    window counted, what the fallback would have left. The difference of the two costs is the excess e, and the
    proposer's debt d becomes max(d + e − τ, −``CREDIT``), τ = ``TOLERANCE``; that of a proposer that was not used
    becomes max(d − τ, −``CREDIT``). So a proposer that costs more than it saves is set aside until its debt is
    forgiven, and then it is tried again.

    What is certain, for any sequence of moves, also an adversarial one: each debt is at most the greatest advantage A
    that was ever predicted plus the greatest excess E of one move, so that over T moves the measured excess of each
    proposer is at most τ T + A + E − d₀. Nothing is assumed about plants or payloads, but the excess is the *measured*
    one: the residual comes from noisy samples, the fallback's from the bank, and the fallback's own moves would have
    begun with another vibration. Whether the excess truly paid obeys the bound is earned by measurement alone.

    The first debt d₀ is calibrated: the least one of a list with which, in every declared family of shift, at most 5 %
    of n episodes, counted as (k + 1)/(n + 1), cost more than with the fallback. For a further episode of one of these
    families that is a bound on the probability of costing more, in the mean over calibrations, as far as the share
    falls as the debt grows and the episodes are exchangeable. For a family that was not declared there is none.

    Attributes:
        proposer: proposes a shaper or an action.
        fallback: the fixed classical policy.
        other: another fixed one, which takes its place where it is predicted to be better.
        machines: of the bank, a leaf's first axis over plants: stiffness and damping × payload, flattened.
        payloads: of the bank.
        log_prior: logarithms of the plants' probabilities before the first move.
        debt: at the beginning of an episode.
        impulses: number of impulses of every shaper; those that one lacks are zero.

    Source: Gibbs and Candès (2021), adaptive conformal inference; Lekeufack, Angelopoulos, Bajcsy, Jordan and Malik
    (2024), conformal decision theory, for the update by a cost in the place of coverage. A safe policy that regulates
    an optimised one: conformal policy control (arXiv 2603.02196); switching to it: arXiv 2511.07899.
    """

    proposer: AbstractPolicy
    fallback: AbstractPolicy
    other: AbstractPolicy
    machines: AbstractMachine
    payloads: Float[Array, " plants"]
    log_prior: Float[Array, " plants"]
    debt: Scalar
    impulses: int = eqx.field(static=True)

    def init(self, params: Params) -> GuardState:
        none, zero = jnp.zeros((), jnp.int32), jnp.zeros_like(params.period)
        plant = params.machine.plant(middle(params), none)
        rest = plant.rest_state(plant.zero_inputs()).astype(params.period.dtype)
        empty = jnp.zeros(self.impulses, params.period.dtype)
        shaper = Shaper(empty.at[0].set(1.0), empty)
        bank = BankState(rest, zero, params.distance[0], shaper, self.log_prior, none)
        debt, plants = jnp.full(3, self.debt), jnp.zeros_like(self.payloads)
        memories = self.proposer.init(params), self.fallback.init(params), self.other.init(params)
        return GuardState(*memories, bank, debt, none, zero, plants, plants + 1)

    def act(self, memory: GuardState, observation: Observation, params: Params, state: EnvState) -> Choice:
        samples, distance = observed(observation, params)
        bank, first = memory.bank, memory.bank.made == 0
        windows = self._over_plants(params, lambda p, m: predicted_window(p, bank, m))
        ends, log_likelihood = corrected(params, windows, samples)
        log_posterior = jax.nn.log_softmax(bank.log_prior + jnp.where(first, 0.0, log_likelihood))
        posterior = jnp.exp(log_posterior)
        left = measured_residual(params, samples, windows.deflections, windows.energy / memory.references)
        excess = params.energy_weight * (left - posterior @ memory.residuals) - memory.saved
        used = (memory.chosen == jnp.array([1, 2, 3])) & ~first
        debt = jnp.maximum(memory.debt + jnp.where(used, excess, 0.0) - TOLERANCE, -CREDIT)
        debt = jnp.where(first, memory.debt, debt)

        log_prior = self._before_next(params, log_posterior)
        bank = bank._replace(
            plant=jnp.where(first, bank.plant, posterior @ ends),
            position=jnp.where(first, bank.position, bank.position + bank.distance),
            distance=distance,
            log_prior=log_prior,
        )
        memories, shapers = self._candidates(memory, observation, params, state, bank, log_posterior)
        fallback = jax.tree.map(lambda x: x[:1], shapers)
        residuals, references = self._over_plants(params, lambda p, m: _residuals(p, bank, m, fallback))
        plausible = self._plausible(log_prior)
        predicted, _ = self._over_plants(params, lambda p, m: _residuals(p, bank, m, shapers), plausible)
        times = params.time_weight * shapers.times[:, -1] / params.period
        costs = times + FORESIGHT * params.energy_weight * (jax.nn.softmax(log_prior[plausible]) @ predicted)
        proposer = jnp.array([0, 1, 3] + [2] * (len(ROBUSTNESSES) + 1))
        costs = costs + jnp.concatenate([jnp.zeros(1, debt.dtype), jnp.maximum(debt, 0.0)])[proposer]
        best = jnp.argmin(costs)
        shaper = jax.tree.map(lambda x: x[best], shapers)
        bank = bank._replace(shaper=shaper, made=bank.made + 1)
        chosen = proposer[best].astype(jnp.int32)
        saved = times[0] - times[best]
        return GuardState(*memories, bank, debt, chosen, saved, residuals[:, 0], references), shaper

    def _candidates(
        self, memory: GuardState, observation: Observation, params: Params, state: EnvState, bank: BankState,
        log_posterior: Float[Array, " plants"],
    ) -> tuple[tuple[Any, Any, Any], Shaper]:  # fmt: skip
        """The new memories of proposer, fallback and the other one, and the shapers to choose from: the fallback's, the
        proposal, the other's, the bank's own."""
        ours, fallback = self.fallback.act(memory.fallback, observation, params, state)
        theirs, proposal = self.proposer.act(memory.proposal, observation, params, state)
        others, other = self.other.act(memory.other, observation, params, state)
        nominal = slice(PAYLOADS)
        payload = jax.nn.softmax(log_posterior[nominal]) @ self.payloads[nominal]
        payload = jnp.where(bank.made == 0, middle(params), payload)
        tuned = tuned_shaper(params, payload, bank.distance, bank.made)
        one = jnp.ones_like(params.period)
        made = [_as_shaper(choice, params) for choice in (fallback, proposal, other)]
        made += [Hedge(one, robustness * one).shaper(tuned) for robustness in ROBUSTNESSES]
        made += [self._arresting(params, tuned, bank, log_posterior)]
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *(each.pad(self.impulses) for each in made))
        return (theirs, ours, others), stacked

    def _arresting(
        self, params: Params, tuned: Shaper, bank: BankState, log_posterior: Float[Array, " plants"]
    ) -> Shaper:
        """The shaper near the tuned one that brings the most probable plant to rest from the vibration that is there;
        its amplitudes may be negative."""
        place = jnp.argmax(log_posterior)
        machine = jax.tree.map(lambda x: x[place], self.machines)
        same_variant = log_posterior.reshape(-1, PAYLOADS)[place // PAYLOADS]
        payload = jax.nn.softmax(same_variant) @ self.payloads[:PAYLOADS]
        plant, command = machine.plant(payload, bank.made), machine.command(bank.distance, bank.made)

        def vibration(shaper: Shaper) -> Float[Array, " samples"]:
            plan = plan_move(plant, command, shaper, bank.position)
            after, _ = run_move(plant, plan, bank.plant, params.steps)
            return run_window(plant, plan, after, params.sensor, params.steps)[1]

        found = retuned(vibration, tuned)
        sound = jnp.all(jnp.isfinite(found.amplitudes) & jnp.isfinite(found.times)) & (bank.made > 0)
        return jax.tree.map(partial(jnp.where, sound), found, tuned)

    def _plausible(self, log_prior: Float[Array, " plants"]) -> Int[Array, " plausible"]:
        """Indices of the plants of the most probable variants."""
        _, variants = jax.lax.top_k(jax.nn.logsumexp(log_prior.reshape(-1, PAYLOADS), axis=1), PLAUSIBLE)
        return (PAYLOADS * variants[:, None] + jnp.arange(PAYLOADS)).reshape(-1)

    def _over_plants(
        self, params: Params, of: Callable[[Params, Scalar], Any], places: Int[Array, " some"] | slice = slice(None)
    ) -> Any:
        """A function of params with a plant's machine, and its payload, for every plant of the bank, or some."""

        def one(machine: AbstractMachine, payload: Scalar) -> Any:
            return of(eqx.tree_at(lambda p: p.machine, params, machine), payload)

        return jax.vmap(one)(*jax.tree.map(lambda x: x[places], (self.machines, self.payloads)))

    def _before_next(self, params: Params, log_posterior: Float[Array, " plants"]) -> Float[Array, " plants"]:
        """The plants' probabilities before the next move: the payload may have changed, nothing else has."""
        rows, prior = log_posterior.reshape(-1, PAYLOADS), self.log_prior.reshape(-1, PAYLOADS)[:1]
        drawn = jax.nn.logsumexp(rows, axis=1, keepdims=True) + jax.nn.log_softmax(prior, axis=1)
        return jnp.logaddexp(jnp.log1p(-params.change_rate) + rows, jnp.log(params.change_rate) + drawn).reshape(-1)


def guarded(
    params: Params,
    proposer: AbstractPolicy,
    fallback: AbstractPolicy | None = None,
    debt: float = DEBTS[0],
    other: AbstractPolicy | None = None,
) -> Guard:
    """A proposing policy with a guard, for an environment whose plant's model is known.

    Args:
        params: the environment as it is declared; samples must be observed, not features.
        proposer: a trained policy, say.
        fallback: the best fixed energy shaper (``baselines.BASELINES``) unless given.
        debt: at the beginning of an episode: 0 trusts the proposer at once; infinity never does.
        other: a fixed policy to choose from beside the fallback; the best fixed linear shaper unless given.

    Raises:
        ValueError: for a negative debt, or a policy that does not fit the environment.
    """
    if not debt >= 0:
        raise ValueError(f"debt must not be negative, not {debt}")
    other = baseline("best-fixed", params) if other is None else other
    fallback = baseline("best-energy", params) if fallback is None else fallback
    (least, greatest), dtype = np.asarray(params.payload, float), params.period.dtype
    quarter = (greatest - least) / 4
    payloads = np.linspace(max(least - quarter, least / 2), greatest + quarter, PAYLOADS)
    inside = (payloads >= least) & (payloads <= greatest)
    over_payloads = np.where(inside, (1 - BEYOND) / inside.sum(), BEYOND / (~inside).sum())
    variants = [damping(stiffness(params, stiff, stiff), damped).machine for stiff, damped in VARIANTS]
    over_variants = np.where(np.arange(len(VARIANTS)) == 0, 1 - BEYOND, BEYOND / (len(VARIANTS) - 1))
    policies = proposer, fallback, other, FixedPayload(middle(params), Hedge(params.period, params.period))
    impulses = [_impulses(policy, params) for policy in policies]
    return Guard(
        proposer,
        fallback,
        other,
        jax.tree.map(lambda *x: jnp.repeat(jnp.stack(x), PAYLOADS, axis=0), *variants),
        jnp.tile(jnp.asarray(payloads, dtype), len(VARIANTS)),
        jnp.asarray(np.log(np.outer(over_variants, over_payloads)).reshape(-1), dtype),
        jnp.asarray(debt, dtype),
        max(impulses),
    )


def calibrated(
    guard: Guard, params: Params, families: Mapping[str, Family], share: float = 0.05, episodes: int = 64
) -> Guard:
    """The guard with the least of ``DEBTS`` with which few episodes of any family cost more than with the fallback.

    Args:
        guard: for the declared environment.
        params: the declared environment.
        families: of shift, by name; see ``families``.
        share: of the episodes, (k + 1)/(n + 1) for k of n.
        episodes: number n in each family.

    Raises:
        ValueError: for a share outside (0, 1), or too few episodes to show it.
    """
    episodes = _check.count(episodes, "episodes")
    if not 1 / (episodes + 1) <= share < 1:
        raise ValueError(f"share must lie between 1/(episodes + 1) = {1 / (episodes + 1):.3g} and 1, not {share}")
    keys = jax.random.split(jax.random.key(CALIBRATION_SEED), episodes)
    rest = [family(params) for family in families.values()]
    limits = [episode_costs(keys, Declared(guard.fallback, params), true)[0] + COUNTED for true in rest]
    order = list(range(len(rest)))
    for debt in DEBTS:
        guard = eqx.tree_at(lambda g: g.debt, guard, jnp.asarray(debt, guard.debt.dtype))
        for each in order:
            costs, _ = episode_costs(keys, Declared(guard, params), rest[each])
            if 1 + np.sum(costs > limits[each]) > share * (episodes + 1):
                # The next debt is tried on this family first: most likely to fail again, which saves the others.
                order = [each, *(other for other in order if other != each)]
                break
        else:
            break
    return guard


def measured_residual(
    params: Params,
    samples: Float[Array, " samples"],
    deflections: Float[Array, "plants samples"],
    residuals: Float[Array, " plants"],
) -> Scalar:
    """The normalised residual energy of the last move by its samples, at most ``DIVERGED_RESIDUAL``.

    The mean square of the samples, spikes clipped, less the sensor's noise, times the ratio of energy to mean square
    that the plants of the bank have on average, those that vibrate most above all. So it does not depend on which of
    them is the true one.

    Args:
        params: the environment.
        samples: of the deflection, m.
        deflections: that the plants predict, m.
        residuals: that they predict, normalised.
    """
    squares = jnp.mean(deflections**2, axis=1)
    valid = jnp.isfinite(squares) & jnp.isfinite(residuals)
    ratio = jnp.sum(jnp.where(valid, residuals, 0.0)) / jnp.maximum(jnp.sum(jnp.where(valid, squares, 0.0)), 1e-20)
    typical = jnp.minimum(samples**2, SPIKE * jnp.median(samples**2))
    power = jnp.maximum(jnp.mean(typical) - sensor_deviation(params) ** 2, 0.0)
    return bounded_residual(ratio * power, jnp.ones_like(power), jnp.zeros((), bool))


def _residuals(
    params: Params, bank: BankState, payload: Scalar, shapers: Shaper
) -> tuple[Float[Array, " shapers"], Scalar]:
    """The normalised residual energy of each shaper in the next move with that payload, and the energy of 1, J."""
    machine = params.machine
    plant, command = machine.plant(payload, bank.made), machine.command(bank.distance, bank.made)
    before = EnvState(bank.plant, bank.position, bank.distance, payload, bank.made, bank.made)
    reference, _ = bare_energy_and_oracle_cost(before, params)

    def one(shaper: Shaper) -> Scalar:
        _, energy = run_move(plant, plan_move(plant, command, shaper, bank.position), bank.plant, params.steps)
        return bounded_residual(energy, reference, ~jnp.isfinite(energy))

    return jax.vmap(one)(shapers), reference


def _as_shaper(choice: Any, params: Params) -> Shaper:
    """The shaper that a policy has chosen, by itself or by an action."""
    return choice if isinstance(choice, Shaper) else params.action.shaper(choice)


def _impulses(policy: AbstractPolicy, params: Params) -> int:
    """The number of impulses of a policy's shapers."""

    def first(key: PRNGKeyArray) -> Shaper:
        state, observation = reset(key, params)
        return _as_shaper(policy.act(policy.init(params), observation, params, state)[1], params)

    return len(eqx.filter_eval_shape(first, jax.random.key(0)).times)
