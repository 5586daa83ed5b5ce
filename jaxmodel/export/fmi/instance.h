/* An instance of the model, its phases and its steps: what FMI 2 and FMI 3 share. model.h is written for each case. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif
#define PASTED(a, b) a##b
#define PASTED_NAMES(a, b) PASTED(a, b)

/* More parts than this are no step, but a mistake in a number. */
#define MOST_PARTS 1e12
/* By this share of it a part may be longer than the longest step: communication steps are rounded. */
#define ROUNDING 0.01

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED } Phase;

/* All that a run carries on. It has no pointers, so that its bytes are its serialisation. */
typedef struct {
    char token[sizeof MODEL_TOKEN];
    Phase phase;
    bool is_stale;    /* whether the readings are older than state, inputs or parameters */
    bool has_stepped; /* whether the inputs of a step before are known */
    double time_s;
    double jumped_s; /* when an input of the motor changed last */
    model_inputs before;
    model_data data;
} Snapshot;

typedef struct {
    Snapshot now;
    const char *problem; /* what is wrong, in a sentence; NULL if nothing is */
    char *name;
    void *environment;
    void (*log)(void); /* the importer's function, of the type of its version of FMI */
} Instance;

static Snapshot beginning(void)
{
    Snapshot snapshot;
    memset(&snapshot, 0, sizeof snapshot);
    memcpy(snapshot.token, MODEL_TOKEN, sizeof MODEL_TOKEN);
    snapshot.data = model_defaults();
    snapshot.is_stale = true;
    return snapshot;
}

static Instance *created(const char *name, void *environment, void (*log)(void))
{
    const char *given = name == NULL ? "" : name;
    Instance *instance = calloc(1, sizeof *instance);
    if (instance == NULL) { return NULL; }
    instance->name = calloc(strlen(given) + 1, 1);
    if (instance->name == NULL) {
        free(instance);
        return NULL;
    }
    strcpy(instance->name, given);
    instance->now = beginning();
    instance->environment = environment;
    instance->log = log;
    return instance;
}

static void removed(Instance *instance)
{
    if (instance != NULL) { free(instance->name); }
    free(instance);
}

static bool wrong(Instance *instance, const char *problem)
{
    instance->problem = problem;
    return false;
}

/* Before the first step the state is that at the start, by the parameters and inputs as they are. */
static void refresh(Instance *instance)
{
    model_data *data = &instance->now.data;
    if (!instance->now.is_stale) { return; }
    if (instance->now.phase < STEPPING) { model_start(&data->parameters, &data->inputs, &data->state); }
    model_read(&data->parameters, &data->inputs, &data->state, &data->readings);
    data->is_valid = model_valid(&data->parameters, &data->inputs, &data->state);
    instance->now.is_stale = false;
}

static bool get_numbers(Instance *instance, const uint32_t references[], size_t count, double values[])
{
    refresh(instance);
    for (size_t k = 0; k < count; k++) {
        const double *place = references[k] == 0 ? &instance->now.time_s : model_place(&instance->now.data, references[k]);
        if (place == NULL) { return wrong(instance, "There is no number with this value reference."); }
        values[k] = *place;
    }
    return true;
}

static bool set_numbers(Instance *instance, const uint32_t references[], size_t count, const double values[])
{
    instance->now.is_stale = true;
    for (size_t k = 0; k < count; k++) {
        const uint32_t reference = references[k];
        double *place = model_place(&instance->now.data, reference);
        if (place == NULL) { return wrong(instance, "There is no number with this value reference."); }
        if (reference >= MODEL_FIRST_READING && reference < MODEL_FIRST_TUNABLE) {
            return wrong(instance, "A reading or a state of the model is computed; it cannot be set.");
        }
        if (reference >= MODEL_FIRST_FIXED && instance->now.phase >= STEPPING) {
            return wrong(instance, "A number of the start is set before the end of the initialization.");
        }
        if (!isfinite(values[k])) { return wrong(instance, "A value that is set must be a finite number."); }
        *place = values[k];
    }
    return true;
}

static bool enter_initialization(Instance *instance)
{
    if (instance->now.phase != INSTANTIATED) { return wrong(instance, "The initialization can be entered once only."); }
    instance->now.phase = INITIALIZING;
    return true;
}

static bool exit_initialization(Instance *instance)
{
    if (instance->now.phase != INITIALIZING) { return wrong(instance, "The initialization was not entered."); }
    instance->now.is_stale = true;
    refresh(instance);
    instance->now.phase = STEPPING;
    return true;
}

static bool all_finite(const model_data *data)
{
    for (uint32_t reference = MODEL_FIRST_READING; reference < MODEL_FIRST_TUNABLE; reference++) {
        if (!isfinite(*model_place((model_data *)data, reference))) { return false; }
    }
    return true;
}

/* Into how many equal parts a span is divided that are no longer than a time. */
static int64_t parts(double span_s, double longest_s)
{
    const double count = ceil(span_s / longest_s - ROUNDING);
    return count > 1.0 && count < MOST_PARTS ? (int64_t)count : 1;
}

/* After a jump of the inputs, steps grow from a share of the electrical time constant by a constant factor, and are a
 * share of the rotor's while the winding warms or the armature has a kink; all are cut into parts that are no longer
 * than the longest step. It is the rule of jaxmodel.simulate, whose rows are here the communication steps. */
static void advance(Snapshot *now, double span_s)
{
    model_data *data = &now->data;
    double electrical_s = 0.0, rotor_s = 0.0, longest_s = INFINITY;
    model_pace(&data->parameters, &longest_s, &electrical_s, &rotor_s);
    longest_s = fmin(longest_s, data->longest_step_s);
    double shortest_s = rotor_s, share = PACE_BENDING_STEP_SHARE;
    bool settles = MODEL_BENDS;
    if (rotor_s > PACE_SLOW_ROTOR_S) {
        shortest_s = fmin(MODEL_BENDS ? rotor_s : fmax(rotor_s, PACE_SLOW_ROTOR_S), PACE_WARMING_S);
        share = PACE_WARMING_STEP_SHARE;
        settles = true;
    }
    int64_t count = 1;
    if (MODEL_SETTLES && (!now->has_stepped || model_jumped(&now->before, &data->inputs))) {
        const double first_s = PACE_FIRST_STEP_SHARE * electrical_s;
        const double growing = ceil(log1p(span_s / first_s * (MODEL_GROWTH - 1.0)) / log(MODEL_GROWTH));
        count = growing > 1.0 && growing < MOST_PARTS ? (int64_t)growing : 1;
        now->jumped_s = now->time_s;
    }
    double of_units = 0.0, before = 0.0;
    for (int64_t k = 0; k < count; k++) { of_units += pow(MODEL_GROWTH, (double)k); }
    const double unit_s = span_s / of_units;
    for (int64_t k = 0; k < count; k++) {
        const double units = pow(MODEL_GROWTH, (double)k), since_s = now->time_s - now->jumped_s + unit_s * before;
        int64_t pieces = 1;
        if (MODEL_SETTLES && settles && since_s < PACE_SETTLED * rotor_s) {
            const double fine = ceil(unit_s * units / (share * fmax(shortest_s, since_s / PACE_SETTLED)));
            pieces = fine > 1.0 && fine < MOST_PARTS ? (int64_t)fine : 1;
        }
        pieces *= parts(unit_s * units / (double)pieces, longest_s);
        for (int64_t piece = 0; piece < pieces; piece++) {
            model_step(&data->parameters, &data->inputs, unit_s * units / (double)pieces, &data->state);
        }
        before += units;
    }
    now->before = data->inputs;
    now->has_stepped = true;
    now->is_stale = true;
}

/* Moves the model over a communication step; after an error it is where it was before. */
static bool do_step(Instance *instance, double time_s, double span_s)
{
    const Snapshot before = instance->now;
    if (before.phase != STEPPING) { return wrong(instance, "A step follows the initialization, and no termination."); }
    if (!isfinite(span_s) || span_s < 0.0) { return wrong(instance, "The communication step must be 0 s or longer."); }
    if (!(fabs(time_s - before.time_s) <= 1e-6 * fmax(1.0, fabs(time_s)))) {
        return wrong(instance, "The communication point is not the end of the step before; set the state of that time.");
    }
    if (span_s > 0.0) { advance(&instance->now, span_s); }
    instance->now.time_s = time_s + span_s;
    refresh(instance);
    if (!all_finite(&instance->now.data)) {
        instance->now = before;
        return wrong(instance, "The step ends at a number that is not finite; look at the parameters and inputs.");
    }
    return true;
}

static bool store(Instance *instance, void **state)
{
    if (*state == NULL) { *state = calloc(1, sizeof(Snapshot)); }
    if (*state == NULL) { return wrong(instance, "There is no memory for the state."); }
    memcpy(*state, &instance->now, sizeof(Snapshot));
    return true;
}

static bool restore(Instance *instance, const Snapshot *snapshot)
{
    if (snapshot == NULL || memcmp(snapshot->token, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0) {
        return wrong(instance, "The state is not one of this model.");
    }
    memcpy(&instance->now, snapshot, sizeof *snapshot);
    return true;
}

static void release(void **state)
{
    if (state == NULL) { return; }
    free(*state);
    *state = NULL;
}

static bool serialize(Instance *instance, const void *state, void *bytes, size_t size)
{
    if (size < sizeof(Snapshot)) { return wrong(instance, "There is no room for the bytes of the state."); }
    memcpy(bytes, state, sizeof(Snapshot));
    return true;
}

static bool deserialize(Instance *instance, const void *bytes, size_t size, void **state)
{
    if (size < sizeof(Snapshot) || memcmp(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0) {
        return wrong(instance, "The bytes are not those of a state of this model.");
    }
    if (!store(instance, state)) { return false; }
    memcpy(*state, bytes, sizeof(Snapshot));
    return true;
}
