"""The unit of a Modbus server: its tables, and what each function does with them. Time and lines are in server.py.

Each function is a figure of the standard: quantities and byte counts first (03), then addresses (02), then the device.
"""

COILS, INPUTS, HOLDING, REGISTERS = "coils", "discrete_inputs", "holding_registers", "input_registers"
READ_FROM = {0x01: COILS, 0x02: INPUTS, 0x03: HOLDING, 0x04: REGISTERS}


class Declined(Exception):
    """The request gets an exception response; `args[0]` is its code."""


def word(pdu, at):
    """Return a number of two bytes."""
    return int.from_bytes(pdu[at : at + 2], "big")


def demand(holds, code):
    """Decline the request with this code unless the condition holds."""
    if not holds:
        raise Declined(code)


def rows(texts, size):
    """Return address -> value of a table: {"10": "0001 0002"} has registers 10 and 11."""
    found = {}
    for first, text in texts.items():
        digits = text.replace(" ", "")
        for place in range(len(digits) // size):
            found[int(first) + place] = int(digits[place * size : place * size + size], 16)
    return found


def packed(numbers):
    """Return registers as bytes."""
    return b"".join(number.to_bytes(2, "big") for number in numbers)


class Unit:
    """The tables of one unit, as a case describes them."""

    def __init__(self, given):
        self.given = given
        self.tables = {name: rows(given.get(name, {}), 1) for name in (COILS, INPUTS)}
        self.tables |= {name: rows(given.get(name, {}), 4) for name in (HOLDING, REGISTERS)}
        self.files = {int(number): [*rows({"0": text}, 4).values()] for number, text in given.get("files", {}).items()}
        self.queues = {int(at): [*rows({"0": text}, 4).values()] for at, text in given.get("queues", {}).items()}

    def content(self):
        """Return the tables as a case writes them."""
        found = {}
        for name, size in ((COILS, 1), (INPUTS, 1), (HOLDING, 4), (REGISTERS, 4)):
            if name in self.given:
                found[name] = {first: self._text(name, int(first), size) for first in self.given[name]}
        if "files" in self.given:
            texts = {number: " ".join(f"{one:04X}" for one in row) for number, row in self.files.items()}
            found["files"] = {str(number): text for number, text in texts.items()}
        return found

    def _text(self, name, first, size):
        count = len(self.given[name][str(first)].replace(" ", "")) // size
        values = [self.tables[name][first + place] for place in range(count)]
        if size == 4:
            return " ".join(f"{value:04X}" for value in values)
        digits = "".join(map(str, values))
        return " ".join(digits[at : at + 8] for at in range(0, count, 8))

    # Tables

    def exists(self, name, first, quantity):
        """Decline addresses that do not exist, and what the device declines there."""
        demand(all(address in self.tables[name] for address in range(first, first + quantity)), 2)

    def device(self, name, first, quantity):
        """Decline what the device declines at these addresses."""
        for fault in self.given.get("faults", ()):
            demand(fault["table"] != name or not first <= fault["address"] < first + quantity, fault["exception"])

    def writable(self, name, first, quantity):
        """Decline a write to addresses that do not exist or are read-only."""
        self.exists(name, first, quantity)
        protected = self.given.get("read_only", {}).get(name, ())
        demand(not any(first <= address < first + quantity for address in protected), 2)
        self.device(name, first, quantity)

    def store(self, name, first, values):
        """Set values from an address on."""
        self.tables[name].update(enumerate(values, first))

    # Functions: request PDU in, response PDU out

    def read(self, pdu):
        """Return bits (01, 02) or registers (03, 04)."""
        demand(len(pdu) == 5, 3)
        name, first, quantity = READ_FROM[pdu[0]], word(pdu, 1), word(pdu, 3)
        is_bits = pdu[0] < 3
        demand(1 <= quantity <= (2000 if is_bits else 125), 3)
        self.exists(name, first, quantity)
        self.device(name, first, quantity)
        values = [self.tables[name][first + place] for place in range(quantity)]
        if is_bits:
            row = sum(bit << place for place, bit in enumerate(values))
            data = row.to_bytes((quantity + 7) // 8, "little")
        else:
            data = packed(values)
        return bytes((pdu[0], len(data))) + data

    def write_one(self, pdu):
        """Write a coil (05) or a register (06); the response is the request."""
        demand(len(pdu) == 5, 3)
        first, value = word(pdu, 1), word(pdu, 3)
        if pdu[0] == 0x05:
            demand(value in (0x0000, 0xFF00), 3)
        name = COILS if pdu[0] == 0x05 else HOLDING
        self.writable(name, first, 1)
        self.store(name, first, [value >> 15 if name == COILS else value])
        return pdu

    def write_many(self, pdu):
        """Write coils (0F) or registers (10)."""
        demand(len(pdu) > 5, 3)
        first, quantity, count = word(pdu, 1), word(pdu, 3), pdu[5]
        is_bits = pdu[0] == 0x0F
        demand(1 <= quantity <= (1968 if is_bits else 123), 3)
        demand(count == ((quantity + 7) // 8 if is_bits else 2 * quantity) == len(pdu) - 6, 3)
        name = COILS if is_bits else HOLDING
        self.writable(name, first, quantity)
        if is_bits:
            self.store(name, first, [pdu[6 + place // 8] >> place % 8 & 1 for place in range(quantity)])
        else:
            self.store(name, first, [word(pdu, at) for at in range(6, len(pdu), 2)])
        return pdu[:5]

    def mask(self, pdu):
        """Keep the bits of the AND mask and set the others as in the OR mask (16)."""
        demand(len(pdu) == 7, 3)
        first, keep, put = word(pdu, 1), word(pdu, 3), word(pdu, 5)
        self.writable(HOLDING, first, 1)
        self.store(HOLDING, first, [self.tables[HOLDING][first] & keep | put & ~keep & 0xFFFF])
        return pdu

    def exchange(self, pdu):
        """Write registers, then read registers (17)."""
        demand(len(pdu) > 9, 3)
        read, reads, write, writes, count = word(pdu, 1), word(pdu, 3), word(pdu, 5), word(pdu, 7), pdu[9]
        demand(1 <= reads <= 125 and 1 <= writes <= 121 and count == 2 * writes == len(pdu) - 10, 3)
        self.exists(HOLDING, read, reads)
        self.writable(HOLDING, write, writes)
        self.device(HOLDING, read, reads)
        self.store(HOLDING, write, [word(pdu, at) for at in range(10, len(pdu), 2)])
        return bytes((pdu[0], 2 * reads)) + packed(self.tables[HOLDING][read + place] for place in range(reads))

    def queue(self, pdu):
        """Return the registers of a FIFO queue, which stay there (18)."""
        demand(len(pdu) == 3, 3)
        demand(word(pdu, 1) in self.queues, 2)
        row = self.queues[word(pdu, 1)]
        demand(len(row) <= 31, 3)
        return pdu[:1] + packed([2 + 2 * len(row), len(row)]) + packed(row)

    def records(self, pdu):
        """Read (14) or write (15) groups of file records: nothing is written unless all groups exist."""
        is_read = pdu[0] == 0x14
        least, most = (7, 0xF5) if is_read else (9, 0xFB)
        demand(len(pdu) > 1 and least <= pdu[1] <= most and pdu[1] == len(pdu) - 2, 3)
        groups, at = [], 2
        while at < len(pdu):
            demand(at + 7 <= len(pdu), 3)
            file, first, length = word(pdu, at + 1), word(pdu, at + 3), word(pdu, at + 5)
            demand(pdu[at] == 6 and file > 0 and first <= 0x270F, 2)
            demand(length > 0, 2)
            at += 7
            end = at if is_read else at + 2 * length
            demand(end <= len(pdu), 3)
            groups.append((file, first, length, [word(pdu, place) for place in range(at, end, 2)]))
            at = end
        demand(not is_read or sum(2 + 2 * length for _, _, length, _ in groups) <= 251, 3)
        demand(all(first + length <= len(self.files.get(file, ())) for file, first, length, _ in groups), 2)
        if not is_read:
            for file, first, length, values in groups:
                self.files[file][first : first + length] = values
            return pdu
        parts = [self.files[file][first : first + length] for file, first, length, _ in groups]
        data = b"".join(bytes((1 + 2 * len(part), 6)) + packed(part) for part in parts)
        return bytes((0x14, len(data))) + data

    def identification(self, pdu):
        """Return identification objects, as many as fit (2B/0E)."""
        demand(len(pdu) == 4, 3)
        code, first = pdu[2], pdu[3]
        objects = {0: b"", 1: b"", 2: b""}
        objects |= {int(number, 16): bytes.fromhex(text) for number, text in self.given["identification"].items()}
        highest = max(objects)
        conformity = 0x80 | (1 if highest <= 2 else 2 if highest <= 6 else 3)
        demand(1 <= code <= 4, 3)
        numbers = sorted(number for number in objects if number <= {1: 2, 2: 6}.get(code, 0xFF))
        if code == 4:
            demand(first in objects, 2)
            numbers = [first]
        rest = numbers[numbers.index(first) :] if first in numbers else numbers
        data, sent = b"", 0
        while sent < len(rest) and len(data) + 2 + len(objects[rest[sent]]) <= 253 - 7:
            data += bytes((rest[sent], len(objects[rest[sent]]))) + objects[rest[sent]]
            sent += 1
        more = (0xFF, rest[sent]) if sent < len(rest) else (0, 0)
        return bytes((0x2B, 0x0E, code, conformity, *more, sent)) + data

    def server_id(self, pdu):
        """Return the server id (11)."""
        demand(len(pdu) == 1, 3)
        data = bytes.fromhex(self.given["server_id"])
        return bytes((0x11, len(data))) + data

    def status(self, pdu):
        """Return the exception status (07)."""
        demand(len(pdu) == 1, 3)
        return pdu + bytes.fromhex(self.given.get("exception_status", "00"))


FUNCTIONS = {
    **dict.fromkeys(("01", "02", "03", "04"), Unit.read),
    **dict.fromkeys(("05", "06"), Unit.write_one),
    **dict.fromkeys(("0F", "10"), Unit.write_many),
    **dict.fromkeys(("14", "15"), Unit.records),
    "07": Unit.status,
    "11": Unit.server_id,
    "16": Unit.mask,
    "17": Unit.exchange,
    "18": Unit.queue,
    "2B/0E": Unit.identification,
}
