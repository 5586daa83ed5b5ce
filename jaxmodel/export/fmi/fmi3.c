/* The functions of FMI 3.0 for co-simulation, declared as in the standard (fmi-standard.org, version 3.0.2). */
#include "instance.h"

#ifdef FMI3_FUNCTION_PREFIX
#define FMI(name) PASTED_NAMES(FMI3_FUNCTION_PREFIX, name)
#else
#define FMI(name) name
#endif

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef bool fmi3Boolean;
typedef bool fmi3Clock;
typedef uint8_t fmi3Byte;
typedef double fmi3Float64;
typedef const char *fmi3String;
typedef const uint8_t *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown } fmi3IntervalQualifier;
typedef void (*LogMessage)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*Update)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                       fmi3Boolean *, fmi3Float64 *);
typedef void (*Lock)(void);

/* Tells the importer what is wrong, unless all is well. */
static fmi3Status told(fmi3Instance component, bool is_well)
{
    Instance *instance = component;
    if (is_well) { return fmi3OK; }
    if (instance->log != NULL) {
        ((LogMessage)instance->log)(instance->environment, fmi3Error, "logStatusError", instance->problem);
    }
    return fmi3Error;
}

/* Of a type that no number of the model has, or what it cannot do: well only if nothing is asked. */
static fmi3Status none(fmi3Instance component, size_t count)
{
    return told(component, count == 0 || wrong(component, "The model has no number of this type, or cannot do this."));
}

EXPORTED const char *FMI(fmi3GetVersion)(void) { return "3.0"; }

EXPORTED fmi3Status FMI(fmi3SetDebugLogging)(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String names[])
{
    (void)c, (void)on, (void)count, (void)names; /* errors are always told, and there is nothing else to tell */
    return fmi3OK;
}

EXPORTED fmi3Instance FMI(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean has_events, fmi3Boolean may_return_early, const fmi3ValueReference intermediate[], size_t count,
    fmi3InstanceEnvironment environment, LogMessage log, Update update)
{
    const bool fits = token != NULL && strcmp(token, MODEL_TOKEN) == 0;
    (void)resources, (void)visible, (void)logging, (void)has_events, (void)may_return_early;
    (void)intermediate, (void)count, (void)update;
    if (!fits && log != NULL) {
        log(environment, fmi3Error, "logStatusError", "The instantiation token is not " MODEL_TOKEN ".");
    }
    return fits ? created(name, environment, (void (*)(void))log) : NULL;
}

static fmi3Instance no_such_type(fmi3InstanceEnvironment environment, LogMessage log)
{
    if (log != NULL) { log(environment, fmi3Error, "logStatusError", "The model is for co-simulation."); }
    return NULL;
}

EXPORTED fmi3Instance FMI(fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                                        fmi3Boolean visible, fmi3Boolean logging,
                                                        fmi3InstanceEnvironment environment, LogMessage log)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    return no_such_type(environment, log);
}

EXPORTED fmi3Instance FMI(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, LogMessage log, void (*tick)(fmi3InstanceEnvironment), Lock lock, Lock unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)tick, (void)lock, (void)unlock;
    return no_such_type(environment, log);
}

EXPORTED void FMI(fmi3FreeInstance)(fmi3Instance c) { removed(c); }

EXPORTED fmi3Status FMI(fmi3EnterInitializationMode)(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                                     fmi3Float64 start_s, fmi3Boolean has_stop, fmi3Float64 stop_s)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop_s;
    if (!isfinite(start_s)) { return told(c, wrong(c, "The time of the start must be a finite number.")); }
    if (!enter_initialization(c)) { return told(c, false); }
    ((Instance *)c)->now.time_s = start_s;
    return fmi3OK;
}

EXPORTED fmi3Status FMI(fmi3ExitInitializationMode)(fmi3Instance c) { return told(c, exit_initialization(c)); }

EXPORTED fmi3Status FMI(fmi3EnterEventMode)(fmi3Instance c) { return none(c, 1); }

EXPORTED fmi3Status FMI(fmi3EnterStepMode)(fmi3Instance c) { return none(c, 1); }

EXPORTED fmi3Status FMI(fmi3EnterConfigurationMode)(fmi3Instance c) { return none(c, 1); }

EXPORTED fmi3Status FMI(fmi3ExitConfigurationMode)(fmi3Instance c) { return none(c, 1); }

EXPORTED fmi3Status FMI(fmi3Terminate)(fmi3Instance c)
{
    ((Instance *)c)->now.phase = TERMINATED;
    return fmi3OK;
}

EXPORTED fmi3Status FMI(fmi3Reset)(fmi3Instance c)
{
    ((Instance *)c)->now = beginning();
    return fmi3OK;
}

EXPORTED fmi3Status FMI(fmi3GetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                        fmi3Float64 values[], size_t count_values)
{
    if (count != count_values) { return none(c, 1); }
    return told(c, get_numbers(c, vr, count, values));
}

EXPORTED fmi3Status FMI(fmi3SetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                        const fmi3Float64 values[], size_t count_values)
{
    if (count != count_values) { return none(c, 1); }
    return told(c, set_numbers(c, vr, count, values));
}

EXPORTED fmi3Status FMI(fmi3GetBoolean)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                        fmi3Boolean values[], size_t count_values)
{
    refresh(c);
    for (size_t k = 0; k < count; k++) {
        if (count != count_values || vr[k] != MODEL_VALID) { return none(c, count); }
        values[k] = ((Instance *)c)->now.data.is_valid;
    }
    return fmi3OK;
}

/* Of the other types the model has no number. */
#define NONE_OF(Name, Type)                                                                                      \
    EXPORTED fmi3Status FMI(fmi3Get##Name)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,          \
                                           Type values[], size_t count_values)                                   \
    {                                                                                                            \
        (void)vr, (void)values, (void)count_values;                                                              \
        return none(c, count);                                                                                   \
    }                                                                                                            \
    NO_SETTER_OF(Name, Type)
#define NO_SETTER_OF(Name, Type)                                                                                 \
    EXPORTED fmi3Status FMI(fmi3Set##Name)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,          \
                                           const Type values[], size_t count_values)                             \
    {                                                                                                            \
        (void)vr, (void)values, (void)count_values;                                                              \
        return none(c, count);                                                                                   \
    }
NONE_OF(Float32, float)
NONE_OF(Int8, int8_t)
NONE_OF(UInt8, uint8_t)
NONE_OF(Int16, int16_t)
NONE_OF(UInt16, uint16_t)
NONE_OF(Int32, int32_t)
NONE_OF(UInt32, uint32_t)
NONE_OF(Int64, int64_t)
NONE_OF(UInt64, uint64_t)
NONE_OF(String, fmi3String)
NO_SETTER_OF(Boolean, fmi3Boolean)

EXPORTED fmi3Status FMI(fmi3GetBinary)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, size_t sizes[],
                                       fmi3Binary values[], size_t count_values)
{
    (void)vr, (void)sizes, (void)values, (void)count_values;
    return none(c, count);
}

EXPORTED fmi3Status FMI(fmi3SetBinary)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                       const size_t sizes[], const fmi3Binary values[], size_t count_values)
{
    (void)vr, (void)sizes, (void)values, (void)count_values;
    return none(c, count);
}

EXPORTED fmi3Status FMI(fmi3GetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, fmi3Clock values[])
{
    (void)vr, (void)values;
    return none(c, count);
}

EXPORTED fmi3Status FMI(fmi3SetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                      const fmi3Clock values[])
{
    (void)vr, (void)values;
    return none(c, count);
}

EXPORTED fmi3Status FMI(fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t *count)
{
    (void)vr, (void)count;
    return none(c, 1);
}

EXPORTED fmi3Status FMI(fmi3GetVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t elements[],
                                                     fmi3ValueReference independents[], size_t of_independents[],
                                                     fmi3DependencyKind kinds[], size_t count)
{
    (void)vr, (void)elements, (void)independents, (void)of_independents, (void)kinds, (void)count;
    return none(c, 1);
}

EXPORTED fmi3Status FMI(fmi3GetFMUState)(fmi3Instance c, fmi3FMUState *state) { return told(c, store(c, state)); }

EXPORTED fmi3Status FMI(fmi3SetFMUState)(fmi3Instance c, fmi3FMUState state) { return told(c, restore(c, state)); }

EXPORTED fmi3Status FMI(fmi3FreeFMUState)(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    release(state);
    return fmi3OK;
}

EXPORTED fmi3Status FMI(fmi3SerializedFMUStateSize)(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(Snapshot);
    return fmi3OK;
}

EXPORTED fmi3Status FMI(fmi3SerializeFMUState)(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return told(c, serialize(c, state, bytes, size));
}

EXPORTED fmi3Status FMI(fmi3DeserializeFMUState)(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                                 fmi3FMUState *state)
{
    return told(c, deserialize(c, bytes, size, state));
}

#define NO_DERIVATIVE(Name)                                                                                      \
    EXPORTED fmi3Status FMI(Name)(fmi3Instance c, const fmi3ValueReference unknowns[], size_t count,             \
                                  const fmi3ValueReference knowns[], size_t count_knowns,                        \
                                  const fmi3Float64 seed[], size_t count_seed, fmi3Float64 values[],             \
                                  size_t count_values)                                                           \
    {                                                                                                            \
        (void)unknowns, (void)knowns, (void)count_knowns, (void)seed, (void)count_seed, (void)values;            \
        (void)count_values;                                                                                      \
        return none(c, count);                                                                                   \
    }
NO_DERIVATIVE(fmi3GetDirectionalDerivative)
NO_DERIVATIVE(fmi3GetAdjointDerivative)

EXPORTED fmi3Status FMI(fmi3GetOutputDerivatives)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                                  const int32_t orders[], fmi3Float64 values[], size_t count_values)
{
    (void)vr, (void)orders, (void)values, (void)count_values;
    return none(c, count);
}

EXPORTED fmi3Status FMI(fmi3GetIntervalDecimal)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                                fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    (void)vr, (void)intervals, (void)qualifiers;
    return none(c, count);
}

EXPORTED fmi3Status FMI(fmi3GetIntervalFraction)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                                 uint64_t counters[], uint64_t resolutions[],
                                                 fmi3IntervalQualifier qualifiers[])
{
    (void)vr, (void)counters, (void)resolutions, (void)qualifiers;
    return none(c, count);
}

#define NO_DECIMAL(Name, Const)                                                                                  \
    EXPORTED fmi3Status FMI(Name)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,                   \
                                  Const fmi3Float64 values[])                                                    \
    {                                                                                                            \
        (void)vr, (void)values;                                                                                  \
        return none(c, count);                                                                                   \
    }
#define NO_FRACTION(Name, Const)                                                                                 \
    EXPORTED fmi3Status FMI(Name)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,                   \
                                  Const uint64_t counters[], Const uint64_t resolutions[])                       \
    {                                                                                                            \
        (void)vr, (void)counters, (void)resolutions;                                                             \
        return none(c, count);                                                                                   \
    }
NO_DECIMAL(fmi3GetShiftDecimal, )
NO_DECIMAL(fmi3SetIntervalDecimal, const)
NO_DECIMAL(fmi3SetShiftDecimal, const)
NO_FRACTION(fmi3GetShiftFraction, )
NO_FRACTION(fmi3SetIntervalFraction, const)
NO_FRACTION(fmi3SetShiftFraction, const)

EXPORTED fmi3Status FMI(fmi3EvaluateDiscreteStates)(fmi3Instance c) { return none(c, 1); }

EXPORTED fmi3Status FMI(fmi3UpdateDiscreteStates)(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *ends,
                                                  fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *has_next,
                                                  fmi3Float64 *next_s)
{
    (void)again, (void)ends, (void)nominals, (void)values, (void)has_next, (void)next_s;
    return none(c, 1);
}

/* Of the other kinds of FMU: the standard asks for these functions too. */
EXPORTED fmi3Status FMI(fmi3EnterContinuousTimeMode)(fmi3Instance c) { return none(c, 1); }

EXPORTED fmi3Status FMI(fmi3CompletedIntegratorStep)(fmi3Instance c, fmi3Boolean no_return, fmi3Boolean *enters_events,
                                                     fmi3Boolean *ends)
{
    (void)no_return, (void)enters_events, (void)ends;
    return none(c, 1);
}

EXPORTED fmi3Status FMI(fmi3SetTime)(fmi3Instance c, fmi3Float64 time_s)
{
    (void)time_s;
    return none(c, 1);
}

EXPORTED fmi3Status FMI(fmi3SetContinuousStates)(fmi3Instance c, const fmi3Float64 values[], size_t count)
{
    (void)values;
    return none(c, count);
}

#define NO_CONTINUOUS(Name)                                                                                      \
    EXPORTED fmi3Status FMI(Name)(fmi3Instance c, fmi3Float64 values[], size_t count)                            \
    {                                                                                                            \
        (void)values;                                                                                            \
        return none(c, count);                                                                                   \
    }
#define NUMBER_IS_ZERO(Name)                                                                                     \
    EXPORTED fmi3Status FMI(Name)(fmi3Instance c, size_t *count)                                                 \
    {                                                                                                            \
        (void)c;                                                                                                 \
        *count = 0;                                                                                              \
        return fmi3OK;                                                                                           \
    }
NO_CONTINUOUS(fmi3GetContinuousStateDerivatives)
NO_CONTINUOUS(fmi3GetEventIndicators)
NO_CONTINUOUS(fmi3GetContinuousStates)
NO_CONTINUOUS(fmi3GetNominalsOfContinuousStates)
NUMBER_IS_ZERO(fmi3GetNumberOfEventIndicators)
NUMBER_IS_ZERO(fmi3GetNumberOfContinuousStates)

EXPORTED fmi3Status FMI(fmi3ActivateModelPartition)(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time_s)
{
    (void)clock, (void)time_s;
    return none(c, 1);
}

EXPORTED fmi3Status FMI(fmi3DoStep)(fmi3Instance c, fmi3Float64 time_s, fmi3Float64 step_s, fmi3Boolean no_return,
                                    fmi3Boolean *needs_events, fmi3Boolean *ends, fmi3Boolean *is_early,
                                    fmi3Float64 *reached_s)
{
    const bool is_well = do_step(c, time_s, step_s);
    (void)no_return;
    *needs_events = false;
    *ends = false;
    *is_early = false;
    *reached_s = ((Instance *)c)->now.time_s;
    return told(c, is_well);
}
