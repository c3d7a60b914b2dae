"""`barewire send`: send the bytes of a frame as they are, and explain what comes back.

A client checks what it sends; this command does not. A frame with a wrong CRC, unit or length goes out as it was typed,
so that one can see what a device makes of it.
"""

from __future__ import annotations

import time

import click

from barewire.ascii import frame as ascii_frame
from barewire.canopen.frame import CanFrame
from barewire.errors import DecodeError, NoAnswer
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.carriers import dialer
from barewire.io.ports.can.interfaces import can_port
from barewire.rtu.frame import encode as rtu_frame
from barewire_workbench import Explanation, explain, explain_exchange
from barewire_workbench.cli.arguments import endpoint_url
from barewire_workbench.cli.output import Output, output_option
from barewire_workbench.frames.can import explain_can
from barewire_workbench.frames.input import parse_ascii, parse_hex
from barewire_workbench.recordings.candump import parse_can

_QUIET = 0.3
"""Seconds without a byte after which an answer that is not a valid frame is over. A USB adapter pauses for less."""

_LONGEST = 65536
"""Bytes that are received at most: a device that never stops sending does not fill the memory."""


@click.command("send")
@click.argument("endpoint", type=endpoint_url)
@click.argument("frame", nargs=-1, required=True, metavar="HEX")
@click.option("--crc", is_flag=True, help="Add the check of the frame: CRC (RTU), or LRC, colon and line end (ASCII).")
@output_option
def send_command(endpoint: str, frame: tuple[str, ...], crc: bool, output: Output) -> None:
    """Send the bytes of a frame as they are; explain the answer.

    Nothing is added or corrected: HEX is the whole frame with its CRC, or with its MBAP header on TCP. An ASCII frame
    is typed as it is, from the colon on; its line end is added. A CAN frame has the form of candump.

    The command waits for the answer as long as the `timeout` of ENDPOINT says. On CAN it prints all frames that it
    receives, until the answer to an SDO request or a remote frame; after other frames, during the whole time-out.
    Without an answer to a request it ends with status 1.

    \b
    barewire send rtu:///dev/ttyUSB0 "01 04 0F B1 00 02 22 F8"
    barewire send rtu:///dev/ttyUSB0 "01 04 0F B1 00 02" --crc
    barewire send ascii:///dev/ttyUSB0 ":01040FB1000239"
    barewire send tcp://127.0.0.1:1502 "00 01 00 00 00 06 01 04 0F B1 00 02"
    barewire send can://socketcan/can0 "605#4041600000000000"
    """
    place = Endpoint.parse(endpoint)
    text = " ".join(frame)
    if crc and place.framing in ("tcp", "can"):
        has = "a CAN controller adds the CRC itself" if place.framing == "can" else "a frame of Modbus TCP has no CRC"
        raise click.UsageError(f"--crc: {has}")
    try:
        if place.framing == "can":
            _send_can(place, parse_can(text), output)
        else:
            _send_bytes(place, _frame_bytes(place.framing, text, crc), output)
    except DecodeError as error:
        raise click.UsageError(error.text) from None


def _frame_bytes(framing: str, text: str, crc: bool) -> bytes:
    """Return the bytes that were typed; with `crc`, the frame around them."""
    if framing == "ascii" and not crc:
        data = parse_ascii(text)
        return data if data.endswith((b"\r\n", b"\n", b"\r")) else data + b"\r\n"
    data = parse_hex(text.strip().removeprefix(":"))
    if not data:
        raise click.UsageError(f"{text!r} has no bytes: expected hexadecimal digits")
    if crc:
        return (rtu_frame if framing == "rtu" else ascii_frame.encode)(data[0], data[1:])
    return data


def _show(output: Output, direction: str, explanation: Explanation) -> None:
    text = "\n".join([direction, *(f"  {line}" for line in explanation.lines())])
    output.show(text, {"direction": direction, **explanation.as_dict()})


# Modbus


def _send_bytes(endpoint: Endpoint, data: bytes, output: Output) -> None:
    protocol = endpoint.framing
    port = dialer(endpoint)()
    try:
        sent = explain(protocol, data)
        if sent.role == "response":
            sent = explain(protocol, data, "request")
        port.send(data)
        _show(output, "sent", sent)
        received = bytearray()
        until = time.monotonic() + endpoint.timeout
        while len(received) < _LONGEST and (wait := until - time.monotonic()) > 0:
            if chunk := port.receive(wait):
                received += chunk
                if endpoint.options.get("echo") == "1" and received.startswith(data):
                    del received[: len(data)]
                if received and explain(protocol, bytes(received), "response").valid:
                    break
                until = max(until, time.monotonic()) if not received else time.monotonic() + _QUIET
    finally:
        port.close()
    if not received:
        raise NoAnswer(f"{endpoint}: no answer within {endpoint.timeout:g} s{_why_no_answer(sent)}")
    if sent.valid:
        answer = explain_exchange(protocol, data.hex(" "), received.hex(" "))
    else:
        answer = explain(protocol, bytes(received), "response")
    _show(output, "received", answer)


def _why_no_answer(sent: Explanation) -> str:
    """Return what is to be said about a request that has no answer: it is broken, or a broadcast."""
    if not sent.valid:
        return ": what was sent is not a valid frame, and a device ignores such frames"
    units = [field.value for field in sent.fields if field.name == "unit"]
    return ": unit 0 is a broadcast, which no device answers" if sent.protocol != "tcp" and units == [0] else ""


# CAN


def _send_can(endpoint: Endpoint, frame: CanFrame, output: Output) -> None:
    expected = _answer_id(frame)
    port = can_port(endpoint)
    try:
        port.send(frame)
        _show(output, "sent", explain_can(frame))
        answered = False
        until = time.monotonic() + endpoint.timeout
        while not answered and (wait := until - time.monotonic()) > 0:
            if (received := port.receive(wait)) is None:
                continue
            answered = expected is not None and received.id == expected and not received.remote
            if answered or output.as_json:
                _show(output, "received", explain_can(received))
            else:
                output.text(f"received  {received}  {explain_can(received).verdict}")
    finally:
        port.close()
    if expected is not None and not answered:
        raise NoAnswer(f"{endpoint}: no frame {expected:03X} within {endpoint.timeout:g} s")


def _answer_id(frame: CanFrame) -> int | None:
    """Return the identifier of the answer that a frame asks for; None if it asks for none.

    >>> _answer_id(CanFrame(0x605, bytes(8))), _answer_id(CanFrame(0x000, b"\\x01\\x05"))
    (1413, None)
    """
    if frame.extended:
        return None
    if frame.remote:
        return frame.id
    return frame.id - 0x80 if 0x600 < frame.id <= 0x67F and frame.data[:1] != b"\x80" else None
