"""rtu-talk, ascii-talk, tcp-talk, and the deliveries of the three frame kinds: bytes in time, frames and noise out."""

from checks import times
from frames import latin, open_ascii, open_rtu, open_tcp
from texts import Refused, hexed, octets

HEADS = {"request": {1: 5, 2: 5, 3: 5, 4: 5, 5: 5, 6: 5, 7: 1, 8: 5, 0x0B: 1, 0x0C: 1, 0x11: 1, 0x16: 7, 0x18: 3}}
HEADS["response"] = {5: 5, 6: 5, 7: 2, 8: 5, 0x0B: 5, 0x0F: 5, 0x10: 5, 0x16: 7}
COUNTS = {"request": {0x0F: 5, 0x10: 5, 0x14: 1, 0x15: 1, 0x17: 9}}
COUNTS["response"] = dict.fromkeys((1, 2, 3, 4, 0x0C, 0x11, 0x14, 0x15, 0x17), 1)


def measured(side, pdu):
    """Return how long a PDU is, or how many bytes are needed to tell; None for a function that nobody can count."""
    code = pdu[0]
    if side == "response" and code >= 0x80:
        return 10 if pdu[:2] == b"\xab\xff" else 2
    if code in HEADS[side]:
        return HEADS[side][code]
    if code in COUNTS[side]:
        at = COUNTS[side][code]
        return at + 1 + pdu[at] if len(pdu) > at else at + 1
    if side == "response" and code == 0x18:
        return 3 + int.from_bytes(pdu[1:3], "big") if len(pdu) > 2 else 3
    if code == 0x2B:
        return measured_2b(side, pdu)
    return None


def measured_2b(side, pdu):
    """Return the same for function 2B."""
    if pdu[1:2] == b"\x0e":
        if side == "request":
            return 4
        size = 7
        for _ in range(pdu[6] if len(pdu) > 6 else 0):
            size += 2 + (pdu[size + 1] if len(pdu) > size + 1 else 0)
        return size
    if pdu[1:2] == b"\x0d":
        if len(pdu) < 4:
            return 4
        head = 12 if pdu[3] == 0 else 11
        has_data = (side == "request") == (pdu[2] == 1)
        return head + int.from_bytes(pdu[head - 2 : head], "big") if has_data and len(pdu) >= head else head
    return 2 if len(pdu) < 2 else None


class RtuLine:
    """A receiver of RTU. `patience` None: the silences of the standard and nothing else end a frame."""

    def __init__(self, side, baud, bits, patience):
        self.character, self.longest_gap, self.silence = times(baud, bits)
        self.counts = patience is not None
        if self.counts:
            self.longest_gap = self.silence = patience
        self.side, self.held, self.spoiled, self.last = side, b"", False, 0

    def feed(self, data, at):
        """Return the events up to this time, when the last byte of `data` was in."""
        events = []
        gap = at - len(data) * self.character - self.last
        if self.held and gap >= self.silence:
            events += self.close()
        self.spoiled = self.spoiled or bool(self.held and data and gap > self.longest_gap)
        self.held += data
        if data:
            self.last = at
        return events + (self.take() if self.counts else [])

    def take(self):
        """Return the frames at the beginning of what is held, as far as they can be counted."""
        events = []
        while len(self.held) >= 4 and (size := measured(self.side, self.held[1:])):
            frame = self.held[: size + 3]
            if len(self.held) < size + 3 or not right(frame):
                break
            events.append(open_rtu(frame))
            self.held = self.held[size + 3 :]
        return events

    def close(self):
        """Return what silence has ended: a frame, or stray bytes and a frame, or noise."""
        whole, spoiled = self.held, self.spoiled
        self.held, self.spoiled = b"", False
        if spoiled:
            return [{"noise": whole, "reason": "silence"}]
        for at in range(5 if self.counts else 1):
            if right(whole[at:]) and not whole[:at].strip(b"\x00\xff"):
                return ([{"noise": whole[:at], "reason": "checksum"}] if at else []) + [open_rtu(whole[at:])]
        return [{"noise": whole, "reason": "short" if len(whole) < 4 else "checksum"}]


def right(frame):
    """Return whether bytes are an RTU frame."""
    try:
        open_rtu(frame)
    except Refused:
        return False
    return True


class AsciiLine:
    """A receiver of ASCII."""

    character = 1000

    def __init__(self, timeout, data_bits=8):
        self.timeout, self.mask = timeout, (1 << data_bits) - 1
        self.held, self.last = b"", 0
        self.ends, self.asked = {}, {}  # by unit: its last character, and the request that may change it

    def feed(self, data, at):
        """Return the events up to this time, when the last character of `data` was in."""
        events = []
        if self.held and at - self.last > self.timeout:
            events.append({"noise": self.held, "reason": "silence"})
            self.held = b""
        for byte in data:
            if byte & self.mask == ord(":") and self.held:
                events.append({"noise": self.held, "reason": "delimiter"})
                self.held = b""
            self.held += bytes([byte & self.mask])
            if self.held[-2:-1] == b"\r" and self.held[-1:] == self.end():
                events.append(self.ended(self.held[:-1] + b"\n"))
                self.held = b""
        self.last = at if data else self.last
        return events

    def end(self):
        """Return the character that ends the message that is held: LF, or the one its unit was told."""
        return self.ends.get(bytes(self.held[1:3]), b"\n")

    def ended(self, text):
        """Return the event of a message that has its end."""
        try:
            frame = open_ascii(text)
        except Refused as refused:
            return {"noise": self.held, "reason": refused.args[0]}
        unit, pdu = bytes(text[1:3]), frame["pdu"]
        answered = self.asked.pop(unit, None) == pdu
        if answered and pdu.startswith("08 00 03"):
            self.ends[unit] = octets(pdu)[3:4]
        elif answered:
            self.ends.pop(unit, None)
        elif pdu.startswith(("08 00 03", "08 00 01")):
            self.asked[unit] = pdu
        return frame


class TcpLine:
    """A receiver of TCP. After a header that cannot be right, nobody knows where a frame begins."""

    character = 0

    def __init__(self):
        self.held, self.lost = b"", ""

    def feed(self, data, at):
        """Return the events."""
        self.held += data
        events = []
        while self.held and not self.lost:
            try:
                size = 6 + int.from_bytes(self.held[4:6], "big")
                events.append(open_tcp(self.held[:size]))
                self.held = self.held[size:]
            except Refused as refused:
                if refused.args[0] == "short":
                    break
                self.lost = refused.args[0]
        if self.lost and self.held:
            events.append({"noise": self.held, "reason": self.lost})
            self.held = b""
        return events


def received(line, given, read):
    """Feed the pieces of a delivery without a pause, then silence; return the frames."""
    events, at = [], 0
    for piece in map(read, given["pieces"]):
        at += len(piece) * line.character
        events += line.feed(piece, at)
    events += line.feed(b"", at + 10_000_000)
    return {"frames": [event for event in events if "pdu" in event]}


def receive_rtu(given):
    """side, unit, pieces -> frames"""
    return received(RtuLine(given["side"], 19200, 11, 30_000), given, octets)


def receive_ascii(given):
    """side, unit, pieces -> frames"""
    return received(AsciiLine(1_000_000), given, latin)


def receive_tcp(given):
    """side, unit, pieces -> frames"""
    return received(TcpLine(), given, octets)


def talk(line, given, read, write):
    """Feed each step; return its events, and what the line holds at the end."""
    steps = []
    for step in given["talk"]:
        events = line.feed(read(step.get("hear", "")), step["at"])
        told = [event | {"noise": write(event["noise"])} if "noise" in event else event for event in events]
        steps.append({"events": told})
    return {"talk": steps, "held": write(line.held)}


def talk_rtu(given):
    """line, talk -> talk, held"""
    setup = given["line"]
    side = "request" if setup["role"] == "server" else "response"
    return talk(RtuLine(side, setup["baud"], setup["bits"], setup["patience"]), given, octets, hexed)


def talk_ascii(given):
    """line, talk -> talk, held"""
    setup = given["line"]
    line = AsciiLine(setup["timeout"], setup["data_bits"])
    return talk(line, given, latin, lambda data: data.decode("latin-1"))


def talk_tcp(given):
    """line, talk -> talk, held"""
    return talk(TcpLine(), given, octets, hexed)


def only_frames(run):
    """line, talk -> frames"""

    def frames(given):
        silence = {"at": given["talk"][-1]["at"] + 10_000_000}
        steps = run({**given, "talk": [*given["talk"], silence]})["talk"]
        return {"frames": [event for step in steps for event in step["events"] if "pdu" in event]}

    return frames


KINDS = {
    "rtu-frame": {"receive": receive_rtu},
    "ascii-frame": {"receive": receive_ascii},
    "tcp-frame": {"receive": receive_tcp},
    "rtu-talk": {"run": talk_rtu, "frames": only_frames(talk_rtu)},
    "ascii-talk": {"run": talk_ascii, "frames": only_frames(talk_ascii)},
    "tcp-talk": {"run": talk_tcp, "frames": only_frames(talk_tcp)},
}
