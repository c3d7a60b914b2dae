"""A Modbus server behind a line: units, broadcasts, counters, the event log, listen only mode."""

from server_unit import FUNCTIONS, Declined, Unit, demand, packed, word

ABOUT_LINE = ("08", "0B", "0C")
COUNTERS = ("0B", "0C", "0D", "0E", "0F", "10", "11", "12", "events")
RESTARTS = (bytes.fromhex("08 00 01 00 00"), bytes.fromhex("08 00 01 FF 00"))
LISTEN_ONLY = bytes.fromhex("08 00 04 00 00")
CLEAR = bytes.fromhex("08 00 0A 00 00")
SENT_BITS = {1: 0x41, 2: 0x41, 3: 0x41, 4: 0x42, 5: 0x44, 6: 0x44, 7: 0x48}


class Station:
    """A unit with what it knows of its line."""

    def __init__(self, given):
        self.unit = Unit(given)
        self.counts = dict.fromkeys(("02", *COUNTERS), 0) | given.get("counters", {})
        self.log = []  # the newest event first
        self.listens = False

    def count(self, name):
        """Count one more; 65535 is followed by 0."""
        self.counts[name] = (self.counts[name] + 1) % 0x10000

    def note(self, event):
        """Put an event into the log, which has the latest 64."""
        self.log = [event, *self.log[:63]]

    def listening(self):
        """Return the bit of an event in listen only mode."""
        return 0x20 if self.listens else 0

    def receive(self, pdu, is_broadcast):
        """Count and carry out a request on a serial line, and return the response or None."""
        self.count("0E")
        self.note(0x80 | (0x40 if is_broadcast else 0) | self.listening())
        if self.listens and pdu not in RESTARTS:
            return None  # 08/0F would count it, but the restart that ends this mode clears that counter
        was_listening, code = self.listens, 0
        try:
            response = self.carry_out(pdu, is_serial=True)
        except Declined as declined:
            code = declined.args[0]
            response = bytes((pdu[0] | 0x80, code))
            self.count("0D")
            if code in (6, 7):
                self.count({6: "11", 7: "10"}[code])
        if (pdu == LISTEN_ONLY and not code) or (pdu in RESTARTS and was_listening):
            response = None
        if is_broadcast:
            self.count("0F")
        is_own_event = not code and (pdu in RESTARTS or pdu == LISTEN_ONLY)  # 00 or 04 are in the log already
        if not is_own_event:
            self.note(SENT_BITS.get(code, 0x40) | self.listening())
            if not code and pdu[0] != 0x0B and pdu != CLEAR:
                self.count("events")
        return response

    def carry_out(self, pdu, is_serial):
        """Return the response to a request. Raise Declined."""
        name = f"2B/{pdu[1]:02X}" if pdu[0] == 0x2B and len(pdu) > 1 else f"{pdu[0]:02X}"
        known = [*FUNCTIONS, *(ABOUT_LINE if is_serial else ())]
        demand(name in self.unit.given.get("functions", known), 1)
        if name == "08":
            return self.diagnose(pdu)
        if name in ABOUT_LINE:
            demand(len(pdu) == 1, 3)
            numbers = [0xFFFF if self.unit.given.get("busy") else 0, self.counts["events"]]
            if name == "0B":
                return pdu + packed(numbers)
            return pdu + bytes((6 + len(self.log),)) + packed([*numbers, self.counts["0B"]]) + bytes(self.log)
        return FUNCTIONS[name](self.unit, pdu)

    def diagnose(self, pdu):
        """Return the response to 08, whose data are 0000 but for an echo (00) and a restart (01)."""
        demand(len(pdu) >= 3, 3)
        sub, data = word(pdu, 1), pdu[3:]
        demand(sub in (0, 1, 2, 4, *range(0x0A, 0x13), 0x14), 1)
        if sub == 0x00:
            return pdu
        demand(data == b"\0\0" or pdu in RESTARTS, 3)
        if sub == 0x04:
            self.note(0x04)
            self.listens = True
        elif sub == 0x01:
            self.counts |= dict.fromkeys(COUNTERS, 0)
            self.log = [] if data == b"\xff\0" else self.log
            self.note(0x00)
            self.listens = False
        elif sub == 0x0A:
            self.counts = dict.fromkeys(self.counts, 0)
        elif sub == 0x14:
            self.counts["12"] = 0
        else:
            return pdu[:3] + packed([self.counts[f"{sub:02X}"]])
        return pdu


def answer(stations, is_serial, number, pdu):
    """Return the response to a request for a unit, or None."""
    for station in stations.values():
        station.count("0B")
    if pdu[0] & 0x80:
        return None  # the exception response of another unit
    if is_serial and number == 0:
        for station in stations.values():
            station.receive(pdu, is_broadcast=True)
        return None
    if is_serial:
        return stations[number].receive(pdu, is_broadcast=False) if number in stations else None
    station = stations.get(number, stations.get(255))
    try:
        demand(station is not None, 0x0B)
        return station.carry_out(pdu, is_serial=False)
    except Declined as declined:
        return bytes((pdu[0] | 0x80, declined.args[0]))


def answers(stations, held):
    """Return the frames that answer those of a stream, each with its header; take them out of `held`."""
    said = b""
    while len(held) >= 6:
        size = 6 + int.from_bytes(held[4:6], "big")
        if held[2:4] != b"\0\0" or not 8 <= size <= 260:
            held.clear()  # nobody knows where the next frame begins
        elif len(held) < size:
            break
        else:
            pdu = answer(stations, False, held[6], bytes(held[7:size]))
            if pdu is not None:
                said += held[:4] + (len(pdu) + 1).to_bytes(2, "big") + held[6:7] + pdu
            del held[:size]
    return said or None


def run(question):
    """Return what the server says in each step, and its tables at the end."""
    stations = {int(number): Station(given) for number, given in question["server"]["units"].items()}
    steps, held = [], bytearray()
    for step in question["talk"]:
        said = None
        if "stream" in step:
            held += bytes.fromhex(step["stream"])
            said = answers(stations, held)
        elif "ask" in step:
            said = answer(stations, question["server"]["line"] != "tcp", step["unit"], bytes.fromhex(step["ask"]))
        for station in stations.values() if not {"ask", "stream"} & {*step} else ():
            station.count("12" if "overrun" in step else "0C")
            station.note((0x90 if "overrun" in step else 0x82) | station.listening())
        steps.append({"say": None if said is None else said.hex(" ").upper()})
    return {"talk": steps, "then": {str(number): station.unit.content() for number, station in stations.items()}}


KINDS = {"server": {"run": run}}
