"""What goes wrong on a Modbus line or connection, as the traffic of a client that logs it: a cause makes the entries of
a log, and says which codes are right for it. Any other accusation is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random
from typing import NamedTuple

from barewire import ascii, rtu, tcp
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.rtu.crc import crc16
from barewire_workbench.diagnosis.verdict import VerdictCode
from barewire_workbench.frames.findings import DiagnosisCode
from barewire_workbench.wire import FORMATS, ReceiverFault, UartLine
from tests.workbench.diagnosis.notations import Entry

Code = DiagnosisCode | VerdictCode
UNDECIDED: frozenset[Code] = frozenset({"nothing-proved", "open", "not-seen", "no-bytes", "no-frame", "no-frames"})
"""Codes that accuse nobody."""
SILENT: frozenset[Code] = frozenset({"no-answer", "no-answers", "dead-unit", "lost-answers"})
"""What is right where an answer is missing."""
DAMAGED: frozenset[Code] = frozenset({"disturbed"})


class Exchange(NamedTuple):
    """A request and its response, each as unit and PDU."""

    unit: int
    asked: bytes
    answered: bytes


class Habit(NamedTuple):
    """A cause, and the codes that are right for it."""

    right: frozenset[Code]
    make: Callable[[Random, list[Exchange]], Iterator[Entry]]
    reads: bool = False


def exchanges(dice: Random, count: int, *, reads: bool = False) -> list[Exchange]:
    """Return reads and writes of one unit, with values that devices have."""
    unit = dice.choice((1, 1, 2, 5, 17, dice.randint(1, 247)))
    made = []
    for _ in range(count):
        address, quantity = dice.choice((0, 16, 100, dice.randrange(5000))), dice.choice((1, 2, 2, 4, 10))
        place = address.to_bytes(2, "big")
        code = dice.choice((3, 3, 4) if reads else (3, 3, 4, 6, 16))
        data = b"".join(
            dice.choice((0, dice.randrange(300), dice.randrange(0x10000))).to_bytes(2, "big") for _ in range(quantity)
        )
        if code == 6:
            made.append(Exchange(unit, bytes((6,)) + place + data[:2], bytes((6,)) + place + data[:2]))
        elif code == 16:
            head = bytes((16,)) + place + quantity.to_bytes(2, "big")
            made.append(Exchange(unit, head + bytes((2 * quantity,)) + data, head))
        else:
            asked = bytes((code,)) + place + quantity.to_bytes(2, "big")
            made.append(Exchange(unit, asked, bytes((code, 2 * quantity)) + data))
    return made


def played(
    change: Callable[[Random, Exchange, bytes, bytes], list[tuple[float, bool, bytes]]], framing: str = "rtu"
) -> Callable[[Random, list[Exchange]], Iterator[Entry]]:
    """Return the cause that changes each exchange: `change` gets the frames of request and response."""

    def make(dice: Random, made: list[Exchange]) -> Iterator[Entry]:
        now = 36000.0 + dice.randrange(10_000)
        for number, exchange in enumerate(made):
            frames = [framed(framing, exchange.unit, pdu, number + 1) for pdu in (exchange.asked, exchange.answered)]
            for after, sent, data in change(dice, exchange, *frames):
                yield Entry(now + after, sent, data)
            now += 2.0

    return make


def framed(framing: str, unit: int, pdu: bytes, number: int) -> bytes:
    """Return the frame around a PDU."""
    if framing == "tcp":
        return tcp.encode(unit, pdu, number)
    return ascii.encode(unit, pdu) if framing == "ascii" else rtu.encode(unit, pdu)


def answer(change: Callable[[Random, Exchange, bytes], bytes | None]) -> Callable[..., list[tuple[float, bool, bytes]]]:
    """Return the change of the response alone; None if there is none."""

    def changed(dice: Random, exchange: Exchange, asked: bytes, answered: bytes) -> list[tuple[float, bool, bytes]]:
        data = change(dice, exchange, answered)
        return [(0.0, True, asked), *([(0.05, False, data)] if data else [])]

    return changed


def heard(form: int = 0, **fault: int) -> Callable[..., list[tuple[float, bool, bytes]]]:
    return answer(lambda dice, _, data: UartLine(FORMATS[form], ReceiverFault(**fault)).read(data))  # type: ignore[arg-type]


def _crc(data: bytes) -> bytes:
    return crc16(data).to_bytes(2, "little")


def _split(dice: Random, exchange: Exchange, asked: bytes, answered: bytes) -> list[tuple[float, bool, bytes]]:
    at = dice.randrange(2, len(answered) - 1)
    return [(0.0, True, asked), (0.05, False, answered[:at]), (0.06, False, answered[at:])]


def _late(dice: Random, made: list[Exchange]) -> Iterator[Entry]:
    """Each response comes when the client has sent its next request."""
    now, before = 36000.0, b""
    for exchange in made:
        yield Entry(now, True, rtu.encode(exchange.unit, exchange.asked))
        if before:
            yield Entry(now + 0.05, False, before)
        before = rtu.encode(exchange.unit, exchange.answered)
        now += 1.5


def _exception(code: int) -> Callable[[Random, Exchange, bytes], bytes]:
    return lambda dice, exchange, _: rtu.encode(exchange.unit, bytes((exchange.asked[0] | EXCEPTION_BIT, code)))


def _flipped(data: bytes, at: int, bit: int) -> bytes:
    return data[:at] + bytes((data[at] ^ 1 << bit,)) + data[at + 1 :]


def _other_request(dice: Random, exchange: Exchange) -> bytes:
    return rtu.encode(exchange.unit % 247 + 1, bytes((3, 0, dice.randrange(1, 99), 0, 2)))


def _other_exchange(dice: Random, exchange: Exchange) -> tuple[bytes, bytes]:
    other = exchange.unit % 247 + 1
    return rtu.encode(other, bytes((3, 0, dice.randrange(99), 0, 2))), rtu.encode(other, b"\3\4" + dice.randbytes(4))


def _cut_before_zero(
    dice: Random, exchange: Exchange, asked: bytes, answered: bytes
) -> list[tuple[float, bool, bytes]]:
    """A response whose CRC ends with 00, without that byte."""
    size = answered[2]
    while rtu.encode(exchange.unit, answered[1:3] + (data := dice.randbytes(size)))[-1]:
        pass
    return [(0.0, True, asked), (0.05, False, rtu.encode(exchange.unit, answered[1:3] + data)[:-1])]


def _spare_bits(dice: Random, made: list[Exchange]) -> Iterator[Entry]:
    for number, exchange in enumerate(made):
        quantity = dice.randint(1, 7)
        yield Entry(36000.0 + number, True, rtu.encode(exchange.unit, bytes((1, 0, dice.randrange(99), 0, quantity))))
        yield Entry(
            36000.05 + number, False, rtu.encode(exchange.unit, bytes((1, 1, 0xFF >> dice.randrange(8 - quantity))))
        )


def _inserted(dice: Random, made: list[Exchange]) -> Iterator[Entry]:
    """A good response, and the same one with a byte inside, of which the reader takes as many bytes as before."""
    for number, exchange in enumerate(made):
        asked = rtu.encode(exchange.unit, b"\x03\0" + dice.randbytes(1) + b"\0\4")
        answered = rtu.encode(exchange.unit, b"\x03\x08" + dice.randbytes(8))
        at = dice.randrange(3, len(answered) - 4)
        for place, data in enumerate((answered, (answered[:at] + b"\xff" + answered[at:])[:-1])):
            yield Entry(36000.0 + 4 * number + 2 * place, True, asked)
            yield Entry(36000.05 + 4 * number + 2 * place, False, data)


def _enveloped(
    *, answering: int = 0x83BC50B4, inner: bytes | None = None
) -> Callable[..., list[tuple[float, bool, bytes]]]:
    """Return the traffic inside frames of Solarman V5: from this logger, which may have something else than RTU."""

    def frame(control: bytes, logger: int, inner: bytes) -> bytes:
        payload = b"\2" + bytes(14 if control == b"\x10\x45" else 13) + inner
        body = len(payload).to_bytes(2, "little") + control + b"\0\0" + logger.to_bytes(4, "little") + payload
        return b"\xa5" + body + bytes((sum(body) & 0xFF, 0x15))

    def changed(dice: Random, exchange: Exchange, asked: bytes, answered: bytes) -> list[tuple[float, bool, bytes]]:
        returned = frame(b"\x10\x15", answering, answered if inner is None else inner)
        return [(0.0, True, frame(b"\x10\x45", 0x83BC50B4, asked)), (0.05, False, returned)]

    return changed


RTU: dict[str, Habit] = {
    "in frames of Solarman V5": Habit(frozenset({"nothing-wrong"}), played(_enveloped())),
    "another logger of Solarman V5": Habit(
        frozenset({"wrong-answer", *SILENT}), played(_enveloped(answering=1, inner=b"\6\0"))
    ),
    "a logger without RTU": Habit(frozenset({"wrong-answer", *SILENT}), played(_enveloped(inner=b"\5\0"))),
    "the first byte behind the others": Habit(
        frozenset({"late-answer"}), played(answer(lambda _, __, data: data[1:] + data[:1])), reads=True
    ),
    "an exception with a byte more": Habit(
        frozenset({"byte-extra", "malformed"}),
        played(answer(lambda _, e, __: rtu.encode(e.unit, bytes((e.asked[0] | EXCEPTION_BIT, 2, 0))))),
    ),
    "in frames of another protocol": Habit(
        frozenset({"no-frame"}),
        played(
            lambda d, e, asked, answered: [
                (at, sent, bytes.fromhex("AA 5A 00 31 7F 02 11 22 33 44") + frame + b"\x66\xbb")
                for at, sent, frame in ((0.0, True, asked), (0.05, False, answered))
            ]
        ),
        reads=True,
    ),
    "good": Habit(frozenset({"nothing-wrong"}), played(answer(lambda _, __, data: data))),
    "good in pieces": Habit(frozenset({"nothing-wrong"}), played(_split)),
    "silence": Habit(SILENT, played(answer(lambda *_: None))),
    "baud rate": Habit(frozenset({"baud-rate", "disturbed", *SILENT}), played(heard(0, faster=2, slower=1))),
    "baud rate, half as fast": Habit(
        frozenset({"baud-rate", "disturbed", *SILENT}), played(heard(0, faster=1, slower=2))
    ),
    "inverted": Habit(frozenset({"inverted", "disturbed", *SILENT}), played(heard(0, inverted=True))),
    "echo and response": Habit(
        frozenset({"echo"}),
        played(lambda d, e, asked, answered: [(0, True, asked), (0.01, False, asked), (0.06, False, answered)]),
        reads=True,
    ),
    "echo and response in one piece": Habit(
        frozenset({"echo", "two-frames"}),
        played(lambda d, e, asked, answered: [(0, True, asked), (0.05, False, asked + answered)]),
        reads=True,
    ),
    "echo alone": Habit(
        frozenset({"echo", *SILENT}),
        played(lambda d, e, asked, answered: [(0, True, asked), (0.01, False, asked)]),
        reads=True,
    ),
    "zero before": Habit(
        frozenset({"noise-before", "byte-extra", "no-bias"}), played(answer(lambda _, __, data: b"\0" + data))
    ),
    "FF before": Habit(
        frozenset({"noise-before", "byte-extra", "no-bias"}), played(answer(lambda _, __, data: b"\xff" + data))
    ),
    "zero behind": Habit(
        frozenset({"noise-after", "byte-extra", "no-bias", "disturbed"}),
        played(answer(lambda _, __, data: data + b"\0")),
    ),
    "zero before, cut": Habit(
        frozenset({"noise-before", "byte-extra", "no-bias", "cut-frame", "disturbed"}),
        played(answer(lambda _, __, data: b"\0" + data[:-1])),
    ),
    "first byte lost": Habit(
        frozenset({"byte-lost", "turnaround", "disturbed", "cut-frame"}), played(answer(lambda _, __, data: data[1:]))
    ),
    "last byte lost": Habit(
        frozenset({"byte-lost", "turnaround", "disturbed", "cut-frame", "byte-count"}),  # in one of 256 the CRC fits
        played(answer(lambda _, __, data: data[:-1])),
    ),
    "half an answer": Habit(
        frozenset({"cut-frame", "disturbed", "byte-lost"}),
        played(answer(lambda _, __, data: data[: len(data) // 2 + 1])),
    ),
    "a byte lost inside": Habit(
        frozenset({"byte-lost", "disturbed", "byte-count", "cut-frame"}),
        played(answer(lambda d, __, data: (lambda at: data[:at] + data[at + 1 :])(d.randrange(2, len(data) - 2)))),
    ),
    "a bit changed": Habit(
        frozenset({"bit-flip", "disturbed", "byte-count"}),
        played(answer(lambda d, __, data: _flipped(data, d.randrange(3, len(data) - 2), d.randrange(8)))),
    ),
    "late": Habit(frozenset({"late-answer", "late-answers", *SILENT}), _late),
    "answer of another unit": Habit(
        frozenset({"wrong-answer"}), played(answer(lambda _, e, __: rtu.encode(e.unit % 247 + 1, e.answered)))
    ),
    "exception 01": Habit(frozenset({"refused"}), played(answer(_exception(1)))),
    "exception 02": Habit(frozenset({"refused", "address-base"}), played(answer(_exception(2)))),
    "exception 04": Habit(frozenset({"refused"}), played(answer(_exception(4)))),
    "exception 06": Habit(frozenset({"refused"}), played(answer(_exception(6)))),
    "exception 0B": Habit(frozenset({"refused", *SILENT}), played(answer(_exception(11)))),
    "exception without a CRC": Habit(
        frozenset({"crc-missing", "malformed", "disturbed"}),
        played(answer(lambda d, e, _: _exception(2)(d, e, b"")[:-2])),
    ),
    "CRC bytes exchanged": Habit(
        frozenset({"crc-swapped", "malformed"}), played(answer(lambda _, __, data: data[:-2] + data[:-3:-1]))
    ),
    "no CRC": Habit(frozenset({"crc-missing", "malformed"}), played(answer(lambda _, __, data: data[:-2]))),
    "another CRC": Habit(
        frozenset({"crc-kind", "malformed"}),
        played(answer(lambda _, __, data: data[:-2] + (crc16(data[:-2]) ^ 0xFFFF).to_bytes(2, "little"))),
    ),
    "a device that speaks TCP": Habit(
        frozenset({"mbap-on-serial", "wrong-protocol"}),
        played(answer(lambda _, e, __: tcp.encode(e.unit, e.answered, 0))),
    ),
    "a device that speaks ASCII": Habit(
        frozenset({"ascii-on-rtu", "wrong-protocol"}), played(answer(lambda _, e, __: ascii.encode(e.unit, e.answered)))
    ),
    "a wrong byte count": Habit(
        frozenset({"byte-count", "malformed", "wrong-answer", "cut-frame", "two-frames", "noise-after", "disturbed"}),
        played(
            answer(
                lambda _, e, data: (
                    (lambda body: body + _crc(body))(bytes((e.unit, e.answered[0], e.answered[1] + 2)) + e.answered[2:])
                    if e.answered[0] in (3, 4)
                    else data
                )
            )
        ),
        reads=True,
    ),
    "more registers than asked": Habit(
        frozenset({"wrong-answer", "malformed"}),
        played(
            answer(
                lambda _, e, data: (
                    rtu.encode(e.unit, bytes((e.answered[0], e.answered[1] + 2)) + e.answered[2:] + b"\0\0")
                    if e.answered[0] in (3, 4)
                    else data
                )
            )
        ),
        reads=True,
    ),
    "another function": Habit(
        frozenset({"wrong-answer"}),
        played(
            answer(
                lambda _, e, __: rtu.encode(
                    e.unit, bytes((7 - e.answered[0] if e.answered[0] in (3, 4) else e.answered[0],)) + e.answered[1:]
                )
            )
        ),
        reads=True,
    ),
    "another master": Habit(
        frozenset({"two-masters", "role", "wrong-answer", *SILENT}),
        played(answer(lambda d, e, __: _other_request(d, e))),
    ),
    "the last byte, 00, is lost": Habit(
        frozenset({"cut-frame", "byte-lost", "disturbed", "turnaround", *SILENT}), played(_cut_before_zero), reads=True
    ),
    "an exception without its code": Habit(
        frozenset({"cut-frame", "disturbed"}),
        played(answer(lambda _, e, __: rtu.encode(e.unit, bytes((e.asked[0] | EXCEPTION_BIT,))))),
    ),
    "digits as text": Habit(
        frozenset({"rtu-on-ascii", "disturbed", "nothing-wrong", *SILENT}),  # in Python it is how bytes are shown
        played(answer(lambda _, __, data: data.hex().encode())),
    ),
    "bits behind those asked": Habit(frozenset({"wrong-value"}), _spare_bits),
    "unit 0 is read": Habit(
        frozenset({"wrong-value"}),
        played(lambda d, e, _, __: [(0, True, rtu.encode(0, bytes((3, 0, d.randrange(9), 0, 2))))]),
    ),
    "unit 0 is read, and a unit answers": Habit(
        frozenset({"wrong-answer"}),
        played(lambda d, e, _, answered: [(0, True, rtu.encode(0, e.asked)), (0.05, False, answered)]),
        reads=True,
    ),
    "the same byte too many": Habit(frozenset({"byte-extra", "disturbed"}), _inserted),
    "another master polls": Habit(
        frozenset({"two-masters", "role", "wrong-answer", *SILENT}),
        played(
            lambda d, e, asked, _: [
                (0, True, asked),
                *((at, False, frame) for at, frame in zip((0.3, 0.35), _other_exchange(d, e))),
            ]
        ),
    ),
    "broadcast": Habit(
        frozenset({"nothing-wrong"}), played(lambda d, e, asked, answered: [(0, True, rtu.encode(0, b"\x06\0\1\0\3"))])
    ),
    "noise in place of an answer": Habit(
        frozenset({"disturbed", *SILENT}),
        played(
            answer(lambda d, __, data: bytes(d.choice((0, 0xFF, d.randrange(256))) for _ in range(d.randint(2, 9))))
        ),
    ),
}
TCP: dict[str, Habit] = {
    "good": Habit(frozenset({"nothing-wrong"}), played(answer(lambda _, __, data: data), "tcp")),
    "good in pieces": Habit(frozenset({"nothing-wrong"}), played(_split, "tcp")),
    "silence": Habit(SILENT, played(answer(lambda *_: None), "tcp")),
    "exception 02": Habit(
        frozenset({"refused", "address-base"}),
        played(answer(lambda _, e, data: data[:4] + b"\0\3" + data[6:7] + bytes((e.asked[0] | 0x80, 2))), "tcp"),
    ),
    "length of the header one too small": Habit(
        frozenset({"mbap-header", "malformed"}),
        played(answer(lambda _, __, data: data[:5] + bytes((data[5] - 1,)) + data[6:]), "tcp"),
    ),
    "length of the header too large": Habit(
        frozenset({"mbap-header", "malformed", "cut-frame", *SILENT}),
        played(answer(lambda _, __, data: data[:5] + bytes((data[5] + 3,)) + data[6:]), "tcp"),
    ),
    "length of the request": Habit(
        frozenset({"mbap-header", "malformed"}),
        played(answer(lambda _, e, data: data[:4] + b"\0\6" + data[6:] if data[5] != 6 else data), "tcp"),
        reads=True,
    ),
    "RTU in the answer": Habit(
        frozenset({"rtu-on-tcp", "wrong-protocol"}),
        played(answer(lambda _, e, __: rtu.encode(e.unit, e.answered)), "tcp"),
    ),
    "CRC behind the frame": Habit(
        frozenset({"crc-inside-mbap", "malformed", "byte-extra"}),
        played(answer(lambda _, __, data: data[:5] + bytes((data[5] + 2,)) + data[6:] + _crc(data[6:])), "tcp"),
    ),
    "another transaction": Habit(
        frozenset({"wrong-answer", *SILENT, "header-byte-order"}),
        played(answer(lambda _, __, data: b"\x12\x34" + data[2:]), "tcp"),
    ),
    "the transaction before": Habit(
        frozenset({"wrong-answer", "late-answer", *SILENT}),
        played(answer(lambda _, __, data: (int.from_bytes(data[:2], "big") - 1).to_bytes(2, "big") + data[2:]), "tcp"),
    ),
    "the header alone": Habit(
        frozenset({"cut-frame", *SILENT}), played(answer(lambda _, __, data: data[:7]), "tcp"), reads=True
    ),
    "another unit": Habit(
        frozenset({"wrong-answer", *SILENT}),
        played(answer(lambda _, e, data: data[:6] + bytes((e.unit % 247 + 1,)) + data[7:]), "tcp"),
    ),
    "cut": Habit(frozenset({"cut-frame", *SILENT}), played(answer(lambda _, __, data: data[:-2]), "tcp")),
    "another protocol": Habit(
        frozenset({"wrong-protocol", "mbap-header", *SILENT, "cut-frame"}),
        played(answer(lambda d, __, ___: b"HTTP/1.1 400 Bad Request\r\n"), "tcp"),
    ),
}
ASCII: dict[str, Habit] = {
    "good": Habit(frozenset({"nothing-wrong"}), played(answer(lambda _, __, data: data), "ascii")),
}
