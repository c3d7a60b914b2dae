"""`Eds`: an EDS or DCF, its text and the objects that it describes.

bytes --parse--> Eds --.objects-------> EdsObject, EdsItem
                  |  --.dictionary(5)-> ObjectDictionary of node 5
bytes <--encode---'  <-.set, .put       one line is changed
"""

from __future__ import annotations

from collections.abc import Mapping

from barewire.canopen.eds.diagnostics import Diagnostic, EdsError
from barewire.canopen.eds.document import Document
from barewire.canopen.eds.edit import set_key
from barewire.canopen.eds.lexer import decode_text
from barewire.canopen.eds.model import EdsObject, to_dictionary
from barewire.canopen.eds.reader import read_objects
from barewire.canopen.eds.value_syntax import Expression
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.errors import EncodeError


class Eds(Document):
    """An EDS or DCF. `parse` makes one of bytes, `compose` one from scratch.

    >>> lines = b"[1017]", b"ParameterName = Heartbeat  ; ms", b"DataType=0x0006", b"AccessType=rw", b"DefaultValue=0"
    >>> heartbeat = parse(b"\\n".join(lines))
    >>> heartbeat.get("1017", "parametername")
    'Heartbeat'
    >>> heartbeat.set(0x1017, 0, "DefaultValue", 1000)
    >>> heartbeat.encode()[-33:]
    b'6\\nAccessType=rw\\nDefaultValue=1000'
    >>> [str(diagnostic) for diagnostic in heartbeat.diagnostics][:1]
    ['1: not-listed: [1017]: is in none of the three lists of objects; read all the same']
    """

    __slots__ = ("_object_diagnostics", "_objects")

    def _discard_computed(self) -> None:
        super()._discard_computed()
        self._objects: dict[int, EdsObject] | None = None
        self._object_diagnostics: list[Diagnostic] = []

    def __repr__(self) -> str:
        return f"<Eds: {len(self.lines)} lines, {len(self.objects)} objects>"

    @property
    def objects(self) -> Mapping[int, EdsObject]:
        """The objects by index, including those of compact storage."""
        if self._objects is None:
            self._object_diagnostics = []
            self._objects = read_objects(self, self._object_diagnostics)
        return self._objects

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All departures from CiA 306, in the order of lines."""
        _ = self.objects  # fills `_object_diagnostics`
        return tuple(sorted({*super().diagnostics, *self._object_diagnostics}))

    def dictionary(self, node_id: int | None = None) -> ObjectDictionary:
        """The object dictionary of a node: formulas evaluated for it, each ParameterValue as the present value.

        Without `node_id`, that of [DeviceComissioning] is used. Raises EncodeError if there is none and a formula
        needs it.
        """
        return to_dictionary(self.objects.values(), self.node_id if node_id is None else node_id)

    def set(self, index: int, sub: int, key: str, value: str | Expression | None) -> None:
        """Write a key of a variable, or of one sub-index of an object.

        A value of the object's data type is written in the form of the old one (decimal or hexadecimal); a str is
        written as it is. Values and names of sub-indices made by CompactSubObj are written to their section
        [hhhhValue] or [hhhhName]; a record implied by CompactPDO is first written out. None removes the line.
        """
        described = self.objects.get(index)
        if described is None:
            raise EncodeError(f"there is no object {index:04X}h")
        set_key(self, described, described.item(sub), key, value)


def parse(data: bytes, *, strict: bool = False) -> Eds:
    """Parse the bytes of a file. Never raises, unless `strict`: then EdsError if there is any diagnostic."""
    eds = Eds(decode_text(data))
    if strict and eds.diagnostics:
        raise EdsError(eds.diagnostics)
    return eds
