# SPDX-License-Identifier: MIT OR Apache-2.0
# Generated from the Rust crate `profile` by `cargo xtask layout`. Do not edit.
#
# An image of the DPR, or its whole map, by its length. Each object is a type of its own. Kaitai Struct does not verify
# the CRCs: objects that are damaged, or places that are vacant, are parsed like any others.
meta:
  id: horus_profile
  title: HORUS image or map
  license: MIT OR Apache-2.0
  endian: le
seq:
  - id: link_status
    type: link_status
  - id: reported
    type: reported
  - id: gps
    type: gps
    repeat: expr
    repeat-expr: receivers
  - id: port_status
    type: port_status
    if: is_map
  - id: base_station
    type: uplink
    if: is_map
  - id: flight_controller
    type: uplink
    if: is_map
  - id: hold_status
    type: hold_status
    if: has_hold
instances:
  is_map:
    value: (_io.size - 96) % 60 != 0
  has_hold:
    value: (_io.size - 96) % 60 == 16
  receivers:
    value: '(_io.size - 96 - (has_hold ? 256 : is_map ? 192 : 0)) / 60'
types:
  link_status:
    doc: Link-Status, 32 bytes
    seq:
      - id: timestamp
        type: u4
        doc: "ms since DPR start"
      - id: identifier
        type: u2
        enum: identifier
      - id: status
        type: u2
      - id: objects_accepted
        type: u4
        doc: "objects accepted"
      - id: objects_rejected
        type: u4
        doc: "objects rejected"
      - id: frames_received
        type: u4
        doc: "frames received"
      - id: frames_missed
        type: u4
        doc: "frames missed"
      - id: age_100us
        type: u2
        doc: "age of Reported-Position, 100 us"
      - id: access_violations
        type: u2
        doc: "accesses refused"
      - id: crc
        type: u4be
        doc: "over all before"
    instances:
      status_up:
        value: (status & 0x0001) != 0
        doc: "frames arrive within their deadline"
      status_all_accepted:
        value: (status & 0x0002) != 0
        doc: "every object of the last cycle was accepted"
      status_horus_frozen:
        value: (status & 0x0004) != 0
        doc: "HORUS repeats its timestamp"
      status_horus_restarted:
        value: (status & 0x0008) != 0
        doc: "HORUS started again"
      status_ram_fault:
        value: (status & 0x0010) != 0
        doc: "a scrub found a RAM fault"
      status_front_end_fault:
        value: (status & 0x0020) != 0
        doc: "the RFID front end has a fault"
      status_unasked_reset:
        value: (status & 0x0040) != 0
        doc: "nobody asked for the DPR's last reset"
      status_uplink_rejected:
        value: (status & 0x0080) != 0
        doc: "the last uplink was rejected"
      status_out_of_sequence:
        value: (status & 0x0100) != 0
        doc: "nothing is shown until it is found again"
      status_clock_implausible:
        value: (status & 0x0200) != 0
        doc: "HORUS's clock is off by > 2 %"
      status_flash_fault:
        value: (status & 0x0400) != 0
        doc: "the DPR's program memory is damaged"
      status_reset:
        value: (status & 0x7000) >> 12
        enum: reset
        doc: "why the DPR last started"
      status_no_field:
        value: (status & 0x8000) != 0
        doc: "the front end works and senses no field of the sender"
  reported:
    doc: Reported-Position, 64 bytes
    seq:
      - id: timestamp
        type: u4
        doc: "ms since HORUS start"
      - id: identifier
        type: u2
        enum: identifier
      - id: status
        type: u2
      - id: latitude
        type: f8
        doc: "degrees"
      - id: longitude
        type: f8
        doc: "degrees"
      - id: position_crc
        type: u4be
        doc: "over latitude and longitude"
      - id: altitude
        type: f8
        doc: "m"
      - id: pitch
        type: f4
        doc: "rad"
      - id: yaw
        type: f4
        doc: "rad"
      - id: roll
        type: f4
        doc: "rad"
      - id: acceleration
        type: f4
        repeat: expr
        repeat-expr: 3
        doc: "m/s2"
      - id: crc
        type: u4be
        doc: "over all before"
    instances:
      status_agreeing:
        value: (status & 0x0007) >> 0
        doc: "receivers that agree, 0 to 7"
      status_position_valid:
        value: (status & 0x0008) != 0
        doc: "latitude and longitude are valid"
      status_attitude_valid:
        value: (status & 0x0010) != 0
        doc: "pitch, yaw and roll are valid"
      status_acceleration_valid:
        value: (status & 0x0020) != 0
        doc: "the accelerations are valid"
      status_degraded:
        value: (status & 0x0040) != 0
        doc: "fewer receivers agree than configured, or on no altitude"
      status_without_crystal:
        value: (status & 0x0080) != 0
        doc: "HORUS runs without its crystal"
      status_state:
        value: (status & 0x0f00) >> 8
        enum: state
        doc: "what HORUS is doing"
      status_memory_fault:
        value: (status & 0x1000) != 0
        doc: "HORUS has found a fault of its memory"
      status_reset:
        value: (status & 0xe000) >> 13
        enum: reset
        doc: "why HORUS last started"
  gps:
    doc: GPS1 to GPS5, 60 bytes
    seq:
      - id: timestamp
        type: u4
        doc: "ms since HORUS start"
      - id: identifier
        type: u2
        enum: identifier
      - id: status
        type: u2
      - id: latitude
        type: f8
        doc: "degrees"
      - id: longitude
        type: f8
        doc: "degrees"
      - id: altitude
        type: f8
        doc: "m"
      - id: pitch
        type: f4
        doc: "rad"
      - id: yaw
        type: f4
        doc: "rad"
      - id: roll
        type: f4
        doc: "rad"
      - id: acceleration
        type: f4
        repeat: expr
        repeat-expr: 3
        doc: "m/s2"
      - id: crc
        type: u4be
        doc: "over all before"
    instances:
      status_fix:
        value: (status & 0x000f) >> 0
        enum: fix
        doc: "UBX fixType"
      status_position_valid:
        value: (status & 0x0010) != 0
        doc: "latitude and longitude are valid"
      status_attitude_valid:
        value: (status & 0x0020) != 0
        doc: "pitch, yaw and roll are valid"
      status_acceleration_valid:
        value: (status & 0x0040) != 0
        doc: "the accelerations are valid"
      status_heard:
        value: (status & 0x0080) != 0
        doc: "heard in the last 250 ms"
      status_stale:
        value: (status & 0x0100) != 0
        doc: "the solution is older than its period allows"
      status_excluded:
        value: (status & 0x0200) != 0
        doc: "the voter excluded this receiver"
      status_age:
        value: (status & 0xfc00) >> 10
        doc: "age of its solution"
  port_status:
    doc: Port-Status, 64 bytes
    seq:
      - id: timestamp
        type: u4
        doc: "ms since DPR start"
      - id: identifier
        type: u2
        enum: identifier
      - id: status
        type: u2
      - id: uplinks_accepted
        type: u4
        doc: "uplinks stored"
      - id: commands_carried_out
        type: u4
        doc: "commands carried out"
      - id: last_command_timestamp
        type: u4
        doc: "ms, timestamp of the last command"
      - id: last_command
        type: u4
        doc: "its word"
      - id: base_station_age_ms
        type: u2
        doc: "ms since the base station's uplink"
      - id: flight_controller_age_ms
        type: u2
        doc: "ms since the flight controller's uplink"
      - id: violations
        type: u2
        repeat: expr
        repeat-expr: 10
      - id: integrity_faults
        type: u2
        doc: "faults found in images"
      - id: flash_passes
        type: u2
        doc: "passes over the flash"
      - id: stuck_bits
        type: u2
        doc: "stuck bits found"
      - id: buffers_out_of_use
        type: u2
        doc: "buffers out of use"
      - id: last_stop
        type: u4
        doc: "reason of the last safe state"
      - id: crc
        type: u4be
        doc: "over all before"
    instances:
      status_base_station_fresh:
        value: (status & 0x0001) != 0
        doc: "its uplink is shown"
      status_flight_controller_fresh:
        value: (status & 0x0002) != 0
        doc: "its uplink is shown"
      status_last_refused:
        value: (status & 0x0004) != 0
        doc: "the last uplink or command was refused"
      status_self_test_running:
        value: (status & 0x0008) != 0
        doc: "a self-test is under way"
      status_self_test_passed:
        value: (status & 0x0010) != 0
        doc: "the last one found nothing"
      status_self_test_failed:
        value: (status & 0x0020) != 0
        doc: "the last one found a fault"
      status_buffers_out_of_use:
        value: (status & 0x0040) != 0
        doc: "a buffer or image is out of use"
      status_hold_heard:
        value: (status & 0x0080) != 0
        doc: "a frame of the hold came in the last 300 ms"
      status_hold_accepted:
        value: (status & 0x0100) != 0
        doc: "the last one was accepted"
      status_hold_accepted_count:
        value: (status & 0x1e00) >> 9
        doc: "objects of the hold accepted, mod 16"
      status_hold_rejected_count:
        value: (status & 0xe000) >> 13
        doc: "frames of the hold rejected, mod 8"
  uplink:
    doc: Uplink, 64 bytes
    seq:
      - id: timestamp
        type: u4
        doc: "ms on the writer's clock"
      - id: identifier
        type: u2
        enum: identifier
      - id: status
        type: u2
        doc: "as writer and reader agree"
      - id: payload
        size: 52
        doc: "the writer's"
      - id: crc
        type: u4be
        doc: "over all before"
  command:
    doc: Command, 64 bytes
    seq:
      - id: timestamp
        type: u4
        doc: "ms on the flight controller's clock"
      - id: identifier
        type: u2
        enum: identifier
      - id: status
        type: u2
        doc: "not evaluated"
      - id: word
        type: u4
        enum: command_word
      - id: reserved
        size: 48
        doc: "zero"
      - id: crc
        type: u4be
        doc: "over all before"
  hold_status:
    doc: Hold-Status, 64 bytes
    seq:
      - id: timestamp
        type: u4
        doc: "ms since the hold's start"
      - id: identifier
        type: u2
        enum: identifier
      - id: status
        type: u2
      - id: temperature
        type: f4
        doc: "degrees Celsius"
      - id: humidity
        type: f4
        doc: "relative, %"
      - id: set_point
        type: f4
        doc: "degrees Celsius"
      - id: vibration
        type: f4
        repeat: expr
        repeat-expr: 3
        doc: "m/s2, RMS over the last second"
      - id: greatest_shock
        type: f4
        doc: "m/s2, since the start or since it was cleared"
      - id: supply
        type: f4
        doc: "V"
      - id: output
        type: f4
        doc: "-1 (cooling) to 1 (heating)"
      - id: acknowledged
        type: acknowledgement
        repeat: expr
        repeat-expr: 2
        doc: "u16 number, u16 outcome: base station's, own"
      - id: seconds
        type: u4
        doc: "s since the hold's start"
      - id: reserved
        size: 4
        doc: "zero"
      - id: crc
        type: u4be
        doc: "over all before"
    instances:
      status_values_valid:
        value: (status & 0x0001) != 0
        doc: "the values are valid"
      status_within_limits:
        value: (status & 0x0002) != 0
        doc: "the values are within the hold's limits"
      status_locked:
        value: (status & 0x0004) != 0
        doc: "locked"
      status_sensor_fault:
        value: (status & 0x0008) != 0
        doc: "a sensor has a fault"
      status_memory_fault:
        value: (status & 0x0010) != 0
        doc: "the hold has found a fault of its memory"
      status_safe_state:
        value: (status & 0x0020) != 0
        doc: "the output is off, the lock stays as it is"
      status_reset:
        value: (status & 0x01c0) >> 6
        enum: reset
        doc: "why the hold last started"
  request:
    doc: Request of a window, 8 bytes
    seq:
      - id: offset
        type: u2
        doc: "the first byte of the map to show"
      - id: length
        type: u2
        doc: "bytes"
      - id: crc
        type: u4be
        doc: "over all before"
  acknowledgement:
    doc: of the last command to the hold
    seq:
      - id: number
        type: u2
      - id: outcome
        type: u2
        enum: outcome
enums:
  identifier:
    17408: link_status
    18432: reported_position
    17409: port_status
    16896: uplink_base_station
    17152: uplink_flight_controller
    17153: command
    16640: hold_status
    18433: gps1
    18434: gps2
    18435: gps3
    18436: gps4
    18437: gps5
  command_word:
    1129466947: clear_counters
    1414743380: self_test
  state:
    0: starting
    1: monitoring
    2: outside_range
    3: switched
    4: motors_cut
    5: emergency_fired
    6: inputs_contradict
    7: position_lost
  fix:
    0: none
    1: dead_reckoning
    2: fix_2d
    3: fix_3d
    4: combined
    5: time_only
  reset:
    0: power_on
    1: pin
    2: watchdog
    3: lockup
    4: software
    5: other
  outcome:
    0: nothing
    1: done
    2: refused
    3: unknown
    4: too_old
