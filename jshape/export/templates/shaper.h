/*
 * $about
 *
 * Use, with a call of step every $sample_time s:
 *
 *     static ${name}_state axis;
 *     ${name}_init(&axis, position);            once: at rest at that position
 *     shaped = ${name}_step(&axis, command);    every sample
 *
 *     ${name}_reset(&axis, position)            at rest there, at once; the shaper stays
 *     ${name}_bypass(&axis, 1)                  the command goes through unshaped; 0: shaped again
 *     ${name}_set(&axis, &taps)                 another shaper, which must live as long as it is used
 *
 * Bypass and set make no jump, in the middle of a move either: what the command did before them goes on through the
 * former taps, what it does after them through the new ones, so that each part of the move keeps a whole shaper. They
 * return 1; or 0, and change nothing, while an earlier change is still running out (${NAME}_CAPACITY samples) or if
 * $refused.
 *
 * $arithmetic
 */
#ifndef ${NAME}_H
#define ${NAME}_H
$includes

#define ${NAME}_SAMPLE_TIME $sample_time /* s */

/* Samples in the ring buffer; define it larger before this file to make room for longer shapers. */
#ifndef ${NAME}_CAPACITY
#define ${NAME}_CAPACITY $capacity
#endif
$constants

typedef struct {
    unsigned count;        /* of taps */
    const unsigned *delay; /* samples, below the capacity */
    const $tap *gain; /* $gain_unit */
} ${name}_taps;

typedef struct {
    $sample past[${NAME}_CAPACITY]; /* the latest commands */
    unsigned newest;                /* where the last one stands */
    unsigned fresh;                 /* samples since the taps changed, up to the capacity */
    $sample frozen;                 /* the last command before they changed */
    const ${name}_taps *taps;       /* in force */
    const ${name}_taps *former;     /* before them */
    const ${name}_taps *shaper;     /* in force unless bypassed */
    int bypassed;
} ${name}_state;

static const unsigned ${name}_delays[$count] = {
    $delays
};
static const $tap ${name}_gains[$count] = {
    $gains
};
static const ${name}_taps ${name}_default = {$count, ${name}_delays, ${name}_gains};

static const unsigned ${name}_no_delay[1] = {0};
static const $tap ${name}_unity[1] = {$unity};
static const ${name}_taps ${name}_through = {1, ${name}_no_delay, ${name}_unity};

/* At rest at that position, at once. */
static inline void ${name}_reset(${name}_state *s, $sample position) {
    unsigned i;
    for (i = 0; i < ${NAME}_CAPACITY; ++i) {
        s->past[i] = position;
    }
    s->newest = 0;
    s->fresh = ${NAME}_CAPACITY;
    s->frozen = position;
}

/* The shaper of this file, at rest at that position. */
static inline void ${name}_init(${name}_state *s, $sample position) {
    s->taps = s->former = s->shaper = &${name}_default;
    s->bypassed = 0;
    ${name}_reset(s, position);
}

/* The commands since the taps changed (fresh), or those before, through taps; the others count as frozen. */
static inline $wide ${name}_part(const ${name}_state *s, const ${name}_taps *taps, int fresh, $sample now) {
    $wide sum = 0;
    unsigned i;
    for (i = 0; i < taps->count; ++i) {
        const unsigned delay = taps->delay[i];
        const unsigned at = s->newest >= delay ? s->newest - delay : s->newest + ${NAME}_CAPACITY - delay;
        const int is_fresh = delay < s->fresh;
        const $sample then = is_fresh == fresh ? s->past[at] : s->frozen;
        $accumulate
    }
    $finish
}

/* The shaped command of this sample. */
static inline $sample ${name}_step(${name}_state *s, $sample command) {
    $wide shaped;
    s->newest = s->newest + 1 < ${NAME}_CAPACITY ? s->newest + 1 : 0;
    s->past[s->newest] = command;
    if (s->fresh < ${NAME}_CAPACITY) {
        ++s->fresh;
    }
    shaped = ${name}_part(s, s->taps, 1, command);
    if (s->fresh < ${NAME}_CAPACITY) {
        shaped += ${name}_part(s, s->former, 0, s->frozen) - s->frozen;
    }
    $deliver
}

/* Whether the taps in force are now these. */
static inline int ${name}_change(${name}_state *s, const ${name}_taps *taps) {
    if (s->fresh < ${NAME}_CAPACITY) {
        return 0;
    }
    if (s->taps != taps) {
        s->former = s->taps;
        s->taps = taps;
        s->frozen = s->past[s->newest];
        s->fresh = 0;
    }
    return 1;
}

static inline int ${name}_bypass(${name}_state *s, int on) {
    if (!${name}_change(s, on ? &${name}_through : s->shaper)) {
        return 0;
    }
    s->bypassed = on;
    return 1;
}

static inline int ${name}_set(${name}_state *s, const ${name}_taps *taps) {
    unsigned i;
    $check_start
    for (i = 0; i < taps->count; ++i) {
        if (taps->delay[i] >= ${NAME}_CAPACITY) {
            return 0;
        }
        $check_each
    }
    $check_end
    if (!s->bypassed && !${name}_change(s, taps)) {
        return 0;
    }
    s->shaper = taps;
    return 1;
}

#endif
