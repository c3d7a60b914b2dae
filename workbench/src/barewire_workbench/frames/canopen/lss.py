"""LSS messages, field by field: the services that set the node-ID and bit rate of a device.   [CiA 305]

    7E5h   | service | 7 bytes, numbers little-endian, unused 0 |      master -> device
    7E4h   | service | 7 bytes                                  |      device -> master

`canopen.lss` defines the services and their directions; this file has the names of the fields and of their values.
"""

from __future__ import annotations

from barewire.canopen.lss.messages import (
    AUTOMATIC_BIT_RATE,
    BEGIN,
    LSS_ANSWERS,
    LSS_BIT_RATES,
    LSS_REQUESTS,
    UNCONFIGURED,
    Fastscan,
    LssAddress,
    LssService,
    LssState,
)
from barewire.codecs import Field, Layout
from barewire.errors import DecodeError
from barewire_workbench.frames.result import FrameRole, fill_gaps

_PARTS = {"vendor": "vendor-ID", "product": "product code", "revision": "revision", "serial": "serial number"}
"""The four numbers of an LSS address: field of `LssAddress` -> name in the standard."""

_PART = {number: _PARTS[name] for number, name in enumerate(LssAddress._fields)}
_LIMITS = (_PART[0], _PART[1], _PART[2], _PART[2], _PART[3], _PART[3])
_RESULT = Layout("<BB", "result", "details")
_NUMBER = {name: Layout("<I", name) for name in _PARTS.values()}

_TITLES: dict[LssService, str] = {
    LssService.SWITCH_GLOBAL: "switch state global",
    LssService.CONFIGURE_NODE: "configure node-ID",
    LssService.CONFIGURE_BIT_TIMING: "configure bit timing",
    LssService.ACTIVATE_BIT_TIMING: "activate bit timing",
    LssService.STORE: "store configuration",
    **{LssService(LssService.SELECT_VENDOR + k): f"switch state selective: {name}" for k, name in _PART.items()},
    LssService.SELECTED: "switch state selective: selected",
    LssService.IDENTIFY_VENDOR: "identify device: vendor-ID",
    LssService.IDENTIFY_PRODUCT: "identify device: product code",
    LssService.IDENTIFY_REVISION_LOW: "identify device: revision, lowest",
    LssService.IDENTIFY_REVISION_HIGH: "identify device: revision, highest",
    LssService.IDENTIFY_SERIAL_LOW: "identify device: serial number, lowest",
    LssService.IDENTIFY_SERIAL_HIGH: "identify device: serial number, highest",
    LssService.IDENTIFY_UNCONFIGURED: "identify devices without a node-ID",
    LssService.IDENTIFIED: "identify device: identified",
    LssService.UNCONFIGURED_IDENTIFIED: "identify devices without a node-ID: identified",
    LssService.FASTSCAN: "fastscan",
    **{LssService(LssService.INQUIRE_VENDOR + k): f"inquire {name}" for k, name in _PART.items()},
    LssService.INQUIRE_NODE: "inquire node-ID",
}
_SCAN = Layout("<IBBB", "number", "bit check", "LSS sub", "LSS next")
assert _SCAN.size == Fastscan.layout.size

_REQUEST_LAYOUTS: dict[LssService, Layout] = {
    LssService.SWITCH_GLOBAL: Layout("<B", "mode"),
    LssService.CONFIGURE_NODE: Layout("<B", "node-ID"),
    LssService.CONFIGURE_BIT_TIMING: Layout("<BB", "table", "entry"),
    LssService.ACTIVATE_BIT_TIMING: Layout("<H", "delay"),
    **{LssService(LssService.SELECT_VENDOR + k): _NUMBER[name] for k, name in _PART.items()},
    **{LssService(LssService.IDENTIFY_VENDOR + k): _NUMBER[name] for k, name in enumerate(_LIMITS)},
    LssService.FASTSCAN: _SCAN,
}
_RESPONSE_LAYOUTS: dict[LssService, Layout] = {
    LssService.CONFIGURE_NODE: _RESULT,
    LssService.CONFIGURE_BIT_TIMING: _RESULT,
    LssService.STORE: _RESULT,
    **{LssService(LssService.INQUIRE_VENDOR + k): _NUMBER[name] for k, name in _PART.items()},
    LssService.INQUIRE_NODE: Layout("<B", "node-ID"),
}


def explain_lss(data: bytes, role: FrameRole) -> tuple[list[Field], DecodeError | None, str]:
    """Return fields, error and summary of an LSS frame. Never raises.

    >>> explain_lss(bytes.fromhex("1105000000000000"), "request")[2]
    'configure node-ID'
    """
    if not data:
        return [], DecodeError("short", data, 0, "the service is byte 0, but the frame is empty"), ""
    if data[0] not in (LSS_REQUESTS if role == "request" else LSS_ANSWERS):
        error = DecodeError("function", data, 0, f"{data[0]:02X}h is not a service of an LSS {role}")
        return fill_gaps([Field(0, 1, "service", data[0], "unknown")], len(data)), error, "unknown service"
    service = LssService(data[0])
    title = _TITLES[service]
    fields = [Field(0, 1, "service", data[0], title)]
    layout = (_REQUEST_LAYOUTS if role == "request" else _RESPONSE_LAYOUTS).get(service)
    end = 1
    for field in [] if layout is None else layout.fields(data[1:], 1):
        value = int.from_bytes(data[field.offset : field.offset + field.length], "little")
        fields.append(field._replace(value=value, meaning=_value_text(service, field.name, value)))
        end = field.offset + field.length
    if layout is not None and end < 1 + layout.size:
        missing = layout.names[len(fields) - 1]
        return fill_gaps(fields, len(data), missing), None, title
    if end < len(data):
        fields.append(Field(end, len(data) - end, "reserved", data[end:].hex(" ").upper()))
    return fields, None, title


def _value_text(service: LssService, name: str, value: int) -> str:
    match name:
        case "mode":
            return LssState(value).name.lower() if value in tuple(LssState) else "not defined"
        case "node-ID":
            return "no node-ID yet" if value == UNCONFIGURED else "" if 1 <= value <= 127 else "expected 1..127"
        case "result":
            return {0: "done", 0xFF: "failed, see details"}.get(value, "refused")
        case "delay":
            return "ms before the change, and the same again after it"
        case "entry" if value in LSS_BIT_RATES:
            return f"{LSS_BIT_RATES[value] // 1000} kbit/s"
        case "entry":
            return "detected by the device" if value == AUTOMATIC_BIT_RATE else "reserved"
        case "bit check" if value == BEGIN:
            return "the start: all devices without a node-ID answer"
        case "LSS sub" | "LSS next" if value in _PART:
            return _PART[value]
    return ""
