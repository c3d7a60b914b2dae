"""barewire: Modbus (RTU, ASCII, TCP) and CANopen in pure Python, from the first bit of a CRC to a named value.

The map. Which room for which question:

    barewire.codecs     value <-> bytes: which bits make this number?
    barewire.modbus     the letter: what does a Modbus message say, whatever carries it?
    barewire.rtu        the envelope ended by silence or by count: CRC-16, character times
    barewire.ascii      the envelope ended by CR LF: LRC, hexadecimal
    barewire.tcp        the envelope ended by a length: MBAP
    barewire.canopen    CAN frames and what CANopen says with them: NMT, SDO, PDO, heartbeat
    barewire.devices    meaning: names, units, scales, places; the three machines and their simulators
    barewire.explain    any frame, field by field, in words
    barewire.io     the only room with clocks and sockets: blocking, asyncio, serial ports, TCP, CAN buses
    barewire.cli        the command `barewire`

Rooms are loaded when you enter them: `import barewire` costs nothing.
"""

__version__ = "0.1.0"
