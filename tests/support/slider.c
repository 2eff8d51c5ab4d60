/* An axis of one integrator, as an FMU of FMI 2.0 or, with -DFMI3, of FMI 3.0:

       x' = gain u - F / damping,   v = x'

   From time `fails_at` on a step fails, from `breaks_at` on x is NaN, from `crashes_at` on a step
   ends the process, from `hangs_at` on none returns. */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { X, V, U, F, GAIN, DAMPING, FAILS_AT, BREAKS_AT, CRASHES_AT, HANGS_AT, COUNT };

#ifdef FMI3
#include "fmi3Functions.h"
#define API(name) fmi3##name
typedef fmi3Status Status;
typedef fmi3Float64 Real;
typedef fmi3ValueReference Reference;
#define GOOD fmi3OK
#define BAD fmi3Error
#else
#include "fmi2Functions.h"
#define API(name) fmi2##name
typedef fmi2Status Status;
typedef fmi2Real Real;
typedef fmi2ValueReference Reference;
#define GOOD fmi2OK
#define BAD fmi2Error
#endif

typedef struct {
    Real value[COUNT];
#ifdef FMI3
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
#else
    fmi2CallbackFunctions callbacks;
#endif
} Slider;

static Slider *make(void)
{
    Slider *s = calloc(1, sizeof *s);
    s->value[GAIN] = 0.5;
    s->value[DAMPING] = 1000.0;
    s->value[FAILS_AT] = s->value[BREAKS_AT] = s->value[CRASHES_AT] = s->value[HANGS_AT] = 1e9;
    return s;
}

static Status set(void *c, const Reference vr[], size_t n, const Real value[])
{
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= COUNT) return BAD;
        ((Slider *)c)->value[vr[i]] = value[i];
    }
    return GOOD;
}

static Status get(void *c, const Reference vr[], size_t n, Real value[])
{
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= COUNT) return BAD;
        value[i] = ((Slider *)c)->value[vr[i]];
    }
    return GOOD;
}

static Status step(Slider *s, Real time, Real size)
{
    Real *x = s->value, end = time + size + 1e-12;
    if (end >= x[CRASHES_AT]) {
        puts("the slider is about to crash");
        fflush(stdout);
        raise(SIGSEGV);
    }
    while (end >= x[HANGS_AT]) pause();
    if (end >= x[FAILS_AT]) {
#ifdef FMI3
        s->log(s->environment, fmi3Error, "logStatusError", "the slider has left its rail");
#else
        s->callbacks.logger(s->callbacks.componentEnvironment, "slider", fmi2Error,
                            "logStatusError", "the slider has left its rail");
#endif
        return BAD;
    }
    x[V] = x[GAIN] * x[U] - x[F] / x[DAMPING];
    x[X] += size * x[V];
    if (end >= x[BREAKS_AT]) x[X] = NAN;
    return GOOD;
}

#ifdef FMI3
const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    if (strcmp(token, "{slider}")) return NULL;
    Slider *s = make();
    s->log = log;
    s->environment = environment;
    return s;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, Real tolerance, Real start,
                                   fmi3Boolean s, Real stop) { return GOOD; }
Status fmi3ExitInitializationMode(fmi3Instance c) { return GOOD; }
Status fmi3Terminate(fmi3Instance c) { return GOOD; }
Status fmi3SetFloat64(fmi3Instance c, const Reference vr[], size_t n, const Real value[], size_t m)
{ return set(c, vr, n, value); }
Status fmi3GetFloat64(fmi3Instance c, const Reference vr[], size_t n, Real value[], size_t m)
{ return get(c, vr, n, value); }
Status fmi3DoStep(fmi3Instance c, Real time, Real size, fmi3Boolean no_set, fmi3Boolean *event,
                  fmi3Boolean *end, fmi3Boolean *early, Real *last)
{
    *event = *end = *early = 0;
    *last = time + size;
    return step(c, time, size);
}
#else
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String path,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                              fmi2Boolean logging)
{
    if (strcmp(guid, "{slider}")) return NULL;
    Slider *s = make();
    s->callbacks = *callbacks;
    return s;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, Real tolerance, Real start,
                           fmi2Boolean s, Real stop) { return GOOD; }
Status fmi2EnterInitializationMode(fmi2Component c) { return GOOD; }
Status fmi2ExitInitializationMode(fmi2Component c) { return GOOD; }
Status fmi2Terminate(fmi2Component c) { return GOOD; }
Status fmi2SetReal(fmi2Component c, const Reference vr[], size_t n, const Real value[])
{ return set(c, vr, n, value); }
Status fmi2GetReal(fmi2Component c, const Reference vr[], size_t n, Real value[])
{ return get(c, vr, n, value); }
Status fmi2DoStep(fmi2Component c, Real time, Real size, fmi2Boolean no_set)
{ return step(c, time, size); }
#endif
