/* NAME: flies half a metre up the wind, again and again. Now make it find the source. */
#define _POSIX_C_SOURCE 200809L

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

int main(void) {
    char *line = NULL;
    size_t capacity = 0;
    double height_m = 0;
    while (getline(&line, &capacity, stdin) > 0) {
        json_t *message = json_loads(line, 0, NULL);
        const char *kind = json_string_value(json_object_get(message, "message"));
        if (!kind || strcmp(kind, "Ending") == 0) break;
        if (strcmp(kind, "Briefing") == 0) height_m = json_number_value(json_object_get(message, "search_height_m"));
        if (json_is_true(json_object_get(message, "awaiting_command"))) {
            size_t i;
            json_t *reading;
            double x_m, y_m, upwind_rad = 0;
            json_array_foreach(json_object_get(message, "readings"), i, reading)
                if (strcmp(json_string_value(json_object_get(reading, "sensor")), "wind") == 0)
                    json_unpack(reading, "{s:[F,F]}", "values", &(double){0}, &upwind_rad);
            json_unpack(message, "{s:[F,F]}", "position_world_m", &x_m, &y_m);
            json_t *command =
                json_pack("{s:O, s:s, s:[f,f,f]}", "tick", json_object_get(message, "tick"), "kind", "waypoint",
                          "position_world_m", x_m + 0.5 * cos(upwind_rad), y_m + 0.5 * sin(upwind_rad), height_m);
            json_dumpf(command, stdout, JSON_COMPACT);
            putchar('\n');
            fflush(stdout);
            json_decref(command);
        }
        json_decref(message);
    }
    return 0;
}
