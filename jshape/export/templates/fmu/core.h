/*
 * What a functional mock-up unit of jshape does, whatever the version of the interface: time, samples, integration.
 *
 * model.h gives the numbers N_REAL, N_BOOLEAN and N_STATE, the type Own and six functions:
 *     own_reset(m)            start values
 *     own_begin(m)            the end of the initialisation
 *     own_outputs(m)          outputs and derivatives from states and inputs
 *     own_next(m)             the time of the next sample, HUGE_VAL if there is none
 *     own_interval()          between samples, 0 if there are none
 *     own_event(m)            the sample that is due
 *     own_derivatives(m, x, dx)
 */
#ifndef JSHAPE_FMU_CORE_H
#define JSHAPE_FMU_CORE_H

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef struct Model Model;

#include "model.h"

struct Model {
    double time;                 /* s */
    double origin;               /* s, where the experiment began */
    double tolerance;            /* of the integration, relative */
    double step;                 /* s, the last one of the integration */
    double real[N_REAL];         /* by value reference */
    int boolean[N_BOOLEAN + 1];  /* likewise */
    unsigned long samples;       /* made so far */
    int begun;                   /* whether the initialisation has ended, for a shaper */
    Own own;
};

#include "equations.h"

/* Integrates the states to a time, inputs held, by Dormand and Prince's pair of orders 5 and 4. 0: they diverge. */
#if N_STATE > 0
static int model_integrate(Model *m, double until) {
    static const double a[7][6] = {
        {0},
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {44.0 / 45, -56.0 / 15, 32.0 / 9},
        {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
        {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
        {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
    static const double e[7] = {71.0 / 57600,     0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200,
                                22.0 / 525, -1.0 / 40};
    double *x = m->real + FIRST_STATE;
    double k[7][N_STATE], y[N_STATE];
    int i, j, s, refused = 0;
    while (until - m->time > 1e-12 * (fabs(until) + 1e-3)) {
        double h = m->step > 0 ? m->step : 1e-3 * (until - m->time), error = 0;
        int last = 0;
        if (h >= until - m->time) {
            h = until - m->time;
            last = 1;
        }
        for (s = 0; s < 7; ++s) {
            for (i = 0; i < N_STATE; ++i) {
                y[i] = x[i];
                for (j = 0; j < s; ++j) {
                    y[i] += h * a[s][j] * k[j][i];
                }
            }
            own_derivatives(m, y, k[s]);
        }
        for (i = 0; i < N_STATE; ++i) {
            double size = fabs(x[i]) > fabs(y[i]) ? fabs(x[i]) : fabs(y[i]), sum = 0;
            for (s = 0; s < 7; ++s) {
                sum += e[s] * k[s][i];
            }
            sum = fabs(h * sum) / (m->tolerance * (size + 1e-3));
            error = sum > error || sum != sum ? sum : error;
        }
        if (!(error <= 1)) {
            m->step = h * (error > 0 && error < 1e6 ? fmax(0.2, 0.9 * pow(error, -0.2)) : 0.1);
            if (++refused > 60) {
                return 0;
            }
            continue;
        }
        refused = 0;
        memcpy(x, y, sizeof y);
        m->time = last ? until : m->time + h;
        if (!last || error > 0.1) {
            m->step = h * (error > 1e-6 ? fmin(5.0, 0.9 * pow(error, -0.2)) : 5.0);
        }
    }
    m->time = until;
    return 1;
}
#else
static int model_integrate(Model *m, double until) {
    m->time = until;
    return 1;
}
#endif

static void model_reset(Model *m) {
    memset(m, 0, sizeof *m);
    m->tolerance = 1e-11;
    own_reset(m);
}

/* One communication step: the samples from its beginning on, without its end, with the inputs that hold now. */
static int model_step(Model *m, double from, double step) {
    const double until = from + step;
    /* A time that was summed up step by step is off by its rounding. */
    const double close = 1e-4 * fmin(fabs(step), own_interval());
    m->time = from;
    while (own_next(m) < until - close) {
        const double next = own_next(m);
        if (next > m->time && !model_integrate(m, next)) {
            return 0;
        }
        own_event(m);
    }
    return model_integrate(m, until);
}

#endif
