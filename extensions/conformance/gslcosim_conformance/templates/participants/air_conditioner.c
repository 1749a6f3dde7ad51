/* A participant in C, with msgpack frames over standard input and output; needs nothing but the C library.
 * An air conditioner that turns the inlet up while any sensor is in gas, and slowly down again afterwards. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void fail(const char *what) {
    fprintf(stderr, "air_conditioner: expected %s\n", what);
    exit(EXIT_FAILURE);
}

/* ---- msgpack, read: a value begins at `at`; what is not needed is skipped, so later keys do no harm. */

typedef struct {
    const uint8_t *at, *end;
} Value;

static uint64_t big_endian(Value *value, int n_bytes) {
    uint64_t number = 0;
    if (value->end - value->at < n_bytes) fail("a whole message");
    while (n_bytes--) number = number << 8 | *value->at++;
    return number;
}

/* The size in the head of a map, array, text or bytes, which is then passed over; `kind` is what it is. */
static uint64_t head(Value *value, char *kind) {
    uint8_t byte = (uint8_t)big_endian(value, 1);
    if (byte >> 4 == 0x8) return *kind = 'm', byte & 0x0F;
    if (byte >> 4 == 0x9) return *kind = 'a', byte & 0x0F;
    if (byte >> 5 == 0x5) return *kind = 't', byte & 0x1F;
    switch (byte) {
        case 0xDE: case 0xDF: return *kind = 'm', big_endian(value, byte == 0xDE ? 2 : 4);
        case 0xDC: case 0xDD: return *kind = 'a', big_endian(value, byte == 0xDC ? 2 : 4);
        case 0xD9: case 0xDA: case 0xDB: return *kind = 't', big_endian(value, 1 << (byte - 0xD9));
        case 0xC4: case 0xC5: case 0xC6: return *kind = 'b', big_endian(value, 1 << (byte - 0xC4));
        case 0xCC: case 0xCD: case 0xCE: case 0xCF: return *kind = 'n', 1u << (byte - 0xCC);
        case 0xD0: case 0xD1: case 0xD2: case 0xD3: return *kind = 'n', 1u << (byte - 0xD0);
        case 0xCA: case 0xCB: return *kind = 'n', byte == 0xCA ? 4 : 8;
        default: return *kind = 'n', 0; /* small numbers, nil, false and true are their head alone */
    }
}

static void skip(Value *value) {
    char kind;
    uint64_t size = head(value, &kind);
    if (kind == 'm' || kind == 'a')
        for (size *= kind == 'm' ? 2 : 1; size--;) skip(value);
    else if (size > (uint64_t)(value->end - value->at))
        fail("a whole message");
    else
        value->at += size;
}

/* How many items a map or an array has; `value` is then the first of them. */
static uint64_t items(Value *value, char wanted) {
    char kind;
    uint64_t size = head(value, &kind);
    if (kind != wanted) fail(wanted == 'm' ? "a map" : "an array");
    return size;
}

static bool is_text(Value value, const char *text) {
    char kind;
    uint64_t size = head(&value, &kind);
    return kind == 't' && size == strlen(text) && size <= (uint64_t)(value.end - value.at) &&
           memcmp(value.at, text, size) == 0;
}

/* Finds the value of a key of a map. */
static bool find(Value map, const char *key, Value *found) {
    for (uint64_t left = items(&map, 'm'); left--; skip(&map)) {
        bool is_it = is_text(map, key);
        skip(&map);
        if (is_it) return *found = map, true;
    }
    return false;
}

static double number(Value value) {
    uint8_t byte = (uint8_t)big_endian(&value, 1);
    union { uint32_t bits; float real; } single;
    union { uint64_t bits; double real; } whole;
    if (byte < 0x80) return byte;
    if (byte >= 0xE0) return (int8_t)byte;
    if (byte >= 0xCC && byte <= 0xCF) return (double)big_endian(&value, 1 << (byte - 0xCC));
    if (byte == 0xCA) return single.bits = (uint32_t)big_endian(&value, 4), single.real;
    if (byte == 0xCB) return whole.bits = big_endian(&value, 8), whole.real;
    fail("a number");
    return 0.0;
}

static double number_at(Value map, const char *key) {
    Value found;
    if (!find(map, key, &found)) fail(key);
    return number(found);
}

static double number_or(Value map, const char *key, double otherwise) {
    Value found;
    return find(map, key, &found) ? number(found) : otherwise;
}

/* ---- msgpack, written: one message at a time. */

static uint8_t answer[512];
static size_t n_answer;

static void put(const void *data, size_t n_bytes) {
    if (n_answer + n_bytes > sizeof answer) fail("a short answer");
    memcpy(answer + n_answer, data, n_bytes);
    n_answer += n_bytes;
}

static void put_number(uint8_t byte, uint64_t bits, int n_bytes) {
    put(&byte, 1);
    while (n_bytes--) {
        uint8_t next = (uint8_t)(bits >> 8 * n_bytes);
        put(&next, 1);
    }
}

static void put_map(int n_pairs) { put_number((uint8_t)(0x80 | n_pairs), 0, 0); }
static void put_array(int n_items) { put_number((uint8_t)(0x90 | n_items), 0, 0); }
static void put_bool(bool is_true) { put_number(is_true ? 0xC3 : 0xC2, 0, 0); }
static void put_whole(uint64_t whole) { put_number(0xCF, whole, 8); }

static void put_real(double real) {
    uint64_t bits;
    memcpy(&bits, &real, sizeof bits);
    put_number(0xCB, bits, 8);
}

static void put_text(const char *text) {
    put_number(0xD9, strlen(text), 1);
    put(text, strlen(text));
}

static void send_answer(void) {
    uint8_t length[4] = {0, 0, (uint8_t)(n_answer >> 8), (uint8_t)n_answer};
    if (fwrite(length, 1, 4, stdout) != 4 || fwrite(answer, 1, n_answer, stdout) != n_answer || fflush(stdout))
        fail("an open standard output");
    n_answer = 0;
}

/* The next frame, in memory that the next call uses again; false at the end of the stream. */
static bool receive(Value *message) {
    static uint8_t *buffer;
    static size_t capacity;
    uint8_t length[4];
    if (fread(length, 1, 4, stdin) != 4) return false;
    size_t n_bytes = (size_t)length[0] << 24 | length[1] << 16 | length[2] << 8 | length[3];
    if (n_bytes > capacity && !(buffer = realloc(buffer, capacity = n_bytes))) fail("more memory");
    if (fread(buffer, 1, n_bytes, stdin) != n_bytes) fail("a whole frame");
    *message = (Value){buffer, buffer + n_bytes};
    return true;
}

/* ---- the model. */

static bool is_in_gas(Value message, double above_ppm) {
    Value inputs, samples;
    if (!find(message, "inputs", &inputs)) fail("inputs");
    /* Before its first tick nothing has been sampled. */
    if (!find(inputs, "truth/samples", &samples)) return false;
    if (!find(samples, "samples", &samples)) fail("samples");
    for (uint64_t n_samples = items(&samples, 'a'); n_samples--; skip(&samples)) {
        Value gases;
        if (!find(samples, "gases", &gases)) fail("gases");
        for (uint64_t n_gases = items(&gases, 'a'); n_gases--; skip(&gases))
            if (number_at(gases, "mixing_ratio_ppm") > above_ppm) return true;
    }
    return false;
}

int main(void) {
    double above_ppm = 1.0, full_share = 3.0, most_change = 0.1, share = 1.0;
    uint64_t n_ticks = 0;
    Value message, kind, parameters;

    put_map(3), put_text("tick"), put_whole(0);
    put_text("reads"), put_array(1), put_text("truth/samples");
    put_text("writes"), put_array(2), put_text("ventilation"), put_text("state");
    send_answer();

    while (receive(&message) && find(message, "message", &kind) && !is_text(kind, "Ending")) {
        if (is_text(kind, "ParticipantBriefing")) {
            if (!find(message, "parameters", &parameters)) fail("parameters");
            above_ppm = number_or(parameters, "above_ppm", above_ppm);
            full_share = number_or(parameters, "full_share", full_share);
            double period_s = number_at(message, "period_ticks") * number_at(message, "tick_ns") / 1e9;
            most_change = fabs(full_share - 1.0) * period_s / number_or(parameters, "ramp_s", 2.0);
        } else if (is_text(kind, "ParticipantInputs")) {
            bool has_gas = is_in_gas(message, above_ppm);
            n_ticks += has_gas;
            share += fmax(-most_change, fmin(most_change, (has_gas ? full_share : 1.0) - share));
            put_map(2), put_text("tick"), put_whole((uint64_t)number_at(message, "tick"));
            put_text("outputs"), put_map(2);
            put_text("ventilation"), put_map(1), put_text("share"), put_real(share);
            put_text("state"), put_map(2), put_text("is_in_gas"), put_bool(has_gas);
            put_text("n_ticks"), put_whole(n_ticks);
            send_answer();
        }
    }
    return EXIT_SUCCESS;
}
