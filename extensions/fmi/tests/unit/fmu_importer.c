/* An importer of FMI 3.0 without any library: loads a unit, moves its points, and prints what it outputs.
 *
 *     fmu_importer LIBRARY TOKEN RESOURCES N_POINTS N_OUTPUTS RESTART
 *
 * Each line of standard input is a time and x, y, z of each point; each line of standard output the outputs at it. At
 * the line RESTART (from 0; -1 is never) it serialises the state, ends the instance, and goes on in another.
 */

#define _POSIX_C_SOURCE 200809L

#include <dlfcn.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void *library;
static uint32_t *inputs, *outputs;
static double *points_m, *values;
static size_t n_inputs, n_values;

static void *find(const char *name) {
    void *function = dlsym(library, name);
    if (function == NULL) {
        fprintf(stderr, "%s is missing\n", name);
        exit(1);
    }
    return function;
}

static void check(int status, const char *what) {
    if (status != 0) {
        fprintf(stderr, "%s returned %d\n", what, status);
        exit(1);
    }
}

static void log_message(void *environment, int status, const char *category, const char *message) {
    (void)environment, (void)category;
    fprintf(stderr, "%d %s\n", status, message);
}

static void *start(char **words, double time_s) {
    void *(*instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t,
                         void *, void (*)(void *, int, const char *, const char *), void *) =
        find("fmi3InstantiateCoSimulation");
    int (*enter)(void *, bool, double, double, bool, double) = find("fmi3EnterInitializationMode");
    int (*set)(void *, const uint32_t *, size_t, const double *, size_t) = find("fmi3SetFloat64");
    int (*leave)(void *) = find("fmi3ExitInitializationMode");
    void *unit = instantiate("room", words[2], words[3], false, true, false, false, NULL, 0, NULL, log_message, NULL);
    check(unit == NULL, "fmi3InstantiateCoSimulation");
    check(enter(unit, false, 0.0, time_s, false, 0.0), "fmi3EnterInitializationMode");
    check(set(unit, inputs, n_inputs, points_m, n_inputs), "fmi3SetFloat64");
    check(leave(unit), "fmi3ExitInitializationMode");
    return unit;
}

static void *restart(char **words, void *unit) {
    int (*get_state)(void *, void **) = find("fmi3GetFMUState");
    int (*set_state)(void *, void *) = find("fmi3SetFMUState");
    int (*free_state)(void *, void **) = find("fmi3FreeFMUState");
    int (*measure)(void *, void *, size_t *) = find("fmi3SerializedFMUStateSize");
    int (*serialize)(void *, void *, uint8_t *, size_t) = find("fmi3SerializeFMUState");
    int (*deserialize)(void *, const uint8_t *, size_t, void **) = find("fmi3DeserializeFMUState");
    int (*terminate)(void *) = find("fmi3Terminate");
    void (*free_instance)(void *) = find("fmi3FreeInstance");
    void *state = NULL;
    size_t size = 0;
    check(get_state(unit, &state), "fmi3GetFMUState");
    check(measure(unit, state, &size), "fmi3SerializedFMUStateSize");
    uint8_t *bytes = malloc(size);
    check(serialize(unit, state, bytes, size), "fmi3SerializeFMUState");
    check(free_state(unit, &state), "fmi3FreeFMUState");
    check(terminate(unit), "fmi3Terminate");
    free_instance(unit);
    unit = start(words, 0.0);
    check(deserialize(unit, bytes, size, &state), "fmi3DeserializeFMUState");
    check(set_state(unit, state), "fmi3SetFMUState");
    check(free_state(unit, &state), "fmi3FreeFMUState");
    free(bytes);
    return unit;
}

int main(int n_words, char **words) {
    if (n_words != 7 || (library = dlopen(words[1], RTLD_NOW)) == NULL) {
        fprintf(stderr, "cannot load: %s\n", n_words == 7 ? dlerror() : "six words are needed");
        return 1;
    }
    int (*get)(void *, const uint32_t *, size_t, double *, size_t) = find("fmi3GetFloat64");
    int (*set)(void *, const uint32_t *, size_t, const double *, size_t) = find("fmi3SetFloat64");
    int (*step)(void *, double, double, bool, bool *, bool *, bool *, double *) = find("fmi3DoStep");
    size_t n_points = strtoul(words[4], NULL, 10), n_outputs = strtoul(words[5], NULL, 10);
    n_inputs = 3 * n_points, n_values = n_outputs * n_points;
    long restart_line = strtol(words[6], NULL, 10);
    inputs = malloc(n_inputs * sizeof *inputs), outputs = malloc(n_values * sizeof *outputs);
    points_m = malloc(n_inputs * sizeof *points_m), values = malloc(n_values * sizeof *values);
    for (size_t p = 0; p < n_points; p++) {
        uint32_t first = 1 + (uint32_t)(p * (3 + n_outputs));
        for (uint32_t i = 0; i < 3; i++) {
            inputs[3 * p + i] = first + i;
        }
        for (uint32_t i = 0; i < n_outputs; i++) {
            outputs[n_outputs * p + i] = first + 3 + i;
        }
    }
    void *unit = NULL;
    double time_s, now_s = 0.0;
    for (long line = 0; scanf("%lf", &time_s) == 1; line++) {
        for (size_t i = 0; i < n_inputs; i++) {
            if (scanf("%lf", &points_m[i]) != 1) {
                return 1;
            }
        }
        if (unit == NULL) {
            unit = start(words, time_s);
        } else {
            bool needs_event = false, terminates = false, is_early = false;
            double last_s = 0.0;
            check(step(unit, now_s, time_s - now_s, true, &needs_event, &terminates, &is_early, &last_s), "fmi3DoStep");
        }
        now_s = time_s;
        check(set(unit, inputs, n_inputs, points_m, n_inputs), "fmi3SetFloat64");
        if (line == restart_line) {
            unit = restart(words, unit);
        }
        check(get(unit, outputs, n_values, values, n_values), "fmi3GetFloat64");
        for (size_t i = 0; i < n_values; i++) {
            printf("%.17g ", values[i]);
        }
        printf("\n");
    }
    return 0;
}
