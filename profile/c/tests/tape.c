/* Plays a tape to the C client and writes its output, for profile/tests/support/tape.rs, which does the
 * same with the Rust client and describes the tape. The two texts must be the same.
 */
#include "tape.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "../horus_dpr.h"

#define MAX_MISO 1024U

typedef struct {
    const uint8_t *bytes;
    size_t left;
    horus_dpr_sink_t sink;
    void *context;
} tape_t;

/* The next `count` bytes of the tape, NULL if it has fewer. */
static const uint8_t *take(tape_t *tape, size_t count)
{
    const uint8_t *taken = NULL;
    if (tape->left >= count) {
        taken = tape->bytes;
        tape->bytes += count;
        tape->left -= count;
    } else {
        tape->left = 0U;
    }
    return taken;
}

static uint64_t number(const uint8_t *bytes, size_t count)
{
    uint64_t value = 0U;
    for (size_t i = 0U; i < count; i++) {
        value |= (uint64_t)bytes[i] << (8U * i);
    }
    return value;
}

static void __attribute__((format(printf, 2, 3))) say(const tape_t *tape, const char *format, ...)
{
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    const int count = vsnprintf(text, sizeof(text), format, arguments);
    va_end(arguments);
    if ((count > 0) && ((size_t)count < sizeof(text))) {
        tape->sink(tape->context, text, (size_t)count);
    }
}

static void say_bytes(const tape_t *tape, const uint8_t *bytes, size_t count)
{
    static const char digits[] = "0123456789abcdef";
    for (size_t i = 0U; i < count; i++) {
        const char text[2] = { digits[bytes[i] >> 4U], digits[bytes[i] & 0x0FU] };
        tape->sink(tape->context, text, sizeof(text));
    }
    tape->sink(tape->context, "\n", 1U);
}

static unsigned long long bits64(double value)
{
    uint64_t bits;
    (void)memcpy(&bits, &value, sizeof(bits));
    return bits;
}

static unsigned bits32(float value)
{
    uint32_t bits;
    (void)memcpy(&bits, &value, sizeof(bits));
    return bits;
}

static void say_sample(const tape_t *tape, const horus_dpr_sample_t *sample)
{
    say(tape, " t=%u s=%04x %016llx %016llx %016llx %08x %08x %08x %08x %08x %08x", (unsigned)sample->timestamp,
        (unsigned)sample->status, bits64(sample->latitude), bits64(sample->longitude), bits64(sample->altitude),
        bits32(sample->pitch), bits32(sample->yaw), bits32(sample->roll), bits32(sample->acceleration[0]),
        bits32(sample->acceleration[1]), bits32(sample->acceleration[2]));
}

static void say_link(const tape_t *tape, const horus_dpr_link_t *link)
{
    say(tape, " t=%u s=%04x %u %u %u %u %u %u", (unsigned)link->timestamp, (unsigned)link->status,
        (unsigned)link->objects_accepted, (unsigned)link->objects_rejected, (unsigned)link->frames_received,
        (unsigned)link->frames_missed, (unsigned)link->age_100us, (unsigned)link->access_violations);
}

static void say_report(const tape_t *tape, const horus_dpr_report_t *report)
{
    say(tape, "end %d age=%u", (int)report->verdict, (unsigned)report->age_us);
    if (report->has_status) {
        say(tape, " status %04x", (unsigned)report->status);
    }
    if (report->has_position) {
        say(tape, " position");
        say_sample(tape, &report->position);
    }
    if (report->has_link) {
        say(tape, " link");
        say_link(tape, &report->link);
    }
    say(tape, "\n");
}

static void say_hold(const tape_t *tape, const horus_dpr_hold_t *hold)
{
    say(tape, " t=%u s=%04x %08x %08x %08x %08x %08x %08x %08x %08x %08x", (unsigned)hold->timestamp,
        (unsigned)hold->status, bits32(hold->temperature), bits32(hold->humidity), bits32(hold->set_point),
        bits32(hold->vibration[0]), bits32(hold->vibration[1]), bits32(hold->vibration[2]),
        bits32(hold->greatest_shock), bits32(hold->supply), bits32(hold->output));
    say(tape, " %u:%u %u:%u %u", (unsigned)hold->base_station.number, (unsigned)hold->base_station.outcome,
        (unsigned)hold->own.number, (unsigned)hold->own.outcome, (unsigned)hold->seconds);
}

static void say_hold_report(
    const tape_t *tape, const horus_dpr_hold_report_t *report, const horus_dpr_sender_t *sender)
{
    say(tape, "hold %d age=%u", (int)report->shown, (unsigned)report->age_us);
    if (report->shown == HORUS_DPR_HOLD_VALID) {
        say_hold(tape, &report->values);
    }
    say(tape, " sent %d %u %u\n", (int)sender->sent, (unsigned)sender->number, (unsigned)sender->outcome);
}

static void say_view(const tape_t *tape, const horus_dpr_t *client, const uint8_t *miso, size_t count)
{
    static const uint16_t writers[2] = { HORUS_DPR_ID_UPLINK_BASE_STATION, HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER };
    horus_dpr_link_t link;
    horus_dpr_sample_t sample;
    horus_dpr_port_t port;
    horus_dpr_uplink_t uplink;
    horus_dpr_hold_t hold;
    horus_dpr_result_t result = horus_dpr_view_link(client, miso, count, &link);
    say(tape, "link %d", (int)result);
    if (result == HORUS_DPR_OK) {
        say_link(tape, &link);
    }
    say(tape, "\n");
    for (uint8_t index = 0U; index <= 6U; index++) {
        result = horus_dpr_view_object(client, miso, count, index, &sample);
        say(tape, "object %u %d", (unsigned)index, (int)result);
        if (result == HORUS_DPR_OK) {
            say_sample(tape, &sample);
        }
        if ((result == HORUS_DPR_OK) && (index > 0U)) {
            const uint16_t age_ms = horus_dpr_solution_age_ms(&sample);
            if (age_ms == HORUS_DPR_NO_SOLUTION) {
                say(tape, " never");
            } else {
                say(tape, " %u ms", (unsigned)age_ms);
            }
        }
        say(tape, "\n");
    }
    result = horus_dpr_view_port(client, miso, count, &port);
    say(tape, "port %d", (int)result);
    if (result == HORUS_DPR_OK) {
        say(tape, " t=%u s=%04x %u %u %u %08x %u %u", (unsigned)port.timestamp, (unsigned)port.status,
            (unsigned)port.uplinks_accepted, (unsigned)port.commands_carried_out, (unsigned)port.last_command_timestamp,
            (unsigned)port.last_command, (unsigned)port.base_station_age_ms, (unsigned)port.flight_controller_age_ms);
        for (size_t kind = 0U; kind < HORUS_DPR_VIOLATIONS; kind++) {
            say(tape, " %u", (unsigned)port.violations[kind]);
        }
        say(tape, " %u %u %u %u %u", (unsigned)port.integrity_faults, (unsigned)port.flash_passes,
            (unsigned)port.stuck_bits, (unsigned)port.buffers_out_of_use, (unsigned)port.last_stop);
    }
    say(tape, "\n");
    for (size_t writer = 0U; writer < 2U; writer++) {
        result = horus_dpr_view_uplink(client, miso, count, writers[writer], &uplink);
        say(tape, "uplink %d", (int)result);
        if (result == HORUS_DPR_OK) {
            say(tape, " t=%u s=%04x ", (unsigned)uplink.timestamp, (unsigned)uplink.status);
            say_bytes(tape, uplink.payload, sizeof(uplink.payload));
        } else {
            say(tape, "\n");
        }
    }
    if (client->config.hold) {
        result = horus_dpr_view_hold(client, miso, count, &hold);
        say(tape, "hold %d", (int)result);
        if (result == HORUS_DPR_OK) {
            say_hold(tape, &hold);
        }
        say(tape, "\n");
    }
}

/* The flight controller's end of the hold. */
typedef struct {
    horus_dpr_hold_track_t track;
    horus_dpr_sender_t sender;
} hold_t;

/* One transaction: begin, and end with the tape's bytes, at an odd address. */
static const uint8_t *transact(tape_t *tape, horus_dpr_t *client, hold_t *hold, size_t *count)
{
    static uint8_t miso[MAX_MISO + 1U];
    const uint8_t *head = take(tape, 18U);
    uint8_t mosi[HORUS_DPR_MAX_MAP_BYTES];
    horus_dpr_report_t report;
    const uint8_t *brought = NULL;
    if (head != NULL) {
        const size_t length = (size_t)number(&head[16], 2U);
        const uint8_t *body = take(tape, length);
        const size_t short_of = horus_dpr_begin(client, mosi, HORUS_DPR_REQUEST_BYTES - 1U);
        const size_t bytes = horus_dpr_begin(client, mosi, sizeof(mosi));
        if ((body != NULL) && (length <= MAX_MISO)) {
            say(tape, "begin %u ", (unsigned)(bytes + short_of));
            say_bytes(tape, mosi, (bytes < HORUS_DPR_MAX_WRITE) ? bytes : HORUS_DPR_MAX_WRITE);
            (void)memcpy(&miso[1], body, length);
            horus_dpr_end(client, &miso[1], length, number(head, 8U), number(&head[8], 8U), &report);
            say_report(tape, &report);
            if (client->config.hold) {
                horus_dpr_hold_t values;
                horus_dpr_hold_report_t hold_report;
                if (horus_dpr_view_hold(client, &miso[1], length, &values) == HORUS_DPR_OK) {
                    horus_dpr_sender_observe(&hold->sender, &values);
                }
                horus_dpr_hold_read(&hold->track, client, &miso[1], length, number(head, 8U), &hold_report);
                say_hold_report(tape, &hold_report, &hold->sender);
            }
            *count = length;
            brought = &miso[1];
        } else {
            tape->left = 0U;
        }
    }
    return brought;
}

void horus_dpr_play(const uint8_t *bytes, size_t count, horus_dpr_sink_t sink, void *context)
{
    static const uint8_t nothing[1] = { 0U };
    tape_t tape = { bytes, count, sink, context };
    horus_dpr_config_t config = horus_dpr_config(3U);
    horus_dpr_t client;
    hold_t hold;
    const uint8_t *miso = nothing;
    size_t brought = 0U;
    uint8_t object[HORUS_DPR_OBJECT_BYTES];
    uint8_t payload[HORUS_DPR_PAYLOAD_BYTES];

    (void)memset(&hold, 0, sizeof(hold));
    (void)horus_dpr_init(&client, &config);
    while (tape.left > 0U) {
        const uint8_t *kind = take(&tape, 1U);
        const uint8_t *body;
        switch (*kind % 10U) {
        case 0U:
            body = take(&tape, 11U);
            if (body != NULL) {
                config.receivers = body[0] & 0x7FU;
                config.hold = (body[0] & 0x80U) != 0U;
                config.read_bytes = (uint16_t)number(&body[1], 2U);
                config.age_limit_us = (uint32_t)number(&body[3], 4U);
                config.silence_us = (uint32_t)number(&body[7], 4U);
                const horus_dpr_result_t result = horus_dpr_init(&client, &config);
                say(&tape, "config %d\n", (int)result);
                if (result == HORUS_DPR_OK) {
                    (void)memset(&hold, 0, sizeof(hold));
                    miso = nothing;
                    brought = 0U;
                }
            }
            break;
        case 1U:
            body = take(&tape, 4U);
            if (body != NULL) {
                const uint16_t offset = (uint16_t)number(body, 2U);
                say(&tape, "ask %d\n", (int)horus_dpr_ask(&client, offset, (uint16_t)number(&body[2], 2U)));
            }
            break;
        case 2U:
            body = take(&tape, HORUS_DPR_OBJECT_BYTES);
            if (body != NULL) {
                say(&tape, "write %d\n", (int)horus_dpr_write(&client, body));
            }
            break;
        case 3U:
            body = transact(&tape, &client, &hold, &brought);
            miso = (body != NULL) ? body : nothing;
            brought = (body != NULL) ? brought : 0U;
            break;
        case 4U:
            say_view(&tape, &client, miso, brought);
            break;
        case 5U:
            body = take(&tape, 5U);
            if (body != NULL) {
                const uint32_t word =
                    ((body[4] % 2U) == 0U) ? HORUS_DPR_COMMAND_CLEAR_COUNTERS : HORUS_DPR_COMMAND_SELF_TEST;
                horus_dpr_seal_command(object, (uint32_t)number(body, 4U), word);
                say(&tape, "command %d ", (int)horus_dpr_write(&client, object));
                say_bytes(&tape, object, sizeof(object));
            }
            break;
        case 7U:
            body = take(&tape, 5U);
            if (body != NULL) {
                static const uint16_t words[4] = { HORUS_DPR_HOLD_SET_POINT, HORUS_DPR_HOLD_LOCK,
                    HORUS_DPR_HOLD_UNLOCK, HORUS_DPR_HOLD_CLEAR_SHOCK };
                const uint32_t bits = ((body[0] % 4U) == 0U) ? (uint32_t)number(&body[1], 4U) : 0U;
                float value;
                (void)memcpy(&value, &bits, sizeof(value));
                if (horus_dpr_sender_send(&hold.sender, words[body[0] % 4U], value)) {
                    say(&tape, "send %u\n", (unsigned)hold.sender.number);
                } else {
                    say(&tape, "send none\n");
                }
            }
            break;
        case 8U:
            horus_dpr_sender_give_up(&hold.sender);
            say(&tape, "give up\n");
            break;
        default:
            body = take(&tape, 6U + HORUS_DPR_PAYLOAD_BYTES);
            if (body != NULL) {
                (void)memcpy(payload, &body[6], sizeof(payload));
                if ((*kind % 10U) == 9U) {
                    horus_dpr_sender_fill(&hold.sender, payload);
                }
                horus_dpr_seal_uplink(object, (uint32_t)number(body, 4U), (uint16_t)number(&body[4], 2U), payload);
                say(&tape, "own %d ", (int)horus_dpr_write(&client, object));
                say_bytes(&tape, object, sizeof(object));
            }
            break;
        }
    }
}
