-- SPDX-License-Identifier: MIT OR Apache-2.0
-- A dissector for Wireshark: the objects of the HORUS link in MAVLink 2 (TUNNEL) and in plain datagrams, over UDP.
--
-- Generated from the Rust crate `profile` by `cargo xtask layout`. Do not edit.
--
-- Wireshark finds it in its folder of plugins (Help, About, Folders). tshark takes it with
-- `tshark -X lua_script:horus.lua -r capture.pcap -V`. It recognises objects on any port of UDP. A line on which every
-- object is damaged is not recognised: say `-d udp.port==14550,horus`, or "Decode As" in Wireshark.

local layout = @layout@

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
