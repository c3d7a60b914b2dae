"""The peer of a case of kind `client`: units on a line in virtual time, as vectors/README.md describes them.

peer = ClientPeer(case)
peer.begin(0)                     the user asks the first question
peer.hear(frame, now)             the client has sent this frame; times are integer microseconds
peer.coming                       [(time, bytes)]: what the client receives, sorted by time; one piece for each time
peer.end(0)                       the question has its outcome
"""

EXCEPTION = 0x80


class ClientPeer:
    def __init__(self, case):
        self.framing = case["line"]["framing"]
        self.asks = case["ask"]
        self.units = {unit["unit"]: Unit(unit) for unit in case["units"]}
        self.probes = iter(case.get("probes", []))
        self.fates = [iter(ask.get("fates", [])) for ask in self.asks]
        self.seen = [0 for _ in self.asks]
        self.open = []
        self.answered_at = {}
        self.coming = []

    def begin(self, place):
        ask = self.asks[place]
        self.open.append(place)
        for first, row in ask.get("changes", {}).items():
            self.units[ask["unit"]].registers.update(registers(first, row))

    def end(self, place):
        self.open.remove(place)

    def hear(self, frame, now):
        unit, pdu, number = unwrapped(self.framing, frame)
        fate = self.fate(unit, pdu)
        if fate.get("echo"):
            self.receive(now, frame)
        if fate.get("lost") == "request":
            return
        if unit == 0 and self.framing != "tcp":
            for one in self.units.values():
                one.answer(pdu)
            return
        answer = bytes.fromhex(fate.get("pdu", ""))
        if unit in self.units and not (answer and answer[0] & EXCEPTION):
            own = self.units[unit].answer(pdu)
            answer = answer or own
        if not answer or "lost" in fate:
            return
        at = now + fate.get("delay", 2000)
        if self.framing != "tcp":
            at = max(at, self.answered_at.get(unit, 0) + 5000)
        for item in fate.get("before", []):
            other = (item["unit"], item["pdu"], number ^ item.get("number", 0)) if "pdu" in item else None
            self.receive(at, wrapped(self.framing, *other) if other else bytes.fromhex(item["bytes"]))
            at += 10000
        data = bytearray(wrapped(self.framing, fate.get("unit", unit), answer.hex(), number ^ fate.get("number", 0)))
        if "damage" in fate:
            place, mask = fate["damage"]
            data[place] ^= mask
        data = bytes(data[: fate.get("cut")])
        for later in fate.get("again", []):
            if later > 0:
                self.receive(at + later, data)
        data += data * fate.get("again", []).count(0)
        for size in fate.get("pieces", []):
            self.receive(at, data[:size])
            data = data[size:]
            at += fate["pause"]
        self.receive(at, data)
        self.answered_at[unit] = at

    def fate(self, unit, pdu):
        for place in self.open:
            if self.asks[place]["unit"] == unit and bytes.fromhex(self.asks[place]["pdu"]) == pdu:
                self.seen[place] += 1
                return next(self.fates[place], {})
        return next(self.probes, {})

    def receive(self, at, data):
        at_once = [piece for when, piece in self.coming if when == at]
        self.coming = sorted([one for one in self.coming if one[0] != at] + [(at, b"".join((*at_once, data)))])


class Unit:
    def __init__(self, unit):
        self.registers, self.coils = {}, {}
        for first, row in unit["registers"].items():
            self.registers.update(registers(first, row))
        for first, row in unit["coils"].items():
            self.coils.update({int(first) + n: int(bit) for n, bit in enumerate(row.replace(" ", ""))})
        self.diagnostics = unit.get("diagnostics", "echoes")

    def answer(self, pdu):
        """The response to a request; None if the unit ignores it."""
        function, first, second = pdu[0], int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        if function == 8:
            return {"echoes": pdu, "declines": b"\x88\x01", "ignores": None}[self.diagnostics]
        if function not in (1, 2, 3, 4, 5, 6, 15, 16):
            return bytes([function | EXCEPTION, 1])
        table = self.coils if function in (1, 2, 5, 15) else self.registers
        count = 1 if function in (5, 6) else second
        places = range(first, first + count)
        if not all(place in table for place in places):
            return bytes([function | EXCEPTION, 2])
        if function in (1, 2):
            bits = sum(table[place] << n for n, place in enumerate(places))
            return bytes([function, (count + 7) // 8]) + bits.to_bytes((count + 7) // 8, "little")
        if function in (3, 4):
            return bytes([function, 2 * count]) + b"".join(table[place].to_bytes(2, "big") for place in places)
        if function == 5:
            table[first] = 1 if second == 0xFF00 else 0
        if function == 6:
            table[first] = second
        if function == 15:
            bits = int.from_bytes(pdu[6:], "little")
            table.update({place: bits >> n & 1 for n, place in enumerate(places)})
        if function == 16:
            table.update({place: int.from_bytes(pdu[6 + 2 * n :][:2], "big") for n, place in enumerate(places)})
        return pdu[:5]


def registers(first, row):
    """A row of registers, "006B 0001", as address -> value."""
    return {int(first) + n: int(word, 16) for n, word in enumerate(row.split())}


# Envelopes


def wrapped(framing, unit, pdu, number):
    body = bytes([unit]) + bytes.fromhex(pdu)
    if framing == "tcp":
        return number.to_bytes(2, "big") + b"\0\0" + len(body).to_bytes(2, "big") + body
    if framing == "rtu":
        return body + crc16(body).to_bytes(2, "little")
    return b":" + (body + bytes([-sum(body) & 0xFF])).hex().upper().encode() + b"\r\n"


def unwrapped(framing, frame):
    if framing == "tcp":
        return frame[6], bytes(frame[7:]), int.from_bytes(frame[:2], "big")
    body = frame[:-2] if framing == "rtu" else bytes.fromhex(frame[1:-4].decode())
    return body[0], bytes(body[1:]), 0


def crc16(data):
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register
