"""device, what its PDOs have in common: the communication parameters, and the mapped objects."""

from device_objects import fields
from device_rules import OFF

EVENT = (254, 255)
"""The transmission types of an event; those below wait for SYNC or a request."""


class Pdo:
    """What both directions have in common: the parameters, the mapped objects."""

    def __init__(self, device, index):
        self.device, self.objects, self.index = device, device.objects, index
        self.start()

    def parameter(self, sub, default=0):
        """Return a communication parameter."""
        return self.objects.number(f"{self.index:04X}:{sub:02X}", default)

    def is_on(self):
        """Return whether it is on."""
        return not self.parameter(1) & OFF

    def count(self):
        """Return the number of mapped objects, or what kind of MPDO it is."""
        return self.objects.number(f"{self.index + 0x200:04X}:00", 0)

    def mapped(self):
        """Return place and bits of each mapped object."""
        rows = self.objects.rows(f"{self.index + 0x200:04X}")[: self.count()]
        entries = [fields(self.objects.number(row), 2, 1, 1) for row in rows]
        return [(f"{index:04X}:{sub:02X}", bits) for index, sub, bits in entries]
