/*
 * Policy from jshape: which shaper the next move gets, from what was observed after the last one.
 *
 *     static ${name}_memory memory;
 *     float observation[${NAME}_OBSERVATIONS], action[${NAME}_ACTIONS];
 *
 *     ${name}_start(&memory);                       once, or when the memory is to begin anew
 *     ${name}_step(&memory, observation, action);   before every move
 *
 * Entries of the action lie within [-1, 1], as do those of the observation; one that is not finite counts as 0:
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
    /* What the head acts on: the memory, then the observation. */
    float features[${NAME}_HIDDEN + ${NAME}_OBSERVATIONS], layer[${NAME}_WIDTH];
    float *const input = features + ${NAME}_HIDDEN;
    int i;
    for (i = 0; i < ${NAME}_OBSERVATIONS; i++) {
        const float entry = isfinite(observation[i]) ? observation[i] : 0.0f;
        input[i] = i < ${NAME}_SENSED ? asinhf(${NAME}_GAIN * entry) : entry;
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
        features[i] = n + z * (memory->unit[i] - n);
    }
    for (i = 0; i < ${NAME}_HIDDEN; i++) {
        memory->unit[i] = features[i];
    }
    for (i = 0; i < ${NAME}_WIDTH; i++) {
        layer[i] = tanhf(${name}_bias_layer[i]
            + ${name}_dot(${name}_weight_layer[i], features, ${NAME}_HIDDEN + ${NAME}_OBSERVATIONS));
    }
    for (i = 0; i < ${NAME}_ACTIONS; i++) {
        action[i] = tanhf(${name}_bias_action[i] + ${name}_dot(${name}_weight_action[i], layer, ${NAME}_WIDTH));
    }
}

#endif
