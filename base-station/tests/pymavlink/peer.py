"""The other end of the tests in main.rs: MAVLink by pymavlink.

Reads one request a line (JSON) from standard input and answers each with one line. Bytes are hexadecimal digits.
"""

import json
import os
import sys

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "common"

from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import common  # noqa: E402


def codec(request, system=42):
    """A codec, with the request's key if there is one."""
    mav = common.MAVLink(None, srcSystem=system, srcComponent=1)
    mav.robust_parsing = True
    if request.get("key"):
        mav.signing.secret_key = bytes.fromhex(request["key"])
        mav.signing.link_id = 5
        mav.signing.timestamp = request["timestamp"]
        mav.signing.sign_outgoing = True
        mav.signing.allow_unsigned_callback = lambda mav, message: False
    return mav


def told(message):
    """A message as JSON; None for bytes that are no message of this dialect."""
    if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN_"):
        return None
    fields = {name: getattr(message, name) for name in message.get_fieldnames()}
    return {
        "name": message.get_type(),
        "system": message.get_srcSystem(),
        "component": message.get_srcComponent(),
        "sequence": message.get_seq(),
        "signed": message.get_signed(),
        "version": 2 if message.get_msgbuf()[0] == 0xFD else 1,
        "fields": fields,
    }


def parse(request):
    """The messages in each of the pieces, which are one stream or separate datagrams."""
    mav = codec(request)
    answer = []
    for piece in request["pieces"]:
        # An incomplete message at the end of a datagram does not continue in the next one.
        mav.buf, mav.buf_index = bytearray(), 0
        found = mav.parse_buffer(bytes.fromhex(piece)) or []
        answer.append([message for message in map(told, found) if message])
    return answer


def tunnel(mav, payload_type, payload):
    return mav.tunnel_encode(0, 0, payload_type, len(payload), list(payload.ljust(128, b"\0")))


def others(mav):
    """Other messages on the link of a flight controller."""
    return [
        mav.heartbeat_encode(2, 12, 81, 0, 4),
        mav.sys_status_encode(7, 7, 7, 500, 11000, -1, 50, 0, 0, 0, 0, 0, 0),
        mav.global_position_int_encode(70_000, 474979000, 87289000, 0, 0, 0, 0, 0, 65535),
        mav.statustext_encode(6, b"somebody else's words"),
        # TUNNELs of others: with an unknown, a registered, and another private type.
        tunnel(mav, 0, b"0"),
        tunnel(mav, 201, bytes(range(96))),
        tunnel(mav, 0x9000, bytes(128)),
    ]


def send(request):
    """The given objects among other messages, each in its wire format."""
    mav = codec(request)
    answer = []
    for given in request["objects"]:
        for message in others(mav):
            answer.append({"name": message.get_type(), "bytes": message.pack(mav).hex()})
            mav.seq = (mav.seq + 1) % 256
        message = tunnel(mav, given["type"], bytes.fromhex(given["bytes"]))
        answer.append({"name": "ours", "bytes": message.pack(mav).hex()})
        mav.seq = (mav.seq + 1) % 256
        # Flight controllers of the last decade send MAVLink 1.
        old = mav.heartbeat_encode(2, 12, 81, 0, 4).pack(mav, force_mavlink1=True)
        answer.append({"name": "MAVLink 1", "bytes": old.hex()})
    return answer


sockets = {}


def listen(request):
    """Opens a UDP port as a ground station does, and returns it."""
    link = mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="common")
    sockets["in"] = link
    return link.port.getsockname()[1]


def hear(request):
    """The first `count` messages that arrive there, in order."""
    heard = []
    while len(heard) < request["count"]:
        message = sockets["in"].recv_match(blocking=True, timeout=20)
        if message is None:
            break
        heard.append(told(message))
    return [message for message in heard if message]


def forward(request):
    """Sends objects to a UDP port as a companion computer does."""
    link = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{request['port']}", dialect="common", source_system=42, source_component=1
    )
    for given in request["objects"]:
        payload = bytes.fromhex(given["bytes"]).ljust(128, b"\0")
        link.mav.heartbeat_send(2, 12, 81, 0, 4)
        link.mav.tunnel_send(0, 0, given["type"], len(given["bytes"]) // 2, list(payload))
    return len(request["objects"])


def autopilot(request):
    """Opens an autopilot's UDP port and returns it. Like ArduPilot it only sends to known peers."""
    link = mavutil.mavlink_connection(
        "udpin:127.0.0.1:0", dialect="common", source_system=42, source_component=1
    )
    link.setup_signing(bytes.fromhex(request["key"]), allow_unsigned_callback=lambda mav, message: False, link_id=5)
    sockets["autopilot"] = link
    return link.port.getsockname()[1]


def is_active(request):
    """The HEARTBEAT that the autopilot receives within these seconds, or None; after the first it forwards."""
    link = sockets["autopilot"]
    heard = link.recv_match(type="HEARTBEAT", blocking=True, timeout=request["seconds"])
    if heard is None:
        return None
    for given in request["objects"]:
        payload = bytes.fromhex(given["bytes"])
        link.mav.send(tunnel(link.mav, given["type"], payload))
    return told(heard)


def uplink(request):
    """The TUNNEL that the autopilot receives; it answers with the DPR's resulting state."""
    link = sockets["autopilot"]
    heard = link.recv_match(type="TUNNEL", blocking=True, timeout=20)
    if heard is None:
        return None
    stored = bytes(heard.payload[: heard.payload_length])
    link.mav.send(tunnel(link.mav, 0xC401, bytes.fromhex(request["port"]) + stored))
    return told(heard)


for line in sys.stdin:
    request = json.loads(line)
    does = {"parse": parse, "send": send, "listen": listen, "hear": hear, "forward": forward}
    does |= {"autopilot": autopilot, "is_active": is_active, "uplink": uplink}
    print(json.dumps(does[request["do"]](request)), flush=True)
