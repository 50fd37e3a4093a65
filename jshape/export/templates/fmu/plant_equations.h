/* The equations of motion of a $kind of jshape; m->real begins with the inputs, then come the states x. */
static void own_reset(Model *m) {
    $rest
}

static void own_begin(Model *m) {
    (void)m;
}

static double own_next(const Model *m) {
    (void)m;
    return HUGE_VAL;
}

static double own_interval(void) {
    return 0;
}

static void own_event(Model *m) {
    (void)m;
}

static void own_derivatives(Model *m, const double *x, double *dx) {
    (void)m, (void)x;
    $field
}

static void own_outputs(Model *m) {
    const double *x = m->real + FIRST_STATE;
    own_derivatives(m, x, m->real + FIRST_STATE + N_STATE);
    $energy
}
