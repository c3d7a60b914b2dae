"""What no rule lowers: four subjects, each with the functions that it replaces.

By place, "MODULE:NAME" or "MODULE:CLASS.METHOD": the source in its place, None if it is left out.
"""

from __future__ import annotations

PATCHES: dict[str, str | None] = {
    # 1. CRC: the table. To fold a frame as one big number takes 200 times as long where these numbers are slow.
    "barewire.rtu.crc:crc16": """
def crc16(data):
    crc = INITIAL
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc
""",
    # 2. Steps of slices that are assigned to: a loop.
    "barewire.codecs.order:_swap_bytes": """
def _swap_bytes(data):
    swapped = bytearray(data)
    for place in range(0, len(data) - 1, 2):
        swapped[place], swapped[place + 1] = data[place + 1], data[place]
    return bytes(swapped)
""",
    # 3. The shortcuts for reads of registers: they store values by the descriptors of slots, which do not exist here,
    #    and keep 252 formats in memory. Without them the general path does the same.
    "barewire.modbus.messages.registers:ReadHoldingRegisters.decode": None,
    "barewire.modbus.messages.registers:ReadHoldingRegisters.read_response": None,
    "barewire.modbus.messages.registers:ReadHoldingRegisters.answer": """
def answer(self, row):
    return self.response(row)
""",
    "barewire.modbus.messages.registers:ReadHoldingRegistersResponse.encode": """
def encode(self):
    row = self.registers
    return self.layout.pack(self.function_code, 2 * len(row), tail=from_registers(row))
""",
    # 4. The times of a line in whole microseconds. A silence is rounded up. A character is a float, since it is short.
    "barewire.rtu.frame:Timing.of": """
@classmethod
def of(cls, baudrate, bits=11):
    if baudrate <= 0:
        raise EncodeError(f"baudrate {baudrate}: expected a positive number of bits per second", "baudrate")
    if not 7 <= bits <= 12:
        raise EncodeError(f"{bits} bits per character: expected 7..12", "bits")
    character = bits * 1_000_000 / baudrate
    if baudrate > FIXED_ABOVE:
        return cls(character, FIXED_T15, FIXED_T35)
    return cls(character, -(-bits * 1_500_000 // baudrate), -(-bits * 3_500_000 // baudrate))
""",
    "barewire.rtu.frame:Timing.duration": """
def duration(self, length):
    return round(length * self.character)
""",
}
