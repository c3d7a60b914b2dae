"""Text of a fixed number of bytes. The caller chooses encoding and padding; text that does not fit is refused.

"OVERTEMP"  --Text(12)-->  4F 56 45 52 54 45 4D 50 00 00 00 00
"""

from __future__ import annotations

from barewire.codecs.numbers import Value
from barewire.errors import DecodeError, EncodeError, Reason


class Text:
    """`size` bytes of characters, filled up with `pad` at the end.

    `encoding` is the name of a Python codec. The default, latin-1, has a character for every byte, so decoding
    cannot fail. Decoding removes padding and zero bytes at the end.

    >>> Text(6).encode("ADXL").hex(" ")
    '41 44 58 4c 00 00'
    >>> Text(6).decode(bytes.fromhex("4144584C0000"))
    'ADXL'
    """

    __slots__ = ("encoding", "name", "pad", "size")

    def __init__(self, size: int, encoding: str = "latin-1", pad: bytes = b"\0") -> None:
        if size < 1 or len(pad) != 1:
            raise EncodeError(
                f"text of {size} bytes padded with {pad!r}: expected 1 byte or more, and one byte of padding"
            )
        self.name = f"text{size}"
        self.size = size
        self.encoding = encoding
        self.pad = pad

    def __repr__(self) -> str:
        return f"Text({self.size}, {self.encoding!r}, {self.pad!r})"

    def encode(self, value: Value) -> bytes:
        """Encode text as `size` bytes. Raises EncodeError if it is too long or has a character outside the encoding."""
        if not isinstance(value, str):
            raise EncodeError(f"{value!r} is not text")
        try:
            data = value.encode(self.encoding)
        except UnicodeEncodeError as error:
            character = value[error.start]
            raise EncodeError(f"character {character!r} of {value!r} is not in {self.encoding}") from None
        if len(data) > self.size:
            raise EncodeError(f"{value!r} takes {len(data)} bytes, there is room for {self.size}")
        return data.ljust(self.size, self.pad)

    def decode(self, data: bytes) -> str:
        """Decode text and remove its padding. Raises DecodeError for a wrong length or bytes outside the encoding."""
        if len(data) != self.size:
            reason: Reason = "short" if len(data) < self.size else "long"
            text = f"text takes {self.size} bytes, got {len(data)}"
            raise DecodeError(reason, data, min(len(data), self.size), text)
        try:
            return data.rstrip(self.pad + b"\0").decode(self.encoding)
        except UnicodeDecodeError as error:
            raise DecodeError("character", data, error.start, f"not {self.encoding} text") from None
