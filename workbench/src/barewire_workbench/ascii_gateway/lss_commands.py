"""The LSS commands of the gateway, executed by the LSS master.   [CiA 309-3, LSS; CiA 305]

        [1] lss_switch_sel 0x1 0x2 0x3 0x4     the device with this address to configuration: OK, or ERROR:103
        [2] lss_set_node 7                     OK, or ERROR:502
        [3] lss_store                          OK, or ERROR:504, 505
        [4] lss_switch_glob 0                  back to waiting: OK
        [5] _lss_fastscan                      0x00000001 0x00000002 0x00000003 0x00000004
        [6] lss_allnodes 100 9 0               # node 9: 0x00000001 ... | # 1 found | OK

A service without a response ends with ERROR:103, except the global ones, which have no response.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import NODE_MAX
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.master import (
    LSS_TIMEOUT,
    activate_bit_timing,
    assign_node_ids,
    configure_bit_timing,
    configure_node,
    fastscan,
    identify_slaves,
    identify_unconfigured,
    inquire_address,
    inquire_node,
    switch_global,
    switch_selective,
)
from barewire.canopen.lss.messages import UNCONFIGURED, LssAddress, LssRefused, LssService, LssState
from barewire.conversation import Conversation
from barewire_workbench.ascii_gateway.lines import GatewayCode, GatewayError

_ERROR_CODES = {
    (LssService.CONFIGURE_NODE, 1): GatewayCode.LSS_NODE_ID,
    (LssService.CONFIGURE_BIT_TIMING, 1): GatewayCode.LSS_BIT_RATE,
    (LssService.STORE, 1): GatewayCode.LSS_STORING,
    (LssService.STORE, 2): GatewayCode.LSS_MEDIA,
}


def error_code(refused: LssRefused) -> GatewayCode:
    """Return the gateway's error code for a refusal of an LSS device."""
    return _ERROR_CODES.get((refused.service, refused.code), GatewayCode.LSS_ERROR)


def switch_all(configuration: int) -> Conversation[CanFrame, None]:
    """lss_switch_glob: switch all devices to configuration, or to waiting."""
    return switch_global(LssState(configuration))


def switch_one(vendor: int, product: int, revision: int, serial: int) -> Conversation[CanFrame, None]:
    """lss_switch_sel: switch the device with this address to configuration."""
    if not (yield from switch_selective(LssAddress(vendor, product, revision, serial))):
        raise GatewayError(GatewayCode.TIME_OUT, "no device with this address answered")


def set_node(node: int) -> Conversation[CanFrame, None]:
    """lss_set_node: set the pending node-ID, FFh for none."""
    return configure_node(None if node == UNCONFIGURED else node)


def set_bit_rate(table: int, entry: int) -> Conversation[CanFrame, None]:
    """lss_conf_bitrate."""
    return configure_bit_timing(entry, table)


def activate_bit_rate(milliseconds: int) -> Conversation[CanFrame, float]:
    """lss_activate_bitrate."""
    return activate_bit_timing(milliseconds / 1000)


def inquire(part: int | None = None) -> Conversation[CanFrame, str]:
    """lss_inquire_addr: all four numbers of the address, or one: 0 to 3, or its command byte 5Ah to 5Dh."""
    if part is not None and part >= LssService.INQUIRE_VENDOR:
        part -= LssService.INQUIRE_VENDOR
    if part is not None and not 0 <= part <= 3:
        raise GatewayError(GatewayCode.SYNTAX, "lss_inquire_addr: expected 0..3, or 0x5A..0x5D, or nothing")
    address = yield from inquire_address()
    return _address_text(address) if part is None else f"0x{address[part]:08X}"


def get_node() -> Conversation[CanFrame, str]:
    """lss_get_node: the node-ID, FFh for none."""
    node = yield from inquire_node()
    return f"0x{UNCONFIGURED if node is None else node:02X}"


def identify(
    vendor: int, product: int, revision_low: int, revision_high: int, serial_low: int, serial_high: int
) -> Conversation[CanFrame, None]:
    """lss_identity: ask whether a device is within these limits."""
    if not (yield from identify_slaves(vendor, product, (revision_low, revision_high), (serial_low, serial_high))):
        raise GatewayError(GatewayCode.TIME_OUT, "no device within these limits answered")


def identify_nonconfigured() -> Conversation[CanFrame, None]:
    """lss_ident_nonconf: ask whether a device has no node-ID."""
    if not (yield from identify_unconfigured()):
        raise GatewayError(GatewayCode.TIME_OUT, "no device without a node-ID answered")


def find_one(milliseconds: int = 0) -> Conversation[CanFrame, str]:
    """_lss_fastscan: find one device without a node-ID."""
    address = yield from fastscan(timeout=_seconds(milliseconds))
    if address is None:
        raise GatewayError(GatewayCode.TIME_OUT, "there is no device without a node-ID")
    return _address_text(address)


def assign_all(
    milliseconds: int = 0, first: int = 2, store: int = 1, scan: list[int] | None = None
) -> Conversation[CanFrame, str]:
    """lss_allnodes: find all devices without a node-ID, and assign node-IDs from `first` upwards.

    `scan` has a scan type and a number for each part of the address: with type 2 the part must have this number.
    """
    scan = scan or [0] * 8
    types, numbers = scan[::2], scan[1::2]
    if len(scan) != 8 or any(type > 2 for type in types):
        text = "lss_allnodes: expected scan_type 0..2 and number for each of the four parts"
        raise GatewayError(GatewayCode.SYNTAX, text)
    known = [number if type == 2 else None for type, number in zip(types, numbers)]
    nodes = range(first, NODE_MAX + 1)
    devices = yield from assign_node_ids(nodes, known, store=bool(store), timeout=_seconds(milliseconds))
    lines = []
    for device in devices:
        not_stored = ", not stored" if store and not device.stored else ""
        lines.append(f"# node {device.node}: {_address_text(device.address)}{not_stored}")
    return "\n".join([*lines, f"# {len(devices)} found", "OK"])


def _seconds(milliseconds: int) -> float:
    # At most a minute: while a service waits, the other clients of the gateway cannot use LSS.
    return min(milliseconds, 60_000) / 1000 if milliseconds else LSS_TIMEOUT


def _address_text(address: LssAddress) -> str:
    return " ".join(f"0x{number:08X}" for number in address)
