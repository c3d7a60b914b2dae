"""The LSS commands of the gateway, executed by the LSS master.   [CiA 309-3, LSS; CiA 305]

        [1] lss_switch_sel 0x1 0x2 0x3 0x4     the device with this address to configuration: OK, or ERROR:103
        [2] lss_set_node 7                     OK, or ERROR:502
        [3] lss_store                          OK, or ERROR:504, 505
        [4] lss_switch_glob 0                  back to waiting: OK
        [5] _lss_fastscan                      0x00000001 0x00000002 0x00000003 0x00000004

A service without a response ends with ERROR:103, except the global ones, which have no response.
"""

from __future__ import annotations

from collections.abc import Callable

from barewire.canopen.cob_ids import NODE_MAX
from barewire.canopen.frame import CanFrame
from barewire.canopen.gateway.codes import GatewayCode, GatewayError
from barewire.canopen.gateway.commands import LssCommand
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
    return str(UNCONFIGURED if node is None else node)


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


def _all_nodes(milliseconds: int = 0, first: int = 2, store: int = 1) -> Conversation[CanFrame, str]:
    """Find all devices without a node-ID, and assign node-IDs from `first` upwards."""
    if not 1 <= first <= NODE_MAX or store > 1:
        raise GatewayError(GatewayCode.SYNTAX, "lss_allnodes: expected [timeout_ms [first_node 1..127 [store 0|1]]]")
    found = yield from assign_node_ids(range(first, NODE_MAX + 1), store=bool(store), timeout=_seconds(milliseconds))
    given = ", ".join(f"node {device.node}: {_shown(device.address)}" for device in found)
    return f"OK #{len(found)} found{': ' if given else ''}{given}"


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
