/* A room of gslcosim as an FMI 3.0 unit for co-simulation: stored wind, and gas of recorded filaments, at points.
 *
 * The room lies in resources/room.bin, so this file is the same for all rooms. Its layout, little-endian:
 *
 *     magic, token       "gslroom1", and the instantiation token in 64 bytes, padded with zeros
 *     numbers            struct Header, without magic and token
 *     strength_ppm_m3    double [n_sources], a filament's gas as volume of pure gas
 *     gas_index          int64 [n_sources]
 *     sensor_kinds       int64 [n_sensors], of SensorKind
 *     sensor_numbers     double [n_sensors][6 + 2 n_gases], parameters of the kernel of gslcosim, then zeros
 *     first              int64 [n_gas_frames + 1], frame k holds the filaments first[k] to first[k + 1] - 1
 *     occupancy          uint8 [nx][ny][nz], 1 is solid; with has_gas
 *     cells_to_wall      uint8 [nx][ny][nz][6], toward -x, +x, -y, +y, -z, +z, 255 is none; with has_wall_images
 *     wind               float32 [n_wind_frames][nx][ny][nz][3], at cell centres [m/s]
 *     filaments          float32 [n_filaments][4], x, y, z and sigma [m]
 *     sources            uint8 [n_filaments], which source released it
 *
 * Frames are read when time reaches them, so an instance takes the memory of one frame of each kind.
 * Formulas and their order of operations are those of gslcosim's kernels; compile without fused multiply-add
 * (-ffp-contract=off) and without -ffast-math, or samples differ from gslcosim's in their last digits.
 *
 * Value references: 0 is time; point p (from 0) has 1 + p (6 + n_gases + n_sensors) for x, then y, z, wind x, y, z, its
 * gases and its sensors.
 */

#define _FILE_OFFSET_BITS 64
#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#define seek_file _fseeki64
#define tell_file _ftelli64
#else
#define EXPORT __attribute__((visibility("default")))
#define seek_file fseeko
#define tell_file ftello
#endif

/* The types of FMI 3.0, as its standard headers declare them. */
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*LogMessage)(void *environment, fmi3Status status, const char *category, const char *message);

static const char UNREADABLE[] = "room.bin: expected a frame that can be read, was not.";
enum { N_COORDINATES = 3, N_WIND = 3, TOKEN_SIZE = 64, SOLID = 1, NO_WALL = 255 };
static const double NORMALISATION = 15.749609945722419; /* (2 pi)^(3/2) */
static const double EXP_MINUS_MIDDLE = 0.0019304541362277093; /* exp(-6.25) */

typedef struct {
    char magic[8];
    char token[TOKEN_SIZE];
    int64_t n_points, n_gases, n_sensors;
    int64_t shape[3];
    int64_t n_wind_frames, is_wind_looping;
    int64_t has_gas, n_sources, n_gas_frames, n_filaments, has_wall_images;
    double origin_m[3], cell_m;
    double wind_period_s, wind_start_s;
    double gas_step_s, cutoff_sigma;
    double tick_s;
} Header;

typedef enum { MOX, PID } SensorKind;
enum { R0_OHM, AIR_RATIO, RISE_FRAC, DECAY_FRAC, LAWS = 6 }; /* of a MOX sensor */
enum { LAG_FRAC, CORRECTIONS };                               /* of a PID */
static const double MIN_RATIO = 0.01;

typedef enum { INSTANTIATED, INITIALIZATION, STEP, TERMINATED } Mode;

/* All that changes: what snapshots hold. Inputs and what sensors remember follow it in memory. */
typedef struct {
    char token[TOKEN_SIZE];
    double time_s;
    int64_t mode;
} State;

typedef struct {
    void *environment;
    LogMessage log_message;
    FILE *file;
    Header header;
    double *strength_ppm_m3;
    int64_t *gas_index, *first, *sensor_kinds;
    double *sensor_numbers;
    uint8_t *occupancy, *cells_to_wall;
    int64_t wind_at, filaments_at, sources_at; /* offsets in the file */
    float *wind_m_s;                           /* of one frame */
    int64_t i_wind;
    float *filaments;
    uint8_t *sources;
    int64_t i_gas, filament_capacity;
    double time_s;
    Mode mode;
    double *inputs;     /* (n_points, 3) [m] */
    double *remembered; /* (n_points, n_sensors) Rs/R0 of a MOX sensor, 0 before its first reading; what a PID shows */
    double *outputs;    /* (n_points, 3 + n_gases) [m/s], [ppm] */
    bool *is_current;
} Unit;

/* ---------------------------------------------------------------------------------------------------- messages */

static fmi3Status report(const Unit *unit, fmi3Status status, const char *format, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (unit->log_message != NULL) {
        unit->log_message(unit->environment, status, "logStatusError", text);
    }
    return status;
}

static const char *name_mode(Mode mode) {
    static const char *const NAMES[] = {"instantiated", "in initialization mode", "in step mode", "terminated"};
    return NAMES[mode];
}

static fmi3Status refuse(const Unit *unit, const char *function) {
    return report(unit, fmi3Error, "%s: expected another call, as the unit is %s.", function, name_mode(unit->mode));
}

/* ------------------------------------------------------------------------------------------------ the room's file */

static bool read_part(Unit *unit, void **values, int64_t n, size_t size) {
    if (n == 0) {
        return true;
    }
    *values = malloc((size_t)n * size);
    return *values != NULL && fread(*values, size, (size_t)n, unit->file) == (size_t)n;
}

static int64_t count_cells(const Header *header) {
    return header->shape[0] * header->shape[1] * header->shape[2];
}

/* Wind and gas of a point; then come its sensors. */
static size_t count_samples(const Header *header) {
    return (size_t)(N_WIND + header->n_gases);
}

static size_t count_sensor_numbers(const Header *header) {
    return (size_t)(LAWS + 2 * header->n_gases);
}

/* Whether the file is one of this layout and whole; where its frames are. */
static bool open_room(Unit *unit, const char *resource_path, const char *token) {
    size_t length = resource_path == NULL ? 0 : strlen(resource_path);
    char *path = malloc(length + sizeof "/room.bin");
    if (length == 0 || path == NULL) {
        free(path);
        report(unit, fmi3Error, "resourcePath: expected the folder with room.bin, was none.");
        return false;
    }
    char end = resource_path[length - 1];
    sprintf(path, "%s%sroom.bin", resource_path, end == '/' || end == '\\' ? "" : "/");
    unit->file = fopen(path, "rb");
    if (unit->file == NULL) {
        report(unit, fmi3Error, "resourcePath: expected the folder with room.bin, was without it: %s", path);
        free(path);
        return false;
    }
    free(path);
    Header *header = &unit->header;
    if (fread(header, sizeof *header, 1, unit->file) != 1 || memcmp(header->magic, "gslroom1", 8) != 0) {
        report(unit, fmi3Error, "room.bin: expected a room of layout gslroom1, was something else.");
        return false;
    }
    if (token == NULL || strncmp(token, header->token, TOKEN_SIZE) != 0) {
        report(unit, fmi3Error, "instantiationToken: expected %.64s, was %.80s.", header->token,
               token == NULL ? "none" : token);
        return false;
    }
    int64_t n_cells = count_cells(header), n = header->n_filaments;
    bool is_read = read_part(unit, (void **)&unit->strength_ppm_m3, header->n_sources, sizeof(double)) &&
                   read_part(unit, (void **)&unit->gas_index, header->n_sources, sizeof(int64_t)) &&
                   read_part(unit, (void **)&unit->sensor_kinds, header->n_sensors, sizeof(int64_t)) &&
                   read_part(unit, (void **)&unit->sensor_numbers,
                             header->n_sensors * (int64_t)count_sensor_numbers(header), sizeof(double)) &&
                   read_part(unit, (void **)&unit->first, header->has_gas ? header->n_gas_frames + 1 : 0,
                             sizeof(int64_t)) &&
                   read_part(unit, (void **)&unit->occupancy, header->has_gas ? n_cells : 0, 1) &&
                   read_part(unit, (void **)&unit->cells_to_wall, header->has_wall_images ? 6 * n_cells : 0, 1);
    unit->wind_at = (int64_t)tell_file(unit->file);
    unit->filaments_at = unit->wind_at + header->n_wind_frames * n_cells * N_WIND * (int64_t)sizeof(float);
    unit->sources_at = unit->filaments_at + n * 4 * (int64_t)sizeof(float);
    is_read = is_read && seek_file(unit->file, 0, SEEK_END) == 0;
    if (!is_read || (int64_t)tell_file(unit->file) != unit->sources_at + n) {
        report(unit, fmi3Error, "room.bin: expected a whole file, was too short or too long.");
        return false;
    }
    return true;
}

static bool read_frame(Unit *unit, void *values, int64_t offset, int64_t n, size_t size) {
    return seek_file(unit->file, offset, SEEK_SET) == 0 && fread(values, size, (size_t)n, unit->file) == (size_t)n;
}

/* int(x + 1e-9) of the number of steps that a time is: 0.3 s is step 3 of 0.1 s, whatever rounding makes of it. */
static int64_t count_steps(double time_s, double step_s) {
    return (int64_t)(time_s / step_s + 1e-9);
}

static bool load_wind(Unit *unit) {
    const Header *header = &unit->header;
    int64_t i = count_steps(header->wind_start_s + unit->time_s, header->wind_period_s), n = header->n_wind_frames;
    i = header->is_wind_looping ? i % n : (i < n ? i : n - 1);
    if (i == unit->i_wind) {
        return true;
    }
    int64_t n_values = count_cells(header) * N_WIND;
    unit->i_wind = -1;
    if (!read_frame(unit, unit->wind_m_s, unit->wind_at + i * n_values * (int64_t)sizeof(float), n_values,
                    sizeof(float))) {
        return false;
    }
    unit->i_wind = i;
    return true;
}

static bool load_filaments(Unit *unit) {
    int64_t i = count_steps(unit->time_s, unit->header.gas_step_s);
    if (!unit->header.has_gas || i == unit->i_gas) {
        return true;
    }
    int64_t begin = unit->first[i], n = unit->first[i + 1] - begin;
    unit->i_gas = -1;
    if (n > unit->filament_capacity) {
        free(unit->filaments);
        free(unit->sources);
        unit->filament_capacity = 2 * n;
        unit->filaments = malloc((size_t)(2 * n) * 4 * sizeof(float));
        unit->sources = malloc((size_t)(2 * n));
        if (unit->filaments == NULL || unit->sources == NULL) {
            unit->filament_capacity = 0;
            return false;
        }
    }
    if (n > 0 && !(read_frame(unit, unit->filaments, unit->filaments_at + begin * 4 * (int64_t)sizeof(float), 4 * n,
                              sizeof(float)) &&
                   read_frame(unit, unit->sources, unit->sources_at + begin, n, 1))) {
        return false;
    }
    unit->i_gas = i;
    return true;
}

/* ---------------------------------------------------------------------------------------------------------- wind */

/* Lower cell centre and weight of the upper one, clamped: see _bracket of gslcosim/environment/grid_kernels.py. */
static int64_t bracket(double coordinate_m, double origin_m, double cell_m, int64_t n, double *weight) {
    double s = (coordinate_m - origin_m) / cell_m - 0.5;
    if (s <= 0.0) {
        *weight = 0.0;
        return 0;
    }
    if (s >= (double)(n - 1)) {
        *weight = n > 1 ? 1.0 : 0.0;
        return n > 2 ? n - 2 : 0;
    }
    int64_t i = (int64_t)s;
    *weight = s - (double)i;
    return i;
}

/* Trilinear interpolation between cell centres: see trilinear_wind of gslcosim/environment/grid_kernels.py. */
static void interpolate_wind(const Unit *unit, const double *point_m, double *wind_m_s) {
    const Header *header = &unit->header;
    const int64_t *shape = header->shape;
    double a, b, c;
    int64_t i = bracket(point_m[0], header->origin_m[0], header->cell_m, shape[0], &a);
    int64_t j = bracket(point_m[1], header->origin_m[1], header->cell_m, shape[1], &b);
    int64_t k = bracket(point_m[2], header->origin_m[2], header->cell_m, shape[2], &c);
    int64_t i1 = i + 1 < shape[0] ? i + 1 : shape[0] - 1;
    int64_t j1 = j + 1 < shape[1] ? j + 1 : shape[1] - 1;
    int64_t k1 = k + 1 < shape[2] ? k + 1 : shape[2] - 1;
    double w000 = (1.0 - a) * (1.0 - b) * (1.0 - c), w100 = a * (1.0 - b) * (1.0 - c);
    double w010 = (1.0 - a) * b * (1.0 - c), w110 = a * b * (1.0 - c);
    double w001 = (1.0 - a) * (1.0 - b) * c, w101 = a * (1.0 - b) * c;
    double w011 = (1.0 - a) * b * c, w111 = a * b * c;
    const float *f = unit->wind_m_s;
#define AT(i, j, k) f[(((i) * shape[1] + (j)) * shape[2] + (k)) * N_WIND + axis]
    for (int axis = 0; axis < N_WIND; axis++) {
        wind_m_s[axis] = w000 * AT(i, j, k) + w100 * AT(i1, j, k) + w010 * AT(i, j1, k) + w110 * AT(i1, j1, k) +
                         w001 * AT(i, j, k1) + w101 * AT(i1, j, k1) + w011 * AT(i, j1, k1) + w111 * AT(i1, j1, k1);
    }
#undef AT
}

/* ----------------------------------------------------------------------------------------------------------- gas */

static bool is_solid_at(const Unit *unit, const int64_t *cell) {
    const int64_t *shape = unit->header.shape;
    for (int axis = 0; axis < 3; axis++) {
        if (cell[axis] < 0 || cell[axis] >= shape[axis]) {
            return false;
        }
    }
    return unit->occupancy[(cell[0] * shape[1] + cell[1]) * shape[2] + cell[2]] == SOLID;
}

/* Whether no solid cell lies between two points: see is_line_of_sight_free of gslcosim/environment/grid_kernels.py. */
static bool is_visible(const Unit *unit, const double *a_m, const double *b_m) {
    const Header *header = &unit->header;
    const double *start_m = a_m, *end_m = b_m;
    if (a_m[0] > b_m[0] ||
        (a_m[0] == b_m[0] && (a_m[1] > b_m[1] || (a_m[1] == b_m[1] && a_m[2] > b_m[2])))) {
        start_m = b_m, end_m = a_m;
    }
    int64_t cell[3], last[3], step[3], n_steps = 0;
    double next[3], gap[3];
    for (int axis = 0; axis < 3; axis++) {
        double start = (start_m[axis] - header->origin_m[axis]) / header->cell_m;
        double end = (end_m[axis] - header->origin_m[axis]) / header->cell_m;
        cell[axis] = (int64_t)floor(start);
        last[axis] = (int64_t)floor(end);
        step[axis] = last[axis] > cell[axis] ? 1 : (last[axis] < cell[axis] ? -1 : 0);
        next[axis] = gap[axis] = INFINITY;
        if (step[axis] != 0) {
            double border = step[axis] > 0 ? (double)cell[axis] + 1.0 : (double)cell[axis];
            double per_cell = 1.0 / (end - start);
            next[axis] = (border - start) * per_cell;
            gap[axis] = fabs(per_cell);
        }
        n_steps += step[axis] < 0 ? cell[axis] - last[axis] : last[axis] - cell[axis];
    }
    for (int64_t i = 0; i <= n_steps; i++) {
        if (is_solid_at(unit, cell)) {
            return false;
        }
        int axis = next[0] <= next[1] && next[0] <= next[2] ? 0 : (next[1] <= next[2] ? 1 : 2);
        cell[axis] += step[axis];
        next[axis] = cell[axis] != last[axis] ? next[axis] + gap[axis] : INFINITY;
    }
    return true;
}

/* exp(-e) for 0 <= e <= 12.5: see exp_minus of services/fields/spatial_index.py. */
static double exp_minus(double e) {
    double r = (6.25 - e) * 0.03125;
    double p = 1.0 / 39916800.0;
    p = p * r + 1.0 / 3628800.0;
    p = p * r + 1.0 / 362880.0;
    p = p * r + 1.0 / 40320.0;
    p = p * r + 1.0 / 5040.0;
    p = p * r + 1.0 / 720.0;
    p = p * r + 1.0 / 120.0;
    p = p * r + 1.0 / 24.0;
    p = p * r + 1.0 / 6.0;
    p = p * r + 0.5;
    p = p * r + 1.0;
    p = p * r + 1.0;
    p = p * p;
    p = p * p;
    p = p * p;
    p = p * p;
    return p * p * EXP_MINUS_MIDDLE;
}

/* A filament with its mirror images at the walls around its cell: see services/fields/wall_images.py. */
static double image_factor(const Unit *unit, const double *point_m, const double *centre_m, double s) {
    const Header *header = &unit->header;
    int64_t cell[3];
    for (int axis = 0; axis < 3; axis++) {
        int64_t i = (int64_t)floor((centre_m[axis] - header->origin_m[axis]) / header->cell_m);
        cell[axis] = i < 0 ? 0 : (i < header->shape[axis] ? i : header->shape[axis] - 1);
    }
    const uint8_t *n =
        unit->cells_to_wall + 6 * ((cell[0] * header->shape[1] + cell[1]) * header->shape[2] + cell[2]);
    double product = 1.0;
    for (int axis = 0; axis < 3; axis++) {
        double factor = 1.0;
        if (n[2 * axis] != NO_WALL) {
            double low_m = header->origin_m[axis] + (double)(cell[axis] - n[2 * axis]) * header->cell_m;
            double below_m = point_m[axis] - low_m;
            if (below_m > 0.0) {
                factor += exp(-2.0 * below_m * (centre_m[axis] - low_m) / (s * s));
            }
        }
        if (n[2 * axis + 1] != NO_WALL) {
            double high_m = header->origin_m[axis] + (double)(cell[axis] + 1 + n[2 * axis + 1]) * header->cell_m;
            double above_m = high_m - point_m[axis];
            if (above_m > 0.0) {
                factor += exp(-2.0 * above_m * (high_m - centre_m[axis]) / (s * s));
            }
        }
        product *= factor;
    }
    return product;
}

/* The sum over filaments in sight and within the cut-off: see services/fields/mixing_ratio.py, spatial_index.py. */
static void sum_filaments(const Unit *unit, const double *point_m, double *ppm) {
    const Header *header = &unit->header;
    double cutoff = header->cutoff_sigma, largest_exponent = 0.5 * cutoff * cutoff;
    int64_t n = unit->first[unit->i_gas + 1] - unit->first[unit->i_gas];
    for (int64_t f = 0; f < n; f++) {
        const float *row = unit->filaments + 4 * f;
        double centre_m[3] = {row[0], row[1], row[2]}, s = row[3];
        double dx = centre_m[0] - point_m[0], dy = centre_m[1] - point_m[1], dz = centre_m[2] - point_m[2];
        double exponent = (dx * dx + dy * dy + dz * dz) * (0.5 / (s * s));
        if (exponent > largest_exponent || !is_visible(unit, point_m, centre_m)) {
            continue;
        }
        int64_t source = unit->sources[f];
        double share = unit->strength_ppm_m3[source] / (NORMALISATION * s * s * s) * exp_minus(exponent);
        if (header->has_wall_images) {
            share *= image_factor(unit, point_m, centre_m, s);
        }
        ppm[unit->gas_index[source]] += share;
    }
}

/* Gas and wind at a point. */
static bool compute_samples(Unit *unit, size_t point) {
    if (unit->is_current[point]) {
        return true;
    }
    if (!load_wind(unit) || !load_filaments(unit)) {
        return false;
    }
    const double *point_m = unit->inputs + N_COORDINATES * point;
    double *outputs = unit->outputs + count_samples(&unit->header) * point;
    interpolate_wind(unit, point_m, outputs);
    for (int64_t gas = 0; gas < unit->header.n_gases; gas++) {
        outputs[N_WIND + gas] = 0.0;
    }
    if (unit->header.has_gas) {
        sum_filaments(unit, point_m, outputs + N_WIND);
    }
    unit->is_current[point] = true;
    return true;
}

/* ------------------------------------------------------------------------------------------------------- sensors */

/* Rs/R0 that a MOX sensor settles to: see steady_ratio of services/sensing/models/mox.py. */
static double steady_ratio(const Header *header, const double *numbers, const double *ppm) {
    double air = numbers[AIR_RATIO], ratio = air;
    for (int64_t gas = 0; gas < header->n_gases; gas++) {
        double a = numbers[LAWS + 2 * gas], b = numbers[LAWS + 2 * gas + 1];
        if (a != 0.0 && ppm[gas] > 0.0) {
            double fall = air - a * pow(ppm[gas], b);
            ratio -= fall > 0.0 ? fall : 0.0;
        }
    }
    return ratio > MIN_RATIO ? ratio : MIN_RATIO;
}

/* A tick of a sensor without noise: see advance_mox of mox.py, measure_pid of gas_sensors.py beside it. */
static double advance_sensor(const Header *header, SensorKind kind, const double *numbers, const double *ppm,
                             double y) {
    if (kind == MOX) {
        if (y == 0.0) {
            return numbers[AIR_RATIO];
        }
        double target = steady_ratio(header, numbers, ppm);
        return y + (target < y ? numbers[RISE_FRAC] : numbers[DECAY_FRAC]) * (target - y);
    }
    double total = 0.0;
    for (int64_t gas = 0; gas < header->n_gases; gas++) {
        double correction = numbers[CORRECTIONS + gas];
        total += correction != 0.0 ? ppm[gas] / correction : 0.0;
    }
    return numbers[LAG_FRAC] == 1.0 ? total : y + numbers[LAG_FRAC] * (total - y);
}

/* All sensors at the time of the unit. */
static bool read_sensors(Unit *unit) {
    const Header *header = &unit->header;
    for (int64_t point = 0; header->n_sensors > 0 && point < header->n_points; point++) {
        unit->is_current[point] = false;
        if (!compute_samples(unit, (size_t)point)) {
            return false;
        }
        const double *ppm = unit->outputs + count_samples(header) * (size_t)point + N_WIND;
        for (int64_t i = 0; i < header->n_sensors; i++) {
            double *y = unit->remembered + point * header->n_sensors + i;
            *y = advance_sensor(header, (SensorKind)unit->sensor_kinds[i],
                                unit->sensor_numbers + count_sensor_numbers(header) * (size_t)i, ppm, *y);
        }
    }
    return true;
}

/* What a sensor shows: clean air before its first reading. */
static double show_sensor(const Unit *unit, size_t point, size_t sensor) {
    const double *numbers = unit->sensor_numbers + count_sensor_numbers(&unit->header) * sensor;
    double y = unit->remembered[(size_t)unit->header.n_sensors * point + sensor];
    if (unit->sensor_kinds[sensor] == MOX) {
        return numbers[R0_OHM] * (y == 0.0 ? numbers[AIR_RATIO] : y);
    }
    return y;
}

/* ------------------------------------------------------------------------------------------------ time and start */

static void forget_samples(Unit *unit) {
    memset(unit->is_current, 0, (size_t)unit->header.n_points * sizeof(bool));
}

/* Latest time of the recorded gas [s]; wind has none. */
static double last_time_s(const Unit *unit) {
    return unit->header.has_gas ? (double)(unit->header.n_gas_frames - 1) * unit->header.gas_step_s : INFINITY;
}

/* Whether a time can be asked for. Beyond 1e15 steps doubles no longer count one by one. */
static bool is_time_known(const Unit *unit, double time_s) {
    const Header *header = &unit->header;
    return time_s >= 0.0 && (header->wind_start_s + time_s) / header->wind_period_s < 1e15 &&
           (!header->has_gas ||
            (time_s / header->gas_step_s < 1e15 && count_steps(time_s, header->gas_step_s) < header->n_gas_frames));
}

/* Points start in the middle of the room. */
static void set_start_values(Unit *unit) {
    const Header *header = &unit->header;
    for (int64_t p = 0; p < header->n_points; p++) {
        for (int axis = 0; axis < N_COORDINATES; axis++) {
            unit->inputs[N_COORDINATES * p + axis] =
                header->origin_m[axis] + 0.5 * (double)header->shape[axis] * header->cell_m;
        }
    }
    memset(unit->remembered, 0, (size_t)(header->n_points * header->n_sensors) * sizeof(double));
    unit->time_s = 0.0;
    unit->mode = INSTANTIATED;
    forget_samples(unit);
}

/* ------------------------------------------------------------------------------------- FMI: creation and its modes */

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(void *instance, bool logging_on, size_t n, const char *const categories[]) {
    (void)instance, (void)logging_on, (void)n, (void)categories;
    return fmi3OK;
}

EXPORT void fmi3FreeInstance(void *instance) {
    Unit *unit = instance;
    if (unit == NULL) {
        return;
    }
    if (unit->file != NULL) {
        fclose(unit->file);
    }
    void *const parts[] = {unit->strength_ppm_m3, unit->gas_index, unit->first,     unit->sensor_kinds,
                           unit->sensor_numbers,  unit->occupancy, unit->wind_m_s,  unit->cells_to_wall,
                           unit->filaments,       unit->sources,   unit->inputs,    unit->outputs,
                           unit->is_current};
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        free(parts[i]);
    }
    free(unit);
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resource_path, bool visible,
                                         bool logging_on, bool event_mode_used, bool early_return_allowed,
                                         const uint32_t required[], size_t n_required, void *environment,
                                         LogMessage log_message, void *intermediate_update) {
    (void)name, (void)visible, (void)logging_on, (void)early_return_allowed, (void)required, (void)n_required;
    (void)intermediate_update;
    Unit *unit = calloc(1, sizeof *unit);
    if (unit == NULL) {
        return NULL;
    }
    unit->environment = environment;
    unit->log_message = log_message;
    unit->i_wind = unit->i_gas = -1;
    if (event_mode_used) {
        report(unit, fmi3Error, "eventModeUsed: expected false, as the unit has no event mode, was true.");
        fmi3FreeInstance(unit);
        return NULL;
    }
    if (!open_room(unit, resource_path, token)) {
        fmi3FreeInstance(unit);
        return NULL;
    }
    size_t n_points = (size_t)unit->header.n_points;
    unit->wind_m_s = malloc((size_t)count_cells(&unit->header) * N_WIND * sizeof(float));
    unit->inputs = calloc(n_points * (N_COORDINATES + (size_t)unit->header.n_sensors), sizeof(double));
    unit->outputs = calloc(n_points * count_samples(&unit->header), sizeof(double));
    unit->is_current = calloc(n_points, sizeof(bool));
    if (unit->wind_m_s == NULL || unit->inputs == NULL || unit->outputs == NULL || unit->is_current == NULL) {
        report(unit, fmi3Error, "fmi3InstantiateCoSimulation: expected memory for a frame of wind, was none left.");
        fmi3FreeInstance(unit);
        return NULL;
    }
    unit->remembered = unit->inputs + n_points * N_COORDINATES;
    set_start_values(unit);
    return unit;
}

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resource_path, bool visible,
                                          bool logging_on, void *environment, LogMessage log_message) {
    (void)name, (void)token, (void)resource_path, (void)visible, (void)logging_on;
    Unit unit = {.environment = environment, .log_message = log_message};
    report(&unit, fmi3Error, "fmi3InstantiateModelExchange: expected co-simulation, which is what the unit is for.");
    return NULL;
}

EXPORT void *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resource_path,
                                               bool visible, bool logging_on, void *environment,
                                               LogMessage log_message, void *clock_update, void *lock, void *unlock) {
    (void)name, (void)token, (void)resource_path, (void)visible, (void)logging_on;
    (void)clock_update, (void)lock, (void)unlock;
    Unit unit = {.environment = environment, .log_message = log_message};
    report(&unit, fmi3Error,
           "fmi3InstantiateScheduledExecution: expected co-simulation, which is what the unit is for.");
    return NULL;
}

EXPORT fmi3Status fmi3EnterInitializationMode(void *instance, bool tolerance_defined, double tolerance,
                                              double start_time_s, bool stop_time_defined, double stop_time_s) {
    Unit *unit = instance;
    (void)tolerance_defined, (void)tolerance;
    if (unit->mode != INSTANTIATED) {
        return refuse(unit, "fmi3EnterInitializationMode");
    }
    if (!is_time_known(unit, start_time_s) || (stop_time_defined && !is_time_known(unit, stop_time_s))) {
        return report(unit, fmi3Error, "startTime, stopTime: expected times from 0 s to %.9g s, was %.9g s, %.9g s.",
                      last_time_s(unit), start_time_s, stop_time_defined ? stop_time_s : start_time_s);
    }
    unit->time_s = start_time_s;
    unit->mode = INITIALIZATION;
    forget_samples(unit);
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(void *instance) {
    Unit *unit = instance;
    if (unit->mode != INITIALIZATION) {
        return refuse(unit, "fmi3ExitInitializationMode");
    }
    if (!read_sensors(unit)) {
        return report(unit, fmi3Error, UNREADABLE);
    }
    unit->mode = STEP;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(void *instance) {
    Unit *unit = instance;
    if (unit->mode != STEP) {
        return refuse(unit, "fmi3Terminate");
    }
    unit->mode = TERMINATED;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(void *instance) {
    set_start_values(instance);
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(void *instance, double time_s, double step_s, bool no_set_state_prior,
                             bool *event_handling_needed, bool *terminate_simulation, bool *early_return,
                             double *last_successful_time_s) {
    Unit *unit = instance;
    const Header *header = &unit->header;
    (void)no_set_state_prior;
    *event_handling_needed = *terminate_simulation = *early_return = false;
    *last_successful_time_s = unit->time_s;
    if (unit->mode != STEP) {
        return refuse(unit, "fmi3DoStep");
    }
    if (!(fabs(time_s - unit->time_s) <= 1e-9 * (1.0 + fabs(unit->time_s)))) {
        return report(unit, fmi3Error, "fmi3DoStep: expected a step from %.9g s, where the unit is, was from %.9g s.",
                      unit->time_s, time_s);
    }
    if (!(step_s > 0.0)) {
        return report(unit, fmi3Error, "fmi3DoStep: expected a step of more than 0 s, was %.9g s.", step_s);
    }
    if (!is_time_known(unit, time_s + step_s)) {
        return report(unit, fmi3Discard,
                      "fmi3DoStep: expected a step to at most %.9g s, where the recorded gas ends, was to %.9g s.",
                      last_time_s(unit), time_s + step_s);
    }
    /* Sensors read at each tick within the step, at the points that were set before it. */
    int64_t last_tick = count_steps(time_s + step_s, header->tick_s);
    for (int64_t tick = count_steps(time_s, header->tick_s) + 1; header->n_sensors > 0 && tick <= last_tick; tick++) {
        unit->time_s = (double)tick * header->tick_s;
        if (!read_sensors(unit)) {
            return report(unit, fmi3Error, UNREADABLE);
        }
    }
    unit->time_s = time_s + step_s;
    *last_successful_time_s = unit->time_s;
    forget_samples(unit);
    return fmi3OK;
}

/* --------------------------------------------------------------------------------------------------- FMI: variables */

/* Point and place among its variables of a value reference; false where there is no such variable. */
static bool find_variable(const Unit *unit, uint32_t reference, size_t *point, size_t *place) {
    size_t n = N_COORDINATES + count_samples(&unit->header) + (size_t)unit->header.n_sensors;
    if (reference == 0 || reference > (size_t)unit->header.n_points * n) {
        return false;
    }
    *point = (reference - 1) / n;
    *place = (reference - 1) % n;
    return true;
}

EXPORT fmi3Status fmi3GetFloat64(void *instance, const uint32_t references[], size_t n, double values[],
                                 size_t n_values) {
    Unit *unit = instance;
    if (n != n_values) {
        return report(unit, fmi3Error, "fmi3GetFloat64: expected %zu values, was %zu.", n, n_values);
    }
    for (size_t i = 0; i < n; i++) {
        size_t point, place;
        if (references[i] == 0) {
            values[i] = unit->time_s;
            continue;
        }
        if (!find_variable(unit, references[i], &point, &place)) {
            return report(unit, fmi3Error, "fmi3GetFloat64: expected a value reference of the unit, was %u.",
                          (unsigned)references[i]);
        }
        if (place < N_COORDINATES) {
            values[i] = unit->inputs[N_COORDINATES * point + place];
            continue;
        }
        if (place >= N_COORDINATES + count_samples(&unit->header)) {
            values[i] = show_sensor(unit, point, place - N_COORDINATES - count_samples(&unit->header));
            continue;
        }
        if (!compute_samples(unit, point)) {
            return report(unit, fmi3Error, UNREADABLE);
        }
        values[i] = unit->outputs[count_samples(&unit->header) * point + place - N_COORDINATES];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(void *instance, const uint32_t references[], size_t n, const double values[],
                                 size_t n_values) {
    Unit *unit = instance;
    const Header *header = &unit->header;
    if (unit->mode == TERMINATED) {
        return refuse(unit, "fmi3SetFloat64");
    }
    if (n != n_values) {
        return report(unit, fmi3Error, "fmi3SetFloat64: expected %zu values, was %zu.", n, n_values);
    }
    for (size_t i = 0; i < n; i++) {
        size_t point, place;
        if (!find_variable(unit, references[i], &point, &place) || place >= N_COORDINATES) {
            return report(unit, fmi3Error, "fmi3SetFloat64: expected a value reference of an input, was %u.",
                          (unsigned)references[i]);
        }
        /* Rounded corners keep no point of the border out. */
        double slack_m = 1e-6 * header->cell_m, low_m = header->origin_m[place];
        double high_m = low_m + (double)header->shape[place] * header->cell_m;
        if (!(values[i] >= low_m - slack_m && values[i] <= high_m + slack_m)) {
            return report(unit, fmi3Discard,
                          "point[%zu].%c_m: expected a point in the room, %.9g m to %.9g m, was %.9g m.", point + 1,
                          "xyz"[place], low_m, high_m, values[i]);
        }
        unit->inputs[N_COORDINATES * point + place] = values[i];
        unit->is_current[point] = false;
    }
    return fmi3OK;
}

/* All variables are Float64. */
#define NO_VARIABLES_OF(type, c_type)                                                                                \
    EXPORT fmi3Status fmi3Get##type(void *instance, const uint32_t references[], size_t n, c_type values[],            \
                                    size_t n_values) {                                                                \
        (void)references, (void)values, (void)n_values;                                                               \
        return n == 0 ? fmi3OK : report(instance, fmi3Error, "fmi3Get" #type ": expected Float64, as all variables."); \
    }                                                                                                                 \
    EXPORT fmi3Status fmi3Set##type(void *instance, const uint32_t references[], size_t n, const c_type values[],      \
                                    size_t n_values) {                                                                \
        (void)references, (void)values, (void)n_values;                                                               \
        return n == 0 ? fmi3OK : report(instance, fmi3Error, "fmi3Set" #type ": expected Float64, as all variables."); \
    }

typedef const char *String;
NO_VARIABLES_OF(Float32, float)
NO_VARIABLES_OF(Int8, int8_t)
NO_VARIABLES_OF(UInt8, uint8_t)
NO_VARIABLES_OF(Int16, int16_t)
NO_VARIABLES_OF(UInt16, uint16_t)
NO_VARIABLES_OF(Int32, int32_t)
NO_VARIABLES_OF(UInt32, uint32_t)
NO_VARIABLES_OF(Int64, int64_t)
NO_VARIABLES_OF(UInt64, uint64_t)
NO_VARIABLES_OF(Boolean, bool)
NO_VARIABLES_OF(String, String)

/* ------------------------------------------------------------------------------------------------------- FMI: state */

static size_t count_state_bytes(const Unit *unit) {
    return sizeof(State) + (size_t)(unit->header.n_points * (N_COORDINATES + unit->header.n_sensors)) * sizeof(double);
}

EXPORT fmi3Status fmi3GetFMUState(void *instance, void **state) {
    Unit *unit = instance;
    if (*state == NULL && (*state = malloc(count_state_bytes(unit))) == NULL) {
        return report(unit, fmi3Error, "fmi3GetFMUState: expected memory for a state, was none left.");
    }
    State *head = *state;
    memset(head, 0, sizeof *head);
    memcpy(head->token, unit->header.token, TOKEN_SIZE);
    head->time_s = unit->time_s;
    head->mode = unit->mode;
    memcpy(head + 1, unit->inputs, count_state_bytes(unit) - sizeof *head);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(void *instance, void *state) {
    Unit *unit = instance;
    const State *head = state;
    if (head == NULL) {
        return report(unit, fmi3Error, "fmi3SetFMUState: expected a state of fmi3GetFMUState, was none.");
    }
    unit->time_s = head->time_s;
    unit->mode = (Mode)head->mode;
    memcpy(unit->inputs, head + 1, count_state_bytes(unit) - sizeof *head);
    forget_samples(unit);
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(void *instance, void **state) {
    (void)instance;
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(void *instance, void *state, size_t *size) {
    (void)state;
    *size = count_state_bytes(instance);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(void *instance, void *state, uint8_t bytes[], size_t size) {
    Unit *unit = instance;
    if (state == NULL || size < count_state_bytes(unit)) {
        return report(unit, fmi3Error, "fmi3SerializeFMUState: expected a state and room for %zu bytes, was %zu.",
                      count_state_bytes(unit), size);
    }
    memcpy(bytes, state, count_state_bytes(unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(void *instance, const uint8_t bytes[], size_t size, void **state) {
    Unit *unit = instance;
    State head;
    if (size != count_state_bytes(unit)) {
        return report(unit, fmi3Error, "fmi3DeserializeFMUState: expected %zu bytes, was %zu.",
                      count_state_bytes(unit), size);
    }
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.token, unit->header.token, TOKEN_SIZE) != 0 || head.mode < INSTANTIATED ||
        head.mode > TERMINATED || !is_time_known(unit, head.time_s)) {
        return report(unit, fmi3Error, "fmi3DeserializeFMUState: expected a state of this unit, was of another.");
    }
    if (*state == NULL && (*state = malloc(size)) == NULL) {
        return report(unit, fmi3Error, "fmi3DeserializeFMUState: expected memory for a state, was none left.");
    }
    memcpy(*state, bytes, size);
    return fmi3OK;
}

/* ------------------------------------------------------------- FMI: what the standard has and a room has no use for */

static fmi3Status lack(const Unit *unit, const char *function) {
    return report(unit, fmi3Error, "%s: expected a call that the model description allows, was another.", function);
}

#define LACKING(function, ...)                                                                                      \
    EXPORT fmi3Status function(void *instance, __VA_ARGS__) { return lack(instance, #function); }
#define LACKING_BARE(function)                                                                                      \
    EXPORT fmi3Status function(void *instance) { return lack(instance, #function); }

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

LACKING_BARE(fmi3EnterEventMode)
LACKING_BARE(fmi3EnterStepMode)
LACKING_BARE(fmi3EnterConfigurationMode)
LACKING_BARE(fmi3ExitConfigurationMode)
LACKING_BARE(fmi3EnterContinuousTimeMode)
LACKING_BARE(fmi3EvaluateDiscreteStates)
LACKING(fmi3GetBinary, const uint32_t references[], size_t n, size_t sizes[], const uint8_t *values[], size_t n_values)
LACKING(fmi3SetBinary, const uint32_t references[], size_t n, const size_t sizes[], const uint8_t *const values[],
        size_t n_values)
LACKING(fmi3GetClock, const uint32_t references[], size_t n, bool values[])
LACKING(fmi3SetClock, const uint32_t references[], size_t n, const bool values[])
LACKING(fmi3GetNumberOfVariableDependencies, uint32_t reference, size_t *n)
LACKING(fmi3GetVariableDependencies, uint32_t dependent, size_t elements_of_dependent[], uint32_t independents[],
        size_t elements_of_independents[], int kinds[], size_t n)
LACKING(fmi3GetDirectionalDerivative, const uint32_t unknowns[], size_t n_unknowns, const uint32_t knowns[],
        size_t n_knowns, const double seed[], size_t n_seed, double sensitivity[], size_t n_sensitivity)
LACKING(fmi3GetAdjointDerivative, const uint32_t unknowns[], size_t n_unknowns, const uint32_t knowns[],
        size_t n_knowns, const double seed[], size_t n_seed, double sensitivity[], size_t n_sensitivity)
LACKING(fmi3GetIntervalDecimal, const uint32_t references[], size_t n, double intervals[], int qualifiers[])
LACKING(fmi3GetIntervalFraction, const uint32_t references[], size_t n, uint64_t counters[], uint64_t resolutions[],
        int qualifiers[])
LACKING(fmi3GetShiftDecimal, const uint32_t references[], size_t n, double shifts[])
LACKING(fmi3GetShiftFraction, const uint32_t references[], size_t n, uint64_t counters[], uint64_t resolutions[])
LACKING(fmi3SetIntervalDecimal, const uint32_t references[], size_t n, const double intervals[])
LACKING(fmi3SetIntervalFraction, const uint32_t references[], size_t n, const uint64_t counters[],
        const uint64_t resolutions[])
LACKING(fmi3SetShiftDecimal, const uint32_t references[], size_t n, const double shifts[])
LACKING(fmi3SetShiftFraction, const uint32_t references[], size_t n, const uint64_t counters[],
        const uint64_t resolutions[])
LACKING(fmi3UpdateDiscreteStates, bool *needs_update, bool *terminates, bool *nominals_changed, bool *values_changed,
        bool *next_defined, double *next_s)
LACKING(fmi3CompletedIntegratorStep, bool no_set_state_prior, bool *enter_event_mode, bool *terminates)
LACKING(fmi3SetTime, double time_s)
LACKING(fmi3SetContinuousStates, const double states[], size_t n)
LACKING(fmi3GetContinuousStateDerivatives, double derivatives[], size_t n)
LACKING(fmi3GetEventIndicators, double indicators[], size_t n)
LACKING(fmi3GetContinuousStates, double states[], size_t n)
LACKING(fmi3GetNominalsOfContinuousStates, double nominals[], size_t n)
LACKING(fmi3GetNumberOfEventIndicators, size_t *n)
LACKING(fmi3GetNumberOfContinuousStates, size_t *n)
LACKING(fmi3GetOutputDerivatives, const uint32_t references[], size_t n, const int32_t orders[], double values[],
        size_t n_values)
LACKING(fmi3ActivateModelPartition, uint32_t clock, double time_s)
