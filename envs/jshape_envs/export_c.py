"""A trained policy as a C99 header for a controller: weights as constants and a step function, no heap.

    Path("policy.h").write_text(policy_to_c(jshape_envs.load_policy("DuffingPayload"), observation_names(params)))

After each move the controller hands over what it observed and is given the action, the shaper of the next one.
Arithmetic is ``float``; the weights are written so that they are read back bit for bit.
"""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from string import Template

import numpy as np

from jshape.export.text import identifier
from jshape_envs.policy import GRUPolicy

TEMPLATE = Path(__file__).parent / "templates" / "policy.h"
"""The header, with ``$names`` to fill in."""


def policy_to_c(policy: GRUPolicy, entries: Sequence[str] = (), name: str = "policy") -> str:
    """The text of the header.

    Args:
        policy: to be written.
        entries: names of the observation's entries, for a comment.
        name: that the type and the functions begin with.

    Raises:
        ValueError: for a name that C does not allow, or another number of entries than the policy has.
    """
    name = identifier(name, "c99")
    sizes = policy.sizes
    if len(entries) not in (0, sizes.observation):
        raise ValueError(f"entries must be {sizes.observation} names, one an observation, not {len(entries)}")
    layer, action = policy.head.layers
    weights = {
        "weight_input": policy.cell.weight_ih,
        "weight_memory": policy.cell.weight_hh,
        "bias": policy.cell.bias,
        "bias_memory": policy.cell.bias_n,
        "weight_layer": layer.weight,
        "bias_layer": layer.bias,
        "weight_action": action.weight,
        "bias_action": action.bias,
    }
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        name=name,
        NAME=name.upper(),
        entries="\n".join(f" *     {i:3d}  {entry}" for i, entry in enumerate(entries)) or " *     (not named)",
        observations=sizes.observation,
        actions=sizes.action,
        hidden=policy.cell.hidden_size,
        width=policy.head.width_size,
        sensed=sizes.sensed,
        gain=f"{np.float32(policy.gain)}f",
        arrays="\n\n".join(_array(f"{name}_{key}", np.asarray(value, np.float32)) for key, value in weights.items()),
    )


def _array(name: str, values: np.ndarray) -> str:
    """A constant array of C, of one or two dimensions; NumPy writes as many digits as are read back bit for bit."""
    shape, lines = "".join(f"[{n}]" for n in values.shape), textwrap.TextWrapper(100, break_on_hyphens=False)
    lines.initial_indent = lines.subsequent_indent = 8 * " "
    rows = [lines.fill(", ".join(f"{value}f" for value in row)) for row in np.atleast_2d(values)]
    body = ",\n".join(f"    {{\n{row}\n    }}" for row in rows) if values.ndim == 2 else rows[0]
    return f"static const float {name}{shape} = {{\n{body}\n}};"
