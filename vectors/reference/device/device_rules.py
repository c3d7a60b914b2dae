"""device, what may be written into the objects of communication. A rule aborts, or returns False: nothing is set."""

from device_objects import RANGE, SIZES, fields, is_free
from sdo_blocks import Abort

NO_MAPPING, TOO_MANY_BITS, SAME_NODE, STATE, NO_SIGNATURE = 0x06040041, 0x06040042, 0x06040043, 0x08000022, 0x08000020
OFF = CONSUMES = 1 << 31
PRODUCES = 1 << 30
IDENTIFIER = 0x3FFFFFFF
"""With bit 29, which says that it has 29 bits."""
SAM, DAM = 0xFE, 0xFF
DUMMIES = {1: 1, 2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32}
"""The bits of the types that an RPDO may skip: their index is that of the type."""


class Rules:
    """The rules of one dictionary."""

    def __init__(self, objects):
        self.objects = objects
        objects.rules.append(self.check)

    def check(self, place, data):
        """Apply the rule of an object."""
        index, sub = (int(part, 16) for part in place.split(":"))
        value = int.from_bytes(data, "little")
        if place in ("1005:00", "1012:00"):
            return self.cob_id(place, value, PRODUCES if index == 0x1005 else CONSUMES | PRODUCES)
        if place == "1014:00" or (0x1201 <= index <= 0x127F and sub in (1, 2)):
            return self.cob_id(place, value)
        if 0x1201 <= index <= 0x127F and not 1 <= value <= 127:
            raise Abort(RANGE)
        if place == "1003:00":
            return self.demand(value == 0, RANGE)
        if index in (0x1010, 0x1011):
            return self.storage(index, sub, data)
        if index == 0x1016:
            return self.consumer(place, value)
        if place == "1019:00":
            self.demand(value != 1 and value <= 240, RANGE)
            return self.demand(not self.objects.number("1006:00", 0), STATE)
        if 0x1400 <= index <= 0x15FF or 0x1800 <= index <= 0x19FF:
            return self.communication(place, index, sub, value)
        if 0x1600 <= index <= 0x17FF or 0x1A00 <= index <= 0x1BFF:
            return self.mapping(place, index, sub, value)
        return None

    def demand(self, holds, code):
        """Abort with a code unless the condition holds."""
        if not holds:
            raise Abort(code)

    def cob_id(self, place, value, on=0):
        """An identifier changes only while its service is off: its flags `on` are 0, or, without them, bit 31 is 1."""
        before = self.objects.number(place)
        is_on = before & value & on if on else not (before | value) & OFF
        self.demand(is_free(value), RANGE)
        self.demand(not is_on or not (before ^ value) & IDENTIFIER, RANGE)

    def storage(self, index, sub, data):
        """1010h and 1011h: the signature "save" or "load" is a command and no value."""
        self.demand(data == (b"save" if index == 0x1010 else b"load"), NO_SIGNATURE)
        if index == 0x1010:
            self.objects.save(sub)
        else:
            self.objects.loads.add(sub)
        return False

    def consumer(self, place, value):
        """1016h: a node is watched by one entry only."""
        node, time = fields(value, 2, 2)
        others = [fields(self.objects.number(other), 2, 2) for other in self.objects.rows("1016") if other != place]
        self.demand(not time or all(node != used for used, its_time in others if its_time), SAME_NODE)

    def communication(self, place, index, sub, value):
        """1400h, 1800h: the COB-ID, the type, and what is fixed while the PDO is on."""
        is_receiver = index < 0x1800
        if sub == 1:
            self.cob_id(place, value)
        elif sub == 2:
            is_mpdo = self.objects.number(f"{index + 0x200:04X}:00") in (SAM, DAM)
            self.demand(not 241 <= value <= (253 if is_receiver else 251), RANGE)
            self.demand(not is_mpdo or value >= 254, RANGE)
        elif sub in (3, 6):
            self.demand(self.is_off(index), RANGE)

    def is_off(self, index):
        """Return whether a PDO is off."""
        return self.objects.number(f"{index:04X}:01") & OFF

    def mapping(self, place, index, sub, value):
        """1600h, 1A00h: first the PDO off, then the number 0, then the entries, then their number."""
        self.demand(self.is_off(index - 0x200), STATE)
        if sub:
            self.demand(self.objects.number(f"{index:04X}:00") == 0, STATE)
            self.demand(self.fits(value, "RPDO" if index < 0x1800 else "TPDO"), NO_MAPPING)
        elif value not in (0, SAM, DAM):
            self.demand(value <= 8, RANGE)
            entries = [self.objects.number(row) for row in self.objects.rows(f"{index:04X}")[:value]]
            self.demand(sum(entry % 0x100 for entry in entries) <= 64, TOO_MANY_BITS)

    def fits(self, value, direction):
        """Return whether an object exists, may be in such a PDO, and has so many bits."""
        index, sub, bits = fields(value, 2, 1, 1)
        if index in DUMMIES:
            return DUMMIES[index] == bits
        entry = self.objects.entries.get(f"{index:04X}:{sub:02X}", {})
        if entry.get("mapped") not in ("both", direction):
            return False
        return bits == (1 if entry["type"] == "BOOLEAN" else 8 * SIZES[entry["type"]])
