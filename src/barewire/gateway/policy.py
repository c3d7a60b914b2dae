"""The policy of a gateway: which client may send which request. What no rule allows is refused.

    [policy]                          no rules: everything is allowed
    read_only = true                  whatever the rules say, nothing that changes something is passed on

    [[policy.allow]]                  a request that one rule covers completely is allowed
    clients = ["10.0.0.0/8"]          by address                  units = "1-10"
    roles = ["Operator"]              by TLS certificate          functions = [3, 4]      addresses = "0-99"

A refused request gets exception 02 if a rule would allow it at other addresses, and 01 otherwise. Units, functions and
addresses are those of `Permission`: a rule with addresses covers a request without addresses (files, a function of the
device's own) only if it also lists its function. A request of a known function whose bytes are not valid may touch any
address, so no rule with addresses covers it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address
from typing import NamedTuple

from barewire.modbus.exceptions import ILLEGAL_DATA_ADDRESS, ILLEGAL_FUNCTION
from barewire.modbus.messages.canopen_reference import CanopenReference
from barewire.modbus.messages.raw import RawRequest
from barewire.modbus.server.authorization import Permission
from barewire.modbus.server.server import Caller

_READS = frozenset({0x01, 0x02, 0x03, 0x04, 0x07, 0x0B, 0x0C, 0x11, 0x14, 0x18, 0x2B})
"""Functions that change nothing. Diagnostics (08) can restart a unit and clear its counters; 2B/0D can write."""


class AccessRule(NamedTuple):
    """What some clients may do. None means all: all addresses, with and without a certificate."""

    clients: tuple[IPv4Network | IPv6Network, ...] | None = None
    roles: frozenset[str] | None = None
    permission: Permission = Permission()

    def is_about(self, client: Caller) -> bool:
        """Whether the rule is about this client."""
        if self.roles is not None and (client.role or "") not in self.roles:
            return False
        if self.clients is None:
            return True
        address = _address(client.peer)
        return address is not None and any(address in network for network in self.clients)


@lru_cache(1024)
def _address(peer: str) -> IPv4Address | IPv6Address | None:
    """Return the address in HOST:PORT; an IPv4 address in IPv6 as IPv4. None if there is none: a serial line."""
    try:
        address = ip_address(peer.rpartition(":")[0].strip("[]").partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


class Policy:
    """The rules of a gateway. Without rules everything is allowed.

    >>> policy = Policy([AccessRule(permission=Permission(functions=frozenset({3}), addresses=(range(0, 10),)))])
    >>> refusals = [policy.refusal(Caller(), 1, RawRequest(bytes.fromhex(pdu))) for pdu in
    ...             ("0300000002", "0300090002", "0600000001")]
    >>> refusals
    [None, 2, 1]
    """

    def __init__(self, rules: Sequence[AccessRule] | None = None, *, read_only: bool = False) -> None:
        self.rules = rules
        self.read_only = read_only
        self.allows_all = rules is None and not read_only
        """Whether everything is allowed."""

    def refusal(self, client: Caller, unit: int, request: RawRequest) -> int | None:
        """Return the exception code with which a request is refused; None if it is allowed."""
        if self.read_only and not _only_reads(request):
            return ILLEGAL_FUNCTION
        if self.rules is None:
            return None
        message = request.known or request
        code = ILLEGAL_FUNCTION
        for rule in self.rules:
            if not rule.is_about(client):
                continue
            if rule.permission.allows(unit, message):
                return None
            elsewhere = rule.permission._replace(addresses=None)
            if rule.permission.addresses is not None and elsewhere.allows(unit, message):
                code = ILLEGAL_DATA_ADDRESS
        return code


def _only_reads(request: RawRequest) -> bool:
    if isinstance(request.known, CanopenReference):
        return not request.known.write
    return request.known is not None and request.function_code in _READS
