-- SPDX-License-Identifier: MIT OR Apache-2.0
-- A dissector for Wireshark: the objects of the HORUS link in MAVLink 2 (TUNNEL) and in plain datagrams, over UDP.
--
-- Generated from the Rust crate `profile` by `cargo xtask layout`. Do not edit.
--
-- Wireshark finds it in its folder of plugins (Help, About, Folders). tshark takes it with
-- `tshark -X lua_script:horus.lua -r capture.pcap -V`. It recognises objects on any port of UDP. A line on which every
-- object is damaged is not recognised: say `-d udp.port==14550,horus`, or "Decode As" in Wireshark.

local layout = {
  commands = {
    { name = "CLEAR_COUNTERS", value = 1129466947, what = "sets Port-Status's counters to 0" },
    { name = "SELF_TEST", value = 1414743380, what = "one whole pass over flash and RAM in use" },
  },
  crcs = {
    frame = {
      byte_order = "big-endian",
      check = "0x12D3A0B1",
      init = "0xFFFFFFFF",
      polynomial = "0xF1922815",
      reflect_in = false,
      reflect_out = false,
      residue = "0x9D18E2E0",
      width = 32,
      xorout = "0xFFFFFFFF",
    },
    position = {
      byte_order = "big-endian",
      check = "0xEA8707AB",
      init = "0xFFFFFFFF",
      polynomial = "0x3AFF2FAD",
      reflect_in = false,
      reflect_out = false,
      residue = "0x3C139B22",
      width = 32,
      xorout = "0xFFFFFFFF",
    },
  },
  enumerations = {
    {
      name = "state",
      title = "What HORUS is doing. Other codes are reserved.",
      values = {
        { name = "STARTING", value = 0, what = "no position since HORUS's start" },
        { name = "MONITORING", value = 1, what = "there is a position now" },
        { name = "OUTSIDE_RANGE", value = 2, what = "the position is outside the flight range" },
        { name = "SWITCHED", value = 3, what = "switched to the redundant flight controller" },
        { name = "MOTORS_CUT", value = 4, what = "motors cut" },
        { name = "EMERGENCY_FIRED", value = 5, what = "emergency measure fired" },
        { name = "INPUTS_CONTRADICT", value = 6, what = "an input that tells the state contradicts itself" },
        { name = "POSITION_LOST", value = 7, what = "there was a position, and there is none now" },
      },
    },
    {
      name = "fix",
      title = "A receiver's fix. Other codes are reserved.",
      values = {
        { name = "NONE", value = 0, what = "no fix" },
        { name = "DEAD_RECKONING", value = 1, what = "dead reckoning only" },
        { name = "2D", value = 2, what = "two-dimensional fix" },
        { name = "3D", value = 3, what = "three-dimensional fix" },
        { name = "COMBINED", value = 4, what = "GNSS and dead reckoning combined" },
        { name = "TIME_ONLY", value = 5, what = "time only" },
      },
    },
    {
      name = "reset",
      title = "Why the DPR, HORUS or the hold last started. Other codes are reserved.",
      values = {
        { name = "POWER_ON", value = 0, what = "its supply came on" },
        { name = "PIN", value = 1, what = "its reset pin was low" },
        { name = "WATCHDOG", value = 2, what = "its watchdog was not fed" },
        { name = "LOCKUP", value = 3, what = "a fault while it handled a fault" },
        { name = "SOFTWARE", value = 4, what = "software or a debugger asked for it" },
        { name = "OTHER", value = 5, what = "its supply dipped, or something else" },
      },
    },
    {
      name = "outcome",
      title = "What became of a command to the hold. Other codes are reserved.",
      values = {
        { name = "NOTHING", value = 0, what = "there was no command since the hold's start" },
        { name = "DONE", value = 1, what = "it was carried out" },
        { name = "REFUSED", value = 2, what = "the hold's own limits forbid it" },
        { name = "UNKNOWN", value = 3, what = "its word is unknown" },
        { name = "TOO_OLD", value = 4, what = "its uplink had the same timestamp for more than 1 s" },
      },
    },
    {
      name = "verdict",
      title = "What a transaction brought.",
      values = {
        { name = "NONE", value = 0, what = "no transaction has ended: nobody filled the report" },
        {
          name = "FRESH",
          value = 1,
          what = "a new sample, in sequence, valid, not too old: its position is shown",
        },
        { name = "SAME", value = 2, what = "the same sample again, intact: not new, only older" },
        { name = "SEARCHING", value = 3, what = "a new sample; the sequence is not found yet. Not shown" },
        {
          name = "OUT_OF_SEQUENCE",
          value = 4,
          what = "a sample that does not continue the others. Not shown",
        },
        { name = "EMPTY", value = 5, what = "Link-Status is intact; there is no Reported-Position" },
        {
          name = "INVALID",
          value = 6,
          what = "a new sample whose position is not valid and not shown; its status is",
        },
        { name = "STALE", value = 7, what = "an intact sample that is older than the limit. Not shown" },
        {
          name = "BUSY",
          value = 8,
          what = "0xFF throughout, or nothing: not heard; what was sent is sent again",
        },
        { name = "DAMAGED", value = 9, what = "damaged, or not read whole: nothing of it is used" },
        { name = "SILENT", value = 10, what = "busy or damaged, and nothing intact for too long" },
        { name = "OTHER_WINDOW", value = 11, what = "the window that was asked for: see horus_dpr_view_..." },
      },
    },
    {
      name = "hold_shown",
      title = "Whether there is a Hold-Status.",
      values = {
        { name = "ABSENT", value = 0, what = "the DPR shows none, or none was read yet" },
        {
          name = "OLD",
          value = 1,
          what = "the last one has not changed for more than HORUS_DPR_HOLD_EXPIRY_US",
        },
        { name = "VALID", value = 2, what = "there is one" },
      },
    },
  },
  identifiers = {
    { name = "LINK_STATUS", value = 17408 },
    { name = "REPORTED_POSITION", value = 18432 },
    { name = "PORT_STATUS", value = 17409 },
    { name = "UPLINK_BASE_STATION", value = 16896 },
    { name = "UPLINK_FLIGHT_CONTROLLER", value = 17152 },
    { name = "COMMAND", value = 17153 },
    { name = "HOLD_STATUS", value = 16640 },
    { name = "GPS1", value = 18433 },
    { name = "GPS2", value = 18434 },
    { name = "GPS3", value = 18435 },
    { name = "GPS4", value = 18436 },
    { name = "GPS5", value = 18437 },
  },
  maps = {
    {
      hold = false,
      image_bytes = 156,
      map_bytes = 348,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 156 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 220 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 284 },
      },
      profile_bytes = 124,
      receivers = 1,
    },
    {
      hold = false,
      image_bytes = 216,
      map_bytes = 408,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 60, identifier = 18434, object = "gps", offset = 156 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 216 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 280 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 344 },
      },
      profile_bytes = 184,
      receivers = 2,
    },
    {
      hold = false,
      image_bytes = 276,
      map_bytes = 468,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 60, identifier = 18434, object = "gps", offset = 156 },
        { bytes = 60, identifier = 18435, object = "gps", offset = 216 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 276 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 340 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 404 },
      },
      profile_bytes = 244,
      receivers = 3,
    },
    {
      hold = false,
      image_bytes = 396,
      map_bytes = 588,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 60, identifier = 18434, object = "gps", offset = 156 },
        { bytes = 60, identifier = 18435, object = "gps", offset = 216 },
        { bytes = 60, identifier = 18436, object = "gps", offset = 276 },
        { bytes = 60, identifier = 18437, object = "gps", offset = 336 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 396 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 460 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 524 },
      },
      profile_bytes = 364,
      receivers = 5,
    },
    {
      hold = true,
      image_bytes = 156,
      map_bytes = 412,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 156 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 220 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 284 },
        { bytes = 64, identifier = 16640, object = "hold_status", offset = 348 },
      },
      profile_bytes = 124,
      receivers = 1,
    },
    {
      hold = true,
      image_bytes = 216,
      map_bytes = 472,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 60, identifier = 18434, object = "gps", offset = 156 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 216 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 280 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 344 },
        { bytes = 64, identifier = 16640, object = "hold_status", offset = 408 },
      },
      profile_bytes = 184,
      receivers = 2,
    },
    {
      hold = true,
      image_bytes = 276,
      map_bytes = 532,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 60, identifier = 18434, object = "gps", offset = 156 },
        { bytes = 60, identifier = 18435, object = "gps", offset = 216 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 276 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 340 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 404 },
        { bytes = 64, identifier = 16640, object = "hold_status", offset = 468 },
      },
      profile_bytes = 244,
      receivers = 3,
    },
    {
      hold = true,
      image_bytes = 396,
      map_bytes = 652,
      places = {
        { bytes = 32, identifier = 17408, object = "link_status", offset = 0 },
        { bytes = 64, identifier = 18432, object = "reported", offset = 32 },
        { bytes = 60, identifier = 18433, object = "gps", offset = 96 },
        { bytes = 60, identifier = 18434, object = "gps", offset = 156 },
        { bytes = 60, identifier = 18435, object = "gps", offset = 216 },
        { bytes = 60, identifier = 18436, object = "gps", offset = 276 },
        { bytes = 60, identifier = 18437, object = "gps", offset = 336 },
        { bytes = 64, identifier = 17409, object = "port_status", offset = 396 },
        { bytes = 64, identifier = 16896, object = "uplink", offset = 460 },
        { bytes = 64, identifier = 17152, object = "uplink", offset = 524 },
        { bytes = 64, identifier = 16640, object = "hold_status", offset = 588 },
      },
      profile_bytes = 364,
      receivers = 5,
    },
  },
  objects = {
    {
      bytes = 32,
      fields = {
        {
          bytes = 4,
          count = 1,
          name = "timestamp",
          offset = 0,
          type = "u32",
          unit = "ms",
          what = "ms since DPR start",
        },
        { bytes = 2, count = 1, name = "identifier", offset = 4, one_of = "identifiers", type = "u16" },
        { bytes = 2, count = 1, name = "status", offset = 6, status_word = "link", type = "u16" },
        {
          bytes = 4,
          count = 1,
          name = "objects_accepted",
          offset = 8,
          type = "u32",
          what = "objects accepted",
        },
        {
          bytes = 4,
          count = 1,
          name = "objects_rejected",
          offset = 12,
          type = "u32",
          what = "objects rejected",
        },
        {
          bytes = 4,
          count = 1,
          name = "frames_received",
          offset = 16,
          type = "u32",
          what = "frames received",
        },
        { bytes = 4, count = 1, name = "frames_missed", offset = 20, type = "u32", what = "frames missed" },
        {
          bytes = 2,
          count = 1,
          name = "age_100us",
          offset = 24,
          type = "u16",
          unit = "100 us",
          what = "age of Reported-Position, 100 us",
        },
        {
          bytes = 2,
          count = 1,
          name = "access_violations",
          offset = 26,
          type = "u16",
          what = "accesses refused",
        },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 28 },
          crc = "frame",
          name = "crc",
          offset = 28,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = { 17408 },
      name = "link_status",
      title = "Link-Status",
    },
    {
      bytes = 64,
      fields = {
        {
          bytes = 4,
          count = 1,
          name = "timestamp",
          offset = 0,
          type = "u32",
          unit = "ms",
          what = "ms since HORUS start",
        },
        { bytes = 2, count = 1, name = "identifier", offset = 4, one_of = "identifiers", type = "u16" },
        { bytes = 2, count = 1, name = "status", offset = 6, status_word = "reported", type = "u16" },
        {
          bytes = 8,
          count = 1,
          name = "latitude",
          offset = 8,
          type = "f64",
          unit = "degrees",
          what = "degrees",
        },
        {
          bytes = 8,
          count = 1,
          name = "longitude",
          offset = 16,
          type = "f64",
          unit = "degrees",
          what = "degrees",
        },
        {
          bytes = 4,
          count = 1,
          covers = { 8, 24 },
          crc = "position",
          name = "position_crc",
          offset = 24,
          type = "crc",
          what = "over latitude and longitude",
        },
        { bytes = 8, count = 1, name = "altitude", offset = 28, type = "f64", unit = "m", what = "m" },
        { bytes = 4, count = 1, name = "pitch", offset = 36, type = "f32", unit = "rad", what = "rad" },
        { bytes = 4, count = 1, name = "yaw", offset = 40, type = "f32", unit = "rad", what = "rad" },
        { bytes = 4, count = 1, name = "roll", offset = 44, type = "f32", unit = "rad", what = "rad" },
        {
          bytes = 12,
          count = 3,
          name = "acceleration",
          offset = 48,
          type = "f32",
          unit = "m/s2",
          what = "m/s2",
        },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 60 },
          crc = "frame",
          name = "crc",
          offset = 60,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = { 18432 },
      name = "reported",
      title = "Reported-Position",
    },
    {
      bytes = 60,
      fields = {
        {
          bytes = 4,
          count = 1,
          name = "timestamp",
          offset = 0,
          type = "u32",
          unit = "ms",
          what = "ms since HORUS start",
        },
        { bytes = 2, count = 1, name = "identifier", offset = 4, one_of = "identifiers", type = "u16" },
        { bytes = 2, count = 1, name = "status", offset = 6, status_word = "gps", type = "u16" },
        {
          bytes = 8,
          count = 1,
          name = "latitude",
          offset = 8,
          type = "f64",
          unit = "degrees",
          what = "degrees",
        },
        {
          bytes = 8,
          count = 1,
          name = "longitude",
          offset = 16,
          type = "f64",
          unit = "degrees",
          what = "degrees",
        },
        { bytes = 8, count = 1, name = "altitude", offset = 24, type = "f64", unit = "m", what = "m" },
        { bytes = 4, count = 1, name = "pitch", offset = 32, type = "f32", unit = "rad", what = "rad" },
        { bytes = 4, count = 1, name = "yaw", offset = 36, type = "f32", unit = "rad", what = "rad" },
        { bytes = 4, count = 1, name = "roll", offset = 40, type = "f32", unit = "rad", what = "rad" },
        {
          bytes = 12,
          count = 3,
          name = "acceleration",
          offset = 44,
          type = "f32",
          unit = "m/s2",
          what = "m/s2",
        },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 56 },
          crc = "frame",
          name = "crc",
          offset = 56,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = { 18433, 18434, 18435, 18436, 18437 },
      name = "gps",
      title = "GPS1 to GPS5",
    },
    {
      bytes = 64,
      fields = {
        {
          bytes = 4,
          count = 1,
          name = "timestamp",
          offset = 0,
          type = "u32",
          unit = "ms",
          what = "ms since DPR start",
        },
        { bytes = 2, count = 1, name = "identifier", offset = 4, one_of = "identifiers", type = "u16" },
        { bytes = 2, count = 1, name = "status", offset = 6, status_word = "port", type = "u16" },
        {
          bytes = 4,
          count = 1,
          name = "uplinks_accepted",
          offset = 8,
          type = "u32",
          what = "uplinks stored",
        },
        {
          bytes = 4,
          count = 1,
          name = "commands_carried_out",
          offset = 12,
          type = "u32",
          what = "commands carried out",
        },
        {
          bytes = 4,
          count = 1,
          name = "last_command_timestamp",
          offset = 16,
          type = "u32",
          unit = "ms",
          what = "ms, timestamp of the last command",
        },
        { bytes = 4, count = 1, name = "last_command", offset = 20, type = "u32", what = "its word" },
        {
          bytes = 2,
          count = 1,
          name = "base_station_age_ms",
          offset = 24,
          type = "u16",
          unit = "ms",
          what = "ms since the base station's uplink",
        },
        {
          bytes = 2,
          count = 1,
          name = "flight_controller_age_ms",
          offset = 26,
          type = "u16",
          unit = "ms",
          what = "ms since the flight controller's uplink",
        },
        { bytes = 20, count = 10, counts = "violations", name = "violations", offset = 28, type = "u16" },
        {
          bytes = 2,
          count = 1,
          name = "integrity_faults",
          offset = 48,
          type = "u16",
          what = "faults found in images",
        },
        {
          bytes = 2,
          count = 1,
          name = "flash_passes",
          offset = 50,
          type = "u16",
          what = "passes over the flash",
        },
        { bytes = 2, count = 1, name = "stuck_bits", offset = 52, type = "u16", what = "stuck bits found" },
        {
          bytes = 2,
          count = 1,
          name = "buffers_out_of_use",
          offset = 54,
          type = "u16",
          what = "buffers out of use",
        },
        {
          bytes = 4,
          count = 1,
          name = "last_stop",
          offset = 56,
          type = "u32",
          what = "reason of the last safe state",
        },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 60 },
          crc = "frame",
          name = "crc",
          offset = 60,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = { 17409 },
      name = "port_status",
      title = "Port-Status",
    },
    {
      bytes = 64,
      fields = {
        {
          bytes = 4,
          count = 1,
          name = "timestamp",
          offset = 0,
          type = "u32",
          unit = "ms",
          what = "ms on the writer's clock",
        },
        { bytes = 2, count = 1, name = "identifier", offset = 4, one_of = "identifiers", type = "u16" },
        {
          bytes = 2,
          count = 1,
          name = "status",
          offset = 6,
          type = "u16",
          what = "as writer and reader agree",
        },
        { bytes = 52, count = 52, name = "payload", offset = 8, type = "bytes", what = "the writer's" },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 60 },
          crc = "frame",
          name = "crc",
          offset = 60,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = { 16896, 17152 },
      name = "uplink",
      title = "Uplink",
    },
    {
      bytes = 64,
      fields = {
        {
          bytes = 4,
          count = 1,
          name = "timestamp",
          offset = 0,
          type = "u32",
          unit = "ms",
          what = "ms on the flight controller's clock",
        },
        { bytes = 2, count = 1, name = "identifier", offset = 4, one_of = "identifiers", type = "u16" },
        { bytes = 2, count = 1, name = "status", offset = 6, type = "u16", what = "not evaluated" },
        { bytes = 4, count = 1, name = "word", offset = 8, one_of = "commands", type = "u32" },
        { bytes = 48, count = 48, name = "reserved", offset = 12, type = "zero", what = "zero" },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 60 },
          crc = "frame",
          name = "crc",
          offset = 60,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = { 17153 },
      name = "command",
      title = "Command",
    },
    {
      bytes = 64,
      fields = {
        {
          bytes = 4,
          count = 1,
          name = "timestamp",
          offset = 0,
          type = "u32",
          unit = "ms",
          what = "ms since the hold's start",
        },
        { bytes = 2, count = 1, name = "identifier", offset = 4, one_of = "identifiers", type = "u16" },
        { bytes = 2, count = 1, name = "status", offset = 6, status_word = "hold_status", type = "u16" },
        {
          bytes = 4,
          count = 1,
          name = "temperature",
          offset = 8,
          type = "f32",
          unit = "degrees Celsius",
          what = "degrees Celsius",
        },
        {
          bytes = 4,
          count = 1,
          name = "humidity",
          offset = 12,
          type = "f32",
          unit = "%",
          what = "relative, %",
        },
        {
          bytes = 4,
          count = 1,
          name = "set_point",
          offset = 16,
          type = "f32",
          unit = "degrees Celsius",
          what = "degrees Celsius",
        },
        {
          bytes = 12,
          count = 3,
          name = "vibration",
          offset = 20,
          type = "f32",
          unit = "m/s2",
          what = "m/s2, RMS over the last second",
        },
        {
          bytes = 4,
          count = 1,
          name = "greatest_shock",
          offset = 32,
          type = "f32",
          unit = "m/s2",
          what = "m/s2, since the start or since it was cleared",
        },
        { bytes = 4, count = 1, name = "supply", offset = 36, type = "f32", unit = "V", what = "V" },
        {
          bytes = 4,
          count = 1,
          name = "output",
          offset = 40,
          type = "f32",
          what = "-1 (cooling) to 1 (heating)",
        },
        {
          bytes = 8,
          count = 4,
          name = "acknowledged",
          offset = 44,
          type = "u16",
          what = "u16 number, u16 outcome: base station's, own",
        },
        {
          bytes = 4,
          count = 1,
          name = "seconds",
          offset = 52,
          type = "u32",
          unit = "s",
          what = "s since the hold's start",
        },
        { bytes = 4, count = 4, name = "reserved", offset = 56, type = "zero", what = "zero" },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 60 },
          crc = "frame",
          name = "crc",
          offset = 60,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = { 16640 },
      name = "hold_status",
      title = "Hold-Status",
    },
    {
      bytes = 8,
      fields = {
        {
          bytes = 2,
          count = 1,
          name = "offset",
          offset = 0,
          type = "u16",
          what = "the first byte of the map to show",
        },
        { bytes = 2, count = 1, name = "length", offset = 2, type = "u16", unit = "bytes", what = "bytes" },
        {
          bytes = 4,
          count = 1,
          covers = { 0, 4 },
          crc = "frame",
          name = "crc",
          offset = 4,
          type = "crc",
          what = "over all before",
        },
      },
      identifiers = {  },
      name = "request",
      title = "Request of a window",
    },
  },
  solution_age = { never = 63, oldest_ms = 1550, step_ms = 25 },
  status_words = {
    {
      bits = {
        {
          is_code = true,
          mask = "0x0007",
          name = "agreeing",
          shift = 0,
          what = "receivers that agree, 0 to 7",
        },
        {
          is_code = false,
          mask = "0x0008",
          name = "position_valid",
          shift = 3,
          what = "latitude and longitude are valid",
        },
        {
          is_code = false,
          mask = "0x0010",
          name = "attitude_valid",
          shift = 4,
          what = "pitch, yaw and roll are valid",
        },
        {
          is_code = false,
          mask = "0x0020",
          name = "acceleration_valid",
          shift = 5,
          what = "the accelerations are valid",
        },
        {
          is_code = false,
          mask = "0x0040",
          name = "degraded",
          shift = 6,
          what = "fewer receivers agree than configured, or on no altitude",
        },
        {
          is_code = false,
          mask = "0x0080",
          name = "without_crystal",
          shift = 7,
          what = "HORUS runs without its crystal",
        },
        {
          enumeration = "state",
          is_code = true,
          mask = "0x0F00",
          name = "state",
          shift = 8,
          what = "what HORUS is doing",
        },
        {
          is_code = false,
          mask = "0x1000",
          name = "memory_fault",
          shift = 12,
          what = "HORUS has found a fault of its memory",
        },
        {
          enumeration = "reset",
          is_code = true,
          mask = "0xE000",
          name = "reset",
          shift = 13,
          what = "why HORUS last started",
        },
      },
      name = "reported",
      title = "Reported-Position",
      used = "0xFFFF",
    },
    {
      bits = {
        {
          enumeration = "fix",
          is_code = true,
          mask = "0x000F",
          name = "fix",
          shift = 0,
          what = "UBX fixType",
        },
        {
          is_code = false,
          mask = "0x0010",
          name = "position_valid",
          shift = 4,
          what = "latitude and longitude are valid",
        },
        {
          is_code = false,
          mask = "0x0020",
          name = "attitude_valid",
          shift = 5,
          what = "pitch, yaw and roll are valid",
        },
        {
          is_code = false,
          mask = "0x0040",
          name = "acceleration_valid",
          shift = 6,
          what = "the accelerations are valid",
        },
        { is_code = false, mask = "0x0080", name = "heard", shift = 7, what = "heard in the last 250 ms" },
        {
          is_code = false,
          mask = "0x0100",
          name = "stale",
          shift = 8,
          what = "the solution is older than its period allows",
        },
        {
          is_code = false,
          mask = "0x0200",
          name = "excluded",
          shift = 9,
          what = "the voter excluded this receiver",
        },
        {
          is_code = true,
          mask = "0xFC00",
          name = "age",
          shift = 10,
          unit = "solution_age",
          what = "age of its solution",
        },
      },
      name = "gps",
      title = "GPS1 to GPS5",
      used = "0xFFFF",
    },
    {
      bits = {
        {
          is_code = false,
          mask = "0x0001",
          name = "up",
          shift = 0,
          what = "frames arrive within their deadline",
        },
        {
          is_code = false,
          mask = "0x0002",
          name = "all_accepted",
          shift = 1,
          what = "every object of the last cycle was accepted",
        },
        {
          is_code = false,
          mask = "0x0004",
          name = "horus_frozen",
          shift = 2,
          what = "HORUS repeats its timestamp",
        },
        {
          is_code = false,
          mask = "0x0008",
          name = "horus_restarted",
          shift = 3,
          what = "HORUS started again",
        },
        {
          is_code = false,
          mask = "0x0010",
          name = "ram_fault",
          shift = 4,
          what = "a scrub found a RAM fault",
        },
        {
          is_code = false,
          mask = "0x0020",
          name = "front_end_fault",
          shift = 5,
          what = "the RFID front end has a fault",
        },
        {
          is_code = false,
          mask = "0x0040",
          name = "unasked_reset",
          shift = 6,
          what = "nobody asked for the DPR's last reset",
        },
        {
          is_code = false,
          mask = "0x0080",
          name = "uplink_rejected",
          shift = 7,
          what = "the last uplink was rejected",
        },
        {
          is_code = false,
          mask = "0x0100",
          name = "out_of_sequence",
          shift = 8,
          what = "nothing is shown until it is found again",
        },
        {
          is_code = false,
          mask = "0x0200",
          name = "clock_implausible",
          shift = 9,
          what = "HORUS's clock is off by > 2 %",
        },
        {
          is_code = false,
          mask = "0x0400",
          name = "flash_fault",
          shift = 10,
          what = "the DPR's program memory is damaged",
        },
        {
          enumeration = "reset",
          is_code = true,
          mask = "0x7000",
          name = "reset",
          shift = 12,
          what = "why the DPR last started",
        },
        {
          is_code = false,
          mask = "0x8000",
          name = "no_field",
          shift = 15,
          what = "the front end works and senses no field of the sender",
        },
      },
      name = "link",
      title = "Link-Status",
      used = "0xF7FF",
    },
    {
      bits = {
        {
          is_code = false,
          mask = "0x0001",
          name = "base_station_fresh",
          shift = 0,
          what = "its uplink is shown",
        },
        {
          is_code = false,
          mask = "0x0002",
          name = "flight_controller_fresh",
          shift = 1,
          what = "its uplink is shown",
        },
        {
          is_code = false,
          mask = "0x0004",
          name = "last_refused",
          shift = 2,
          what = "the last uplink or command was refused",
        },
        {
          is_code = false,
          mask = "0x0008",
          name = "self_test_running",
          shift = 3,
          what = "a self-test is under way",
        },
        {
          is_code = false,
          mask = "0x0010",
          name = "self_test_passed",
          shift = 4,
          what = "the last one found nothing",
        },
        {
          is_code = false,
          mask = "0x0020",
          name = "self_test_failed",
          shift = 5,
          what = "the last one found a fault",
        },
        {
          is_code = false,
          mask = "0x0040",
          name = "buffers_out_of_use",
          shift = 6,
          what = "a buffer or image is out of use",
        },
        {
          is_code = false,
          mask = "0x0080",
          name = "hold_heard",
          shift = 7,
          what = "a frame of the hold came in the last 300 ms",
        },
        {
          is_code = false,
          mask = "0x0100",
          name = "hold_accepted",
          shift = 8,
          what = "the last one was accepted",
        },
        {
          is_code = true,
          mask = "0x1E00",
          name = "hold_accepted_count",
          shift = 9,
          what = "objects of the hold accepted, mod 16",
        },
        {
          is_code = true,
          mask = "0xE000",
          name = "hold_rejected_count",
          shift = 13,
          what = "frames of the hold rejected, mod 8",
        },
      },
      name = "port",
      title = "Port-Status",
      used = "0xFFFF",
    },
    {
      bits = {
        { is_code = false, mask = "0x0001", name = "values_valid", shift = 0, what = "the values are valid" },
        {
          is_code = false,
          mask = "0x0002",
          name = "within_limits",
          shift = 1,
          what = "the values are within the hold's limits",
        },
        { is_code = false, mask = "0x0004", name = "locked", shift = 2, what = "locked" },
        { is_code = false, mask = "0x0008", name = "sensor_fault", shift = 3, what = "a sensor has a fault" },
        {
          is_code = false,
          mask = "0x0010",
          name = "memory_fault",
          shift = 4,
          what = "the hold has found a fault of its memory",
        },
        {
          is_code = false,
          mask = "0x0020",
          name = "safe_state",
          shift = 5,
          what = "the output is off, the lock stays as it is",
        },
        {
          enumeration = "reset",
          is_code = true,
          mask = "0x01C0",
          name = "reset",
          shift = 6,
          what = "why the hold last started",
        },
      },
      name = "hold_status",
      title = "Hold-Status",
      used = "0x01FF",
    },
  },
  violations = {
    { name = "REQUEST_DAMAGED", value = 0, what = "a request whose CRC is wrong" },
    { name = "WINDOW_OUTSIDE", value = 1, what = "a window that is empty or not in the map" },
    { name = "TOO_SHORT", value = 2, what = "a request or an object that ended in the middle" },
    { name = "UPLINK_DAMAGED", value = 3, what = "an object whose CRC is wrong" },
    { name = "UPLINK_IDENTIFIER", value = 4, what = "an object that nobody may write" },
    { name = "UPLINK_NOT_NEWER", value = 5, what = "an uplink or a command that is repeated or old" },
    { name = "COMMAND_UNKNOWN", value = 6, what = "an unknown command, or reserved bytes that are not zero" },
    { name = "COMMAND_BUSY", value = 7, what = "a self-test while one is under way" },
    { name = "TOO_MANY", value = 8, what = "more transactions or objects than the DPR grants" },
    { name = "TOO_LONG", value = 9, what = "something was driven behind the object" },
  },
}

local horus = Proto("horus", "HORUS link")

-- Lua 5.2 has bit32, later versions have operators that 5.2 cannot parse.
local xor = bit32 and bit32.bxor or load("return function(a, b) return a ~ b end")()

local function crc32(algorithm)
  local polynomial, init, xorout = tonumber(algorithm.polynomial), tonumber(algorithm.init), tonumber(algorithm.xorout)
  local steps = {}
  for byte = 0, 255 do
    local register = byte * 2 ^ 24
    for _ = 1, 8 do
      local carry = register >= 2 ^ 31
      register = register * 2 % 2 ^ 32
      if carry then register = xor(math.floor(register), polynomial) end
    end
    steps[byte] = math.floor(register)
  end
  return function(data)
    local register = init
    for at = 1, #data do
      local top = math.floor(register / 2 ^ 24)
      register = xor(math.floor(register % 2 ^ 24 * 2 ^ 8), steps[xor(top, data:byte(at))])
    end
    return xor(register, xorout)
  end
end

local crcs = { frame = crc32(layout.crcs.frame), position = crc32(layout.crcs.position) }

-- CRC-16/MCRF4XX, the checksum of MAVLink.
local function checksum(data)
  local register = 0xFFFF
  for at = 1, #data do
    register = xor(register, data:byte(at))
    for _ = 1, 8 do
      local carry = register % 2 == 1
      register = math.floor(register / 2)
      if carry then register = xor(register, 0x8408) end
    end
  end
  return register
end

local function names(list, label)
  local values = {}
  for _, item in ipairs(list) do values[item.value] = item[label or "name"] end
  return values
end

local known = { identifiers = names(layout.identifiers), commands = names(layout.commands, "what") }
for _, enumeration in ipairs(layout.enumerations) do known[enumeration.name] = names(enumeration.values, "what") end

local RIGHT = { [0] = "wrong", [1] = "right" }
local all = {}

local function field(kind, ...)
  all[#all + 1] = ProtoField[kind](...)
  return all[#all]
end

local function expert_info(name, text, group, severity)
  return ProtoExpert.new("horus." .. name, text, expert.group[group], expert.severity[severity])
end

local wrong_crc = expert_info("crc_wrong", "A CRC is wrong", "CHECKSUM", "ERROR")
local other_object = expert_info("other_object", "Another object belongs here", "PROTOCOL", "ERROR")
local vacant = expert_info("vacant", "The place is vacant", "SEQUENCE", "NOTE")
local no_objects = expert_info("no_objects", "No objects have this type and length", "PROTOCOL", "WARN")
local cut_off = expert_info("cut_off", "There is no whole frame of MAVLink 2", "PROTOCOL", "WARN")

-- The elements of a field that has more than one.
local function elements(item)
  if item.counts then return layout[item.counts] end
  if item.name == "acknowledged" then
    return {
      { name = "base_station.number", what = "of the base station's last command" },
      { name = "base_station.outcome", what = "its outcome", values = known.outcome },
      { name = "flight_controller.number", what = "of the flight controller's last command" },
      { name = "flight_controller.outcome", what = "its outcome", values = known.outcome },
    }
  end
  if item.count == 3 then
    return { { name = "x", what = item.what }, { name = "y", what = item.what }, { name = "z", what = item.what } }
  end
end

local KINDS = { u16 = "uint16", u32 = "uint32", crc = "uint32", f32 = "float", f64 = "double" }

-- Makes the field of one value.
local function value_field(abbreviation, name, kind, what, values)
  if kind == "bytes" or kind == "zero" then return field("bytes", abbreviation, name, base.NONE, what) end
  if kind == "f32" or kind == "f64" then return field(KINDS[kind], abbreviation, name, what) end
  local hexadecimal = kind == "crc" or name == "status" or name == "identifier"
  return field(KINDS[kind], abbreviation, name, hexadecimal and base.HEX or base.DEC, values, nil, what)
end

-- Makes the fields of a status word's bits.
local function bit_fields(prefix, word)
  local made = {}
  for index, bits in ipairs(word and word.bits or {}) do
    local abbreviation, mask, what = prefix .. bits.name, tonumber(bits.mask), bits.what
    if not bits.is_code then
      made[index] = field("bool", abbreviation, bits.name, 16, nil, mask, what)
    elseif bits.unit then
      what = what .. ", in steps of " .. layout[bits.unit].step_ms .. " ms; " .. layout[bits.unit].never .. ": never"
      made[index] = field("uint16", abbreviation, bits.name, base.DEC, nil, mask, what)
    else
      made[index] = field("uint16", abbreviation, bits.name, base.DEC, known[bits.enumeration], mask, what)
    end
    made[index] = { field = made[index], what = what }
  end
  return made
end

local words, objects = {}, {}
for _, word in ipairs(layout.status_words) do words[word.name] = word end

-- The rows that show an object, in the order of its bytes.
for _, object in ipairs(layout.objects) do
  local prefix, rows = "horus." .. object.name .. ".", {}
  for _, item in ipairs(object.fields) do
    local parts = elements(item)
    local size = math.floor(item.bytes / (parts and #parts or 1))
    for index, part in ipairs(parts or { { what = item.what, values = known[item.one_of] } }) do
      local name = parts and item.name .. "." .. part.name:lower() or item.name
      local row = { at = item.offset + (index - 1) * size, size = size, what = part.what, covers = item.covers }
      row.field = value_field(prefix .. name, name, item.type, part.what, part.values)
      if item.crc then
        row.crc = crcs[item.crc]
        row.verdict = field("uint8", prefix .. name .. ".status", name .. " is", base.DEC, RIGHT)
      end
      row.bits = bit_fields(prefix .. name .. ".", words[item.status_word])
      rows[#rows + 1] = row
    end
  end
  objects[object.name] = { title = object.title, rows = rows, bytes = object.bytes }
end

-- The objects that a base station knows, in the order of the map, and the lengths of datagrams: number of objects, and
-- the first of them.
local places, first_of, payload_types, lengths = {}, {}, {}, {}
for _, map in ipairs(layout.maps) do
  if map.hold and map.receivers == 5 then
    for _, place in ipairs(map.places) do
      local name = known.identifiers[place.identifier]
      if name ~= "UPLINK_FLIGHT_CONTROLLER" then
        places[#places + 1] = { object = objects[place.object], identifier = place.identifier, name = name }
        first_of[0x8000 + place.identifier] = #places
        payload_types[0x8000 + place.identifier] = "from " .. name .. " on"
      end
    end
  end
  lengths[map.image_bytes] = { first = 1, count = 2 + map.receivers }
  lengths[map.profile_bytes] = { first = 2, count = 1 + map.receivers }
end

-- How many objects from number `first` on fill `length` bytes; nil if none do.
local function count_of(first, length)
  for index = first, #places do
    length = length - places[index].object.bytes
    if length <= 0 then return length == 0 and index - first + 1 or nil end
  end
end

local function draw(tree, row, tvb)
  -- Only CRCs have their most significant byte first.
  local drawn = (row.crc and tree.add or tree.add_le)(tree, row.field, tvb(row.at, row.size))
  if row.what then drawn:append_text(" (" .. row.what .. ")") end
  for _, bits in ipairs(row.bits) do
    drawn:add_le(bits.field, tvb(row.at, row.size)):append_text(" (" .. bits.what .. ")")
  end
  if not row.crc then return true end
  local from, to = row.covers[1], row.covers[2]
  local computed = row.crc(tvb(from, to - from):raw())
  local right = computed == tvb(row.at, row.size):uint()
  drawn:append_text(right and " [right]" or (" [wrong, should be 0x%08x]"):format(computed))
  drawn:add(row.verdict, tvb(row.at, row.size), right and 1 or 0):set_generated()
  if not right then drawn:add_proto_expert_info(wrong_crc) end
  return right
end

-- Shows the objects that fill these bytes; returns what the column of information says of them.
local function show_objects(tvb, tree, first, count)
  local said, at = {}, 0
  for index = first, first + count - 1 do
    local place = places[index]
    local range = tvb(at, place.object.bytes)
    local bytes = range:raw()
    local text = place.name
    local drawn = tree:add(horus, range, ("%s, %d bytes"):format(place.name, place.object.bytes))
    if bytes == ("\0"):rep(#bytes) or bytes == ("\255"):rep(#bytes) then
      drawn:append_text(", vacant")
      drawn:add_proto_expert_info(vacant)
      text = text .. " vacant"
    else
      local right = true
      for _, row in ipairs(place.object.rows) do
        if not draw(drawn, row, range:tvb()) then right = false end
      end
      if not right then
        drawn:append_text(", CRC wrong")
        text = text .. " CRC wrong"
      end
      if range(4, 2):le_uint() ~= place.identifier then
        drawn:add_proto_expert_info(other_object)
        text = text .. " of another identifier"
      end
    end
    said[#said + 1] = text
    at = at + place.object.bytes
  end
  return table.concat(said, ", ")
end

-- MAVLink 2: https://mavlink.io/en/guide/serialization.html
local HEAD, TUNNEL, LONGEST, SIGNATURE = 10, 385, 128, 13
-- What stands in the checksum for a message's fields, of the messages that a base station sends or takes.
local EXTRA = { [0] = 50, [TUNNEL] = 147 }
local mavlink = {
  length = field("uint8", "horus.mavlink.length", "length", base.DEC, nil, nil, "bytes of the message without frame"),
  signed = field("bool", "horus.mavlink.signed", "signed", 8, nil, 0x01, "a signature follows the checksum"),
  sequence = field("uint8", "horus.mavlink.sequence", "sequence", base.DEC, nil, nil, "counts the sender's messages"),
  system = field("uint8", "horus.mavlink.system", "system", base.DEC, nil, nil, "system that sent it"),
  component = field("uint8", "horus.mavlink.component", "component", base.DEC, nil, nil, "component that sent it"),
  message = field("uint24", "horus.mavlink.message", "message", base.DEC,
    { [0] = "HEARTBEAT", [TUNNEL] = "TUNNEL" }, nil, "kind of the message"),
  checksum = field("uint16", "horus.mavlink.checksum", "checksum", base.HEX, nil, nil, "over all after the first byte"),
  verdict = field("uint8", "horus.mavlink.checksum.status", "checksum is", base.DEC, RIGHT),
  link = field("uint8", "horus.mavlink.signature.link", "link", base.DEC, nil, nil, "line that it was signed for"),
  time = field("uint64", "horus.mavlink.signature.timestamp", "timestamp", base.DEC, nil, nil,
    "10 us since 2015-01-01"),
  signature = field("bytes", "horus.mavlink.signature", "signature", base.NONE, "not verified here"),
  other = field("bytes", "horus.mavlink.other", "bytes of another message", base.NONE),
}
local tunnel = {
  kind = field("uint16", "horus.tunnel.payload_type", "payload_type", base.HEX, payload_types, nil,
    "identifier of the first object, with bit 15 set"),
  system = field("uint8", "horus.tunnel.target_system", "target_system", base.DEC, nil, nil, "0: all"),
  component = field("uint8", "horus.tunnel.target_component", "target_component", base.DEC, nil, nil, "0: all"),
  length = field("uint8", "horus.tunnel.payload_length", "payload_length", base.DEC, nil, nil, "bytes of objects"),
}

-- The length of the frame at this place; nil if there is no whole one.
local function frame_length(tvb, at)
  if tvb:len() < at + HEAD + 2 or tvb(at, 1):uint() ~= 0xFD then return nil end
  local length = HEAD + tvb(at + 1, 1):uint() + 2 + (tvb(at + 2, 1):uint() % 2 == 1 and SIGNATURE or 0)
  return tvb:len() >= at + length and length or nil
end

local function show_tunnel(tvb, tree)
  tree:add_le(tunnel.kind, tvb(0, 2))
  tree:add(tunnel.system, tvb(2, 1))
  tree:add(tunnel.component, tvb(3, 1))
  tree:add(tunnel.length, tvb(4, 1))
  local first, length = first_of[tvb(0, 2):le_uint()], tvb(4, 1):uint()
  local count = first and length <= LONGEST and count_of(first, length)
  if count then return show_objects(tvb(5, length):tvb(), tree, first, count) end
  tree:add_proto_expert_info(no_objects)
  return "no objects"
end

local function show_frame(tvb, root)
  local length, message = tvb(1, 1):uint(), tvb(7, 3):le_uint()
  local system, component = tvb(5, 1):uint(), tvb(6, 1):uint()
  local tree = root:add(horus, tvb(), ("MAVLink 2, message %d of system %d"):format(message, system))
  tree:add(mavlink.length, tvb(1, 1))
  tree:add(mavlink.signed, tvb(2, 1))
  tree:add(mavlink.sequence, tvb(4, 1))
  tree:add(mavlink.system, tvb(5, 1))
  tree:add(mavlink.component, tvb(6, 1))
  tree:add_le(mavlink.message, tvb(7, 3))
  local end_of_message = HEAD + length
  local text = message == 0 and "HEARTBEAT" or "message " .. message
  if message == TUNNEL then
    -- MAVLink 2 leaves zeros at the end of a message out.
    local body = tvb(HEAD, length):bytes()
    body:set_size(5 + LONGEST)
    local whole = length < 5 + LONGEST and body:tvb("TUNNEL with its zeros") or tvb(HEAD, length):tvb()
    text = show_tunnel(whole, tree)
  elseif length > 0 then
    tree:add(mavlink.other, tvb(HEAD, length))
  end
  local drawn = tree:add_le(mavlink.checksum, tvb(end_of_message, 2))
  local extra = EXTRA[message]
  if extra then
    local computed = checksum(tvb(1, end_of_message - 1):raw() .. string.char(extra))
    local right = computed == tvb(end_of_message, 2):le_uint()
    drawn:append_text(right and " [right]" or (" [wrong, should be 0x%04x]"):format(computed))
    drawn:add(mavlink.verdict, tvb(end_of_message, 2), right and 1 or 0):set_generated()
    if not right then
      drawn:add_proto_expert_info(wrong_crc)
      text = text .. ", checksum wrong"
    end
  else
    drawn:append_text(" [not verified: the message is not known here]")
  end
  if tvb:len() > end_of_message + 2 then
    local signature = tree:add(mavlink.signature, tvb(end_of_message + 9, 6))
    signature:append_text(" (not verified here)")
    signature:add(mavlink.link, tvb(end_of_message + 2, 1))
    signature:add_le(mavlink.time, tvb(end_of_message + 3, 6)):append_text(" (10 us since 2015-01-01)")
  end
  return ("%d/%d: %s"):format(system, component, text)
end

local function show_mavlink(tvb, tree)
  local said, at = {}, 0
  while at < tvb:len() do
    local length = frame_length(tvb, at)
    if not length then
      tree:add_proto_expert_info(cut_off)
      said[#said + 1] = "no whole frame"
      break
    end
    said[#said + 1] = show_frame(tvb(at, length):tvb(), tree)
    at = at + length
  end
  return table.concat(said, "; ")
end

local function has_tunnel(tvb)
  local at = 0
  local length = frame_length(tvb, at)
  while length do
    local is_tunnel = tvb(at + 7, 3):le_uint() == TUNNEL and length >= HEAD + 2 + 2
    if is_tunnel and first_of[tvb(at + HEAD, 2):le_uint()] then return true end
    at = at + length
    length = frame_length(tvb, at)
  end
  return false
end

local function has_identifier(tvb)
  local run, at = lengths[tvb:len()], 0
  if not run then return false end
  for index = run.first, run.first + run.count - 1 do
    if tvb(at + 4, 2):le_uint() == places[index].identifier then return true end
    at = at + places[index].object.bytes
  end
  return false
end

function horus.dissector(tvb, pinfo, root)
  local run = lengths[tvb:len()]
  local is_mavlink = frame_length(tvb, 0) ~= nil
  if not run and not is_mavlink then return 0 end
  pinfo.cols.protocol = "HORUS"
  local tree = root:add(horus, tvb())
  local text = is_mavlink and show_mavlink(tvb, tree) or show_objects(tvb, tree, run.first, run.count)
  pinfo.cols.info = text
  return tvb:len()
end

horus.fields = all
horus.experts = { wrong_crc, other_object, vacant, no_objects, cut_off }
horus:register_heuristic("udp", function(tvb, pinfo, root)
  if not has_tunnel(tvb) and not has_identifier(tvb) then return false end
  horus.dissector(tvb, pinfo, root)
  -- A later datagram of this line whose objects are all damaged is shown as well.
  pinfo.conversation = horus
  return true
end)
DissectorTable.get("udp.port"):add_for_decode_as(horus)
