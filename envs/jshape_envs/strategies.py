"""The strategies of an environment by name: its baselines, the policy that comes with jshape, the same with a guard."""

from jshape import _check
from jshape.moves import AbstractPolicy, Params
from jshape_envs.baselines import applicable, baseline
from jshape_envs.evaluate import named_policy
from jshape_envs.guard import guarded
from jshape_envs.policy import policy_file


def strategies(environment: str, params: Params) -> list[str]:
    """The names of the strategies that an environment has.

    Args:
        environment: its name.
        params: of it.
    """
    shipped = policy_file(environment, context=params.context).exists()
    return [*applicable(params), *(["trained", "guarded"] if shipped else [])]


def strategy(name: str, environment: str, params: Params) -> AbstractPolicy:
    """A strategy of an environment.

    Args:
        name: one of ``strategies``.
        environment: its name.
        params: of it.

    Raises:
        ValueError: for another name.
    """
    _check.one_of(name, "strategy", tuple(strategies(environment, params)))
    if name not in ("trained", "guarded"):
        return baseline(name, params)
    trained = named_policy(str(policy_file(environment, context=params.context)), params)
    return trained if name == "trained" else guarded(params, trained)
