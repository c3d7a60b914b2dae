"""device, an SDO server in front of the whole dictionary. How a transfer goes on is in sdo_server.py."""

from device_objects import SIZES
from sdo_blocks import COMMAND, Abort, heard, line_of, receive_blocks
from sdo_client import size_in
from sdo_server import Server

DOWNLOAD, UPLOAD, BLOCK_UPLOAD, BLOCK_DOWNLOAD = 1, 2, 5, 6
BLKSIZE = 127


class DeviceServer(Server):
    """A server whose objects are those of a dictionary."""

    def __init__(self, objects):
        super().__init__(b"", BLKSIZE)
        self.objects = objects

    def transfer(self, line):
        """Serve one transfer from its first line on; return the last lines to say."""
        command, self.place = heard(line)[0], line[1:4]
        place = f"{line[2]:02X}{line[1]:02X}:{line[3]:02X}"
        kind = command >> 5
        if kind == DOWNLOAD:
            self.objects.writable(place, None if command & 2 else size_in(line, 1))
            says = yield from self.write(line)
            size = SIZES.get(self.objects.find(place)["type"])
            value = self.value[:size] if command & 3 == 2 else self.value
            self.objects.write(place, value)
            return says
        if kind == UPLOAD:
            self.value = self.objects.read(place)
            return (yield from self.read())
        if kind == BLOCK_UPLOAD and not command & 3:
            self.value = self.objects.read(place)
            return (yield from self.read_blocks(line))
        if kind == BLOCK_DOWNLOAD and not command & 1:
            self.objects.writable(place, size_in(line, 2))
            first = line_of(0xA4, self.place, BLKSIZE)
            self.objects.write(place, (yield from receive_blocks(BLKSIZE, size_in(line, 2), command & 4, [first])))
            return [line_of(0xA1)]
        raise Abort(COMMAND)
