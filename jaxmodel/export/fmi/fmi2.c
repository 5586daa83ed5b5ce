/* The functions of FMI 2.0 for co-simulation, declared as in the standard (fmi-standard.org, version 2.0.4). */
#include "instance.h"

#ifdef FMI2_FUNCTION_PREFIX
#define FMI(name) PASTED_NAMES(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI(name) name
#endif

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*Logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
typedef struct {
    Logger logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

/* Tells the importer what is wrong, unless all is well. */
static fmi2Status told(fmi2Component component, bool is_well)
{
    Instance *instance = component;
    if (is_well) { return fmi2OK; }
    if (instance->log != NULL) {
        ((Logger)instance->log)(instance->environment, instance->name, fmi2Error, "logStatusError", "%s",
                                instance->problem);
    }
    return fmi2Error;
}

/* Of a type that no number of the model has, or what it cannot do: well only if nothing is asked. */
static fmi2Status none(fmi2Component component, size_t count)
{
    return told(component, count == 0 || wrong(component, "The model has no number of this type, or cannot do this."));
}

EXPORTED const char *FMI(fmi2GetTypesPlatform)(void) { return "default"; }

EXPORTED const char *FMI(fmi2GetVersion)(void) { return "2.0"; }

EXPORTED fmi2Status FMI(fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String names[])
{
    (void)c, (void)on, (void)count, (void)names; /* errors are always told, and there is nothing else to tell */
    return fmi2OK;
}

EXPORTED fmi2Component FMI(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                            const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                            fmi2Boolean logging)
{
    Logger log = functions == NULL ? NULL : functions->logger;
    fmi2ComponentEnvironment environment = functions == NULL ? NULL : functions->componentEnvironment;
    const bool fits = type == fmi2CoSimulation && guid != NULL && strcmp(guid, MODEL_TOKEN) == 0;
    (void)resources, (void)visible, (void)logging;
    if (!fits && log != NULL) {
        log(environment, name, fmi2Error, "logStatusError", "It is for co-simulation with the guid %s.", MODEL_TOKEN);
    }
    return fits ? created(name, environment, (void (*)(void))log) : NULL;
}

EXPORTED void FMI(fmi2FreeInstance)(fmi2Component c) { removed(c); }

EXPORTED fmi2Status FMI(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                             fmi2Real start_s, fmi2Boolean has_stop, fmi2Real stop_s)
{
    Instance *instance = c;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop_s;
    if (instance->now.phase != INSTANTIATED || !isfinite(start_s)) {
        return told(c, wrong(c, "The experiment is set up before the initialization, with a finite start."));
    }
    instance->now.time_s = start_s;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2EnterInitializationMode)(fmi2Component c) { return told(c, enter_initialization(c)); }

EXPORTED fmi2Status FMI(fmi2ExitInitializationMode)(fmi2Component c) { return told(c, exit_initialization(c)); }

EXPORTED fmi2Status FMI(fmi2Terminate)(fmi2Component c)
{
    ((Instance *)c)->now.phase = TERMINATED;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2Reset)(fmi2Component c)
{
    ((Instance *)c)->now = beginning();
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real values[])
{
    return told(c, get_numbers(c, vr, count, values));
}

EXPORTED fmi2Status FMI(fmi2GetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                        fmi2Integer values[])
{
    (void)vr, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                        fmi2Boolean values[])
{
    refresh(c);
    for (size_t k = 0; k < count; k++) {
        if (vr[k] != MODEL_VALID) { return none(c, count); }
        values[k] = ((Instance *)c)->now.data.is_valid ? 1 : 0;
    }
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetString)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                       fmi2String values[])
{
    (void)vr, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                     const fmi2Real values[])
{
    return told(c, set_numbers(c, vr, count, values));
}

EXPORTED fmi2Status FMI(fmi2SetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                        const fmi2Integer values[])
{
    (void)vr, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                        const fmi2Boolean values[])
{
    (void)vr, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2SetString)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                       const fmi2String values[])
{
    (void)vr, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state) { return told(c, store(c, state)); }

EXPORTED fmi2Status FMI(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state) { return told(c, restore(c, state)); }

EXPORTED fmi2Status FMI(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    release(state);
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(Snapshot);
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return told(c, serialize(c, state, bytes, size));
}

EXPORTED fmi2Status FMI(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                                 fmi2FMUstate *state)
{
    return told(c, deserialize(c, bytes, size, state));
}

EXPORTED fmi2Status FMI(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknowns[],
                                                      size_t count, const fmi2ValueReference knowns[],
                                                      size_t count_knowns, const fmi2Real seed[], fmi2Real values[])
{
    (void)unknowns, (void)knowns, (void)count_knowns, (void)seed, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                                     const fmi2Integer order[], const fmi2Real values[])
{
    (void)vr, (void)order, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                                      const fmi2Integer order[], fmi2Real values[])
{
    (void)vr, (void)order, (void)values;
    return none(c, count);
}

EXPORTED fmi2Status FMI(fmi2DoStep)(fmi2Component c, fmi2Real time_s, fmi2Real step_s, fmi2Boolean no_return)
{
    (void)no_return;
    return told(c, do_step(c, time_s, step_s));
}

EXPORTED fmi2Status FMI(fmi2CancelStep)(fmi2Component c) { return none(c, 1); }

EXPORTED fmi2Status FMI(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind, (void)value;
    return none(c, 1);
}

EXPORTED fmi2Status FMI(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) { return none(c, 1); }
    *value = ((Instance *)c)->now.time_s;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind, (void)value;
    return none(c, 1);
}

EXPORTED fmi2Status FMI(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated) { return none(c, 1); }
    *value = 0; /* the model never ends a run of its own accord */
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind, (void)value;
    return none(c, 1);
}
