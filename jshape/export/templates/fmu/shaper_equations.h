/* The shaper of $name.h, sampled every ${NAME}_SAMPLE_TIME s from the beginning of the experiment on. */
static void own_reset(Model *m) {
    ${name}_init(&m->own, 0.0);
}

static void own_begin(Model *m) {
    ${name}_init(&m->own, m->real[0]);
    m->real[1] = m->real[0];
    m->begun = 1;
}

static void own_outputs(Model *m) {
    if (!m->begun) {
        m->real[1] = m->real[0]; /* at rest where the command begins */
    }
}

static double own_interval(void) {
    return ${NAME}_SAMPLE_TIME;
}

static double own_next(const Model *m) {
    return m->origin + (double)m->samples * ${NAME}_SAMPLE_TIME;
}

static void own_event(Model *m) {
    if (m->own.bypassed != m->boolean[0]) {
        ${name}_bypass(&m->own, m->boolean[0]); /* waits where an earlier change is still running out */
    }
    m->real[1] = ${name}_step(&m->own, m->real[0]);
    ++m->samples;
}

static void own_derivatives(Model *m, const double *x, double *dx) {
    (void)m, (void)x, (void)dx;
}
