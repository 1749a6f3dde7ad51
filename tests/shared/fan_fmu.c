/* A fan that turns up while there is gas, as an FMU of FMI 2 or 3 (-DFMI=2 or 3).

   UNIT_FAULT=FUNCTION:KIND lets a function crash, hang, exit, print, return a status, or give another result,
   from the simulated time UNIT_FAULT_S on. UNIT_FRAMES=FUNCTION:BYTES, in hexadecimal digits, lets it write to all
   pipes of its process, as answers that nobody has asked it for. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#if FMI == 3
#include "fmi3Functions.h"
#define NAME(three, two) three
typedef fmi3Status Status;
typedef fmi3Instance Instance;
typedef fmi3ValueReference Reference;
#else
#include "fmi2Functions.h"
#define NAME(three, two) two
typedef fmi2Status Status;
typedef fmi2Component Instance;
typedef fmi2ValueReference Reference;
#endif

typedef struct { double gas_ppm, above_ppm, share, time_s; int n_steps, is_in_gas; } State;
typedef struct {
    State state;
#if FMI == 3
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
#else
    const fmi2CallbackFunctions *callbacks;
#endif
} Unit;

static double reached_time_s;

static int has_fault(const char *function, const char *kind) {
    const char *wanted = getenv("UNIT_FAULT"), *from_s = getenv("UNIT_FAULT_S");
    size_t n = strlen(function);
    if (from_s && reached_time_s < atof(from_s) - 1e-9) return 0;
    return wanted && !strncmp(wanted, function, n) && wanted[n] == ':' && !strcmp(wanted + n + 1, kind);
}

static void write_frames(const char *function) {
    static unsigned char bytes[1 << 16];
    const char *wanted = getenv("UNIT_FRAMES");
    size_t n = strlen(function), n_bytes = 0;
    unsigned byte;
    if (!wanted || strncmp(wanted, function, n) || wanted[n] != ':') return;
    for (const char *digits = wanted + n + 1; sscanf(digits, "%2x", &byte) == 1; digits += 2)
        bytes[n_bytes++] = byte;
    for (int fd = 3; fd < 64; fd++) {
        struct stat status;
        if (!fstat(fd, &status) && S_ISFIFO(status.st_mode)) (void)!write(fd, bytes, n_bytes);
    }
}

static int enter(Unit *unit, const char *function) {
    write_frames(function);
    if (has_fault(function, "crash")) abort();
    if (has_fault(function, "segfault")) *(volatile int *)0 = 1;
    if (has_fault(function, "exit")) _exit(7);
    while (has_fault(function, "hang")) sleep(1);
    if (has_fault(function, "print")) { printf("%s was here\n", function); fflush(stdout); }
    int status = has_fault(function, "discard") ? 2 : has_fault(function, "error") ? 3 : has_fault(function, "fatal") ? 4 : 0;
    if (status && unit)
#if FMI == 3
        unit->log(unit->environment, status, "logStatusError", "the fan is stuck");
#else
        unit->callbacks->logger(unit->callbacks->componentEnvironment, "fan", status, "logStatusError", "the %s is stuck", "fan");
#endif
    return status;
}

__attribute__((constructor)) static void load(void) { enter(NULL, "load"); }

#define ENTER(three, two) \
    int status = enter(instance, NAME(three, two)); \
    if (status) return status; \
    State *s = &((Unit *)instance)->state; \
    (void)s

static Instance make(const char *token) {
    if (strcmp(token, "fan-1")) return NULL;
    Unit *unit = calloc(1, sizeof *unit);
    unit->state.above_ppm = 1.0;
    unit->state.share = 1.0;
    return unit;
}

static Status step(State *s, double start_s, double step_s) {
    if (fabs(start_s - s->time_s) > 1e-9) return 3;
    s->is_in_gas = s->gas_ppm > s->above_ppm;
    s->share += ((s->is_in_gas ? 3.0 : 1.0) - s->share) * (1.0 - exp(-step_s));
    reached_time_s = s->time_s = start_s + step_s;
    s->n_steps++;
    if (has_fault("share", "nan")) s->share = NAN;
    if (has_fault("share", "negative")) s->share = -1.0;
    return 0;
}

static double *find_real(State *s, Reference reference) {
    return reference == 1 ? &s->gas_ppm : reference == 2 ? &s->above_ppm : reference == 3 ? &s->share : NULL;
}

#if FMI == 3
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
    fmi3Boolean early, const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    if (enter(NULL, "fmi3InstantiateCoSimulation")) return NULL;
    Unit *unit = make(token);
    if (!unit) { log(environment, 3, "logStatusError", "the token is wrong"); return NULL; }
    unit->environment = environment;
    unit->log = log;
    return unit;
}
void fmi3FreeInstance(fmi3Instance instance) { enter(NULL, "fmi3FreeInstance"); free(instance); }
fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 start_s, fmi3Float64 step_s, fmi3Boolean no_set, fmi3Boolean *event,
    fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached_s) {
    ENTER("fmi3DoStep", "");
    *event = *early = false;
    *end = has_fault("fmi3DoStep", "end");
    *early = has_fault("fmi3DoStep", "early");
    *reached_s = start_s + (*early ? 0.5 : 1.0) * step_s;
    return step(s, start_s, step_s);
}
fmi3Status fmi3GetInt32(fmi3Instance instance, const Reference r[], size_t n, fmi3Int32 v[], size_t m) {
    ENTER("fmi3GetInt32", "");
    for (size_t i = 0; i < n; i++) v[i] = s->n_steps;
    return 0;
}
fmi3Status fmi3GetBoolean(fmi3Instance instance, const Reference r[], size_t n, fmi3Boolean v[], size_t m) {
    ENTER("fmi3GetBoolean", "");
    for (size_t i = 0; i < n; i++) v[i] = s->is_in_gas;
    return 0;
}
#define REALS const Reference r[], size_t n, NAME(fmi3Float64, ) v[], size_t m
#define CONST_REALS const Reference r[], size_t n, const NAME(fmi3Float64, ) v[], size_t m
#else
fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String token, fmi2String path, const fmi2CallbackFunctions *callbacks,
    fmi2Boolean visible, fmi2Boolean logging) {
    if (enter(NULL, "fmi2Instantiate")) return NULL;
    Unit *unit = make(token);
    if (unit) unit->callbacks = callbacks;
    return unit;
}
void fmi2FreeInstance(fmi2Component instance) { enter(NULL, "fmi2FreeInstance"); free(instance); }
fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real start_s, fmi2Real step_s, fmi2Boolean no_set) {
    ENTER("", "fmi2DoStep");
    return step(s, start_s, step_s);
}
fmi2Status fmi2GetRealStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Real *value) {
    *value = 0.05;
    return 0;
}
fmi2Status fmi2GetInteger(fmi2Component instance, const Reference r[], size_t n, fmi2Integer v[]) {
    ENTER("", "fmi2GetInteger");
    for (size_t i = 0; i < n; i++) v[i] = s->n_steps;
    return 0;
}
fmi2Status fmi2GetBoolean(fmi2Component instance, const Reference r[], size_t n, fmi2Boolean v[]) {
    ENTER("", "fmi2GetBoolean");
    for (size_t i = 0; i < n; i++) v[i] = s->is_in_gas;
    return 0;
}
#define REALS const Reference r[], size_t n, fmi2Real v[]
#define CONST_REALS const Reference r[], size_t n, const fmi2Real v[]
#endif

Status NAME(fmi3GetFloat64, fmi2GetReal)(Instance instance, REALS) {
    ENTER("fmi3GetFloat64", "fmi2GetReal");
    for (size_t i = 0; i < n; i++) if (find_real(s, r[i])) v[i] = *find_real(s, r[i]);
    return 0;
}
Status NAME(fmi3SetFloat64, fmi2SetReal)(Instance instance, CONST_REALS) {
    ENTER("fmi3SetFloat64", "fmi2SetReal");
    for (size_t i = 0; i < n; i++) if (find_real(s, r[i])) *find_real(s, r[i]) = v[i];
    return 0;
}
#if FMI == 3
fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start_s, fmi3Boolean has_stop,
    fmi3Float64 stop_s) {
    ENTER("fmi3EnterInitializationMode", "");
    return 0;
}
#else
fmi2Status fmi2SetupExperiment(
    fmi2Component instance, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start_s, fmi2Boolean has_stop,
    fmi2Real stop_s) {
    ENTER("", "fmi2SetupExperiment");
    return 0;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component instance) { ENTER("", "fmi2EnterInitializationMode"); return 0; }
#endif
Status NAME(fmi3ExitInitializationMode, fmi2ExitInitializationMode)(Instance instance) {
    ENTER("fmi3ExitInitializationMode", "fmi2ExitInitializationMode");
    return 0;
}
Status NAME(fmi3Terminate, fmi2Terminate)(Instance instance) { ENTER("fmi3Terminate", "fmi2Terminate"); return 0; }

typedef NAME(fmi3FMUState, fmi2FMUstate) Kept;
typedef NAME(fmi3Byte, fmi2Byte) Byte;
Status NAME(fmi3GetFMUState, fmi2GetFMUstate)(Instance instance, Kept *kept) {
    ENTER("fmi3GetFMUState", "fmi2GetFMUstate");
    *kept = malloc(sizeof *s);
    memcpy(*kept, s, sizeof *s);
    return 0;
}
Status NAME(fmi3SetFMUState, fmi2SetFMUstate)(Instance instance, Kept kept) {
    ENTER("fmi3SetFMUState", "fmi2SetFMUstate");
    memcpy(s, kept, sizeof *s);
    return 0;
}
Status NAME(fmi3FreeFMUState, fmi2FreeFMUstate)(Instance instance, Kept *kept) {
    ENTER("fmi3FreeFMUState", "fmi2FreeFMUstate");
    free(*kept);
    *kept = NULL;
    return 0;
}
Status NAME(fmi3SerializedFMUStateSize, fmi2SerializedFMUstateSize)(Instance instance, Kept kept, size_t *size) {
    ENTER("fmi3SerializedFMUStateSize", "fmi2SerializedFMUstateSize");
    *size = sizeof *s;
    return 0;
}
Status NAME(fmi3SerializeFMUState, fmi2SerializeFMUstate)(Instance instance, Kept kept, Byte data[], size_t size) {
    ENTER("fmi3SerializeFMUState", "fmi2SerializeFMUstate");
    memcpy(data, kept, size);
    return 0;
}
Status NAME(fmi3DeserializeFMUState, fmi2DeSerializeFMUstate)(
    Instance instance, const Byte data[], size_t size, Kept *kept) {
    ENTER("fmi3DeserializeFMUState", "fmi2DeSerializeFMUstate");
    *kept = malloc(size);
    memcpy(*kept, data, size);
    return 0;
}
