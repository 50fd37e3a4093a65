"""Baselines, policies without training: fixed shapers, adaptive ones and oracles, under one interface::

    policy = baseline("model-bank", params)
    rewards, info = rollout(jax.random.key(0), policy, params, moves=64)

Where a family leaves something open (how robust a shaper is, for one), the best choice for the params' own payloads and
moves is made, on episodes of its own.

- ``fixed``: shapers designed once.
- ``direct``: linear shapers for the frequencies measured last.
- ``frequency``: how these are measured.
- ``amplitude_aware``: the payload of a nonlinear plant from frequency and amplitude.
- ``model_based``: a bank of models, weighed by their errors.
- ``posterior``: shapers for an estimated payload.
- ``observed``: an observation in SI units, and what is known before.
- ``best``: the best of many candidates.
- ``oracles``: policies that read the hidden state.
"""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.moves import AbstractPolicy, Params
from jshape.plants import AbstractOscillator
from jshape_envs.baselines.amplitude_aware import AmplitudeAware, amplitude_aware
from jshape_envs.baselines.best import best_of, scales
from jshape_envs.baselines.direct import DirectAdaptive, FrequencyTracker, direct_adaptive, frequency_tracker
from jshape_envs.baselines.fixed import Fixed, FixedEnergy, fixed_energy, fixed_linear
from jshape_envs.baselines.model_based import ModelBased, model_based
from jshape_envs.baselines.observed import evenly, middle
from jshape_envs.baselines.oracles import FullOracle, Oracle
from jshape_envs.baselines.posterior import FixedPayload, Hedge, hedges

__all__ = ["BASELINES", "AmplitudeAware", "DirectAdaptive", "Fixed", "FixedEnergy", "FixedPayload"]
__all__ += ["FrequencyTracker", "FullOracle", "Hedge", "ModelBased", "Oracle", "amplitude_aware", "applicable"]
__all__ += ["baseline", "best_of", "direct_adaptive", "fixed_energy", "fixed_linear", "frequency_tracker"]
__all__ += ["model_based"]

_ZETAS = (0.0, 0.05)


def baseline(name: str, params: Params) -> AbstractPolicy:
    """The baseline of that name for an environment; ``BASELINES`` lists them.

    Raises:
        ValueError: for an unknown name, and for ``"energy"`` where the plant has no energy shaper.
    """
    _check.one_of(name, "baseline", tuple(BASELINES))
    return BASELINES[name](params)


def applicable(params: Params) -> list[str]:
    """The names of the baselines that the environment has."""
    plant = params.machine.plant(middle(params), jnp.zeros((), jnp.int32))
    return [name for name in BASELINES if name != "energy" or isinstance(plant, AbstractOscillator)]


def _best_fixed(params: Params) -> AbstractPolicy:
    kinds = ("zv", "zvd", "ei")
    return best_of([fixed_linear(params, k, s, z) for k in kinds for s in scales(params) for z in _ZETAS], params)


def _best_energy(params: Params) -> AbstractPolicy:
    payloads = np.asarray(evenly(params.payload, 9))
    tuned = [FixedPayload(jnp.asarray(p, params.period.dtype), h) for p in payloads[1:-1] for h in hedges(params)]
    closed_forms = (1, 2) if "energy" in applicable(params) else ()
    return best_of([*tuned, *(fixed_energy(params, rests, p) for rests in closed_forms for p in payloads)], params)


def _best_tracker(params: Params) -> AbstractPolicy:
    return best_of([frequency_tracker(params, k, s) for k in ("zv", "zvd") for s in scales(params)], params)


def _best_seeking(params: Params) -> AbstractPolicy:
    return best_of([direct_adaptive(params, seeks=True, scale=s) for s in scales(params)], params)


def _hedged(policy: AmplitudeAware | ModelBased, params: Params) -> AbstractPolicy:
    """The policy with the hedge that serves it best."""
    return best_of([eqx.tree_at(lambda p: p.hedge, policy, hedge) for hedge in hedges(params)], params, episodes=8)


BASELINES: dict[str, Callable[[Params], AbstractPolicy]] = {
    "zv": partial(fixed_linear, kind="zv"),
    "zvd": partial(fixed_linear, kind="zvd"),
    "ei": partial(fixed_linear, kind="ei"),
    "best-fixed": _best_fixed,
    "energy": fixed_energy,
    "best-energy": _best_energy,
    "i-d": direct_adaptive,
    "i-d-e": partial(direct_adaptive, seeks=True),
    "i-d-e-scaled": _best_seeking,
    "tracker": _best_tracker,
    "amplitude-aware": lambda params: _hedged(amplitude_aware(params), params),
    "model-bank": lambda params: _hedged(model_based(params), params),
    "oracle": lambda params: Oracle(),
    "full-oracle": lambda params: FullOracle(),
}
"""The baselines by their names. Fixed: ``zv``, ``zvd``, ``ei`` for the middle payload at rest; ``best-fixed``, the best
of them at any frequency and damping; ``energy``, the three-impulse energy shaper for the middle payload and the move's
size; ``best-energy``, the best of the energy shapers and the oracle's own, hedged, for any one payload. Adaptive:
``i-d``, ``i-d-e``, the paper's; ``i-d-e-scaled``, with the best factor between the measured frequency and the shaper's;
``tracker``, a fit of sines, the best factor and kind of shaper; ``amplitude-aware`` and ``model-bank``, which know the
plant's model, with the hedge that serves them best. And two that read the hidden state: ``oracle`` the payload,
with shapers for rest; ``full-oracle`` the plant's state, too."""
