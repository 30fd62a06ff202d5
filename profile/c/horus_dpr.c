/* SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * The flight controller's end of the SSI, in C11, which is C++11 as well. See horus_dpr.h, and
 * docs/flight-controller.md for how to use it.
 *
 * It is the same client as profile::ssi::client in Rust, and is compared with it transaction by transaction. It has no
 * allocation, no recursion, no loop whose length depends on the data, no pointer cast, and accesses only bytes: any
 * input, at any alignment, on a host of any byte order, gives a defined result.
 *
 * Deviations from MISRA C:2012: rule 15.5 (a function has one exit) where the first statements refuse an argument;
 * directive 4.9 (function-like macros) for the asserted layout in the header.
 */
#include "horus_dpr.h"

#include <float.h>
#include <string.h>

#include "horus_dpr_crc.h"

#if HORUS_DPR_VERSION != 1000U
#error "horus_dpr.c and horus_dpr.h are of different versions"
#endif

/* A float and a double are IEEE 754 binary32 and binary64, as in the objects. */
HORUS_DPR_ASSERT((sizeof(float) == 4U) && (FLT_MANT_DIG == 24) && (FLT_MAX_EXP == 128), "float must be binary32");
HORUS_DPR_ASSERT((sizeof(double) == 8U) && (DBL_MANT_DIG == 53) && (DBL_MAX_EXP == 1024), "double must be binary64");

#define CRC_BYTES 4U
#define POSITION_BYTES 20U /* latitude, longitude and the CRC over them */

#define ABSENT_F32 0x7FC00000U
#define ABSENT_F64 0x7FF8000000000000U
#define MAGNITUDE_F64 0x7FFFFFFFFFFFFFFFU
#define INFINITE_F64 0x7FF0000000000000U
#define MAGNITUDE_F32 0x7FFFFFFFU
#define INFINITE_F32 0x7F800000U

/* ---- numbers */

static uint16_t get16(const uint8_t *bytes)
{
    return (uint16_t)((uint16_t)bytes[0] | (uint16_t)((uint16_t)bytes[1] << 8U));
}

static uint32_t get32(const uint8_t *bytes)
{
    return (uint32_t)get16(bytes) | ((uint32_t)get16(&bytes[2]) << 16U);
}

static uint64_t get64(const uint8_t *bytes)
{
    return (uint64_t)get32(bytes) | ((uint64_t)get32(&bytes[4]) << 32U);
}

static void put16(uint8_t *bytes, uint16_t value)
{
    bytes[0] = (uint8_t)(value & 0xFFU);
    bytes[1] = (uint8_t)((uint32_t)value >> 8U);
}

static void put32(uint8_t *bytes, uint32_t value)
{
    put16(bytes, (uint16_t)(value & 0xFFFFU));
    put16(&bytes[2], (uint16_t)(value >> 16U));
}

static void put_crc(uint8_t *bytes, uint32_t crc)
{
    bytes[0] = (uint8_t)(crc >> 24U);
    bytes[1] = (uint8_t)((crc >> 16U) & 0xFFU);
    bytes[2] = (uint8_t)((crc >> 8U) & 0xFFU);
    bytes[3] = (uint8_t)(crc & 0xFFU);
}

static double f64_of(uint64_t bits)
{
    double value;
    (void)memcpy(&value, &bits, sizeof(value));
    return value;
}

static float f32_of(uint32_t bits)
{
    float value;
    (void)memcpy(&value, &bits, sizeof(value));
    return value;
}

static bool is_finite(uint32_t bits)
{
    return (bits & MAGNITUDE_F32) < INFINITE_F32;
}

static uint32_t saturated(uint64_t value)
{
    return (value < (uint64_t)UINT32_MAX) ? (uint32_t)value : UINT32_MAX;
}

/* An age plus the time since, us. */
static uint32_t sum_us(uint32_t age_us, uint64_t since_us)
{
    return (since_us < (uint64_t)UINT32_MAX) ? saturated((uint64_t)age_us + since_us) : UINT32_MAX;
}

/* ---- CRCs */

static uint32_t crc_register(const uint32_t *table, const uint8_t *bytes, size_t count)
{
    uint32_t crc = 0xFFFFFFFFU;
    for (size_t i = 0U; i < count; i++) {
        crc = (crc << 8U) ^ table[(crc >> 24U) ^ (uint32_t)bytes[i]];
    }
    return crc;
}

static bool is_intact(const uint8_t *bytes, size_t count)
{
    return crc_register(horus_dpr_frame_table, bytes, count) == HORUS_DPR_FRAME_RESIDUE;
}

static void seal(uint8_t *bytes, size_t count)
{
    const size_t covered = count - CRC_BYTES;
    put_crc(&bytes[covered], crc_register(horus_dpr_frame_table, bytes, covered) ^ 0xFFFFFFFFU);
}

/* ---- objects */

/* Whether each byte is `value`; all of them are read. True of no bytes. */
static bool is_throughout(const uint8_t *bytes, size_t count, uint8_t value)
{
    uint8_t difference = 0U;
    for (size_t i = 0U; i < count; i++) {
        difference = (uint8_t)(difference | (uint8_t)(bytes[i] ^ value));
    }
    return difference == 0U;
}

/* The content of an object's place; the work does not depend on it. */
static horus_dpr_result_t judge(const uint8_t *bytes, size_t count, uint16_t identifier)
{
    const bool intact = is_intact(bytes, count);
    const bool zeros = is_throughout(bytes, count, 0x00U);
    const bool ones = is_throughout(bytes, count, 0xFFU);
    const bool right = get16(&bytes[offsetof(horus_dpr_wire_reported_t, identifier)]) == identifier;
    bool position = true;
    horus_dpr_result_t result = HORUS_DPR_OK;
    if (identifier == HORUS_DPR_ID_REPORTED_POSITION) {
        const uint8_t *covered = &bytes[offsetof(horus_dpr_wire_reported_t, latitude)];
        position = crc_register(horus_dpr_position_table, covered, POSITION_BYTES) == HORUS_DPR_POSITION_RESIDUE;
    }
    if (!(intact && position && right)) {
        if (zeros || ones) {
            result = HORUS_DPR_VACANT;
        } else if (!intact) {
            result = HORUS_DPR_CRC;
        } else if (!position) {
            result = HORUS_DPR_POSITION_CRC;
        } else {
            result = HORUS_DPR_IDENTIFIER;
        }
    }
    return result;
}

static void decode_link(const uint8_t *bytes, horus_dpr_link_t *link)
{
    link->timestamp = get32(&bytes[offsetof(horus_dpr_wire_link_status_t, timestamp)]);
    link->status = (uint16_t)(get16(&bytes[offsetof(horus_dpr_wire_link_status_t, status)]) & HORUS_DPR_LINK_USED);
    link->objects_accepted = get32(&bytes[offsetof(horus_dpr_wire_link_status_t, objects_accepted)]);
    link->objects_rejected = get32(&bytes[offsetof(horus_dpr_wire_link_status_t, objects_rejected)]);
    link->frames_received = get32(&bytes[offsetof(horus_dpr_wire_link_status_t, frames_received)]);
    link->frames_missed = get32(&bytes[offsetof(horus_dpr_wire_link_status_t, frames_missed)]);
    link->age_100us = get16(&bytes[offsetof(horus_dpr_wire_link_status_t, age_100us)]);
    link->access_violations = get16(&bytes[offsetof(horus_dpr_wire_link_status_t, access_violations)]);
}

static void decode_port(const uint8_t *bytes, horus_dpr_port_t *port)
{
    port->timestamp = get32(&bytes[offsetof(horus_dpr_wire_port_status_t, timestamp)]);
    port->status = (uint16_t)(get16(&bytes[offsetof(horus_dpr_wire_port_status_t, status)]) & HORUS_DPR_PORT_USED);
    port->uplinks_accepted = get32(&bytes[offsetof(horus_dpr_wire_port_status_t, uplinks_accepted)]);
    port->commands_carried_out = get32(&bytes[offsetof(horus_dpr_wire_port_status_t, commands_carried_out)]);
    port->last_command_timestamp = get32(&bytes[offsetof(horus_dpr_wire_port_status_t, last_command_timestamp)]);
    port->last_command = get32(&bytes[offsetof(horus_dpr_wire_port_status_t, last_command)]);
    port->base_station_age_ms = get16(&bytes[offsetof(horus_dpr_wire_port_status_t, base_station_age_ms)]);
    port->flight_controller_age_ms = get16(&bytes[offsetof(horus_dpr_wire_port_status_t, flight_controller_age_ms)]);
    for (size_t kind = 0U; kind < HORUS_DPR_VIOLATIONS; kind++) {
        port->violations[kind] = get16(&bytes[offsetof(horus_dpr_wire_port_status_t, violations) + (2U * kind)]);
    }
    port->integrity_faults = get16(&bytes[offsetof(horus_dpr_wire_port_status_t, integrity_faults)]);
    port->flash_passes = get16(&bytes[offsetof(horus_dpr_wire_port_status_t, flash_passes)]);
    port->stuck_bits = get16(&bytes[offsetof(horus_dpr_wire_port_status_t, stuck_bits)]);
    port->buffers_out_of_use = get16(&bytes[offsetof(horus_dpr_wire_port_status_t, buffers_out_of_use)]);
    port->last_stop = get32(&bytes[offsetof(horus_dpr_wire_port_status_t, last_stop)]);
}

static double get_f64(const uint8_t *bytes)
{
    return f64_of(get64(bytes));
}

static float get_f32(const uint8_t *bytes)
{
    return f32_of(get32(bytes));
}

static void decode_hold(const uint8_t *bytes, horus_dpr_hold_t *hold)
{
    const uint8_t *acknowledged = &bytes[offsetof(horus_dpr_wire_hold_status_t, acknowledged)];
    hold->timestamp = get32(&bytes[offsetof(horus_dpr_wire_hold_status_t, timestamp)]);
    hold->status =
        (uint16_t)(get16(&bytes[offsetof(horus_dpr_wire_hold_status_t, status)]) & HORUS_DPR_HOLD_STATUS_USED);
    hold->temperature = get_f32(&bytes[offsetof(horus_dpr_wire_hold_status_t, temperature)]);
    hold->humidity = get_f32(&bytes[offsetof(horus_dpr_wire_hold_status_t, humidity)]);
    hold->set_point = get_f32(&bytes[offsetof(horus_dpr_wire_hold_status_t, set_point)]);
    for (size_t axis = 0U; axis < 3U; axis++) {
        hold->vibration[axis] =
            get_f32(&bytes[offsetof(horus_dpr_wire_hold_status_t, vibration) + (axis * sizeof(float))]);
    }
    hold->greatest_shock = get_f32(&bytes[offsetof(horus_dpr_wire_hold_status_t, greatest_shock)]);
    hold->supply = get_f32(&bytes[offsetof(horus_dpr_wire_hold_status_t, supply)]);
    hold->output = get_f32(&bytes[offsetof(horus_dpr_wire_hold_status_t, output)]);
    hold->base_station.number = get16(&acknowledged[0]);
    hold->base_station.outcome = get16(&acknowledged[2]);
    hold->own.number = get16(&acknowledged[4]);
    hold->own.outcome = get16(&acknowledged[6]);
    hold->seconds = get32(&bytes[offsetof(horus_dpr_wire_hold_status_t, seconds)]);
}

static void decode_reported(const uint8_t *bytes, horus_dpr_sample_t *sample)
{
    sample->timestamp = get32(&bytes[offsetof(horus_dpr_wire_reported_t, timestamp)]);
    sample->status = (uint16_t)(get16(&bytes[offsetof(horus_dpr_wire_reported_t, status)]) & HORUS_DPR_REPORTED_USED);
    sample->latitude = get_f64(&bytes[offsetof(horus_dpr_wire_reported_t, latitude)]);
    sample->longitude = get_f64(&bytes[offsetof(horus_dpr_wire_reported_t, longitude)]);
    sample->altitude = get_f64(&bytes[offsetof(horus_dpr_wire_reported_t, altitude)]);
    sample->pitch = get_f32(&bytes[offsetof(horus_dpr_wire_reported_t, pitch)]);
    sample->yaw = get_f32(&bytes[offsetof(horus_dpr_wire_reported_t, yaw)]);
    sample->roll = get_f32(&bytes[offsetof(horus_dpr_wire_reported_t, roll)]);
    for (size_t axis = 0U; axis < 3U; axis++) {
        sample->acceleration[axis] =
            get_f32(&bytes[offsetof(horus_dpr_wire_reported_t, acceleration) + (axis * sizeof(float))]);
    }
}

static void decode_gps(const uint8_t *bytes, horus_dpr_sample_t *sample)
{
    sample->timestamp = get32(&bytes[offsetof(horus_dpr_wire_gps_t, timestamp)]);
    sample->status = (uint16_t)(get16(&bytes[offsetof(horus_dpr_wire_gps_t, status)]) & HORUS_DPR_GPS_USED);
    sample->latitude = get_f64(&bytes[offsetof(horus_dpr_wire_gps_t, latitude)]);
    sample->longitude = get_f64(&bytes[offsetof(horus_dpr_wire_gps_t, longitude)]);
    sample->altitude = get_f64(&bytes[offsetof(horus_dpr_wire_gps_t, altitude)]);
    sample->pitch = get_f32(&bytes[offsetof(horus_dpr_wire_gps_t, pitch)]);
    sample->yaw = get_f32(&bytes[offsetof(horus_dpr_wire_gps_t, yaw)]);
    sample->roll = get_f32(&bytes[offsetof(horus_dpr_wire_gps_t, roll)]);
    for (size_t axis = 0U; axis < 3U; axis++) {
        sample->acceleration[axis] =
            get_f32(&bytes[offsetof(horus_dpr_wire_gps_t, acceleration) + (axis * sizeof(float))]);
    }
}

/* Changes the sample's values to those for display, as in profile::range: a value that is not valid, or impossible, is
 * NaN, with its status bit clear. Returns whether its position is valid. */
static bool decode_valid(const uint8_t *bytes, horus_dpr_sample_t *sample)
{
    const uint64_t latitude = get64(&bytes[offsetof(horus_dpr_wire_reported_t, latitude)]) & MAGNITUDE_F64;
    const uint64_t longitude = get64(&bytes[offsetof(horus_dpr_wire_reported_t, longitude)]) & MAGNITUDE_F64;
    const uint64_t signed_altitude = get64(&bytes[offsetof(horus_dpr_wire_reported_t, altitude)]);
    const uint64_t altitude = signed_altitude & MAGNITUDE_F64;
    const uint64_t highest =
        (signed_altitude == altitude) ? HORUS_DPR_MAX_ALTITUDE_BITS : HORUS_DPR_MIN_ALTITUDE_BITS;
    const bool known = altitude <= INFINITE_F64; /* not NaN */
    bool located = (latitude <= HORUS_DPR_MAX_LATITUDE_BITS) && (longitude <= HORUS_DPR_MAX_LONGITUDE_BITS) &&
                   ((altitude <= highest) || (!known));
    bool attitude;
    bool acceleration = true;

    decode_reported(bytes, sample);
    attitude = ((sample->status & HORUS_DPR_REPORTED_ATTITUDE_VALID) != 0U) &&
               is_finite(get32(&bytes[offsetof(horus_dpr_wire_reported_t, pitch)])) &&
               is_finite(get32(&bytes[offsetof(horus_dpr_wire_reported_t, yaw)])) &&
               is_finite(get32(&bytes[offsetof(horus_dpr_wire_reported_t, roll)]));
    for (size_t axis = 0U; axis < 3U; axis++) {
        const size_t place = offsetof(horus_dpr_wire_reported_t, acceleration) + (axis * sizeof(float));
        acceleration = is_finite(get32(&bytes[place])) && acceleration;
    }
    acceleration = acceleration && ((sample->status & HORUS_DPR_REPORTED_ACCELERATION_VALID) != 0U);

    located = located && ((sample->status & HORUS_DPR_REPORTED_POSITION_VALID) != 0U);
    if (!located) {
        sample->latitude = f64_of(ABSENT_F64);
        sample->longitude = f64_of(ABSENT_F64);
        sample->status = (uint16_t)(sample->status & (uint16_t)~HORUS_DPR_REPORTED_POSITION_VALID);
    }
    if ((!located) || (!known)) {
        sample->altitude = f64_of(ABSENT_F64);
    }
    if (!attitude) {
        sample->pitch = f32_of(ABSENT_F32);
        sample->yaw = f32_of(ABSENT_F32);
        sample->roll = f32_of(ABSENT_F32);
        sample->status = (uint16_t)(sample->status & (uint16_t)~HORUS_DPR_REPORTED_ATTITUDE_VALID);
    }
    if (!acceleration) {
        for (size_t axis = 0U; axis < 3U; axis++) {
            sample->acceleration[axis] = f32_of(ABSENT_F32);
        }
        sample->status = (uint16_t)(sample->status & (uint16_t)~HORUS_DPR_REPORTED_ACCELERATION_VALID);
    }
    return located;
}

/* A report without any data. */
static void absent(horus_dpr_sample_t *sample)
{
    (void)memset(sample, 0, sizeof(*sample));
    sample->latitude = f64_of(ABSENT_F64);
    sample->longitude = f64_of(ABSENT_F64);
    sample->altitude = f64_of(ABSENT_F64);
    sample->pitch = f32_of(ABSENT_F32);
    sample->yaw = f32_of(ABSENT_F32);
    sample->roll = f32_of(ABSENT_F32);
    for (size_t axis = 0U; axis < 3U; axis++) {
        sample->acceleration[axis] = f32_of(ABSENT_F32);
    }
}

/* ---- map */

static size_t image_len(const horus_dpr_config_t *config)
{
    return HORUS_DPR_GPS_OFFSET + ((size_t)config->receivers * sizeof(horus_dpr_wire_gps_t));
}

static size_t map_len(const horus_dpr_config_t *config)
{
    return image_len(config) + HORUS_DPR_PORT_BYTES + (config->hold ? HORUS_DPR_HOLD_BYTES : 0U);
}

static bool is_inside(horus_dpr_window_t window, const horus_dpr_config_t *config)
{
    return (window.length > 0U) && (((size_t)window.offset + (size_t)window.length) <= map_len(config));
}

static horus_dpr_window_t default_window(const horus_dpr_config_t *config)
{
    const horus_dpr_window_t window = { 0U, config->read_bytes };
    return window;
}

const uint8_t *horus_dpr_find(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, size_t offset, size_t length)
{
    const size_t window = (size_t)client->shown.offset;
    const size_t read = (bytes < (size_t)client->shown.length) ? bytes : (size_t)client->shown.length;
    const uint8_t *found = NULL;
    if ((length > 0U) && (offset >= window) && (length <= read) && ((offset - window) <= (read - length))) {
        found = &miso[offset - window];
    }
    return found;
}

/* ---- the client */

horus_dpr_config_t horus_dpr_config(uint8_t receivers)
{
    const horus_dpr_config_t config = {
        receivers,
        HORUS_DPR_PREFIX_BYTES,
        HORUS_DPR_AGE_LIMIT_US,
        HORUS_DPR_SILENCE_US,
        false,
    };
    return config;
}

horus_dpr_result_t horus_dpr_init(horus_dpr_t *client, const horus_dpr_config_t *config)
{
    const uint8_t receivers = config->receivers;
    const bool known = ((receivers >= 1U) && (receivers <= 3U)) || (receivers == 5U);
    horus_dpr_result_t result = HORUS_DPR_WINDOW;
    if (known && (config->read_bytes >= HORUS_DPR_PREFIX_BYTES) && is_inside(default_window(config), config)) {
        (void)memset(client, 0, sizeof(*client));
        client->config = *config;
        client->shown = default_window(config);
        result = HORUS_DPR_OK;
    }
    return result;
}

horus_dpr_result_t horus_dpr_ask(horus_dpr_t *client, uint16_t offset, uint16_t length)
{
    const horus_dpr_window_t window = { offset, length };
    horus_dpr_result_t result = HORUS_DPR_WINDOW;
    if (is_inside(window, &client->config)) {
        client->asked = window;
        client->has_asked = true;
        result = HORUS_DPR_OK;
    }
    return result;
}

horus_dpr_result_t horus_dpr_write(horus_dpr_t *client, const uint8_t object[HORUS_DPR_OBJECT_BYTES])
{
    const uint16_t identifier = get16(&object[offsetof(horus_dpr_wire_uplink_t, identifier)]);
    const uint32_t word = get32(&object[offsetof(horus_dpr_wire_command_t, word)]);
    const bool known = (word == HORUS_DPR_COMMAND_CLEAR_COUNTERS) || (word == HORUS_DPR_COMMAND_SELF_TEST);
    const bool clear = is_throughout(&object[offsetof(horus_dpr_wire_command_t, reserved)],
        HORUS_DPR_RESERVED_BYTES, 0x00U);
    horus_dpr_result_t result = HORUS_DPR_OK;
    if (!is_intact(object, HORUS_DPR_OBJECT_BYTES)) {
        result = HORUS_DPR_CRC;
    } else if (identifier == HORUS_DPR_ID_COMMAND) {
        result = (known && clear) ? HORUS_DPR_OK : HORUS_DPR_COMMAND;
    } else if ((identifier != HORUS_DPR_ID_UPLINK_BASE_STATION) &&
               (identifier != HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER)) {
        result = HORUS_DPR_IDENTIFIER;
    } else {
        result = HORUS_DPR_OK;
    }
    if (result == HORUS_DPR_OK) {
        (void)memcpy(client->object, object, sizeof(client->object));
        client->has_object = true;
        client->object_under_way = false;
    }
    return result;
}

void horus_dpr_seal_uplink(uint8_t object[HORUS_DPR_OBJECT_BYTES], uint32_t timestamp, uint16_t status,
    const uint8_t payload[HORUS_DPR_PAYLOAD_BYTES])
{
    put32(&object[offsetof(horus_dpr_wire_uplink_t, timestamp)], timestamp);
    put16(&object[offsetof(horus_dpr_wire_uplink_t, identifier)], HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER);
    put16(&object[offsetof(horus_dpr_wire_uplink_t, status)], status);
    (void)memcpy(&object[offsetof(horus_dpr_wire_uplink_t, payload)], payload, HORUS_DPR_PAYLOAD_BYTES);
    seal(object, HORUS_DPR_OBJECT_BYTES);
}

void horus_dpr_seal_command(uint8_t object[HORUS_DPR_OBJECT_BYTES], uint32_t timestamp, uint32_t word)
{
    (void)memset(object, 0, HORUS_DPR_OBJECT_BYTES);
    put32(&object[offsetof(horus_dpr_wire_command_t, timestamp)], timestamp);
    put16(&object[offsetof(horus_dpr_wire_command_t, identifier)], HORUS_DPR_ID_COMMAND);
    put32(&object[offsetof(horus_dpr_wire_command_t, word)], word);
    seal(object, HORUS_DPR_OBJECT_BYTES);
}

size_t horus_dpr_begin(horus_dpr_t *client, uint8_t *mosi, size_t capacity)
{
    const horus_dpr_window_t window = client->has_window ? client->window : default_window(&client->config);
    const size_t written = client->has_object ? HORUS_DPR_MAX_WRITE : HORUS_DPR_REQUEST_BYTES;
    const size_t bytes = ((size_t)window.length > written) ? (size_t)window.length : written;
    if (capacity < bytes) {
        return 0U;
    }
    (void)memset(mosi, 0, bytes);
    if (client->has_asked) {
        client->sent = client->asked;
        client->has_sent = true;
        client->has_asked = false;
    }
    if (client->has_sent) {
        put16(&mosi[0], client->sent.offset);
        put16(&mosi[2], client->sent.length);
        seal(mosi, HORUS_DPR_REQUEST_BYTES);
    }
    if (client->has_object) {
        (void)memcpy(&mosi[HORUS_DPR_REQUEST_BYTES], client->object, sizeof(client->object));
        client->object_under_way = true;
    }
    return bytes;
}

/* The earliest instant at which a new sample could have been read, us, if it continues the last one. */
static bool is_in_sequence(const horus_dpr_t *client, uint32_t timestamp, uint64_t read_us, uint64_t *due_us)
{
    const uint32_t step_ms = timestamp - client->last_timestamp;
    const uint64_t step_us = (uint64_t)step_ms * 1000U;
    const uint64_t drift_us = step_us / HORUS_DPR_TOLERANCE_SHARE;
    const uint64_t last_us = client->last_due_us;
    const uint64_t expected_us = (last_us <= (UINT64_MAX - step_us)) ? (last_us + step_us) : UINT64_MAX;
    const uint64_t latest_us = (expected_us <= (UINT64_MAX - drift_us)) ? (expected_us + drift_us) : UINT64_MAX;
    const uint64_t deviation_us = (read_us > expected_us) ? (read_us - expected_us) : (expected_us - read_us);
    const bool whole = (step_ms > 0U) && (step_ms <= HORUS_DPR_MAX_STEP_MS) && ((step_ms % HORUS_DPR_CYCLE_MS) == 0U);
    const bool in_time = deviation_us <= (HORUS_DPR_TOLERANCE_US + drift_us);
    /* A sample that is read early shows that the others were read late. HORUS's clock may be slower by 2 %. */
    *due_us = (read_us < latest_us) ? read_us : latest_us;
    return client->has_last && whole && in_time;
}

/* The greatest possible age of the sample of an image that was not read before, us. */
static uint32_t sample_age_us(
    const horus_dpr_t *client, const horus_dpr_link_t *link, uint64_t began_us, uint64_t fresh_us)
{
    /* Link-Status rounds down, and saturates at the highest value. */
    const uint32_t published_us =
        (link->age_100us == UINT16_MAX) ? HORUS_DPR_AGE_UNKNOWN : (100U * ((uint32_t)link->age_100us + 1U));
    uint64_t shown_us = HORUS_DPR_EXPIRY_US;
    if ((fresh_us <= began_us) && ((began_us - fresh_us) < shown_us)) {
        shown_us = began_us - fresh_us;
    }
    /* The reading before bounds the image's publication only if it showed another image. */
    if (client->has_image && (client->image_timestamp != link->timestamp) && (client->image_us <= began_us) &&
        ((began_us - client->image_us) < shown_us)) {
        shown_us = began_us - client->image_us;
    }
    return sum_us(published_us, shown_us);
}

/* The age of the last intact sample, us. */
static uint32_t last_age_us(const horus_dpr_t *client, uint64_t now_us)
{
    uint32_t age_us = HORUS_DPR_AGE_UNKNOWN;
    if (client->has_last && (now_us >= client->last_read_us)) {
        age_us = sum_us(client->last_age_us, now_us - client->last_read_us);
    }
    return age_us;
}

/* Whether a position of this age, or of unknown age, must not be shown. */
static bool is_too_old(const horus_dpr_t *client, uint32_t age_us)
{
    return (age_us > client->config.age_limit_us) || (age_us == HORUS_DPR_AGE_UNKNOWN);
}

/* Judges an intact sample. */
static horus_dpr_verdict_t judge_sample(horus_dpr_t *client, const horus_dpr_link_t *link, const uint8_t *reported,
    uint64_t began_us, uint64_t fresh_us)
{
    const uint32_t timestamp = get32(&reported[offsetof(horus_dpr_wire_reported_t, timestamp)]);
    const bool first = !client->has_last;
    horus_dpr_verdict_t verdict = HORUS_DPR_FRESH;
    if (client->has_last && (client->last_timestamp == timestamp)) {
        verdict = is_too_old(client, last_age_us(client, began_us)) ? HORUS_DPR_STALE : HORUS_DPR_SAME;
    } else {
        uint64_t due_us = began_us;
        const bool in_sequence = is_in_sequence(client, timestamp, began_us, &due_us);
        horus_dpr_sample_t sample;
        const bool valid = decode_valid(reported, &sample);
        const uint32_t age_us = sample_age_us(client, link, began_us, fresh_us);
        client->has_last = true;
        client->last_timestamp = timestamp;
        client->last_due_us = in_sequence ? due_us : began_us;
        client->last_read_us = began_us;
        client->last_age_us = age_us;
        if (!in_sequence) {
            client->found = 0U;
        } else if (client->found < HORUS_DPR_SEARCH_CYCLES) {
            client->found++;
        } else {
            /* the sequence is held */
        }
        if ((!in_sequence) && (!first)) {
            verdict = HORUS_DPR_OUT_OF_SEQUENCE;
        } else if (client->found < HORUS_DPR_SEARCH_CYCLES) {
            verdict = HORUS_DPR_SEARCHING;
        } else if (!valid) {
            verdict = HORUS_DPR_INVALID;
        } else if (is_too_old(client, age_us)) {
            verdict = HORUS_DPR_STALE;
        } else {
            verdict = HORUS_DPR_FRESH;
        }
        client->has_position = (verdict == HORUS_DPR_FRESH);
        client->has_status = client->has_position || (verdict == HORUS_DPR_INVALID);
        client->position = sample;
    }
    return verdict;
}

/* Whether any object that was read is intact; all of them are checked. */
static bool is_any_intact(const horus_dpr_t *client, const uint8_t *miso, size_t bytes)
{
    horus_dpr_link_t link;
    horus_dpr_sample_t sample;
    horus_dpr_port_t port;
    horus_dpr_uplink_t uplink;
    horus_dpr_hold_t hold;
    bool intact = horus_dpr_view_link(client, miso, bytes, &link) == HORUS_DPR_OK;
    const bool port_intact = horus_dpr_view_port(client, miso, bytes, &port) == HORUS_DPR_OK;
    const bool base_intact =
        horus_dpr_view_uplink(client, miso, bytes, HORUS_DPR_ID_UPLINK_BASE_STATION, &uplink) == HORUS_DPR_OK;
    const bool own_intact =
        horus_dpr_view_uplink(client, miso, bytes, HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER, &uplink) == HORUS_DPR_OK;
    const bool hold_intact = horus_dpr_view_hold(client, miso, bytes, &hold) == HORUS_DPR_OK;
    for (uint8_t index = 0U; index <= client->config.receivers; index++) {
        const bool object = horus_dpr_view_object(client, miso, bytes, index, &sample) == HORUS_DPR_OK;
        intact = intact || object;
    }
    return intact || port_intact || base_intact || own_intact || hold_intact;
}

void horus_dpr_end(horus_dpr_t *client, const uint8_t *miso, size_t bytes, uint64_t began_us, uint64_t fresh_us,
    horus_dpr_report_t *report)
{
    horus_dpr_result_t link = HORUS_DPR_LENGTH;
    horus_dpr_result_t reported = HORUS_DPR_LENGTH;
    horus_dpr_verdict_t verdict = HORUS_DPR_DAMAGED;
    bool another;
    bool busy;
    bool intact = false;
    size_t read;

    (void)memset(report, 0, sizeof(*report));
    client->shown = client->has_window ? client->window : default_window(&client->config);
    read = (bytes < (size_t)client->shown.length) ? bytes : (size_t)client->shown.length;
    busy = is_throughout(miso, read, 0xFFU);
    another = (client->shown.offset != 0U) || (client->shown.length < HORUS_DPR_PREFIX_BYTES);
    if (!busy) {
        /* The DPR has received the request. A busy one has not, and still shows the earlier window. */
        client->window = client->sent;
        client->has_window = client->has_sent;
        client->has_sent = false;
        client->has_object = client->has_object && (!client->object_under_way);
        client->object_under_way = false;
    }

    if ((!another) && (!busy) && (read >= HORUS_DPR_PREFIX_BYTES)) {
        link = judge(&miso[HORUS_DPR_LINK_STATUS_OFFSET], sizeof(horus_dpr_wire_link_status_t),
            HORUS_DPR_ID_LINK_STATUS);
        reported = judge(&miso[HORUS_DPR_REPORTED_POSITION_OFFSET], sizeof(horus_dpr_wire_reported_t),
            HORUS_DPR_ID_REPORTED_POSITION);
    }
    if (link == HORUS_DPR_OK) {
        report->has_link = true;
        decode_link(&miso[HORUS_DPR_LINK_STATUS_OFFSET], &report->link);
    }
    if (report->has_link && (reported == HORUS_DPR_OK)) {
        verdict = judge_sample(
            client, &report->link, &miso[HORUS_DPR_REPORTED_POSITION_OFFSET], began_us, fresh_us);
    } else if (report->has_link && (reported == HORUS_DPR_VACANT)) {
        verdict = HORUS_DPR_EMPTY;
    } else if (busy) {
        verdict = HORUS_DPR_BUSY;
    } else if (another) {
        verdict = HORUS_DPR_OTHER_WINDOW;
        intact = is_any_intact(client, miso, bytes);
    } else {
        verdict = HORUS_DPR_DAMAGED;
    }

    if (report->has_link) {
        client->has_image = true;
        client->image_timestamp = report->link.timestamp;
        client->image_us = began_us;
    }
    if (report->has_link || intact || (!client->has_intact)) {
        client->has_intact = true;
        client->intact_us = began_us;
    }
    if (((verdict == HORUS_DPR_BUSY) || (verdict == HORUS_DPR_DAMAGED)) && (began_us > client->intact_us) &&
        ((began_us - client->intact_us) > (uint64_t)client->config.silence_us)) {
        verdict = HORUS_DPR_SILENT;
    }
    report->verdict = verdict;
    report->age_us = last_age_us(client, began_us);
    if (is_too_old(client, report->age_us)) {
        client->has_position = false;
        client->has_status = false;
    }
    report->has_position = client->has_position;
    report->has_status = client->has_status;
    report->status = client->has_status ? client->position.status : 0U;
    if (report->has_position) {
        report->position = client->position;
    } else {
        absent(&report->position);
    }
}

/* ---- the last transaction, object by object */

horus_dpr_result_t horus_dpr_view_link(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, horus_dpr_link_t *link)
{
    const uint8_t *place = horus_dpr_find(
        client, miso, bytes, HORUS_DPR_LINK_STATUS_OFFSET, sizeof(horus_dpr_wire_link_status_t));
    horus_dpr_result_t result = HORUS_DPR_LENGTH;
    if (place != NULL) {
        result = judge(place, sizeof(horus_dpr_wire_link_status_t), HORUS_DPR_ID_LINK_STATUS);
        if (result == HORUS_DPR_OK) {
            decode_link(place, link);
        }
    }
    return result;
}

horus_dpr_result_t horus_dpr_view_object(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, uint8_t index, horus_dpr_sample_t *sample)
{
    horus_dpr_result_t result = HORUS_DPR_LENGTH;
    if (index == 0U) {
        const uint8_t *place = horus_dpr_find(
            client, miso, bytes, HORUS_DPR_REPORTED_POSITION_OFFSET, sizeof(horus_dpr_wire_reported_t));
        if (place != NULL) {
            result = judge(place, sizeof(horus_dpr_wire_reported_t), HORUS_DPR_ID_REPORTED_POSITION);
            if (result == HORUS_DPR_OK) {
                decode_reported(place, sample);
            }
        }
    } else if (index <= client->config.receivers) {
        const size_t offset = HORUS_DPR_GPS_OFFSET + (((size_t)index - 1U) * sizeof(horus_dpr_wire_gps_t));
        const uint8_t *place = horus_dpr_find(client, miso, bytes, offset, sizeof(horus_dpr_wire_gps_t));
        if (place != NULL) {
            result = judge(place, sizeof(horus_dpr_wire_gps_t), (uint16_t)(HORUS_DPR_ID_REPORTED_POSITION + index));
            if (result == HORUS_DPR_OK) {
                decode_gps(place, sample);
            }
        }
    } else {
        result = HORUS_DPR_LENGTH;
    }
    return result;
}

uint16_t horus_dpr_solution_age_ms(const horus_dpr_sample_t *gps)
{
    const uint16_t steps = (uint16_t)((gps->status & HORUS_DPR_GPS_AGE_MASK) >> HORUS_DPR_GPS_AGE_SHIFT);
    return (steps == HORUS_DPR_GPS_AGE_NEVER) ? HORUS_DPR_NO_SOLUTION : (uint16_t)(steps * HORUS_DPR_GPS_AGE_STEP_MS);
}

horus_dpr_result_t horus_dpr_view_port(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, horus_dpr_port_t *port)
{
    const size_t offset = image_len(&client->config) + HORUS_DPR_PORT_STATUS_OFFSET;
    const uint8_t *place = horus_dpr_find(client, miso, bytes, offset, sizeof(horus_dpr_wire_port_status_t));
    horus_dpr_result_t result = HORUS_DPR_LENGTH;
    if (place != NULL) {
        result = judge(place, sizeof(horus_dpr_wire_port_status_t), HORUS_DPR_ID_PORT_STATUS);
        if (result == HORUS_DPR_OK) {
            decode_port(place, port);
        }
    }
    return result;
}

horus_dpr_result_t horus_dpr_view_uplink(const horus_dpr_t *client, const uint8_t *miso, size_t bytes,
    uint16_t identifier, horus_dpr_uplink_t *uplink)
{
    const size_t area = (identifier == HORUS_DPR_ID_UPLINK_BASE_STATION) ? HORUS_DPR_UPLINK_BASE_STATION_OFFSET :
                                                                           HORUS_DPR_UPLINK_FLIGHT_CONTROLLER_OFFSET;
    const uint8_t *place =
        horus_dpr_find(client, miso, bytes, image_len(&client->config) + area, sizeof(horus_dpr_wire_uplink_t));
    horus_dpr_result_t result = HORUS_DPR_LENGTH;
    if (place != NULL) {
        result = judge(place, sizeof(horus_dpr_wire_uplink_t), identifier);
        if (result == HORUS_DPR_OK) {
            uplink->timestamp = get32(&place[offsetof(horus_dpr_wire_uplink_t, timestamp)]);
            uplink->status = get16(&place[offsetof(horus_dpr_wire_uplink_t, status)]);
            (void)memcpy(uplink->payload, &place[offsetof(horus_dpr_wire_uplink_t, payload)], sizeof(uplink->payload));
        }
    }
    return result;
}

/* ---- the active hold */

/* The bytes of Hold-Status's place, NULL if they were not all read or the configuration has no hold. */
static const uint8_t *find_hold(const horus_dpr_t *client, const uint8_t *miso, size_t bytes)
{
    const size_t offset = image_len(&client->config) + HORUS_DPR_HOLD_OFFSET;
    const uint8_t *place = NULL;
    if (client->config.hold) {
        place = horus_dpr_find(client, miso, bytes, offset, sizeof(horus_dpr_wire_hold_status_t));
    }
    return place;
}

horus_dpr_result_t horus_dpr_view_hold(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, horus_dpr_hold_t *hold)
{
    const uint8_t *place = find_hold(client, miso, bytes);
    horus_dpr_result_t result = HORUS_DPR_LENGTH;
    if (place != NULL) {
        result = judge(place, sizeof(horus_dpr_wire_hold_status_t), HORUS_DPR_ID_HOLD_STATUS);
        if (result == HORUS_DPR_OK) {
            decode_hold(place, hold);
        }
    }
    return result;
}

void horus_dpr_hold_read(horus_dpr_hold_track_t *track, const horus_dpr_t *client, const uint8_t *miso, size_t bytes,
    uint64_t began_us, horus_dpr_hold_report_t *report)
{
    const size_t read = (bytes < (size_t)client->shown.length) ? bytes : (size_t)client->shown.length;
    horus_dpr_hold_t hold;
    horus_dpr_result_t result = horus_dpr_view_hold(client, miso, bytes, &hold);

    (void)memset(report, 0, sizeof(*report));
    if (is_throughout(miso, read, 0xFFU)) {
        result = HORUS_DPR_LENGTH;
    }
    if ((result == HORUS_DPR_OK) && ((!track->has_last) || (track->last.timestamp != hold.timestamp))) {
        /* The reading before bounds its arrival, and the DPR shows none for longer than its expiry. */
        uint64_t shown_us = HORUS_DPR_HOLD_EXPIRY_US;
        if (track->has_looked && (track->looked_us <= began_us) && ((began_us - track->looked_us) < shown_us)) {
            shown_us = began_us - track->looked_us;
        }
        track->has_last = true;
        track->last = hold;
        track->last_read_us = began_us;
        track->last_age_us = sum_us(HORUS_DPR_HOLD_FRAME_US, shown_us);
    }
    if (result == HORUS_DPR_VACANT) {
        track->has_last = false;
    }
    if ((result == HORUS_DPR_OK) || (result == HORUS_DPR_VACANT)) {
        track->has_looked = true;
        track->looked_us = began_us;
    }

    report->shown = HORUS_DPR_HOLD_ABSENT;
    report->age_us = HORUS_DPR_AGE_UNKNOWN;
    if (track->has_last) {
        report->shown = HORUS_DPR_HOLD_OLD;
        /* A clock that was set back makes the age unknown. */
        if (began_us >= track->last_read_us) {
            const uint64_t since_us = began_us - track->last_read_us;
            report->age_us = sum_us(track->last_age_us, since_us);
            if (since_us <= HORUS_DPR_HOLD_EXPIRY_US) {
                report->shown = HORUS_DPR_HOLD_VALID;
                report->values = track->last;
            }
        }
    }
}

/* Whether a number is 1 to 32767 ahead of another. */
static bool is_newer(uint16_t number, uint16_t than)
{
    const uint16_t ahead = (uint16_t)(number - than);
    return (ahead != 0U) && (ahead <= 0x7FFFU);
}

void horus_dpr_sender_observe(horus_dpr_sender_t *sender, const horus_dpr_hold_t *hold)
{
    const uint32_t behind = sender->hold_timestamp - hold->timestamp;
    const bool restarted = sender->has_hold && (behind != 0U) && (behind <= 0x7FFFFFFFU);
    const bool waiting = sender->sent == HORUS_DPR_SENT_WAITING;
    const bool outcome =
        (hold->own.outcome >= HORUS_DPR_OUTCOME_DONE) && (hold->own.outcome <= HORUS_DPR_OUTCOME_TOO_OLD);
    sender->has_hold = true;
    sender->hold_timestamp = hold->timestamp;
    sender->acknowledged = hold->own.number;
    if ((waiting || (sender->sent == HORUS_DPR_SENT_LOST)) && (hold->own.number == sender->number) && outcome) {
        sender->sent = HORUS_DPR_SENT_ANSWERED;
        sender->outcome = hold->own.outcome;
    } else if (waiting && (restarted || is_newer(hold->own.number, sender->number))) {
        sender->sent = HORUS_DPR_SENT_LOST;
    } else {
        /* nothing new is known of the command */
    }
}

bool horus_dpr_sender_send(horus_dpr_sender_t *sender, uint16_t word, float value)
{
    const bool may_send = sender->has_hold && (sender->sent != HORUS_DPR_SENT_WAITING);
    if (may_send) {
        const bool own = (sender->sent != HORUS_DPR_SENT_NOTHING) && is_newer(sender->number, sender->acknowledged);
        uint32_t bits;
        (void)memcpy(&bits, &value, sizeof(bits));
        sender->number = (uint16_t)((own ? sender->number : sender->acknowledged) + 1U);
        sender->sent = HORUS_DPR_SENT_WAITING;
        sender->outcome = HORUS_DPR_OUTCOME_NOTHING;
        (void)memset(sender->command, 0, sizeof(sender->command));
        put16(&sender->command[0], sender->number);
        put16(&sender->command[2], word);
        put32(&sender->command[4], bits);
    }
    return may_send;
}

void horus_dpr_sender_give_up(horus_dpr_sender_t *sender)
{
    if (sender->sent == HORUS_DPR_SENT_WAITING) {
        sender->sent = HORUS_DPR_SENT_LOST;
    }
}

void horus_dpr_sender_fill(const horus_dpr_sender_t *sender, uint8_t payload[HORUS_DPR_PAYLOAD_BYTES])
{
    if (sender->sent == HORUS_DPR_SENT_WAITING) {
        (void)memcpy(payload, sender->command, sizeof(sender->command));
    } else {
        (void)memset(payload, 0, sizeof(sender->command));
    }
}
