"""The policy: every combination of client, role, unit, function and address is allowed or refused as it is written."""

from __future__ import annotations

from itertools import product

import pytest

from barewire.gateway.config import read_config
from barewire.gateway.policy import Policy
from barewire.modbus import Caller, CanopenReference, RawRequest
from tests.helpers import every_case

FILE = """
[[listen]]
url = "tcp://127.0.0.1:1502"
[[backend]]
name = "b"
url = "tcp://127.0.0.1:1503"
units = "1-10"
[policy]
"""
CLIENTS = ("10.1.2.3:50000", "192.0.2.7:1", "[2001:db8::1]:502", "::ffff:10.0.0.1:7", "")
ROLES = (None, "Operator", "Viewer")
UNITS = (1, 5, 9)
REQUESTS = {
    "read 0..1": "03 00 00 00 02",
    "read 99..100": "03 00 63 00 02",
    "write 5": "06 00 05 00 01",
    "write 0..99": "0F 00 00 00 64 0D" + " 00" * 13,
    "read and write": "17 00 00 00 01 00 05 00 01 02 00 00",
    "own function": "41 01",
    "malformed read": "03 00 00",
    "read of more registers than there may be": "03 00 00 00 FF",
    "restart": "08 00 01 00 00",
}


def policy(text: str) -> Policy:
    return read_config(FILE + text).policy


def written(client: str, role: str | None, unit: int, name: str) -> int | None:
    """What the rules of the test below mean, written as a person would say it."""
    is_inside = client.startswith(("10.", "::ffff:10."))
    code = bytes.fromhex(REQUESTS[name])[0]
    addresses = {
        "read 0..1": (0, 1),
        "read 99..100": (99, 100),
        "write 5": (5,),
        "write 0..99": tuple(range(100)),
        "read and write": (0, 5),
    }.get(name)
    refused = 1
    if is_inside and unit <= 5 and code in (3, 4):  # rule 1: reading of 0 to 99 inside
        if addresses is not None and max(addresses) <= 99:
            return None
        refused = 2
    if role == "Operator" and code in (6, 15, 23):  # rule 2: operators write 0 to 50
        if addresses is not None and max(addresses) <= 50:
            return None
        refused = 2
    if role == "Operator" and client.startswith("[2001:db8::") and unit == 9:  # rule 3: anything
        return None
    return refused


RULES = """
[[policy.allow]]
clients = ["10.0.0.0/8"]
units = "1-5"
functions = [3, 4]
addresses = "0-99"
[[policy.allow]]
roles = ["Operator"]
functions = [6, 15, 23]
addresses = "0-50"
[[policy.allow]]
clients = ["2001:db8::/32"]
roles = ["Operator"]
units = 9
"""


@pytest.mark.parametrize("name", REQUESTS)
def test_every_combination(name: str) -> None:
    rules = policy(RULES)
    request = RawRequest(bytes.fromhex(REQUESTS[name]))
    for client, role, unit in product(CLIENTS, ROLES, UNITS):
        code = rules.refusal(Caller(client, role), unit, request)
        assert code == written(client, role, unit, name), (client, role, unit)


def test_without_rules_everything_is_allowed_and_with_an_empty_list_nothing() -> None:
    request = RawRequest(bytes.fromhex("06 00 00 00 01"))
    assert policy("").refusal(Caller(), 1, request) is None
    assert Policy([]).refusal(Caller(), 1, request) == 1


READ_ONLY = {
    **dict.fromkeys(["01 00 00 00 01", "02 00 00 00 01", "03 00 00 00 01", "04 00 00 00 01", "07", "0B", "0C"], True),
    **dict.fromkeys(["11", "14 07 06 00 01 00 00 00 01", "18 00 00", "2B 0E 01 00"], True),
    **dict.fromkeys(["05 00 00 FF 00", "06 00 00 00 00", "0F 00 00 00 01 01 00", "10 00 00 00 01 02 00 00"], False),
    **dict.fromkeys(["16 00 00 00 00 00 00", "17 00 00 00 01 00 00 00 01 02 00 00", "08 00 00 00 00"], False),
    **dict.fromkeys(["41", "03", "03 00 00 00 00", "2B 0E", "15 09 06 00 01 00 00 00 01 00 00"], False),
    CanopenReference.read(5, 0x6041, count=2).encode().hex(): True,
    CanopenReference.write_to(5, 0x6040, 0, b"\6\0").encode().hex(): False,
}


@every_case("pdu", READ_ONLY)
@every_case("rules", ["", "\n[[policy.allow]]\n"])
def test_read_only_is_one_line_and_stronger_than_any_rule(pdu: str, rules: str) -> None:
    code = policy("read_only = true" + rules).refusal(Caller("10.0.0.1:1"), 1, RawRequest(bytes.fromhex(pdu)))
    assert (code is None) is READ_ONLY[pdu]
    assert code in (None, 1)
