"""Searches the frame that a receiver with a wrong baud rate, or with exchanged wires, has read as other bytes.

The characters that can have been sent form a graph: from each state of the receiver, each byte that makes it deliver
the next bytes that were read. A path through the whole graph is a message that would be read so. Bits that no sample
fell on could have had both values:

    sent at 9600       01              03              00 ...
    read at 19200      06              1E              00 ...
    also read so       81, C1 ...      83 ...          80, C0 ...

The search takes these bits as 0 first, and then in all bytes but `UNLIKELY` ones, since frames are full of small
numbers. It follows the paths on which unit, function code and length are those of a Modbus message. Its last two bytes
are given by its CRC, which is the proof: of the messages that are tried, one in 65,536 would fit by chance.
"""

from __future__ import annotations

from collections.abc import Iterator
from heapq import heappop, heappush

from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire.rtu.frame import SHORTEST
from barewire_workbench.diagnosis.good import HIGHEST_UNIT, good_rtu, proof_of
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.result import FrameRole
from barewire_workbench.wire import FORMATS, CharacterFormat, Receiver, ReceiverFault, UartLine

RATIOS = ((2, 1), (3, 2), (4, 1))
"""How much faster the receiver is than the sender: what the usual baud rates have as quotients.

A receiver that is slower misses whole bits, and too many frames fit what it has read. So do they if it is still faster:
it reads two or three bits of each character and then waits for the next edge.
"""

_FORMATS = FORMATS[:3]
"""Without 8N2, which hardly any device has; and with exchanged wires, where the search takes longest, without 8O1."""

FAULTS = tuple(
    fault
    for resyncs in (False, True)
    for fault in (
        *(ReceiverFault(*ratio, resyncs=resyncs) for ratio in RATIOS),
        ReceiverFault(inverted=True, resyncs=resyncs),
    )
)

UNLIKELY = 5
"""So many bytes of a frame may have a 1 among the bits that the receiver did not see. The CRC does not count."""

_SHORTEST_HEARD, _LONGEST_HEARD = 4, 32
"""Bytes: in a longer input too many bits were not seen for a proof."""

_ALTERNATIVES = 2
"""So many of the frames that fit are in a proof."""

_MOST_STEPS, _MOST_INVERTED = 4000, 3000
"""A search ends after so many bytes tried: what can be read in thousands of ways proves nothing. With exchanged wires
any bytes have many readings, and the frames of few bytes are found first."""

_State = tuple[Receiver, int]
"""A receiver, and the number of bytes that it has delivered."""


class _Search:
    def __init__(self, heard: bytes, line: UartLine) -> None:
        self.heard, self.line = heard, line
        self._next: dict[_State, dict[int, _State]] = {}

    def next(self, state: _State) -> dict[int, _State]:
        """Return the bytes that can be sent next, each with the state after it; the fewest 1s come first."""
        if state not in self._next:
            receiver, count = state
            ways = self.line.characters(receiver, self.heard[count:])
            onward = {byte: (after, count + more) for byte, (after, more) in ways.items()}
            self._next[state] = {byte: onward[byte] for byte in sorted(onward, key=_number_of_ones)}
        return self._next[state]

    def frames(self) -> Iterator[tuple[int, bytes]]:
        """Yield the frames whose CRC fits, each with the number of its unlikely bytes, those with the fewest first."""
        paths: list[tuple[int, int, bytes, _State]] = [(0, 0, b"", (self.line.idle, 0))]
        for _ in range(_MOST_INVERTED if self.line.fault.inverted else _MOST_STEPS):
            if not paths:
                return
            unlikely, _, sent, state = heappop(paths)
            measured = (measure_request(sent[1:]), measure_response(sent[1:])) if len(sent) > 1 else (1,)
            sizes = {size + 3 for size in measured if size is not None and size + 3 >= len(sent) + 2}
            sizes = {size for size in sizes if self._can_be_heard(sent, size - len(sent), len(self.heard) - state[1])}
            if len(sent) + 2 in sizes:
                yield from ((unlikely, frame) for frame in self._closed(state, sent))
            for place, (byte, after) in enumerate(self.next(state).items()) if sizes else ():
                cost = unlikely + (place > 0)
                if cost <= UNLIKELY and (sent or 0 < byte <= HIGHEST_UNIT):
                    heappush(paths, (cost, -len(sent), sent + bytes((byte,)), after))

    def _can_be_heard(self, sent: bytes, to_send: int, to_hear: int) -> bool:
        """Return whether so many bytes to be sent can be read as so many bytes.

        A character is read in at least 9 bits of the receiver, and each character that is sent has an edge, so that the
        receiver waits for at most one. As long as the byte count was not sent, there may be more to send.
        """
        bits, ratio = self.line.form.bits, self.line.fault.faster / self.line.fault.slower
        is_final = len(sent) > 10 or (len(sent) > 2 and (sent[1] < 0x07 or sent[1] & EXCEPTION_BIT))
        most, least = to_send * bits * ratio / 9 + 2, to_send * bits / (bits + 1 + 10 / ratio) - 2
        return least <= to_hear and (not is_final or to_hear <= most or len(sent) < 2)

    def _closed(self, state: _State, sent: bytes) -> Iterator[bytes]:
        """Yield the frame if its CRC can have been sent, and the receiver would read nothing else."""
        frame = sent + crc16(sent).to_bytes(2, "little")
        for byte in frame[-2:]:
            if byte not in self.next(state):
                return
            state = self.next(state)[byte]
        if self.heard[state[1] :] == self.line.silence(state[0]) and len(frame) >= SHORTEST:
            yield frame


def _number_of_ones(byte: int) -> tuple[int, int]:
    return byte.bit_count(), byte


def sent_frames(
    heard: bytes, form: CharacterFormat, fault: ReceiverFault, reader: CharacterFormat | None = None
) -> list[tuple[int, bytes]]:
    """Return the frames that are read as `heard`, those with the fewest unlikely bytes first. `reader` is the format
    that the receiver expects, if it is another one.

    >>> heard = bytes.fromhex("06 1E 00 00 00 98 80 66 E6 F8")
    >>> [(unlikely, frame.hex(" ")) for unlikely, frame in sent_frames(heard, FORMATS[0], ReceiverFault(faster=2))]
    [(0, '01 03 00 00 00 0a c5 cd')]
    """
    line = UartLine(form, fault, reader)
    return sorted(set(_Search(heard, line).frames()))


def misread(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Read the bytes at the other baud rates, and with exchanged wires, in each format of a character."""
    if not _SHORTEST_HEARD <= len(data) <= _LONGEST_HEARD:
        return
    found: list[tuple[int, Finding]] = []
    for fault in FAULTS:
        frames: dict[bytes, tuple[int, CharacterFormat]] = {}
        # With exchanged wires the silence before the frame is a break, which is read as 00.
        heard = data[1:] if fault.inverted and data[0] == 0 else data
        for form in _FORMATS[:2] if fault.inverted else _FORMATS:
            for unlikely, frame in sent_frames(heard, form, fault):
                if frame not in frames or frames[frame][0] > unlikely:
                    frames[frame] = unlikely, form
        fits = [(*frames[frame], proof_of(frame, good)) for frame in frames if (good := good_rtu(frame, role))]
        fits.sort(key=lambda fit: fit[0])
        if fits:
            proof = "; or ".join(text for _, _, text in fits[:_ALTERNATIVES])
            found.append((fits[0][0], _finding(fault, fits[0][1], proof)))
    found.sort(key=lambda pair: pair[0])
    yield from (finding for _, finding in found)


def misread_parity(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Read the bytes as those of a sender without a parity bit, which the receiver expects: it takes the stop bit for
    the parity bit, and the start bit of the next character for the stop bit, so that it misses that character."""
    if not _SHORTEST_HEARD <= len(data) <= _LONGEST_HEARD:
        return
    fits = [
        proof_of(frame, good)
        for _, frame in sent_frames(data, FORMATS[0], ReceiverFault(), FORMATS[1])
        if (good := good_rtu(frame, role)) is not None
    ]
    if fits:
        text = "the sender has no parity bit (8N1), and the reader expects one (8E1 or 8O1)"
        yield Finding("parity", text, f"sent so, {'; or '.join(fits[:_ALTERNATIVES])}")


def _finding(fault: ReceiverFault, form: CharacterFormat, proof: str) -> Finding:
    if fault.inverted:
        text = f"every level is read as the other one ({form}): the two wires are exchanged"
        return Finding("inverted", text, f"sent so, {proof}")
    times = {(3, 2): "one and a half times", (2, 1): "twice"}.get((fault.faster, fault.slower), f"{fault.faster} times")
    return Finding("baud-rate", f"the reader has {times} the baud rate of the sender ({form})", f"sent so, {proof}")
