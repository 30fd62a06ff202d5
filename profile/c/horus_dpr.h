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

#define HORUS_DPR_VERSION 1000U /* major, minor and patch, three digits each; horus_dpr.c is of the same */

/* Bytes. */
#define HORUS_DPR_REQUEST_BYTES      8U   /* a request */
#define HORUS_DPR_OBJECT_BYTES       64U  /* an uplink or a command */
#define HORUS_DPR_PAYLOAD_BYTES      52U  /* what an uplink carries */
#define HORUS_DPR_RESERVED_BYTES     48U  /* what a command reserves, zero */
#define HORUS_DPR_MAX_WRITE          72U  /* the longest MOSI that says something */
#define HORUS_DPR_PREFIX_BYTES       96U  /* Link-Status and Reported-Position */
#define HORUS_DPR_GPS_BYTES          60U  /* a receiver's object */
#define HORUS_DPR_PORT_BYTES         192U /* Port-Status and both uplinks */
#define HORUS_DPR_HOLD_BYTES         64U  /* the object of an active hold, behind them where there is one */
#define HORUS_DPR_HOLD_COMMAND_BYTES 12U  /* a command to it, the beginning of an uplink's payload */
#define HORUS_DPR_MAX_MAP_BYTES      652U /* the longest map, that of five receivers with a hold */

/* Offsets in the map. */
#define HORUS_DPR_LINK_STATUS_OFFSET       0U  /* Link-Status */
#define HORUS_DPR_REPORTED_POSITION_OFFSET 32U /* Reported-Position */
#define HORUS_DPR_GPS_OFFSET               96U /* GPS1; the others follow */

/* Offsets behind the image. */
#define HORUS_DPR_PORT_STATUS_OFFSET              0U   /* Port-Status */
#define HORUS_DPR_UPLINK_BASE_STATION_OFFSET      64U  /* the base station's uplink, as stored */
#define HORUS_DPR_UPLINK_FLIGHT_CONTROLLER_OFFSET 128U /* the flight controller's uplink, as stored */
#define HORUS_DPR_HOLD_OFFSET                     192U /* the hold's object, where there is a hold */

/* Identifiers. */
#define HORUS_DPR_ID_REPORTED_POSITION        0x4800U /* Reported-Position; GPS1 to GPS5 are 1 to 5 more */
#define HORUS_DPR_ID_LINK_STATUS              0x4400U /* Link-Status */
#define HORUS_DPR_ID_PORT_STATUS              0x4401U /* Port-Status */
#define HORUS_DPR_ID_UPLINK_BASE_STATION      0x4200U /* uplink of the base station */
#define HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER 0x4300U /* uplink of the flight controller */
#define HORUS_DPR_ID_COMMAND                  0x4301U /* command of the flight controller to the DPR */
#define HORUS_DPR_ID_HOLD_STATUS              0x4100U /* Hold-Status; other makers' holds have up to 255 more */

/* Commands. */
#define HORUS_DPR_COMMAND_CLEAR_COUNTERS 0x43524C43U /* sets Port-Status's counters to 0 */
#define HORUS_DPR_COMMAND_SELF_TEST      0x54534554U /* one whole pass over flash and RAM in use */

/* Words of commands to the hold; 0 is none. */
#define HORUS_DPR_HOLD_SET_POINT   1U /* the value is the temperature to keep, degrees Celsius */
#define HORUS_DPR_HOLD_LOCK        2U /* locks it */
#define HORUS_DPR_HOLD_UNLOCK      3U /* unlocks it */
#define HORUS_DPR_HOLD_CLEAR_SHOCK 4U /* sets the greatest shock to 0 */

/* Limits of the client, unless its configuration sets others. */
#define HORUS_DPR_AGE_LIMIT_US 100000U /* a position older than this is not shown */
#define HORUS_DPR_SILENCE_US   30000U  /* so long without anything intact, and the DPR is silent */

/* Bounds that cannot be set. */
#define HORUS_DPR_CYCLE_MS         10U        /* the cycle of HORUS: each timestamp is a multiple later */
#define HORUS_DPR_MAX_STEP_MS      260U       /* the longest step of timestamps in sequence */
#define HORUS_DPR_SEARCH_CYCLES    3U         /* so many samples in sequence before one is shown */
#define HORUS_DPR_TOLERANCE_US     27500U     /* a sample may be read so much too early or too late */
#define HORUS_DPR_TOLERANCE_SHARE  50U        /* and by one part in so many of the step */
#define HORUS_DPR_EXPIRY_US        25000U     /* the DPR does not show an image for longer than this */
#define HORUS_DPR_UPLINK_EXPIRY_MS 500U       /* the DPR does not show an uplink for longer than this */
#define HORUS_DPR_HOLD_EXPIRY_US   300000U    /* the DPR does not show Hold-Status for longer */
#define HORUS_DPR_HOLD_FRAME_US    1416U      /* the age of Hold-Status when the DPR gets it */
#define HORUS_DPR_AGE_UNKNOWN      UINT32_MAX /* no sample yet, or its age cannot be told */
#define HORUS_DPR_NO_FRESH         UINT64_MAX /* the FRESH line is not wired */

/* Limits of a position, as the bits of their doubles, in the numbers' order; NaN is above. */
#define HORUS_DPR_MAX_LATITUDE_BITS  0x4056800000000000U /* degrees north and south */
#define HORUS_DPR_MAX_LONGITUDE_BITS 0x4066800000000000U /* degrees east and west */
#define HORUS_DPR_MIN_ALTITUDE_BITS  0x408F400000000000U /* m below the ellipsoid */
#define HORUS_DPR_MAX_ALTITUDE_BITS  0x40D3880000000000U /* m above the ellipsoid */

/* The wire, at the DPR's pins; see docs/hardware.md for isolators. */
#define HORUS_DPR_MAX_CLOCK_HZ 8000000U /* SCK at most */
#define HORUS_DPR_CSN_SETUP_NS 1000U    /* CSN falls to first SCK edge at least */
#define HORUS_DPR_CSN_HOLD_NS  2000U    /* last SCK edge to CSN rises at least */
#define HORUS_DPR_GAP_NS       10000U   /* CSN rises to CSN falls at least */

/* Registers of the CRCs after an intact object, before the final XOR. */
#define HORUS_DPR_FRAME_RESIDUE    0x9D18E2E0U /* frame CRC */
#define HORUS_DPR_POSITION_RESIDUE 0x3C139B22U /* CRC over latitude and longitude */

/* Access violations by kind: places in horus_dpr_port_t.violations. */
#define HORUS_DPR_VIOLATION_REQUEST_DAMAGED   0U /* a request whose CRC is wrong */
#define HORUS_DPR_VIOLATION_WINDOW_OUTSIDE    1U /* a window that is empty or not in the map */
#define HORUS_DPR_VIOLATION_TOO_SHORT         2U /* a request or an object that ended in the middle */
#define HORUS_DPR_VIOLATION_UPLINK_DAMAGED    3U /* an object whose CRC is wrong */
#define HORUS_DPR_VIOLATION_UPLINK_IDENTIFIER 4U /* an object that nobody may write */
#define HORUS_DPR_VIOLATION_UPLINK_NOT_NEWER  5U /* an uplink or a command that is repeated or old */
#define HORUS_DPR_VIOLATION_COMMAND_UNKNOWN   6U /* an unknown command, or reserved bytes that are not zero */
#define HORUS_DPR_VIOLATION_COMMAND_BUSY      7U /* a self-test while one is under way */
#define HORUS_DPR_VIOLATION_TOO_MANY          8U /* more transactions or objects than the DPR grants */
#define HORUS_DPR_VIOLATION_TOO_LONG          9U /* something was driven behind the object */
#define HORUS_DPR_VIOLATIONS 10U /* kinds */

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

HORUS_DPR_ASSERT(HORUS_DPR_IMAGE_BYTES(1U) == 156U, "layout of 1 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_MAP_BYTES(1U) == 348U, "layout of 1 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_GPS_AT(1U) == 96U, "layout of 1 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_PORT_STATUS_AT(1U) == 156U, "layout of 1 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(1U) == 348U, "layout of 1 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(1U) + HORUS_DPR_HOLD_BYTES == 412U, "layout of 1 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_IMAGE_BYTES(2U) == 216U, "layout of 2 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_MAP_BYTES(2U) == 408U, "layout of 2 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_GPS_AT(2U) == 156U, "layout of 2 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_PORT_STATUS_AT(2U) == 216U, "layout of 2 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(2U) == 408U, "layout of 2 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(2U) + HORUS_DPR_HOLD_BYTES == 472U, "layout of 2 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_IMAGE_BYTES(3U) == 276U, "layout of 3 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_MAP_BYTES(3U) == 468U, "layout of 3 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_GPS_AT(3U) == 216U, "layout of 3 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_PORT_STATUS_AT(3U) == 276U, "layout of 3 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(3U) == 468U, "layout of 3 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(3U) + HORUS_DPR_HOLD_BYTES == 532U, "layout of 3 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_IMAGE_BYTES(5U) == 396U, "layout of 5 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_MAP_BYTES(5U) == 588U, "layout of 5 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_GPS_AT(5U) == 336U, "layout of 5 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_PORT_STATUS_AT(5U) == 396U, "layout of 5 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(5U) == 588U, "layout of 5 receivers");
HORUS_DPR_ASSERT(HORUS_DPR_HOLD_AT(5U) + HORUS_DPR_HOLD_BYTES == 652U, "layout of 5 receivers");

/* ---- objects on the wire: everything is little-endian except the CRCs, which are big-endian ---- */

/* Link-Status, identifier HORUS_DPR_ID_LINK_STATUS, 32 bytes. */
typedef struct {
    uint8_t timestamp[4];         /*  0: u32, ms since DPR start */
    uint8_t identifier[2];        /*  4: u16 */
    uint8_t status[2];            /*  6: u16, HORUS_DPR_LINK_... */
    uint8_t objects_accepted[4];  /*  8: u32, objects accepted */
    uint8_t objects_rejected[4];  /* 12: u32, objects rejected */
    uint8_t frames_received[4];   /* 16: u32, frames received */
    uint8_t frames_missed[4];     /* 20: u32, frames missed */
    uint8_t age_100us[2];         /* 24: u16, age of Reported-Position, 100 us */
    uint8_t access_violations[2]; /* 26: u16, accesses refused */
    uint8_t crc[4];               /* 28: u32, big-endian, over all before */
} horus_dpr_wire_link_status_t;
HORUS_DPR_ASSERT(sizeof(horus_dpr_wire_link_status_t) == 32U, "size");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, timestamp) == 0U, "timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, identifier) == 4U, "identifier");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, status) == 6U, "status");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, objects_accepted) == 8U, "objects_accepted");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, objects_rejected) == 12U, "objects_rejected");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, frames_received) == 16U, "frames_received");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, frames_missed) == 20U, "frames_missed");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, age_100us) == 24U, "age_100us");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, access_violations) == 26U, "access_violations");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_link_status_t, crc) == 28U, "crc");

/* Reported-Position, identifier HORUS_DPR_ID_REPORTED_POSITION, 64 bytes. */
typedef struct {
    uint8_t timestamp[4];     /*  0: u32, ms since HORUS start */
    uint8_t identifier[2];    /*  4: u16 */
    uint8_t status[2];        /*  6: u16, HORUS_DPR_REPORTED_... */
    uint8_t latitude[8];      /*  8: binary64, degrees */
    uint8_t longitude[8];     /* 16: binary64, degrees */
    uint8_t position_crc[4];  /* 24: u32, big-endian, over latitude and longitude */
    uint8_t altitude[8];      /* 28: binary64, m */
    uint8_t pitch[4];         /* 36: binary32, rad */
    uint8_t yaw[4];           /* 40: binary32, rad */
    uint8_t roll[4];          /* 44: binary32, rad */
    uint8_t acceleration[12]; /* 48: 3 x binary32, m/s2 */
    uint8_t crc[4];           /* 60: u32, big-endian, over all before */
} horus_dpr_wire_reported_t;
HORUS_DPR_ASSERT(sizeof(horus_dpr_wire_reported_t) == 64U, "size");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, timestamp) == 0U, "timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, identifier) == 4U, "identifier");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, status) == 6U, "status");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, latitude) == 8U, "latitude");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, longitude) == 16U, "longitude");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, position_crc) == 24U, "position_crc");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, altitude) == 28U, "altitude");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, pitch) == 36U, "pitch");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, yaw) == 40U, "yaw");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, roll) == 44U, "roll");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, acceleration) == 48U, "acceleration");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_reported_t, crc) == 60U, "crc");

/* GPS1 to GPS5, identifier HORUS_DPR_ID_REPORTED_POSITION + 1 to 5, 60 bytes. */
typedef struct {
    uint8_t timestamp[4];     /*  0: u32, ms since HORUS start */
    uint8_t identifier[2];    /*  4: u16 */
    uint8_t status[2];        /*  6: u16, HORUS_DPR_GPS_... */
    uint8_t latitude[8];      /*  8: binary64, degrees */
    uint8_t longitude[8];     /* 16: binary64, degrees */
    uint8_t altitude[8];      /* 24: binary64, m */
    uint8_t pitch[4];         /* 32: binary32, rad */
    uint8_t yaw[4];           /* 36: binary32, rad */
    uint8_t roll[4];          /* 40: binary32, rad */
    uint8_t acceleration[12]; /* 44: 3 x binary32, m/s2 */
    uint8_t crc[4];           /* 56: u32, big-endian, over all before */
} horus_dpr_wire_gps_t;
HORUS_DPR_ASSERT(sizeof(horus_dpr_wire_gps_t) == 60U, "size");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, timestamp) == 0U, "timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, identifier) == 4U, "identifier");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, status) == 6U, "status");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, latitude) == 8U, "latitude");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, longitude) == 16U, "longitude");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, altitude) == 24U, "altitude");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, pitch) == 32U, "pitch");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, yaw) == 36U, "yaw");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, roll) == 40U, "roll");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, acceleration) == 44U, "acceleration");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_gps_t, crc) == 56U, "crc");

/* Port-Status, identifier HORUS_DPR_ID_PORT_STATUS, 64 bytes. */
typedef struct {
    uint8_t timestamp[4];                /*  0: u32, ms since DPR start */
    uint8_t identifier[2];               /*  4: u16 */
    uint8_t status[2];                   /*  6: u16, HORUS_DPR_PORT_... */
    uint8_t uplinks_accepted[4];         /*  8: u32, uplinks stored */
    uint8_t commands_carried_out[4];     /* 12: u32, commands carried out */
    uint8_t last_command_timestamp[4];   /* 16: u32, ms, timestamp of the last command */
    uint8_t last_command[4];             /* 20: u32, its word */
    uint8_t base_station_age_ms[2];      /* 24: u16, ms since the base station's uplink */
    uint8_t flight_controller_age_ms[2]; /* 26: u16, ms since the flight controller's uplink */
    uint8_t violations[20];              /* 28: u16 of each kind */
    uint8_t integrity_faults[2];         /* 48: u16, faults found in images */
    uint8_t flash_passes[2];             /* 50: u16, passes over the flash */
    uint8_t stuck_bits[2];               /* 52: u16, stuck bits found */
    uint8_t buffers_out_of_use[2];       /* 54: u16, buffers out of use */
    uint8_t last_stop[4];                /* 56: u32, reason of the last safe state */
    uint8_t crc[4];                      /* 60: u32, big-endian, over all before */
} horus_dpr_wire_port_status_t;
HORUS_DPR_ASSERT(sizeof(horus_dpr_wire_port_status_t) == 64U, "size");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, timestamp) == 0U, "timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, identifier) == 4U, "identifier");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, status) == 6U, "status");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, uplinks_accepted) == 8U, "uplinks_accepted");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, commands_carried_out) == 12U, "commands_carried_out");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, last_command_timestamp) == 16U, "last_command_timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, last_command) == 20U, "last_command");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, base_station_age_ms) == 24U, "base_station_age_ms");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, flight_controller_age_ms) == 26U, "flight_controller_age_ms");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, violations) == 28U, "violations");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, integrity_faults) == 48U, "integrity_faults");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, flash_passes) == 50U, "flash_passes");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, stuck_bits) == 52U, "stuck_bits");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, buffers_out_of_use) == 54U, "buffers_out_of_use");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, last_stop) == 56U, "last_stop");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_port_status_t, crc) == 60U, "crc");

/* Uplink, identifier HORUS_DPR_ID_UPLINK_BASE_STATION or HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER, 64 bytes. */
typedef struct {
    uint8_t timestamp[4];  /*  0: u32, ms on the writer's clock */
    uint8_t identifier[2]; /*  4: u16 */
    uint8_t status[2];     /*  6: u16, as writer and reader agree */
    uint8_t payload[52];   /*  8: the writer's */
    uint8_t crc[4];        /* 60: u32, big-endian, over all before */
} horus_dpr_wire_uplink_t;
HORUS_DPR_ASSERT(sizeof(horus_dpr_wire_uplink_t) == 64U, "size");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_uplink_t, timestamp) == 0U, "timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_uplink_t, identifier) == 4U, "identifier");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_uplink_t, status) == 6U, "status");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_uplink_t, payload) == 8U, "payload");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_uplink_t, crc) == 60U, "crc");

/* Command, identifier HORUS_DPR_ID_COMMAND, 64 bytes. */
typedef struct {
    uint8_t timestamp[4];  /*  0: u32, ms on the flight controller's clock */
    uint8_t identifier[2]; /*  4: u16 */
    uint8_t status[2];     /*  6: u16, not evaluated */
    uint8_t word[4];       /*  8: u32, HORUS_DPR_COMMAND_... */
    uint8_t reserved[48];  /* 12: zero */
    uint8_t crc[4];        /* 60: u32, big-endian, over all before */
} horus_dpr_wire_command_t;
HORUS_DPR_ASSERT(sizeof(horus_dpr_wire_command_t) == 64U, "size");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_command_t, timestamp) == 0U, "timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_command_t, identifier) == 4U, "identifier");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_command_t, status) == 6U, "status");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_command_t, word) == 8U, "word");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_command_t, reserved) == 12U, "reserved");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_command_t, crc) == 60U, "crc");

/* Hold-Status, identifier HORUS_DPR_ID_HOLD_STATUS, 64 bytes. */
typedef struct {
    uint8_t timestamp[4];      /*  0: u32, ms since the hold's start */
    uint8_t identifier[2];     /*  4: u16 */
    uint8_t status[2];         /*  6: u16, HORUS_DPR_HOLD_STATUS_... */
    uint8_t temperature[4];    /*  8: binary32, degrees Celsius */
    uint8_t humidity[4];       /* 12: binary32, relative, % */
    uint8_t set_point[4];      /* 16: binary32, degrees Celsius */
    uint8_t vibration[12];     /* 20: 3 x binary32, m/s2, RMS over the last second */
    uint8_t greatest_shock[4]; /* 32: binary32, m/s2, since the start or since it was cleared */
    uint8_t supply[4];         /* 36: binary32, V */
    uint8_t output[4];         /* 40: binary32, -1 (cooling) to 1 (heating) */
    uint8_t acknowledged[8];   /* 44: u16 number, u16 outcome: base station's, own */
    uint8_t seconds[4];        /* 52: u32, s since the hold's start */
    uint8_t reserved[4];       /* 56: zero */
    uint8_t crc[4];            /* 60: u32, big-endian, over all before */
} horus_dpr_wire_hold_status_t;
HORUS_DPR_ASSERT(sizeof(horus_dpr_wire_hold_status_t) == 64U, "size");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, timestamp) == 0U, "timestamp");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, identifier) == 4U, "identifier");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, status) == 6U, "status");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, temperature) == 8U, "temperature");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, humidity) == 12U, "humidity");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, set_point) == 16U, "set_point");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, vibration) == 20U, "vibration");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, greatest_shock) == 32U, "greatest_shock");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, supply) == 36U, "supply");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, output) == 40U, "output");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, acknowledged) == 44U, "acknowledged");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, seconds) == 52U, "seconds");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, reserved) == 56U, "reserved");
HORUS_DPR_ASSERT(offsetof(horus_dpr_wire_hold_status_t, crc) == 60U, "crc");

/* ---- bits and codes of the status words ---- */

/* Reported-Position. */
#define HORUS_DPR_REPORTED_AGREEING_MASK      0x0007U /* receivers that agree, 0 to 7 */
#define HORUS_DPR_REPORTED_POSITION_VALID     0x0008U /* latitude and longitude are valid */
#define HORUS_DPR_REPORTED_ATTITUDE_VALID     0x0010U /* pitch, yaw and roll are valid */
#define HORUS_DPR_REPORTED_ACCELERATION_VALID 0x0020U /* the accelerations are valid */
#define HORUS_DPR_REPORTED_DEGRADED           0x0040U /* fewer receivers agree than configured, or on no altitude */
#define HORUS_DPR_REPORTED_WITHOUT_CRYSTAL    0x0080U /* HORUS runs without its crystal */
#define HORUS_DPR_REPORTED_STATE_MASK         0x0F00U /* what HORUS is doing: horus_dpr_state_t */
#define HORUS_DPR_REPORTED_MEMORY_FAULT       0x1000U /* HORUS has found a fault of its memory */
#define HORUS_DPR_REPORTED_RESET_MASK         0xE000U /* why HORUS last started: horus_dpr_reset_t */
#define HORUS_DPR_REPORTED_USED               0xFFFFU /* the bits that have a meaning */
#define HORUS_DPR_REPORTED_AGREEING_SHIFT     0U      /* how far to shift that code down */
#define HORUS_DPR_REPORTED_STATE_SHIFT        8U      /* how far to shift that code down */
#define HORUS_DPR_REPORTED_RESET_SHIFT        13U     /* how far to shift that code down */

/* GPS1 to GPS5. */
#define HORUS_DPR_GPS_FIX_MASK           0x000FU /* UBX fixType: horus_dpr_fix_t */
#define HORUS_DPR_GPS_POSITION_VALID     0x0010U /* latitude and longitude are valid */
#define HORUS_DPR_GPS_ATTITUDE_VALID     0x0020U /* pitch, yaw and roll are valid */
#define HORUS_DPR_GPS_ACCELERATION_VALID 0x0040U /* the accelerations are valid */
#define HORUS_DPR_GPS_HEARD              0x0080U /* heard in the last 250 ms */
#define HORUS_DPR_GPS_STALE              0x0100U /* the solution is older than its period allows */
#define HORUS_DPR_GPS_EXCLUDED           0x0200U /* the voter excluded this receiver */
#define HORUS_DPR_GPS_AGE_MASK           0xFC00U /* age of its solution: horus_dpr_solution_age_ms */
#define HORUS_DPR_GPS_USED               0xFFFFU /* the bits that have a meaning */
#define HORUS_DPR_GPS_FIX_SHIFT          0U      /* how far to shift that code down */
#define HORUS_DPR_GPS_AGE_SHIFT          10U     /* how far to shift that code down */

#define HORUS_DPR_GPS_AGE_STEP_MS 25U    /* the step of that age, ms */
#define HORUS_DPR_GPS_OLDEST_MS   1550U  /* the age that stands for this or more, ms */
#define HORUS_DPR_GPS_AGE_NEVER   63U    /* the code of an age: there was no solution since HORUS's start */
#define HORUS_DPR_NO_SOLUTION     65535U /* what horus_dpr_solution_age_ms says to that code */

/* Link-Status. */
#define HORUS_DPR_LINK_UP                0x0001U /* frames arrive within their deadline */
#define HORUS_DPR_LINK_ALL_ACCEPTED      0x0002U /* every object of the last cycle was accepted */
#define HORUS_DPR_LINK_HORUS_FROZEN      0x0004U /* HORUS repeats its timestamp */
#define HORUS_DPR_LINK_HORUS_RESTARTED   0x0008U /* HORUS started again */
#define HORUS_DPR_LINK_RAM_FAULT         0x0010U /* a scrub found a RAM fault */
#define HORUS_DPR_LINK_FRONT_END_FAULT   0x0020U /* the RFID front end has a fault */
#define HORUS_DPR_LINK_UNASKED_RESET     0x0040U /* nobody asked for the DPR's last reset */
#define HORUS_DPR_LINK_UPLINK_REJECTED   0x0080U /* the last uplink was rejected */
#define HORUS_DPR_LINK_OUT_OF_SEQUENCE   0x0100U /* nothing is shown until it is found again */
#define HORUS_DPR_LINK_CLOCK_IMPLAUSIBLE 0x0200U /* HORUS's clock is off by > 2 % */
#define HORUS_DPR_LINK_FLASH_FAULT       0x0400U /* the DPR's program memory is damaged */
#define HORUS_DPR_LINK_RESET_MASK        0x7000U /* why the DPR last started: horus_dpr_reset_t */
#define HORUS_DPR_LINK_NO_FIELD          0x8000U /* the front end works and senses no field of the sender */
#define HORUS_DPR_LINK_USED              0xF7FFU /* the bits that have a meaning */
#define HORUS_DPR_LINK_RESET_SHIFT       12U     /* how far to shift that code down */

/* Port-Status. */
#define HORUS_DPR_PORT_BASE_STATION_FRESH        0x0001U /* its uplink is shown */
#define HORUS_DPR_PORT_FLIGHT_CONTROLLER_FRESH   0x0002U /* its uplink is shown */
#define HORUS_DPR_PORT_LAST_REFUSED              0x0004U /* the last uplink or command was refused */
#define HORUS_DPR_PORT_SELF_TEST_RUNNING         0x0008U /* a self-test is under way */
#define HORUS_DPR_PORT_SELF_TEST_PASSED          0x0010U /* the last one found nothing */
#define HORUS_DPR_PORT_SELF_TEST_FAILED          0x0020U /* the last one found a fault */
#define HORUS_DPR_PORT_BUFFERS_OUT_OF_USE        0x0040U /* a buffer or image is out of use */
#define HORUS_DPR_PORT_HOLD_HEARD                0x0080U /* a frame of the hold came in the last 300 ms */
#define HORUS_DPR_PORT_HOLD_ACCEPTED             0x0100U /* the last one was accepted */
#define HORUS_DPR_PORT_HOLD_ACCEPTED_COUNT_MASK  0x1E00U /* objects of the hold accepted, mod 16 */
#define HORUS_DPR_PORT_HOLD_REJECTED_COUNT_MASK  0xE000U /* frames of the hold rejected, mod 8 */
#define HORUS_DPR_PORT_USED                      0xFFFFU /* the bits that have a meaning */
#define HORUS_DPR_PORT_HOLD_ACCEPTED_COUNT_SHIFT 9U      /* how far to shift that code down */
#define HORUS_DPR_PORT_HOLD_REJECTED_COUNT_SHIFT 13U     /* how far to shift that code down */

/* Hold-Status. */
#define HORUS_DPR_HOLD_STATUS_VALUES_VALID  0x0001U /* the values are valid */
#define HORUS_DPR_HOLD_STATUS_WITHIN_LIMITS 0x0002U /* the values are within the hold's limits */
#define HORUS_DPR_HOLD_STATUS_LOCKED        0x0004U /* locked */
#define HORUS_DPR_HOLD_STATUS_SENSOR_FAULT  0x0008U /* a sensor has a fault */
#define HORUS_DPR_HOLD_STATUS_MEMORY_FAULT  0x0010U /* the hold has found a fault of its memory */
#define HORUS_DPR_HOLD_STATUS_SAFE_STATE    0x0020U /* the output is off, the lock stays as it is */
#define HORUS_DPR_HOLD_STATUS_RESET_MASK    0x01C0U /* why the hold last started: horus_dpr_reset_t */
#define HORUS_DPR_HOLD_STATUS_USED          0x01FFU /* the bits that have a meaning */
#define HORUS_DPR_HOLD_STATUS_RESET_SHIFT   6U      /* how far to shift that code down */

/* What HORUS is doing. Other codes are reserved. */
typedef enum {
    HORUS_DPR_STATE_STARTING = 0,           /* no position since HORUS's start */
    HORUS_DPR_STATE_MONITORING = 1,         /* there is a position now */
    HORUS_DPR_STATE_OUTSIDE_RANGE = 2,      /* the position is outside the flight range */
    HORUS_DPR_STATE_SWITCHED = 3,           /* switched to the redundant flight controller */
    HORUS_DPR_STATE_MOTORS_CUT = 4,         /* motors cut */
    HORUS_DPR_STATE_EMERGENCY_FIRED = 5,    /* emergency measure fired */
    HORUS_DPR_STATE_INPUTS_CONTRADICT = 6,  /* an input that tells the state contradicts itself */
    HORUS_DPR_STATE_POSITION_LOST = 7       /* there was a position, and there is none now */
} horus_dpr_state_t;

/* A receiver's fix. Other codes are reserved. */
typedef enum {
    HORUS_DPR_FIX_NONE = 0,            /* no fix */
    HORUS_DPR_FIX_DEAD_RECKONING = 1,  /* dead reckoning only */
    HORUS_DPR_FIX_2D = 2,              /* two-dimensional fix */
    HORUS_DPR_FIX_3D = 3,              /* three-dimensional fix */
    HORUS_DPR_FIX_COMBINED = 4,        /* GNSS and dead reckoning combined */
    HORUS_DPR_FIX_TIME_ONLY = 5        /* time only */
} horus_dpr_fix_t;

/* Why the DPR, HORUS or the hold last started. Other codes are reserved. */
typedef enum {
    HORUS_DPR_RESET_POWER_ON = 0,  /* its supply came on */
    HORUS_DPR_RESET_PIN = 1,       /* its reset pin was low */
    HORUS_DPR_RESET_WATCHDOG = 2,  /* its watchdog was not fed */
    HORUS_DPR_RESET_LOCKUP = 3,    /* a fault while it handled a fault */
    HORUS_DPR_RESET_SOFTWARE = 4,  /* software or a debugger asked for it */
    HORUS_DPR_RESET_OTHER = 5      /* its supply dipped, or something else */
} horus_dpr_reset_t;

/* What became of a command to the hold. Other codes are reserved. */
typedef enum {
    HORUS_DPR_OUTCOME_NOTHING = 0,  /* there was no command since the hold's start */
    HORUS_DPR_OUTCOME_DONE = 1,     /* it was carried out */
    HORUS_DPR_OUTCOME_REFUSED = 2,  /* the hold's own limits forbid it */
    HORUS_DPR_OUTCOME_UNKNOWN = 3,  /* its word is unknown */
    HORUS_DPR_OUTCOME_TOO_OLD = 4   /* its uplink had the same timestamp for more than 1 s */
} horus_dpr_outcome_t;

/* ---- the client's report ---- */

/* What a transaction brought. */
typedef enum {
    HORUS_DPR_NONE = 0,             /* no transaction has ended: nobody filled the report */
    HORUS_DPR_FRESH = 1,            /* a new sample, in sequence, valid, not too old: its position is shown */
    HORUS_DPR_SAME = 2,             /* the same sample again, intact: not new, only older */
    HORUS_DPR_SEARCHING = 3,        /* a new sample; the sequence is not found yet. Not shown */
    HORUS_DPR_OUT_OF_SEQUENCE = 4,  /* a sample that does not continue the others. Not shown */
    HORUS_DPR_EMPTY = 5,            /* Link-Status is intact; there is no Reported-Position */
    HORUS_DPR_INVALID = 6,          /* a new sample whose position is not valid and not shown; its status is */
    HORUS_DPR_STALE = 7,            /* an intact sample that is older than the limit. Not shown */
    HORUS_DPR_BUSY = 8,             /* 0xFF throughout, or nothing: not heard; what was sent is sent again */
    HORUS_DPR_DAMAGED = 9,          /* damaged, or not read whole: nothing of it is used */
    HORUS_DPR_SILENT = 10,          /* busy or damaged, and nothing intact for too long */
    HORUS_DPR_OTHER_WINDOW = 11     /* the window that was asked for: see horus_dpr_view_... */
} horus_dpr_verdict_t;

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

/* Whether there is a Hold-Status. */
typedef enum {
    HORUS_DPR_HOLD_ABSENT = 0,  /* the DPR shows none, or none was read yet */
    HORUS_DPR_HOLD_OLD = 1,     /* the last one has not changed for more than HORUS_DPR_HOLD_EXPIRY_US */
    HORUS_DPR_HOLD_VALID = 2    /* there is one */
} horus_dpr_hold_shown_t;

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
