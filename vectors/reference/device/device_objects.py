"""device, the object dictionary: values by "index:sub-index", access, lengths, limits, what a reset restores."""

import struct

from can_frames import RESTRICTED
from sdo_blocks import NO_OBJECT, TOO_LONG, TOO_SHORT, Abort
from texts import octets

NO_SUB, WRITE_ONLY, READ_ONLY = 0x06090011, 0x06010001, 0x06010002
RANGE, ABOVE, BELOW, NO_DATA = 0x06090030, 0x06090031, 0x06090032, 0x08000024
SIZES = {"BOOLEAN": 1, "REAL32": 4, "REAL64": 8, "TIME_OF_DAY": 6, "TIME_DIFFERENCE": 6}
SIZES |= {f"{sign}{bits}": bits // 8 for sign in ("INTEGER", "UNSIGNED") for bits in range(8, 65, 8)}
ALWAYS = ("1000:00", "1001:00", "1018:01")


def number_of(kind, data):
    """Return the number in the bytes of a value."""
    if kind.startswith("REAL"):
        return struct.unpack("<f" if kind == "REAL32" else "<d", data)[0]
    return int.from_bytes(data, "little", signed=kind.startswith("INTEGER"))


def bytes_of(kind, text):
    """Return the bytes of a value as the case writes it."""
    if kind == "VISIBLE_STRING":
        return text.encode("latin-1")
    if kind == "UNICODE_STRING":
        return text.encode("utf-16-le")
    if kind.startswith("REAL"):
        return struct.pack("<f" if kind == "REAL32" else "<d", float(text))
    if kind in ("DOMAIN", "OCTET_STRING", "TIME_OF_DAY", "TIME_DIFFERENCE"):
        return octets(text)
    return int(text).to_bytes(SIZES[kind], "little", signed=kind.startswith("INTEGER"))


def fields(value, *sizes):
    """Split a number into numbers of so many bytes, the highest first: 20000108h, 2, 1, 1 -> 2000h, 1, 8."""
    data, found = value.to_bytes(sum(sizes), "big"), []
    for size in sizes:
        found.append(int.from_bytes(data[:size], "big"))
        data = data[size:]
    return found


def is_free(entry):
    """Return whether an entry names an identifier that a service may have."""
    if entry >> 29 & 1:
        return True
    identifier = entry % (1 << 29)
    return identifier <= 0x7FF and not any(first <= identifier <= last for first, last in RESTRICTED)


class Objects:
    """The dictionary. `rules` check what is written, `changed` is told of it."""

    def __init__(self, given):
        self.entries = {place: {"type": "UNSIGNED32", "access": "ro", "value": "0"} for place in ALWAYS}
        self.entries["1001:00"]["type"] = "UNSIGNED8"
        self.entries |= {entry["object"]: entry for entry in given}
        for place in sorted(self.entries, reverse=True):
            index, sub = place.split(":")
            if sub != "00":
                highest = {"type": "UNSIGNED8", "access": "ro", "value": str(int(sub, 16))}
                self.entries.setdefault(f"{index}:00", highest)
        self.defaults = {place: bytes_of(entry["type"], entry["value"]) for place, entry in self.entries.items()}
        self.values, self.stored, self.loads = dict(self.defaults), {}, set()
        self.rules, self.changed = [], []

    def number(self, place, default=None):
        """Return the number of an object, the default one if there is no such object."""
        return number_of(self.entries[place]["type"], self.values[place]) if place in self.entries else default

    def rows(self, index):
        """Return the places of the sub-indices of a record, from 01 on."""
        return sorted(place for place in self.entries if place[:4] == index and place[5:] != "00")

    def find(self, place):
        """Return an entry. Abort if it does not exist."""
        if place in self.entries:
            return self.entries[place]
        index = place.split(":")[0]
        raise Abort(NO_SUB if any(one.startswith(index) for one in self.entries) else NO_OBJECT)

    def read(self, place):
        """Return what a client reads."""
        if self.find(place)["access"] == "wo":
            raise Abort(WRITE_ONLY)
        if place in self.rows("1003")[self.number("1003:00", 0) :]:
            raise Abort(NO_DATA)
        return self.values[place]

    def writable(self, place, size=None):
        """Abort if a client cannot write an object, or not so many bytes."""
        entry = self.find(place)
        if entry["access"] in ("ro", "const"):
            raise Abort(READ_ONLY)
        wanted = SIZES.get(entry["type"])
        if None not in (size, wanted) and size != wanted:
            raise Abort(TOO_LONG if size > wanted else TOO_SHORT)

    def write(self, place, data):
        """Check and set what a client or a PDO has written."""
        self.writable(place, len(data))
        entry = self.entries[place]
        if "low" in entry and number_of(entry["type"], data) < float(entry["low"]):
            raise Abort(BELOW)
        if "high" in entry and number_of(entry["type"], data) > float(entry["high"]):
            raise Abort(ABOVE)
        if entry["type"] == "BOOLEAN" and data[0] > 1:
            raise Abort(RANGE)
        if all(rule(place, data) is not False for rule in self.rules):
            self.put(place, data)

    def put(self, place, data):
        """Set a value, and tell who it concerns."""
        before, self.values[place] = self.values[place], data
        for tell in self.changed:
            tell(place, before != data)

    def save(self, part):
        """Remember the values of a part of the dictionary."""
        self.loads.discard(part)
        self.stored |= {place: value for place, value in self.values.items() if in_part(place, part)}

    def restore(self, last):
        """Return to the stored values and the defaults, up to an index."""
        for part in self.loads:
            self.stored = {place: value for place, value in self.stored.items() if not in_part(place, part)}
        self.loads = set()
        self.values |= {
            place: self.stored.get(place, value) for place, value in self.defaults.items() if place[:4] <= last
        }


def in_part(place, part):
    """Return whether an object belongs to a part of 1010h: all, communication, application."""
    first, last = {1: ("1000", "9FFF"), 2: ("1000", "1FFF"), 3: ("6000", "9FFF")}[part]
    return first <= place[:4] <= last
