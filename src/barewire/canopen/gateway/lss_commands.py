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

from collections.abc import Callable

from barewire.canopen.cob_ids import NODE_MAX
from barewire.canopen.frame import CanFrame
from barewire.canopen.gateway.commands import GatewayCode, GatewayError, LssCommand
from barewire.canopen.lss.fastscan import assign_node_ids, fastscan
from barewire.canopen.lss.master import (
    LSS_TIMEOUT,
    activate_bit_timing,
    configure_bit_timing,
    configure_node,
    identify_slaves,
    identify_unconfigured,
    inquire_address,
    inquire_node,
    store_configuration,
    switch_global,
    switch_selective,
)
from barewire.canopen.lss.messages import UNCONFIGURED, LssAddress, LssRefused, LssService, LssState
from barewire.conversation import Conversation

_CODES = {
    (LssService.CONFIGURE_NODE, 1): GatewayCode.LSS_NODE_ID,
    (LssService.CONFIGURE_BIT_TIMING, 1): GatewayCode.LSS_BIT_RATE,
    (LssService.STORE, 1): GatewayCode.LSS_STORING,
    (LssService.STORE, 2): GatewayCode.LSS_MEDIA,
}


def lss_error_code(refused: LssRefused) -> GatewayCode:
    """Return the gateway's error code for a refusal of an LSS device."""
    return _CODES.get((refused.service, refused.code), GatewayCode.LSS_ERROR)


def run_lss(command: LssCommand) -> Conversation[CanFrame, str]:
    """Execute an LSS command and return its answer. Raise GatewayError, LssRefused, NoAnswer or EncodeError."""
    return _COMMANDS[command.service](*command.numbers)


def _switch_global(state: int) -> Conversation[CanFrame, str]:
    if state > 1:
        raise GatewayError(GatewayCode.SYNTAX, f"lss_switch_glob {state}: expected 0 (waiting) or 1 (configuration)")
    yield from switch_global(LssState(state))
    return "OK"


def _switch_selective(*numbers: int) -> Conversation[CanFrame, str]:
    vendor, product, revision, serial = numbers
    if not (yield from switch_selective(LssAddress(vendor, product, revision, serial))):
        raise GatewayError(GatewayCode.TIME_OUT, "no device with this address answered")
    return "OK"


def _set_node(node: int) -> Conversation[CanFrame, str]:
    yield from configure_node(None if node == UNCONFIGURED else node)
    return "OK"


def _configure_bit_rate(table: int, entry: int) -> Conversation[CanFrame, str]:
    yield from configure_bit_timing(entry, table)
    return "OK"


def _activate(milliseconds: int) -> Conversation[CanFrame, str]:
    yield from activate_bit_timing(milliseconds / 1000)
    return "OK"


def _store() -> Conversation[CanFrame, str]:
    yield from store_configuration()
    return "OK"


def _inquire(part: int | None = None) -> Conversation[CanFrame, str]:
    """Return all four numbers of the address, or one: 0 to 3, or its command byte 5Ah to 5Dh."""
    if part is not None and part >= LssService.INQUIRE_VENDOR:
        part -= LssService.INQUIRE_VENDOR
    if part is not None and not 0 <= part <= 3:
        raise GatewayError(GatewayCode.SYNTAX, "lss_inquire_addr: expected 0..3, or 0x5A..0x5D, or nothing")
    address = yield from inquire_address()
    return _shown(address) if part is None else f"0x{address[part]:08X}"


def _node() -> Conversation[CanFrame, str]:
    node = yield from inquire_node()
    return f"0x{UNCONFIGURED if node is None else node:02X}"


def _identity(*numbers: int) -> Conversation[CanFrame, str]:
    vendor, product, revision_low, revision_high, serial_low, serial_high = numbers
    ranges = (revision_low, revision_high), (serial_low, serial_high)
    if not (yield from identify_slaves(vendor, product, *ranges)):
        raise GatewayError(GatewayCode.TIME_OUT, "no device within these limits answered")
    return "OK"


def _unconfigured() -> Conversation[CanFrame, str]:
    if not (yield from identify_unconfigured()):
        raise GatewayError(GatewayCode.TIME_OUT, "no device without a node-ID answered")
    return "OK"


def _fastscan(milliseconds: int = 0) -> Conversation[CanFrame, str]:
    address = yield from fastscan(timeout=_seconds(milliseconds))
    if address is None:
        raise GatewayError(GatewayCode.TIME_OUT, "there is no device without a node-ID")
    return _shown(address)


def _all_nodes(milliseconds: int = 0, first: int = 2, store: int = 1, *scan: int) -> Conversation[CanFrame, str]:
    """Find all devices without a node-ID, and assign node-IDs from `first` upwards.

    `scan` has a scan type and a number for each part of the address: with type 2 the part must have this number, with 0
    and 1 it may have any.
    """
    if not 1 <= first <= NODE_MAX or store > 1 or len(scan) not in (0, 8) or any(type > 2 for type in scan[::2]):
        expected = "[timeout_ms [first_node 1..127 store 0|1 [scan_type 0..2 number, for each of the four parts]]]"
        raise GatewayError(GatewayCode.SYNTAX, f"lss_allnodes: expected {expected}")
    known = [number if type == 2 else None for type, number in zip(scan[::2], scan[1::2])] or [None] * 4
    nodes, wait = range(first, NODE_MAX + 1), _seconds(milliseconds)
    found = yield from assign_node_ids(nodes, known, store=bool(store), timeout=wait)
    lines = [
        f"# node {device.node}: {_shown(device.address)}{', not stored' if store and not device.stored else ''}"
        for device in found
    ]
    return "\n".join([*lines, f"# {len(found)} found", "OK"])


def _seconds(milliseconds: int) -> float:
    return min(milliseconds, 60_000) / 1000 if milliseconds else LSS_TIMEOUT


def _shown(address: LssAddress) -> str:
    return " ".join(f"0x{number:08X}" for number in address)


_COMMANDS: dict[str, Callable[..., Conversation[CanFrame, str]]] = {
    "lss_switch_glob": _switch_global,
    "lss_switch_sel": _switch_selective,
    "lss_set_node": _set_node,
    "lss_conf_bitrate": _configure_bit_rate,
    "lss_activate_bitrate": _activate,
    "lss_store": _store,
    "lss_inquire_addr": _inquire,
    "lss_get_node": _node,
    "lss_identity": _identity,
    "lss_ident_nonconf": _unconfigured,
    "_lss_fastscan": _fastscan,
    "lss_allnodes": _all_nodes,
}
