"""pdu: the messages of Modbus, without their envelope.

Encoding writes a message and reads it again: what the reader refuses must not be sent.
"""

from texts import Refused, bits_of, bitted, exactly, hexed, number, octets, packed, unpacked, within, worded, words

LONGEST = 253

# Messages of numbers only: the name and the bytes of each.
PLACE = (("address", 2), ("quantity", 2))
COUNTS = (("status", 2), ("event_count", 2))
NUMBERS = {
    "request": {1: PLACE, 2: PLACE, 3: PLACE, 4: PLACE, 0x18: (("address", 2),)},
    "response": {7: (("status", 1),), 0x0B: COUNTS, 0x0F: PLACE, 0x10: PLACE},
    "both": {
        5: (("address", 2), ("value", 2)),
        6: (("address", 2), ("value", 2)),
        0x16: (("address", 2), ("and_mask", 2), ("or_mask", 2)),
    },
}
EMPTY = (7, 0x0B, 0x0C, 0x11)
"""Functions whose request has no fields."""
MOST = {1: 2000, 2: 2000, 3: 125, 4: 125, 0x0F: 1968, 0x10: 123}
WRITTEN = (("read_address", 2), ("read_quantity", 2), ("write_address", 2))


def numbers_of(code, side):
    """Return the fields of a message of numbers only; None for other messages."""
    return NUMBERS["both"].get(code) or NUMBERS[side].get(code)


# Reading ----------------------------------------------------------------------------------------------------------


def take(data, *sizes):
    """Return numbers of these sizes and what follows them."""
    found = []
    for size in sizes:
        if len(data) < size:
            raise Refused("short")
        found.append(int.from_bytes(data[:size], "big"))
        data = data[size:]
    return *found, data


def counted(data, width=1):
    """Return the bytes that a byte count counts; nothing may be missing or follow."""
    count, rest = take(data, width)
    if count != len(rest):
        raise Refused("length")
    return rest


def registers_of(data):
    """Return bytes as the text of registers."""
    if len(data) % 2:
        raise Refused("length")
    return worded(int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2))


def read(side, pdu):
    """Return the function (one byte or two) and the fields of a message."""
    code, data = take(pdu, 1)
    if side == "response" and pdu[:2] == b"\xab\xff":
        return pdu[:2], read_extended(pdu[2:])
    if side == "response" and code >= 0x80:
        exactly(data, 1)
        return pdu[:1], {"function_code": code, "exception_code": data[0]}
    if code == 0x2B:
        if data[:1] == b"\x0e":
            return pdu[:2], read_identification(side, data[1:])
        if data[:1] == b"\x0d":
            return pdu[:2], read_general(side, data[1:])
    return pdu[:1], read_fields(side, code, data)


def read_fields(side, code, data):
    """Return the fields of a message, which follow its function code."""
    if fields := numbers_of(code, side):
        *found, rest = take(data, *(size for _, size in fields))
        exactly(rest, 0)
        message = dict(zip((name for name, _ in fields), found))
        if "quantity" in message:
            within(message["quantity"], 1, MOST[code])
        if code == 5:
            if message["value"] not in (0xFF00, 0):
                raise Refused("value")
            message["value"] = message["value"] == 0xFF00
        return message
    if side == "request" and code in EMPTY:
        exactly(data, 0)
        return {}
    if code == 8:
        sub_function, rest = take(data, 2)
        if sub_function and len(rest) != 2:
            raise Refused("value")
        return {"sub_function": sub_function, "data": hexed(rest)}
    if code in (0x0F, 0x10):
        address, quantity, rest = take(data, 2, 2)
        written = counted(rest)
        within(quantity, 1, MOST[code])
        if len(written) != ((quantity + 7) // 8 if code == 0x0F else 2 * quantity):
            raise Refused("length")
        if code == 0x0F:
            return {"address": address, "bits": bitted(unpacked(written, quantity))}
        return {"address": address, "registers": registers_of(written)}
    if code in (1, 2):
        bits = counted(data)
        within(len(bits), 1, 250)
        return {"bits": bitted(unpacked(bits, 8 * len(bits)))}
    if side == "response" and code in (3, 4, 0x17):
        registers = registers_of(counted(data))
        within(len(words(registers)), 1, 125)
        return {"registers": registers}
    if code == 0x17:
        *found, quantity, rest = take(data, 2, 2, 2, 2)
        written = counted(rest)
        within(found[1], 1, 125)
        within(quantity, 1, 121)
        if len(written) != 2 * quantity:
            raise Refused("length")
        return dict(zip((name for name, _ in WRITTEN), found)) | {"registers": registers_of(written)}
    if code == 0x0C:
        status, events, messages, log = take(counted(data), 2, 2, 2)
        if len(log) > 64:
            raise Refused("value")
        return {"status": status, "event_count": events, "message_count": messages, "events": hexed(log)}
    if code == 0x11:
        return {"data": hexed(counted(data))}
    if code == 0x18:
        size, count, registers = take(data, 2, 2)
        if size != 2 + len(registers) or size != 2 + 2 * count:
            raise Refused("length")
        if count > 31:
            raise Refused("value")
        return {"registers": registers_of(registers)}
    if code in (0x14, 0x15):
        return read_records(side, code, counted(data))
    raise Refused("function")


def read_records(side, code, data):
    """Return places (14 request), registers (14 response) or records (15): groups of bytes up to the end."""
    if not data:
        raise Refused("value")
    if code == 0x14 and side == "request":
        places = read_places(data)
        if sum(1 + place["length"] for place in places) > 125:
            raise Refused("value")  # the response would fit no PDU
        return {"places": places}
    records = []
    while data:
        if code == 0x14:
            size, kind, data = take(data, 1, 1)
            size -= 1
            within(kind, 6, 6)
        else:
            if len(data) < 7:
                raise Refused("short")
            (record,) = read_places(data[:7])
            size, data = 2 * record["length"], data[7:]
        if size % 2:
            raise Refused("length")
        if size > len(data):
            raise Refused("short")
        registers, data = registers_of(data[:size]), data[size:]
        if code == 0x15:
            registers = {"file": record["file"], "record": record["record"], "registers": registers}
        records.append(registers)
    return {"records": records}


def read_places(data):
    """Return groups of seven bytes: 06, a file, its first record, and the number of registers."""
    if len(data) % 7:
        raise Refused("length")
    places = []
    while data:
        kind, file, record, length, data = take(data, 1, 2, 2, 2)
        within(kind, 6, 6)
        if not file or not length or record > 9999:
            raise Refused("value")
        places.append({"file": file, "record": record, "length": length})
    return places


def read_identification(side, data):
    """Return the fields of 2B/0E."""
    if side == "request":
        read_code, object_id, rest = take(data, 1, 1)
        exactly(rest, 0)
        within(read_code, 1, 4)
        return {"read_code": read_code, "object_id": object_id}
    read_code, conformity, more, following, count, rest = take(data, 1, 1, 1, 1, 1)
    if more not in (0, 0xFF):
        raise Refused("value")
    objects = []
    for _ in range(count):
        object_id, size, rest = take(rest, 1, 1)
        if size > len(rest):
            raise Refused("short")
        objects.append({"id": object_id, "value": hexed(rest[:size])})
        rest = rest[size:]
    exactly(rest, 0)
    return {
        "read_code": read_code,
        "conformity": conformity,
        "more_follows": more == 0xFF,
        "next_object": following,
        "objects": objects,
    }


def read_general(side, data):
    """Return the fields of 2B/0D. No node is 0, so a 00 behind the control is the byte of the dialect cia309."""
    control, rest = take(data, 1)
    dialect = "cia309" if rest[:1] == b"\x00" else "schneider"
    node, index, sub_index, start, count, rest = take(rest[dialect == "cia309" :], 1, 2, 1, 2, 2)
    if control > 1:
        raise Refused("value")
    within(node, 1, 127)
    has_data = (side == "request") == (control == 1)
    if len(rest) != (count if has_data else 0):
        raise Refused("length")
    fields = {"node": node, "index": f"{index:04X}", "sub_index": sub_index, "start": start, "count": count}
    return fields | {"data": hexed(rest), "write": control == 1, "dialect": dialect}


def read_extended(data):
    """Return the abort code of AB FF, an exception of ten bytes."""
    length, mei_type, kind, abort_code, rest = take(data, 2, 1, 1, 4)
    exactly(rest, 0)
    if (length, mei_type, kind) != (6, 0x0D, 0xEC):
        raise Refused("value")
    return {"abort_code": f"{abort_code:08X}"}


# Writing ----------------------------------------------------------------------------------------------------------


def counting(data, width=1):
    """Return bytes behind their count."""
    return number(len(data), width) + data


def registered(text):
    """Return registers as bytes."""
    return b"".join(number(word, 2) for word in words(text))


def write(side, function, message):
    """Return the bytes of a message. `function` is its code, of one byte or two."""
    if function == b"\x2b":
        function = b"\x2b\x0e"
    pdu = function + write_fields(side, function, message)
    if len(pdu) > LONGEST:
        raise Refused("value")
    try:
        read(side, pdu)
    except Refused:
        raise Refused("value") from None
    return pdu


def write_fields(side, function, message):
    """Return what follows the function code."""
    code = function[0]
    if code == 0x2B:
        return write_general(message) if function[1] == 0x0D else write_identification(side, message)
    if function == b"\xab\xff":
        return b"\0\x06\x0d\xec" + number(int(message["abort_code"], 16), 4)
    if "exception_code" in message:
        return number(message["exception_code"], 1)
    if fields := numbers_of(code, side):
        values = message | ({"value": 0xFF00 if message["value"] else 0} if code == 5 else {})
        return b"".join(number(values[name], size) for name, size in fields)
    if code == 8:
        return number(message["sub_function"], 2) + octets(message["data"])
    if code == 0x0F:
        row = bits_of(message["bits"])
        return number(message["address"], 2) + number(len(row), 2) + counting(packed(row))
    if code == 0x10:
        data = registered(message["registers"])
        return number(message["address"], 2) + number(len(data) // 2, 2) + counting(data)
    if side == "request" and code == 0x17:
        data = registered(message["registers"])
        head = b"".join(number(message[name], size) for name, size in WRITTEN)
        return head + number(len(data) // 2, 2) + counting(data)
    if code in (1, 2):
        return counting(packed(bits_of(message["bits"])))
    if code in (3, 4, 0x17):
        return counting(registered(message["registers"]))
    if side == "response" and code == 0x0C:
        counts = b"".join(number(message[name], 2) for name in ("status", "event_count", "message_count"))
        return counting(counts + octets(message["events"]))
    if side == "response" and code == 0x11:
        return counting(octets(message["data"]))
    if code == 0x18:
        data = registered(message["registers"])
        return counting(number(len(data) // 2, 2) + data, 2)
    if code in (0x14, 0x15):
        return counting(b"".join(write_group(group) for group in message.get("places") or message["records"]))
    return b""


def write_group(group):
    """Return one group of 14 or 15: registers, or a place with or without registers."""
    if isinstance(group, str):
        return counting(b"\x06" + registered(group))
    data = registered(group.get("registers", ""))
    length = group.get("length", len(data) // 2)
    return b"\x06" + number(group["file"], 2) + number(group["record"], 2) + number(length, 2) + data


def write_identification(side, message):
    """Return the fields of 2B/0E."""
    if side == "request":
        return number(message["read_code"], 1) + number(message["object_id"], 1)
    head = [message["read_code"], message["conformity"], 0xFF if message["more_follows"] else 0, message["next_object"]]
    objects = b"".join(number(one["id"], 1) + counting(octets(one["value"])) for one in message["objects"])
    return b"".join(number(value, 1) for value in [*head, len(message["objects"])]) + objects


def write_general(message):
    """Return the fields of 2B/0D."""
    head = (b"\x01" if message["write"] else b"\x00") + (b"\x00" if message["dialect"] == "cia309" else b"")
    place = number(message["node"], 1) + number(int(message["index"], 16), 2) + number(message["sub_index"], 1)
    counts = number(message["start"], 2) + number(message["count"], 2)
    return head + place + counts + octets(message["data"])


def encode(given):
    """side, function, message -> pdu"""
    return {"pdu": hexed(write(given["side"], octets(given["function"]), given["message"]))}


def decode(given):
    """side, pdu -> function, message"""
    function, message = read(given["side"], octets(given["pdu"]))
    return {"function": hexed(function), "message": message}


KINDS = {"pdu": {"encode": encode, "decode": decode}}
