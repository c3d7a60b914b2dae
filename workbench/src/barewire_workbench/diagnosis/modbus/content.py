"""What is wrong with unit and PDU of an RTU frame whose CRC fits: the sender made them so."""

from __future__ import annotations

from collections.abc import Iterator

from barewire.modbus.messages.registry import measure_request, measure_response
from barewire_workbench.diagnosis.modbus.good import digits, good_body, missing, without_checksum
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.result import FrameRole, counted


def byte_count_form(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A response without its byte count, or with one of two bytes."""
    body, follow = data[:-2], len(data) - 4
    if role != "request" and int.from_bytes(body[2:4], "big") == follow - 2 > 0:
        right = body[:2] + body[3:]
        if (good := good_body(right, "response")) is not None:
            text = f"the byte count has two bytes, {digits(body[2:4])}; it has one"
            yield Finding("byte-count", text, f"with {digits(body[3:4])} it is {without_checksum(good)}")
    if role == "response" and 0 < follow <= 250:
        right = body[:2] + bytes((follow,)) + body[2:]
        if (good := good_body(right, role)) is not None:
            text = "the byte count is missing, also in the CRC"
            yield Finding("byte-count", text, f"with {follow:02X}h behind the function it is {without_checksum(good)}")


def left_over(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Bytes behind a whole message that are counted by the CRC."""
    body = data[:-2]
    for which, measure in (("request", measure_request), ("response", measure_response)):
        size = measure(body[1:])
        if role not in (None, which) or size is None or size + 1 >= len(body):
            continue
        rest = body[size + 1 :]
        if (good := good_body(body[: size + 1], role)) is not None:
            text = f"{counted(len(rest))} behind the PDU, {digits(rest)}, which the CRC includes"
            yield Finding("byte-extra", text, f"without {digits(rest)} it is {without_checksum(good)}")


def too_short(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A message that ends too early, with the CRC of what is there."""
    for rest in missing(data[:-2], 0, role) if len(data) > 5 else ():
        if not rest.is_least:
            text = f"{rest.text()}, but the CRC fits what is there: the sender made it so"
            yield Finding("cut-frame", text, f"the CRC of {digits(data[:-2])} is {digits(data[-2:])}")
