"""A trained policy as a C99 header for a controller: weights as constants and a step function, no heap.

    Path("policy.h").write_text(policy_to_c(jshape_envs.load_policy("DuffingPayload"), observation_names(params)))

After each move the controller hands over what it observed and is given the action that tells the next one's shaper.
Arithmetic is ``float``; the weights are written so that they are read back bit for bit.
"""

from collections.abc import Sequence
from string import Template

import numpy as np

from jshape.export.text import identifier
from jshape_envs.policy import GRUPolicy

_HEADER = Template("""\
/*
 * Policy from jshape: which shaper the next move gets, from what was observed after the last one.
 *
 *     static ${name}_memory memory;
 *     float observation[${NAME}_OBSERVATIONS], action[${NAME}_ACTIONS];
 *
 *     ${name}_start(&memory);                       once, or when everything is forgotten
 *     ${name}_step(&memory, observation, action);   before every move
 *
 * Entries of the action lie within [-1, 1], as do those of the observation:
 *
$entries
 */
#ifndef ${NAME}_H
#define ${NAME}_H

#include <math.h>

#define ${NAME}_OBSERVATIONS $observations
#define ${NAME}_ACTIONS $actions
#define ${NAME}_HIDDEN $hidden
#define ${NAME}_WIDTH $width
#define ${NAME}_SENSED $sensed /* entries that are spread by asinh(${NAME}_GAIN x) */
#define ${NAME}_GAIN $gain

typedef struct {
    float unit[${NAME}_HIDDEN];
} ${name}_memory;

$arrays

static float ${name}_dot(const float *weights, const float *values, int count)
{
    float sum = 0.0f;
    int i;
    for (i = 0; i < count; i++) {
        sum += weights[i] * values[i];
    }
    return sum;
}

static float ${name}_sigmoid(float x)
{
    return 0.5f + 0.5f * tanhf(0.5f * x);
}

static void ${name}_start(${name}_memory *memory)
{
    int i;
    for (i = 0; i < ${NAME}_HIDDEN; i++) {
        memory->unit[i] = 0.0f;
    }
}

static void ${name}_step(${name}_memory *memory, const float *observation, float *action)
{
    /* What the head sees: the memory, then the observation. */
    float seen[${NAME}_HIDDEN + ${NAME}_OBSERVATIONS], layer[${NAME}_WIDTH];
    float *const input = seen + ${NAME}_HIDDEN;
    int i;
    for (i = 0; i < ${NAME}_OBSERVATIONS; i++) {
        input[i] = i < ${NAME}_SENSED ? asinhf(${NAME}_GAIN * observation[i]) : observation[i];
    }
    for (i = 0; i < ${NAME}_HIDDEN; i++) {
        const int update = i + ${NAME}_HIDDEN, candidate = update + ${NAME}_HIDDEN;
        const float r = ${name}_sigmoid(${name}_bias[i]
            + ${name}_dot(${name}_weight_input[i], input, ${NAME}_OBSERVATIONS)
            + ${name}_dot(${name}_weight_memory[i], memory->unit, ${NAME}_HIDDEN));
        const float z = ${name}_sigmoid(${name}_bias[update]
            + ${name}_dot(${name}_weight_input[update], input, ${NAME}_OBSERVATIONS)
            + ${name}_dot(${name}_weight_memory[update], memory->unit, ${NAME}_HIDDEN));
        const float n = tanhf(${name}_bias[candidate]
            + ${name}_dot(${name}_weight_input[candidate], input, ${NAME}_OBSERVATIONS)
            + r * (${name}_bias_memory[i]
                + ${name}_dot(${name}_weight_memory[candidate], memory->unit, ${NAME}_HIDDEN)));
        seen[i] = n + z * (memory->unit[i] - n);
    }
    for (i = 0; i < ${NAME}_HIDDEN; i++) {
        memory->unit[i] = seen[i];
    }
    for (i = 0; i < ${NAME}_WIDTH; i++) {
        layer[i] = tanhf(${name}_bias_layer[i]
            + ${name}_dot(${name}_weight_layer[i], seen, ${NAME}_HIDDEN + ${NAME}_OBSERVATIONS));
    }
    for (i = 0; i < ${NAME}_ACTIONS; i++) {
        action[i] = tanhf(${name}_bias_action[i] + ${name}_dot(${name}_weight_action[i], layer, ${NAME}_WIDTH));
    }
}

#endif
""")


def policy_to_c(policy: GRUPolicy, entries: Sequence[str] = (), name: str = "policy") -> str:
    """The header. ``entries``: what the observation's entries are called, for its comment; ``name``: what the type and
    functions begin with.

    *Raises* ``ValueError`` for a name that C does not allow, or another number of entries than the policy has.
    """
    name = identifier(name, "c99")
    sizes = policy.sizes
    if len(entries) not in (0, sizes.observation):
        raise ValueError(f"entries must tell of each of {sizes.observation} observations, not of {len(entries)}")
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
    return _HEADER.substitute(
        name=name,
        NAME=name.upper(),
        entries="\n".join(f" *     {i:3d}  {entry}" for i, entry in enumerate(entries)) or " *     (not named)",
        observations=sizes.observation,
        actions=sizes.action,
        hidden=policy.cell.hidden_size,
        width=policy.head.width_size,
        sensed=sizes.sensed,
        gain=_literal(np.float32(policy.gain)),
        arrays="\n\n".join(_array(f"{name}_{key}", np.asarray(value, np.float32)) for key, value in weights.items()),
    )


def _array(name: str, values: np.ndarray) -> str:
    shape = "".join(f"[{n}]" for n in values.shape)
    rows = values if values.ndim == 2 else values[None]
    lines = [_wrapped([_literal(x) for x in row]) for row in rows]
    body = ",\n".join(f"    {{\n{line}\n    }}" for line in lines) if values.ndim == 2 else lines[0]
    return f"static const float {name}{shape} = {{\n{body}\n}};"


def _wrapped(items: list[str], each: int = 6) -> str:
    rows = [", ".join(items[i : i + each]) for i in range(0, len(items), each)]
    return ",\n".join(f"        {row}" for row in rows)


def _literal(value: np.float32) -> str:
    # Nine digits tell a float exactly.
    text = f"{value:.9g}"
    return f"{text}f" if any(c in text for c in ".e") else f"{text}.0f"
