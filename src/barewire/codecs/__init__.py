"""VALUES <-> BYTES: width, sign, order, bits and text. This room has never heard of a protocol.

        229.8  <----- codec("f32", "ABCD") ----->  43 65 CC CD

Five files, five questions:

    numbers    which bits make this number?         u8..u64, i8..i64, f32, f64, and any other width of integer
    order      in which order do its bytes lie?     ABCD, CDAB, BADC, DCBA
    bits       which bit, which half?               bit k of a word, a packed row of coils, half a register
    text       which characters?                    fixed length, padding told, nothing lost in silence
    layout     which named fields, one after the other?   a struct with names, and bit patterns like "010- nnes"

I know: values and bytes.  I never know: messages, units, addresses, time.  Everybody may import me.
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
