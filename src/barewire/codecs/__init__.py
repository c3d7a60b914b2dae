"""Values <-> bytes: width, sign, byte order, bits and text, for any protocol.

The files, in reading order:

        229.8  <----- codec("f32", "ABCD") ----->  43 65 CC CD

    order      the order of the bytes of a number    ABCD, CDAB, BADC, DCBA
    numbers    integers and floats                   u8..u64, i8..i64, f32, f64, in steps of 8 bits
    bits       single bits, rows of bits, halves     bit k of a word, a packed row of coils, half a register
    text       characters of a fixed length          encoding and padding are given, no character is lost
    layout     named fields                          a struct with names, and bit patterns like "010- nnes"
"""

from barewire.codecs.bits import (
    get_bit,
    get_field,
    get_half,
    pack_bits,
    set_bit,
    set_field,
    set_half,
    unpack_bits,
)
from barewire.codecs.layout import BitPattern, Field, Layout
from barewire.codecs.numbers import Codec, Number, Value, codec
from barewire.codecs.order import ORDERS, from_registers, reorder, to_registers
from barewire.codecs.text import Text

__all__ = [
    "Codec",
    "Number",
    "Text",
    "Value",
    "codec",
    "ORDERS",
    "reorder",
    "to_registers",
    "from_registers",
    "get_bit",
    "set_bit",
    "get_field",
    "set_field",
    "get_half",
    "set_half",
    "pack_bits",
    "unpack_bits",
    "Layout",
    "Field",
    "BitPattern",
]
