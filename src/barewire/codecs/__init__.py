"""Values <-> bytes: width, sign, byte order, bits and text, for any protocol.

The files, in reading order:

        229.8  <----- codec("f32", "ABCD") ----->  43 65 CC CD

    order      the order of the bytes of a number    ABCD, CDAB, BADC, DCBA
    numbers    integers and floats                   u8..u64, i8..i64, f32, f64, in steps of 8 bits
    bits       single bits, rows of bits, halves     bit k of a word, a packed row of coils, half a register
    text       characters of a fixed length          encoding and padding are given, no character is lost
    layout     named fields                          a struct with names, and bit patterns like "010- nnes"
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.codecs.bits import (
        get_bit as get_bit,
        get_field as get_field,
        get_half as get_half,
        pack_bits as pack_bits,
        set_bit as set_bit,
        set_field as set_field,
        set_half as set_half,
        unpack_bits as unpack_bits,
    )
    from barewire.codecs.layout import BitPattern as BitPattern, Field as Field, Layout as Layout
    from barewire.codecs.numbers import Codec as Codec, Number as Number, Value as Value, codec as codec
    from barewire.codecs.order import (
        ORDERS as ORDERS,
        from_registers as from_registers,
        reorder as reorder,
        to_registers as to_registers,
    )
    from barewire.codecs.text import Text as Text

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        "order": "ORDERS reorder to_registers from_registers",
        "numbers": "Codec Number Value codec",
        "bits": "get_bit set_bit get_field set_field get_half set_half pack_bits unpack_bits",
        "text": "Text",
        "layout": "Layout Field BitPattern",
    },
)
