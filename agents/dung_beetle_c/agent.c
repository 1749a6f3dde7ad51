/* The dung beetle in C: JSON lines on standard input and output, read and written with jansson.
 * The rules and the exact arithmetic are those of ../dung_beetle/README.md. */
#define _POSIX_C_SOURCE 200809L

#include <jansson.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LEG_M 0.8
#define WALL_MARGIN_M 1.0
#define RIGHT_ANGLE_RAD 1.5707963267948966
#define ZIGZAG_RAD 1.0471975511965976
#define HALF_TURN_RAD 3.141592653589793
#define FULL_TURN_RAD 6.283185307179586
#define N_RANDOM_HEADINGS 100

typedef struct {
    char *nose, *vane; /* names of the gas sensor and of the anemometer */
    double min_m[2], max_m[2], height_m;
    uint64_t random_state;
    double last_ohm; /* infinite before the first reading: nothing is less gas than no reading */
    int side;        /* 0 seeking, +1 zigzagging left of upwind, -1 right of it */
} Beetle;

static void fail(const char *what, const char *why) {
    fprintf(stderr, "dung_beetle_c: %s: %s\n", what, why);
    exit(EXIT_FAILURE);
}

/* Lengths are rounded to whole millimetres, so that the last bit of sin and cos has no effect. */
static double to_millimetre(double length_m) { return floor(length_m * 1000.0 + 0.5) / 1000.0; }

static double clamp(double value, double low, double high) { return fmax(low, fmin(high, value)); }

/* The next random number in [0, 1), by SplitMix64. */
static double random_fraction(Beetle *beetle) {
    uint64_t z = beetle->random_state += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

/* Sets the goal to the end of a leg in this direction; says whether it keeps away from the walls. */
static bool try_leg(const Beetle *beetle, const double start_m[2], double heading_rad, double goal_m[3]) {
    goal_m[0] = to_millimetre(start_m[0] + LEG_M * cos(heading_rad));
    goal_m[1] = to_millimetre(start_m[1] + LEG_M * sin(heading_rad));
    for (int axis = 0; axis < 2; axis++)
        if (goal_m[axis] < beetle->min_m[axis] || goal_m[axis] > beetle->max_m[axis]) return false;
    return true;
}

/* Finds the first possible leg: the rule's own, then what is left at a wall; without one, leaves the margin. */
static void next_waypoint(Beetle *beetle, const double start_m[2], double upwind_rad, bool is_blocked,
                          double goal_m[3]) {
    goal_m[2] = beetle->height_m;
    if (beetle->side == 0) {
        if (!is_blocked && try_leg(beetle, start_m, upwind_rad + RIGHT_ANGLE_RAD, goal_m)) return;
    } else {
        if (try_leg(beetle, start_m, upwind_rad + beetle->side * ZIGZAG_RAD, goal_m)) return;
        beetle->side = -beetle->side;
        if (try_leg(beetle, start_m, upwind_rad + beetle->side * ZIGZAG_RAD, goal_m)) return;
        if (try_leg(beetle, start_m, upwind_rad + HALF_TURN_RAD, goal_m)) return;
    }
    for (int i = 0; i < N_RANDOM_HEADINGS; i++)
        if (try_leg(beetle, start_m, FULL_TURN_RAD * random_fraction(beetle), goal_m)) return;
    for (int axis = 0; axis < 2; axis++)
        goal_m[axis] = to_millimetre(clamp(start_m[axis], beetle->min_m[axis], beetle->max_m[axis]));
}

/* The number at `index` of what the sensor of this name reports. */
static double reading(json_t *observation, const char *sensor, size_t index) {
    size_t i;
    json_t *item;
    json_array_foreach(json_object_get(observation, "readings"), i, item) {
        const char *name = json_string_value(json_object_get(item, "sensor"));
        json_t *value = json_array_get(json_object_get(item, "values"), index);
        if (name && strcmp(name, sensor) == 0 && json_is_number(value)) return json_number_value(value);
    }
    fail("observation without a reading of", sensor);
    return 0.0;
}

/* The answer to an observation that awaits one. */
static json_t *decide(Beetle *beetle, json_t *observation) {
    json_error_t error;
    json_int_t tick;
    double start_m[2], goal_m[3];
    if (json_unpack_ex(observation, &error, 0, "{s:I, s:[F,F]}", "tick", &tick, "position_world_m", &start_m[0],
                       &start_m[1]))
        fail("observation", error.text);

    double ohm = reading(observation, beetle->nose, 0);
    bool has_more_gas = ohm < beetle->last_ohm && isfinite(beetle->last_ohm);
    beetle->last_ohm = ohm;
    if (beetle->side == 0)
        beetle->side = has_more_gas ? 1 : 0;
    else if (!has_more_gas)
        beetle->side = -beetle->side;

    bool is_blocked = json_is_string(json_object_get(observation, "notice"));
    next_waypoint(beetle, start_m, reading(observation, beetle->vane, 1), is_blocked, goal_m);
    return json_pack("{s:I, s:s, s:[f,f,f]}", "tick", tick, "kind", "waypoint", "position_world_m", goal_m[0],
                     goal_m[1], goal_m[2]);
}

/* The name of the first sensor whose `key` is `wanted`. */
static char *sensor_with(json_t *briefing, const char *key, const char *wanted) {
    size_t i;
    json_t *sensor;
    json_array_foreach(json_object_get(briefing, "sensors"), i, sensor) {
        const char *value = json_string_value(json_object_get(sensor, key));
        const char *name = json_string_value(json_object_get(sensor, "name"));
        if (value && name && strcmp(value, wanted) == 0) return strdup(name);
    }
    fail("briefing without a sensor of", wanted);
    return NULL;
}

static Beetle briefed(json_t *briefing) {
    Beetle beetle = {.last_ohm = INFINITY};
    json_error_t error;
    json_int_t seed;
    const char *version;
    if (json_unpack_ex(briefing, &error, 0, "{s:s, s:I, s:F, s:{s:[F,F], s:[F,F]}}", "contract_version", &version,
                       "seed", &seed, "search_height_m", &beetle.height_m, "bounds", "min_m", &beetle.min_m[0],
                       &beetle.min_m[1], "max_m", &beetle.max_m[0], &beetle.max_m[1]))
        fail("briefing", error.text);
    if (strncmp(version, "1.", 2) != 0) fail("expected contract version 1, was", version);
    for (int axis = 0; axis < 2; axis++) {
        beetle.min_m[axis] += WALL_MARGIN_M;
        beetle.max_m[axis] -= WALL_MARGIN_M;
    }
    beetle.random_state = (uint64_t)seed;
    beetle.nose = sensor_with(briefing, "unit", "ohm");
    beetle.vane = sensor_with(briefing, "model", "anemometer");
    return beetle;
}

static void send_line(json_t *message) {
    if (json_dumpf(message, stdout, JSON_COMPACT) || putchar('\n') == EOF || fflush(stdout))
        fail("standard output", "closed");
    json_decref(message);
}

int main(void) {
    Beetle beetle = {0};
    char *line = NULL;
    size_t capacity = 0;
    bool is_over = false;
    while (!is_over && getline(&line, &capacity, stdin) > 0) {
        json_error_t error;
        json_t *message = json_loads(line, 0, &error);
        const char *kind = json_string_value(json_object_get(message, "message"));
        if (!kind) fail("expected a JSON object with \"message\"", message ? line : error.text);
        if (strcmp(kind, "Briefing") == 0)
            beetle = briefed(message);
        else if (strcmp(kind, "Ending") == 0)
            is_over = true;
        else if (!beetle.nose)
            fail("expected a Briefing first", line);
        else if (json_is_true(json_object_get(message, "awaiting_command")))
            send_line(decide(&beetle, message));
        json_decref(message);
    }
    free(line);
    free(beetle.nose);
    free(beetle.vane);
    return EXIT_SUCCESS;
}
