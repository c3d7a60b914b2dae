"""device, RPDOs: taken at once or at the next SYNC; and MPDOs, for one object each (DAM, SAM)."""

from device_objects import SIZES, fields
from device_pdo import EVENT, Pdo
from device_rules import DAM, SAM
from sdo_blocks import Abort


class Rpdo(Pdo):
    """A PDO that is received."""

    def start(self):
        """Begin: nothing has come."""
        self.held, self.deadline = None, None

    enter = start

    def changed(self, place):
        """The value of an object has changed, which is no concern of it."""

    def due(self):
        """Return when its event timer is over."""
        return self.deadline if self.device.state == "operational" else None

    def act(self, now):
        """The event timer is over."""
        self.deadline = None
        self.device.errors.occur((self.index, 0x8250), 0x8250, self.index.to_bytes(2, "little"))

    def hear(self, data, now):
        """Take its frame."""
        if self.device.state != "operational" or not self.is_on():
            return
        errors, is_mpdo = self.device.errors, self.count() in (SAM, DAM)
        wanted = 8 if is_mpdo else (sum(bits for _, bits in self.mapped()) + 7) // 8
        sizes = bytes([len(data), wanted])
        if len(data) < wanted:
            errors.occur((self.index, 0x8210), 0x8210, sizes)
            return
        if len(data) > wanted:
            errors.occur((self.index, 0x8220), 0x8220, sizes)
        else:
            for code in (0x8210, 0x8220, 0x8250):
                errors.end((self.index, code))
        if self.parameter(5):
            self.deadline = now + 1000 * self.parameter(5)
        if self.parameter(2) in EVENT:
            self.store(data)
        elif self.device.sync.is_in_window(now):
            self.held = data

    def sync(self, counter):
        """A SYNC has come: what was held takes effect."""
        if self.held is not None:
            data, self.held = self.held, None
            self.store(data)

    def store(self, data):
        """Write the values of a frame."""
        if self.count() in (SAM, DAM):
            self.store_one(data)
            return
        row = int.from_bytes(data, "little")
        for place, bits in self.mapped():
            if place in self.objects.entries:
                size = SIZES[self.objects.entries[place]["type"]]
                self.put(place, (row & (1 << bits) - 1).to_bytes(size, "little"))
            row >>= bits

    def put(self, place, value):
        """Write one value; return whether the dictionary takes it."""
        try:
            self.objects.write(place, value)
        except Abort:
            return False
        return True

    def store_one(self, data):
        """Write the object of an MPDO: the addressed one (DAM), or that of the dispatcher list (SAM)."""
        is_dam, node = divmod(data[0], 0x80)
        index, sub = int.from_bytes(data[1:3], "little"), data[3]
        if is_dam != (self.count() == DAM):
            return
        if is_dam and node in (0, self.device.node):
            self.store_at(index, sub, data)
        for row in self.objects.rows("1FD0") if not is_dam else ():
            block, own, own_sub, its_index, first, its_node = fields(self.objects.number(row), 1, 2, 1, 2, 1, 1)
            if (its_index, its_node) == (index, node) and first <= sub < first + block:
                self.store_at(own, own_sub + sub - first, data)

    def store_at(self, index, sub, data):
        """Write the value of an MPDO; an object that cannot be written is an error."""
        place = f"{index:04X}:{sub:02X}"
        size = SIZES.get(self.objects.entries.get(place, {}).get("type"), 0)
        if index >= 0x2000 and size and self.put(place, data[4 : 4 + size]):
            self.device.errors.end((self.index, 0x8230))
        else:
            self.device.errors.occur((self.index, 0x8230), 0x8230, index.to_bytes(2, "little") + bytes([sub]))
