"""The neutral responder: a bare loop that answers SDO on a CAN bus with frames made beforehand. It uses no library.

    600h+5   an expedited upload, or a block transfer of a mebibyte     -> 580h+5   the answer
    7F0h     count, microseconds     send so many frames, 185h, with this pause after each
    7F1h     count                   receive so many frames, 205h            -> 7F2h     when all are there
                                     it begins to read after a pause, so that the sender need not wake it up each time

A frame is 16 bytes, as a raw CAN socket has it. Run as a program, it serves an inherited socket, or an interface:

    python -m bench.can_responder 7        python -m bench.can_responder vcan0
"""

from __future__ import annotations

import socket
import sys
import time
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from struct import Struct

NODE = 5
FRAME = Struct("=IB3x8s")  # struct can_frame of Linux
PAIR = Struct("<II")
SEND, COUNT, COUNTED, SENT, RECEIVED = 0x7F0, 0x7F1, 0x7F2, 0x185, 0x205
PAUSE = 0.005
VALUE = bytes(place * 7 % 251 for place in range(1 << 20))
EXPEDITED = bytes.fromhex("37 06 00 00")


def frame_of(identifier: int, data: bytes) -> bytes:
    """Return a frame as a raw CAN socket has it."""
    return FRAME.pack(identifier, len(data), data)


def _answer(data: bytes) -> bytes:
    return frame_of(0x580 + NODE, data)


def _blocks() -> list[list[bytes]]:
    """Return the segments of the value, in blocks of 127."""
    segments = [VALUE[at : at + 7].ljust(7, b"\0") for at in range(0, len(VALUE), 7)]
    blocks = []
    for start in range(0, len(segments), 127):
        numbers = range(1, len(segments[start : start + 127]) + 1)
        blocks.append([_answer(bytes([n]) + segments[start + n - 1]) for n in numbers])
    last = blocks[-1][-1][8:]
    blocks[-1][-1] = _answer(bytes([last[0] | 0x80]) + last[1:])
    return blocks


def serve(receive: Callable[[], bytes], send: Callable[[bytes], object]) -> None:
    """Answer frames until `receive` returns no bytes."""
    blocks = _blocks()
    crc = crc_hqx(VALUE, 0).to_bytes(2, "little")
    size = len(VALUE).to_bytes(4, "little")
    coming: Iterator[list[bytes]] = iter(())
    expedited = {bytes([0, 0x10, 0]): _answer(b"\x43\x00\x10\x00" + EXPEDITED)}
    block_upload, block_download = _answer(b"\xc6\0\x21\0" + size), _answer(b"\xa4\0\x21\0\x7f\0\0\0")
    uploaded = _answer(bytes([0xC1 | (-len(VALUE) % 7) << 2]) + crc + bytes(5))
    done, wrong = _answer(b"\xa1" + bytes(7)), _answer(b"\x80\0\x21\0\x04\0\x04\x05")
    request = 0x600 + NODE
    inside = segments = received = wanted = 0
    while frame := receive():
        identifier = int.from_bytes(frame[:4], sys.byteorder)
        if identifier == RECEIVED:
            received += 1
            if received == wanted:
                send(frame_of(COUNTED, b""))
        elif identifier == request:
            command = frame[8]
            if inside:
                segments += 1
                if command & 0x80 or inside == 127:
                    send(_answer(bytes([0xA2, inside, 0x7F]) + bytes(5)))
                    inside = 0 if command & 0x80 else 1
                else:
                    inside += 1
            elif command == 0x40:
                send(expedited[frame[9:12]])
            elif command & 0xE3 == 0xA0:
                coming = iter(blocks)
                send(block_upload)
            elif command in (0xA2, 0xA3):
                for segment in next(coming, [uploaded]):
                    send(segment)
            elif command & 0xE1 == 0xC0:
                inside, segments = 1, 0
                send(block_download)
            elif command & 0xE1 == 0xC1:
                whole = frame[9:11] == crc and segments == -(-len(VALUE) // 7)
                send(done if whole else wrong)
        elif identifier == COUNT:
            received, wanted = 0, PAIR.unpack(frame[8:])[0]
            time.sleep(PAUSE)
        elif identifier == SEND:
            count, pause = PAIR.unpack(frame[8:])
            due = time.perf_counter()
            for number in range(count):
                send(frame_of(SENT, number.to_bytes(8, "little")))
                due += pause * 1e-6
                if pause:
                    time.sleep(max(0.0, due - time.perf_counter()))


def patient(port: socket.socket) -> Callable[[bytes], None]:
    """Return a function that sends when there is room: a CAN interface that is full does not block."""

    def send(frame: bytes) -> None:
        while True:
            try:
                port.send(frame)
                return
            except OSError:
                time.sleep(0.0001)

    return send


def main(place: str) -> None:
    """Serve an inherited socket, or an interface."""
    if place.isdecimal():
        port = socket.socket(fileno=int(place))
        send: Callable[[bytes], object] = port.send
    else:
        port = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        port.bind((place,))
        send = patient(port)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    serve(lambda: port.recv(16), send)


if __name__ == "__main__":
    main(sys.argv[1])
