/* SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * The flight controller's end of the SSI: it determines what is sent to the DPR, and evaluates the answer.
 *
 * Generated from the Rust crate `profile` by `cargo xtask header`, from xtask/src/header/template.h and that crate's
 * layouts. Do not edit: `cargo xtask lint` fails if this file differs from the generated one.
 *
 * C11, or C++11 and later. docs/flight-controller.md shows how to wire and use it; this is the short form:
 *
 *     static horus_dpr_t dpr;
 *     horus_dpr_config_t config = horus_dpr_config(3);
 *     horus_dpr_init(&dpr, &config);
 *
 *     in each control cycle:
 *         uint8_t buffer[HORUS_DPR_MAX_MAP_BYTES];
 *         horus_dpr_report_t report;
 *         uint64_t began_us = now in us;
 *         size_t bytes = horus_dpr_begin(&dpr, buffer, sizeof buffer);
 *         transfer `bytes` bytes of `buffer` by SPI, in place; bytes = 0 if that failed
 *         horus_dpr_end(&dpr, buffer, bytes, began_us, HORUS_DPR_NO_FRESH, &report);
 *         if (report.has_position) { fly by report.position } else { fly by your own receiver }
 *
 * Nothing here allocates, blocks or calls back. A client is plain memory of its caller's; two clients are independent;
 * one client is used by one thread at a time. No pointer may be NULL, but `miso` if there are no bytes.
 */
#ifndef HORUS_DPR_H
#define HORUS_DPR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define HORUS_DPR_ASSERT(condition, text) static_assert(condition, text)
extern "C" {
#else
#define HORUS_DPR_ASSERT(condition, text) _Static_assert(condition, text)
#endif

/* ---- numbers ---- */

@constants@
/* The image for 1, 2, 3 or 5 receivers, bytes: Link-Status, Reported-Position, GPS1 to GPSn. */
#define HORUS_DPR_IMAGE_BYTES(receivers) (HORUS_DPR_GPS_OFFSET + (HORUS_DPR_GPS_BYTES * (receivers)))
/* The memory map, bytes: the image, Port-Status, both uplinks. With an active hold, its object follows. */
#define HORUS_DPR_MAP_BYTES(receivers) (HORUS_DPR_IMAGE_BYTES(receivers) + HORUS_DPR_PORT_BYTES)
/* Offset of GPS1 to GPS5 in the map. */
#define HORUS_DPR_GPS_AT(receiver) (HORUS_DPR_GPS_OFFSET + (HORUS_DPR_GPS_BYTES * ((receiver) - 1U)))
/* Offset of Port-Status in the map. */
#define HORUS_DPR_PORT_STATUS_AT(receivers) (HORUS_DPR_IMAGE_BYTES(receivers) + HORUS_DPR_PORT_STATUS_OFFSET)
/* Offset of the hold's object in the map, where there is a hold. */
#define HORUS_DPR_HOLD_AT(receivers) (HORUS_DPR_IMAGE_BYTES(receivers) + HORUS_DPR_HOLD_OFFSET)

@layouts@
/* ---- objects on the wire: everything is little-endian except the CRCs, which are big-endian ---- */

@wire@
/* ---- bits and codes of the status words ---- */

@status@
/* ---- the client's report ---- */

@verdicts@
/* The content of an object's place, or the reason why an argument was refused. */
typedef enum {
    HORUS_DPR_OK = 0,           /* the object, intact; the argument was accepted */
    HORUS_DPR_VACANT = 1,       /* the place is vacant: every byte is 0x00 or 0xFF */
    HORUS_DPR_LENGTH = 2,       /* it was not read, or not whole; there is no such object */
    HORUS_DPR_CRC = 3,          /* damaged: the frame CRC does not match */
    HORUS_DPR_POSITION_CRC = 4, /* the frame CRC matches, that over latitude and longitude does not */
    HORUS_DPR_IDENTIFIER = 5,   /* intact, but another object than the one that belongs here */
    HORUS_DPR_WINDOW = 6,       /* a window that is empty or not in the map */
    HORUS_DPR_COMMAND = 7       /* a command that the DPR does not know, or whose reserved bytes are not zero */
} horus_dpr_result_t;

/* Values of Reported-Position, or of a receiver. An unknown value is NaN. */
typedef struct {
    uint32_t timestamp;    /* ms since HORUS start, wraps; +10 in each cycle */
    uint16_t status;       /* HORUS_DPR_REPORTED_..., or HORUS_DPR_GPS_... for a receiver's */
    double latitude;       /* degrees, WGS-84, north positive */
    double longitude;      /* degrees, WGS-84, east positive */
    double altitude;       /* m above the WGS-84 ellipsoid, not above mean sea level */
    float pitch;           /* rad, nose up positive */
    float yaw;             /* rad, clockwise from true north */
    float roll;            /* rad, right side down positive */
    float acceleration[3]; /* m/s2 along front, right, down; gravity is removed */
} horus_dpr_sample_t;

/* Values of Link-Status. Counters count since DPR start and wrap unless stated otherwise. */
typedef struct {
    uint32_t timestamp;         /* ms since DPR start, wraps */
    uint16_t status;            /* HORUS_DPR_LINK_... */
    uint32_t objects_accepted;  /* objects accepted */
    uint32_t objects_rejected;  /* objects rejected */
    uint32_t frames_received;   /* frames received, accepted or not */
    uint32_t frames_missed;     /* frames that were due and did not arrive */
    uint16_t age_100us;         /* age of Reported-Position when the image was made, 100 us; saturates at 65535 */
    uint16_t access_violations; /* accesses over SSI that were refused; saturates at 65535 */
} horus_dpr_link_t;

/* Values of Port-Status. Counters of 16 bits saturate at 65535, those of 32 wrap. */
typedef struct {
    uint32_t timestamp;                        /* ms since DPR start, wraps */
    uint16_t status;                           /* HORUS_DPR_PORT_... */
    uint32_t uplinks_accepted;                 /* uplinks that were stored, of both writers */
    uint32_t commands_carried_out;             /* commands that were carried out */
    uint32_t last_command_timestamp;           /* timestamp of the last of them, ms; 0 if there was none */
    uint32_t last_command;                     /* its word; 0 if there was none */
    uint16_t base_station_age_ms;              /* age of the base station's last uplink, ms; 65535: long ago or none */
    uint16_t flight_controller_age_ms;         /* age of the flight controller's last uplink, likewise */
    uint16_t violations[HORUS_DPR_VIOLATIONS]; /* access violations by kind: HORUS_DPR_VIOLATION_... */
    uint16_t integrity_faults;                 /* faults that the round-the-clock check found in images */
    uint16_t flash_passes;                     /* passes of that check over the flash */
    uint16_t stuck_bits;                       /* stuck bits that scrubs found */
    uint16_t buffers_out_of_use;               /* receive buffers and images taken out of use */
    uint32_t last_stop;                        /* reason of the DPR's last safe state; 0 if there was none */
} horus_dpr_port_t;

/* Values of an uplink as the DPR has stored it. */
typedef struct {
    uint32_t timestamp;                       /* ms on the writer's clock, wraps */
    uint16_t status;                          /* defined by writer and reader */
    uint8_t payload[HORUS_DPR_PAYLOAD_BYTES]; /* the writer's data */
} horus_dpr_uplink_t;

/* A command to the hold, as the hold has acknowledged it. */
typedef struct {
    uint16_t number;  /* its sequence number; 0 if there was none */
    uint16_t outcome; /* horus_dpr_outcome_t */
} horus_dpr_acknowledged_t;

/* Values of Hold-Status. A value that is not known is NaN. */
typedef struct {
    uint32_t timestamp;                    /* ms since the hold's start, wraps; +100 in each */
    uint16_t status;                       /* HORUS_DPR_HOLD_STATUS_... */
    float temperature;                     /* degrees Celsius */
    float humidity;                        /* relative, % */
    float set_point;                       /* degrees Celsius */
    float vibration[3];                    /* RMS along x, y, z over the last second, m/s2 */
    float greatest_shock;                  /* since the start or since it was cleared, m/s2 */
    float supply;                          /* V */
    float output;                          /* -1 (cooling) to 1 (heating) */
    horus_dpr_acknowledged_t base_station; /* the base station's last command */
    horus_dpr_acknowledged_t own;          /* the flight controller's last command */
    uint32_t seconds;                      /* time since the hold's start, s */
} horus_dpr_hold_t;

@hold@
/* What is known of the hold after a transaction. */
typedef struct {
    horus_dpr_hold_shown_t shown; /* whether there is a Hold-Status */
    horus_dpr_hold_t values;      /* the last one, with HORUS_DPR_HOLD_VALID only */
    uint32_t age_us;              /* its age when the transaction began, us, not less than true; or AGE_UNKNOWN */
} horus_dpr_hold_report_t;

/* Follows Hold-Status from transaction to transaction. Zeros are its state before the first. */
typedef struct {
    horus_dpr_hold_t last;
    uint64_t last_read_us; /* the instant at which it was first read */
    uint64_t looked_us;    /* the instant of the last reading of its place */
    uint32_t last_age_us;  /* its age when it was first read */
    bool has_last;
    bool has_looked;
} horus_dpr_hold_track_t;

/* What is known of the last command that was sent to the hold. */
typedef enum {
    HORUS_DPR_SENT_NOTHING = 0,  /* none was sent */
    HORUS_DPR_SENT_WAITING = 1,  /* it is in every uplink, and not acknowledged yet */
    HORUS_DPR_SENT_ANSWERED = 2, /* it is acknowledged, once and for all: see `outcome` */
    HORUS_DPR_SENT_LOST = 3      /* it is no longer sent and was not acknowledged: done once or not at all */
} horus_dpr_sent_t;

/* The flight controller's commands to the hold, one at a time. Zeros are its state before the first. */
typedef struct {
    horus_dpr_sent_t sent;                         /* what is known of the last one; read it */
    uint16_t number;                               /* its number; read it */
    uint16_t outcome;                              /* horus_dpr_outcome_t, with HORUS_DPR_SENT_ANSWERED; read it */
    uint16_t acknowledged;                         /* the number that the hold acknowledged last */
    uint32_t hold_timestamp;                       /* the timestamp of the last Hold-Status */
    uint8_t command[HORUS_DPR_HOLD_COMMAND_BYTES]; /* the bytes of the command that is waiting */
    bool has_hold;
} horus_dpr_sender_t;

/* A range of bytes of the map. */
typedef struct {
    uint16_t offset; /* of the first byte */
    uint16_t length; /* number of bytes */
} horus_dpr_window_t;

/* The settings of a client. Fill them with horus_dpr_config, then change any of them. */
typedef struct {
    uint8_t receivers;     /* receivers of the profile: 1, 2, 3 or 5 */
    uint16_t read_bytes;   /* bytes that a transaction reads from the map's start: HORUS_DPR_PREFIX_BYTES or more */
    uint32_t age_limit_us; /* a position older than this is not shown, us */
    uint32_t silence_us;   /* the time without intact data after which the DPR is HORUS_DPR_SILENT, us */
    bool hold;             /* whether the DPR has an active hold: the map is longer by its object; false unless set */
} horus_dpr_config_t;

/* The client's report after a transaction. */
typedef struct {
    horus_dpr_verdict_t verdict; /* the result of the transaction */
    bool has_position;           /* whether there is a position to fly by; if not, fall back on your own receiver */
    horus_dpr_sample_t position; /* that position; a value that is not valid is NaN, with its status bit clear */
    bool has_status;             /* whether HORUS's status is known, with a valid position or without one */
    uint16_t status;             /* HORUS_DPR_REPORTED_..., of a sample in sequence and not too old; else 0 */
    uint32_t age_us;             /* age of the last intact sample when the transaction began, us; not less than true */
    bool has_link;               /* whether this transaction brought Link-Status */
    horus_dpr_link_t link;       /* Link-Status, if so */
} horus_dpr_report_t;

/* A client. Its members are private: read its reports instead. */
typedef struct {
    horus_dpr_config_t config;
    horus_dpr_window_t shown;               /* window of the last transaction */
    horus_dpr_window_t window;              /* window of the next one, if it was requested */
    horus_dpr_window_t asked;               /* window to request in the next one */
    horus_dpr_window_t sent;                /* request, until it is known to have reached the DPR */
    uint8_t object[HORUS_DPR_OBJECT_BYTES]; /* object to write, until it is known to have reached the DPR */
    horus_dpr_sample_t position;            /* the last sample's values, where they may be shown */
    uint64_t last_due_us;                   /* the last sample: the earliest instant at which it could be read */
    uint64_t last_read_us;                  /* the instant at which it was first read */
    uint32_t last_timestamp;
    uint32_t last_age_us; /* its age at that instant */
    uint64_t image_us;    /* the instant of the last intact Link-Status */
    uint64_t intact_us;   /* the instant of the last intact data, or else of the first transaction */
    uint32_t image_timestamp;
    uint8_t found; /* samples in a row that were in sequence */
    bool has_window;
    bool has_asked;
    bool has_sent;
    bool has_object;
    bool object_under_way;
    bool has_position;
    bool has_status;
    bool has_last;
    bool has_image;
    bool has_intact;
} horus_dpr_t;

/* ---- the client ---- */

/* 96 bytes in each transaction, a position of at most HORUS_DPR_AGE_LIMIT_US. */
horus_dpr_config_t horus_dpr_config(uint8_t receivers);

/* Initialises a client. Returns HORUS_DPR_WINDOW, with nothing changed, if no profile has that number of receivers,
 * or if read_bytes are fewer than HORUS_DPR_PREFIX_BYTES or more than the map has. */
horus_dpr_result_t horus_dpr_init(horus_dpr_t *client, const horus_dpr_config_t *config);

/* Requests bytes of the map in the next transaction; the one after it reads them. A request that met a busy DPR is
 * repeated. Returns HORUS_DPR_WINDOW, without a request, if the range is empty or does not lie in the map. */
horus_dpr_result_t horus_dpr_ask(horus_dpr_t *client, uint16_t offset, uint16_t length);

/* Writes an object in the next transaction: one that was sealed here, or one of the base station's, unchanged. One that
 * met a busy DPR is written again. Returns HORUS_DPR_CRC, HORUS_DPR_IDENTIFIER or HORUS_DPR_COMMAND, without a write,
 * if it is damaged or the DPR would refuse it. */
horus_dpr_result_t horus_dpr_write(horus_dpr_t *client, const uint8_t object[HORUS_DPR_OBJECT_BYTES]);

/* Fills `object` with an uplink of the flight controller. Each must have a later timestamp than the one before, ms. */
void horus_dpr_seal_uplink(uint8_t object[HORUS_DPR_OBJECT_BYTES], uint32_t timestamp, uint16_t status,
    const uint8_t payload[HORUS_DPR_PAYLOAD_BYTES]);

/* Fills `object` with a command, HORUS_DPR_COMMAND_..., whose timestamp must be later than that of the one before. */
void horus_dpr_seal_command(uint8_t object[HORUS_DPR_OBJECT_BYTES], uint32_t timestamp, uint32_t word);

/* Fills the beginning of `mosi` for the next transaction and returns the number of bytes, all of which must be clocked.
 * Returns 0, with nothing changed, if `capacity` is too small; HORUS_DPR_MAX_MAP_BYTES always suffice. */
size_t horus_dpr_begin(horus_dpr_t *client, uint8_t *mosi, size_t capacity);

/* Ends the transaction. `miso` is the answer, `bytes` the number of clocked bytes; 0 if the bus failed. `began_us` is
 * the instant at which chip select fell, `fresh_us` that of the last edge of FRESH before it, or HORUS_DPR_NO_FRESH if
 * the line is not wired: both in us on one clock that never goes back. */
void horus_dpr_end(horus_dpr_t *client, const uint8_t *miso, size_t bytes, uint64_t began_us, uint64_t fresh_us,
    horus_dpr_report_t *report);

/* ---- the last transaction, object by object; `miso` and `bytes` as for horus_dpr_end ---- */

/* Bytes of the map, NULL if they were not all read. */
const uint8_t *horus_dpr_find(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, size_t offset, size_t length);

/* Link-Status. The values are only written with HORUS_DPR_OK, here and below. */
horus_dpr_result_t horus_dpr_view_link(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, horus_dpr_link_t *link);

/* Object number `index` of the profile as HORUS sent it: 0 is Reported-Position, 1 to 5 are GPS1 to GPS5. */
horus_dpr_result_t horus_dpr_view_object(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, uint8_t index, horus_dpr_sample_t *sample);

/* The age of a receiver's solution, GPS1 to GPS5, at the tick of its timestamp: ms since it arrived at HORUS, rounded
 * down to HORUS_DPR_GPS_AGE_STEP_MS, HORUS_DPR_GPS_OLDEST_MS for that or more, HORUS_DPR_NO_SOLUTION if there was none
 * since HORUS's start. It has no meaning for Reported-Position. */
uint16_t horus_dpr_solution_age_ms(const horus_dpr_sample_t *gps);

/* Port-Status. */
horus_dpr_result_t horus_dpr_view_port(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, horus_dpr_port_t *port);

/* Hold-Status. HORUS_DPR_LENGTH if the client's configuration has no hold. */
horus_dpr_result_t horus_dpr_view_hold(
    const horus_dpr_t *client, const uint8_t *miso, size_t bytes, horus_dpr_hold_t *hold);

/* An uplink as stored: HORUS_DPR_ID_UPLINK_BASE_STATION or HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER. */
horus_dpr_result_t horus_dpr_view_uplink(const horus_dpr_t *client, const uint8_t *miso, size_t bytes,
    uint16_t identifier, horus_dpr_uplink_t *uplink);

/* ---- the active hold; `miso` and `bytes` as for horus_dpr_end ---- */

/* After each transaction: whether there is a Hold-Status, and how old it is. A transaction that did not read its place,
 * met a busy DPR or read damaged bytes there only lets the last one age. */
void horus_dpr_hold_read(horus_dpr_hold_track_t *track, const horus_dpr_t *client, const uint8_t *miso, size_t bytes,
    uint64_t began_us, horus_dpr_hold_report_t *report);

/* Takes the acknowledgement from a Hold-Status that was read: see docs/design.md#commands-to-the-hold. */
void horus_dpr_sender_observe(horus_dpr_sender_t *sender, const horus_dpr_hold_t *hold);

/* Sends a command, HORUS_DPR_HOLD_SET_POINT and so on, from now on; its number is in `sender`. Returns false, without
 * sending it, while another one is waiting or before a Hold-Status was observed. */
bool horus_dpr_sender_send(horus_dpr_sender_t *sender, uint16_t word, float value);

/* Stops sending the command that is waiting: it is lost. */
void horus_dpr_sender_give_up(horus_dpr_sender_t *sender);

/* Puts the command that is waiting, or none, at the beginning of an uplink's payload, for horus_dpr_seal_uplink. The
 * rest stays as it is. Every uplink needs it, with a later timestamp in each, until the command is answered. */
void horus_dpr_sender_fill(const horus_dpr_sender_t *sender, uint8_t payload[HORUS_DPR_PAYLOAD_BYTES]);

#ifdef __cplusplus
}
#endif

#endif
