/*
 * The functions of FMI 2.0, for model exchange and co-simulation, over core.h.
 */
#include "core.h"

typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef void *fmi2ComponentEnvironment;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment environment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded;
    fmi2Boolean terminateSimulation;
    fmi2Boolean nominalsOfContinuousStatesChanged;
    fmi2Boolean valuesOfContinuousStatesChanged;
    fmi2Boolean nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

#define REFERENCES(count)                          \
    size_t i;                                      \
    for (i = 0; i < n; ++i) {                      \
        if (references[i] >= (unsigned)(count)) {  \
            return fmi2Error;                      \
        }                                          \
    }

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                                     const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean on) {
    Model *m;
    (void)type, (void)resources, (void)visible, (void)on;
    if (!token || strcmp(token, MODEL_TOKEN) != 0) {
        if (functions && functions->logger) {
            functions->logger(functions->environment, name, fmi2Error, "logStatusError", "%s",
                              "the GUID is not that of this unit");
        }
        return NULL;
    }
    m = malloc(sizeof *m);
    if (m) {
        model_reset(m);
    }
    return m;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean ends, fmi2Real stop) {
    Model *m = c;
    (void)ends, (void)stop;
    m->time = m->origin = start;
    /* As asked for, or finer: a loose tolerance of a solver around is none of the plant's. */
    m->tolerance = given && tolerance > 0 && tolerance < m->tolerance ? tolerance : m->tolerance;
    return fmi2OK;
}

#define NOTHING(name)                           \
    EXPORT fmi2Status name(fmi2Component c) {   \
        (void)c;                                \
        return fmi2OK;                          \
    }
NOTHING(fmi2EnterInitializationMode)
NOTHING(fmi2Terminate)
NOTHING(fmi2EnterEventMode)
NOTHING(fmi2EnterContinuousTimeMode)

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    own_begin(c);
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    model_reset(c);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2Real values[]) {
    Model *m = c;
    REFERENCES(N_REAL)
    own_outputs(m);
    for (i = 0; i < n; ++i) {
        values[i] = m->real[references[i]];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t n,
                              const fmi2Real values[]) {
    Model *m = c;
    REFERENCES(N_SETTABLE)
    for (i = 0; i < n; ++i) {
        m->real[references[i]] = values[i];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                 fmi2Boolean values[]) {
    Model *m = c;
    REFERENCES(N_BOOLEAN)
    for (i = 0; i < n; ++i) {
        values[i] = m->boolean[references[i]];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                 const fmi2Boolean values[]) {
    Model *m = c;
    REFERENCES(N_BOOLEAN)
    for (i = 0; i < n; ++i) {
        m->boolean[references[i]] = values[i] != 0;
    }
    return fmi2OK;
}

#define NONE(name, qualifier, type)                                                                    \
    EXPORT fmi2Status name(fmi2Component c, const fmi2ValueReference references[], size_t n,           \
                           qualifier type values[]) {                                                  \
        (void)c, (void)references, (void)values;                                                       \
        return n ? fmi2Error : fmi2OK;                                                                 \
    }
NONE(fmi2GetInteger, , fmi2Integer)
NONE(fmi2SetInteger, const, fmi2Integer)
NONE(fmi2GetString, , fmi2String)
NONE(fmi2SetString, const, fmi2String)

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state) {
        *state = malloc(sizeof(Model));
    }
    if (!*state) {
        return fmi2Error;
    }
    memcpy(*state, c, sizeof(Model));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(c, state, sizeof(Model));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* A function that this unit does not serve. */
#define ABSENT(name, ...) \
    EXPORT fmi2Status name(fmi2Component c, __VA_ARGS__) { return fmi2Error; }
ABSENT(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
ABSENT(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
ABSENT(fmi2DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
ABSENT(fmi2GetDirectionalDerivative, const fmi2ValueReference unknown[], size_t unknowns,
       const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[], fmi2Real values[])

/* Model exchange. */

EXPORT fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    Model *m = c;
    if (own_next(m) <= m->time + 1e-4 * own_interval()) {
        own_event(m);
    }
    memset(info, 0, sizeof *info);
    info->nextEventTimeDefined = own_next(m) < HUGE_VAL;
    info->nextEventTime = info->nextEventTimeDefined ? own_next(m) : 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *event,
                                              fmi2Boolean *terminate) {
    (void)c, (void)final;
    *event = *terminate = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    ((Model *)c)->time = time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    Model *m = c;
    if (n != N_STATE) {
        return fmi2Error;
    }
    memcpy(m->real + FIRST_STATE, x, n * sizeof *x);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    Model *m = c;
    if (n != N_STATE) {
        return fmi2Error;
    }
    memcpy(x, m->real + FIRST_STATE, n * sizeof *x);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t n) {
    Model *m = c;
    if (n != N_STATE) {
        return fmi2Error;
    }
    own_derivatives(m, m->real + FIRST_STATE, derivatives);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n) {
    (void)c, (void)indicators;
    return n ? fmi2Error : fmi2OK;
}

EXPORT fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n) {
    size_t i;
    (void)c;
    for (i = 0; i < n; ++i) {
        nominals[i] = 1;
    }
    return n == N_STATE ? fmi2OK : fmi2Error;
}

/* Co-simulation. */

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                              const fmi2Integer orders[], const fmi2Real values[]) {
    (void)c, (void)references, (void)orders, (void)values;
    return n ? fmi2Error : fmi2OK;
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                               const fmi2Integer orders[], fmi2Real values[]) {
    (void)c, (void)references, (void)orders, (void)values;
    return n ? fmi2Error : fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    (void)final;
    return step >= 0 && model_step(c, time, step) ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }

#define STATUS(name, type)                                               \
    EXPORT fmi2Status name(fmi2Component c, int kind, type *value) {     \
        (void)c, (void)kind, (void)value;                                \
        return fmi2Discard;                                              \
    }
STATUS(fmi2GetStatus, fmi2Status)
STATUS(fmi2GetRealStatus, fmi2Real)
STATUS(fmi2GetIntegerStatus, fmi2Integer)
STATUS(fmi2GetBooleanStatus, fmi2Boolean)
STATUS(fmi2GetStringStatus, fmi2String)
