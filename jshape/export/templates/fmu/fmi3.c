/*
 * The functions of FMI 3.0, for model exchange and co-simulation, over core.h. Value references: 0 the time, then the
 * real variables, then the switches.
 */
#include <stdbool.h>
#include <stdint.h>

#include "core.h"

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef const char *fmi3String;
typedef const uint8_t *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessage)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3Callback)(void);

/* A function that this unit does not serve. */
#define ABSENT(name, ...) \
    EXPORT fmi3Status name(fmi3Instance c, __VA_ARGS__) { return fmi3Error; }

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, bool on, size_t n, const fmi3String categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

static fmi3Instance instantiate(fmi3String token, fmi3InstanceEnvironment environment, fmi3LogMessage log) {
    Model *m;
    if (!token || strcmp(token, MODEL_TOKEN) != 0) {
        if (log) {
            log(environment, fmi3Error, "logStatusError", "the instantiation token is not that of this unit");
        }
        return NULL;
    }
    m = malloc(sizeof *m);
    if (m) {
        model_reset(m);
    }
    return m;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, bool visible,
                                                 bool on, fmi3InstanceEnvironment environment, fmi3LogMessage log) {
    (void)name, (void)resources, (void)visible, (void)on;
    return instantiate(token, environment, log);
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, bool visible,
                                                bool on, bool events, bool early, const fmi3ValueReference needed[],
                                                size_t n, fmi3InstanceEnvironment environment, fmi3LogMessage log,
                                                fmi3Callback update) {
    (void)name, (void)resources, (void)visible, (void)on, (void)early, (void)needed, (void)update;
    return events || n ? NULL : instantiate(token, environment, log);
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                      bool visible, bool on, fmi3InstanceEnvironment environment,
                                                      fmi3LogMessage log, fmi3Callback update, fmi3Callback lock,
                                                      fmi3Callback unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)on, (void)environment, (void)log;
    (void)update, (void)lock, (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance c) { free(c); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool given, double tolerance, double start, bool ends,
                                              double stop) {
    Model *m = c;
    (void)ends, (void)stop;
    m->time = m->origin = start;
    /* As asked for, or finer: a loose tolerance of a solver around is none of the plant's. */
    m->tolerance = given && tolerance > 0 && tolerance < m->tolerance ? tolerance : m->tolerance;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    own_begin(c);
    return fmi3OK;
}

#define NOTHING(name)                          \
    EXPORT fmi3Status name(fmi3Instance c) {   \
        (void)c;                               \
        return fmi3OK;                         \
    }
NOTHING(fmi3EnterEventMode)
NOTHING(fmi3Terminate)
NOTHING(fmi3EnterConfigurationMode)
NOTHING(fmi3ExitConfigurationMode)
NOTHING(fmi3EnterContinuousTimeMode)
NOTHING(fmi3EnterStepMode)
NOTHING(fmi3EvaluateDiscreteStates)

EXPORT fmi3Status fmi3Reset(fmi3Instance c) {
    model_reset(c);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t n, double values[],
                                 size_t count) {
    Model *m = c;
    size_t i;
    own_outputs(m);
    for (i = 0; i < n; ++i) {
        if (references[i] > N_REAL || count != n) {
            return fmi3Error;
        }
        values[i] = references[i] ? m->real[references[i] - 1] : m->time;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t n,
                                 const double values[], size_t count) {
    Model *m = c;
    size_t i;
    for (i = 0; i < n; ++i) {
        if (!references[i] || references[i] > N_SETTABLE || count != n) {
            return fmi3Error;
        }
        m->real[references[i] - 1] = values[i];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference references[], size_t n, bool values[],
                                 size_t count) {
    Model *m = c;
    size_t i;
    for (i = 0; i < n; ++i) {
        if (references[i] <= N_REAL || references[i] > N_REAL + N_BOOLEAN || count != n) {
            return fmi3Error;
        }
        values[i] = m->boolean[references[i] - N_REAL - 1] != 0;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference references[], size_t n, const bool values[],
                                 size_t count) {
    Model *m = c;
    size_t i;
    for (i = 0; i < n; ++i) {
        if (references[i] <= N_REAL || references[i] > N_REAL + N_BOOLEAN || count != n) {
            return fmi3Error;
        }
        m->boolean[references[i] - N_REAL - 1] = values[i];
    }
    return fmi3OK;
}

#define NONE(kind, type)                                                                                           \
    ABSENT(fmi3Get##kind, const fmi3ValueReference references[], size_t n, type values[], size_t count)            \
    ABSENT(fmi3Set##kind, const fmi3ValueReference references[], size_t n, const type values[], size_t count)
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(String, fmi3String)
ABSENT(fmi3GetBinary, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary values[], size_t count)
ABSENT(fmi3SetBinary, const fmi3ValueReference r[], size_t n, const size_t s[], const fmi3Binary v[], size_t count)
ABSENT(fmi3GetClock, const fmi3ValueReference references[], size_t n, bool values[])
ABSENT(fmi3SetClock, const fmi3ValueReference references[], size_t n, const bool values[])
ABSENT(fmi3GetNumberOfVariableDependencies, fmi3ValueReference reference, size_t *n)
ABSENT(fmi3GetVariableDependencies, fmi3ValueReference dependent, size_t elements[], fmi3ValueReference independents[],
       size_t others[], int kinds[], size_t n)
ABSENT(fmi3SerializedFMUStateSize, fmi3FMUState state, size_t *size)
ABSENT(fmi3SerializeFMUState, fmi3FMUState state, uint8_t bytes[], size_t size)
ABSENT(fmi3DeserializeFMUState, const uint8_t bytes[], size_t size, fmi3FMUState *state)
ABSENT(fmi3GetDirectionalDerivative, const fmi3ValueReference unknown[], size_t unknowns,
       const fmi3ValueReference known[], size_t knowns, const double seed[], size_t n, double values[], size_t count)
ABSENT(fmi3GetAdjointDerivative, const fmi3ValueReference unknown[], size_t unknowns,
       const fmi3ValueReference known[], size_t knowns, const double seed[], size_t n, double values[], size_t count)
ABSENT(fmi3GetIntervalDecimal, const fmi3ValueReference references[], size_t n, double values[], int kinds[])
ABSENT(fmi3GetIntervalFraction, const fmi3ValueReference references[], size_t n, uint64_t counters[],
       uint64_t resolutions[], int kinds[])
ABSENT(fmi3GetShiftDecimal, const fmi3ValueReference references[], size_t n, double values[])
ABSENT(fmi3GetShiftFraction, const fmi3ValueReference references[], size_t n, uint64_t a[], uint64_t b[])
ABSENT(fmi3SetIntervalDecimal, const fmi3ValueReference references[], size_t n, const double values[])
ABSENT(fmi3SetIntervalFraction, const fmi3ValueReference references[], size_t n, const uint64_t a[], const uint64_t b[])
ABSENT(fmi3SetShiftDecimal, const fmi3ValueReference references[], size_t n, const double values[])
ABSENT(fmi3SetShiftFraction, const fmi3ValueReference references[], size_t n, const uint64_t a[], const uint64_t b[])
ABSENT(fmi3GetOutputDerivatives, const fmi3ValueReference references[], size_t n, const int32_t orders[],
       double values[], size_t count)
ABSENT(fmi3ActivateModelPartition, fmi3ValueReference clock, double time)

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    if (!*state) {
        *state = malloc(sizeof(Model));
    }
    if (!*state) {
        return fmi3Error;
    }
    memcpy(*state, c, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    memcpy(c, state, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

/* Model exchange. */

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, bool *again, bool *terminate, bool *nominals, bool *values,
                                           bool *defined, double *next) {
    Model *m = c;
    if (own_next(m) <= m->time + 1e-4 * own_interval()) {
        own_event(m);
    }
    *again = *terminate = *nominals = *values = false;
    *defined = own_next(m) < HUGE_VAL;
    *next = *defined ? own_next(m) : 0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, bool final, bool *event, bool *terminate) {
    (void)c, (void)final;
    *event = *terminate = false;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetTime(fmi3Instance c, double time) {
    ((Model *)c)->time = time;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance c, const double x[], size_t n) {
    Model *m = c;
    if (n != N_STATE) {
        return fmi3Error;
    }
    memcpy(m->real + FIRST_STATE, x, n * sizeof *x);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetContinuousStates(fmi3Instance c, double x[], size_t n) {
    Model *m = c;
    if (n != N_STATE) {
        return fmi3Error;
    }
    memcpy(x, m->real + FIRST_STATE, n * sizeof *x);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, double derivatives[], size_t n) {
    Model *m = c;
    if (n != N_STATE) {
        return fmi3Error;
    }
    own_derivatives(m, m->real + FIRST_STATE, derivatives);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance c, double indicators[], size_t n) {
    (void)c, (void)indicators;
    return n ? fmi3Error : fmi3OK;
}

EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, double nominals[], size_t n) {
    size_t i;
    (void)c;
    for (i = 0; i < n; ++i) {
        nominals[i] = 1;
    }
    return n == N_STATE ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
    (void)c;
    *n = 0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
    (void)c;
    *n = N_STATE;
    return fmi3OK;
}

/* Co-simulation. */

EXPORT fmi3Status fmi3DoStep(fmi3Instance c, double time, double step, bool final, bool *event, bool *terminate,
                             bool *early, double *reached) {
    Model *m = c;
    const int done = step >= 0 && model_step(m, time, step);
    (void)final;
    *event = *terminate = *early = false;
    *reached = m->time;
    return done ? fmi3OK : fmi3Error;
}
