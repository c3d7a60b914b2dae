"""device, TPDOs: sent at a change, by a timer, at a SYNC, or on request; and the MPDOs of a producer (SAM)."""

from device_objects import fields
from device_pdo import EVENT, Pdo
from device_rules import PRODUCES, SAM

NO_REMOTE = PRODUCES
"""Bit 30 of the COB-ID of a TPDO: remote frames are not answered."""


class Tpdo(Pdo):
    """A PDO that is sent."""

    def start(self):
        """Begin: operational is an event."""
        self.syncs, self.pending, self.sent_at, self.sampled, self.waits = 0, [], None, None, True

    def enter(self):
        """The device has become operational."""
        self.start()
        for place in self.places():
            self.event(place)

    def places(self):
        """Return the objects that it sends."""
        if self.count() != SAM:
            return [place for place, _ in self.mapped()][:1]
        return [place for place in self.objects.entries if self.scanned(place)]

    def scanned(self, place):
        """Return whether the scanner list has an object: block, index, sub-index."""
        index, sub = (int(part, 16) for part in place.split(":"))
        rows = [fields(self.objects.number(row), 1, 2, 1) for row in self.objects.rows("1FA0")]
        return any(its_index == index and first <= sub < first + block for block, its_index, first in rows)

    def changed(self, place):
        """The value of an object has changed."""
        is_mine = self.scanned(place) if self.count() == SAM else place in dict(self.mapped())
        if self.device.state == "operational" and is_mine:
            self.event(place)

    def event(self, place):
        """Something has happened that the PDO tells: at once, after the inhibit time, or at the next SYNC."""
        if not self.is_on() or self.parameter(2) not in (0, *EVENT):
            return
        self.pending = [*(one for one in self.pending if one != place), place] if self.count() == SAM else [place]
        if self.parameter(2):
            self.act(self.device.now)

    def due(self):
        """Return when it is sent next, by the inhibit time or the event timer."""
        if self.device.state != "operational" or not self.is_on() or self.parameter(2) not in EVENT:
            return None
        if self.pending:
            return max(self.device.now, self.free_at())
        if self.parameter(5) and self.sent_at is not None:
            return self.sent_at + 1000 * self.parameter(5)
        return None

    def free_at(self):
        """Return when the inhibit time is over."""
        return 0 if self.sent_at is None else self.sent_at + 100 * self.parameter(3)

    def act(self, now):
        """Send it if the inhibit time is over."""
        if self.free_at() <= now:
            self.send()

    def send(self, data=None):
        """Send the values of now, or those that were sampled."""
        for place in self.pending or [None]:
            content = self.data(place) if data is None else data
            if content:
                self.device.say(self.parameter(1), content)
        self.pending, self.sent_at = [], self.device.now

    def data(self, place):
        """Return its bytes."""
        if self.count() == SAM:
            index, sub = (bytes.fromhex(part)[::-1] for part in place.split(":"))
            return bytes([self.device.node]) + index + sub + self.objects.values[place].ljust(4, b"\0")
        row = at = 0
        for mapped, bits in self.mapped():
            value = int.from_bytes(self.objects.values.get(mapped, b""), "little")
            row |= (value & (1 << bits) - 1) << at
            at += bits
        return row.to_bytes((at + 7) // 8, "little")

    def sync(self, counter):
        """A SYNC has come."""
        kind = self.parameter(2)
        if self.device.state != "operational" or not self.is_on() or kind in EVENT:
            return
        if kind == 252:
            self.sampled = self.data(None)
        elif kind == 0 and self.pending:
            self.send()
        elif 1 <= kind <= 240:
            start = self.parameter(6) if counter is not None else 0
            self.waits = self.waits and start not in (0, counter)
            self.syncs += not self.waits
            if self.syncs == kind:
                self.syncs = 0
                self.send()

    def request(self):
        """A remote frame has come: 252 sends what it has sampled, 253 the values of now."""
        if self.device.state != "operational" or not self.is_on() or self.parameter(1) & NO_REMOTE:
            return
        if self.parameter(2) == 253 or (self.parameter(2) == 252 and self.sampled is not None):
            self.send(self.sampled if self.parameter(2) == 252 else None)
