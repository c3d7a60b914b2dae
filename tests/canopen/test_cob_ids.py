"""COB-IDs: the table of the predefined connection set, from service to identifier and back."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, CobEntry, classify, cob_id, is_restricted
from barewire.canopen.cob_ids import SERVICES, ServiceName
from barewire.errors import EncodeError


@pytest.mark.parametrize(
    ("service", "first", "last"),
    [
        ("EMCY", 0x081, 0x0FF),
        ("TPDO1", 0x181, 0x1FF),
        ("RPDO1", 0x201, 0x27F),
        ("TPDO2", 0x281, 0x2FF),
        ("RPDO2", 0x301, 0x37F),
        ("TPDO3", 0x381, 0x3FF),
        ("RPDO3", 0x401, 0x47F),
        ("TPDO4", 0x481, 0x4FF),
        ("RPDO4", 0x501, 0x57F),
        ("SDO answer", 0x581, 0x5FF),
        ("SDO request", 0x601, 0x67F),
        ("error control", 0x701, 0x77F),
    ],
)
def test_services_of_a_node(service: ServiceName, first: int, last: int) -> None:
    assert cob_id(service, 1) == first
    assert cob_id(service, 127) == last


@pytest.mark.parametrize(
    ("service", "identifier"),
    [("NMT", 0), ("SYNC", 0x80), ("TIME", 0x100), ("LSS answer", 0x7E4), ("LSS request", 0x7E5)],
)
def test_broadcast_services(service: ServiceName, identifier: int) -> None:
    assert cob_id(service) == identifier


def test_function_codes() -> None:
    codes = {service.name: service.function_code for service in SERVICES}
    assert codes["TPDO1"] == 0b0011
    assert codes["SDO answer"] == 0b1011
    assert codes["SDO request"] == 0b1100
    assert codes["error control"] == 0b1110


def test_classify_inverts_cob_id() -> None:
    owned = {}
    for identifier in range(0x800):
        found = classify(CanFrame(identifier))
        if found is not None:
            service, node = found
            assert cob_id(service.name, node or None) == identifier
            owned[identifier] = service.name
    assert len(owned) == 12 * 127 + 5
    assert 0x001 not in owned  # GFC, and identifiers that CiA 301 does not assign
    assert 0x180 not in owned
    assert 0x6E0 not in owned


def test_extended_frames_have_no_service() -> None:
    assert classify(CanFrame(0x581, extended=True)) is None


@pytest.mark.parametrize("node", [0, 128, -1])
def test_node_ids(node: int) -> None:
    with pytest.raises(EncodeError, match=r"expected 1\.\.127"):
        cob_id("SDO request", node)


def test_invalid_services_and_nodes_raise() -> None:
    with pytest.raises(EncodeError, match="expected a node"):
        cob_id("TPDO1")
    with pytest.raises(EncodeError, match="expected one of"):
        cob_id("SDO", 1)  # type: ignore[arg-type]


def test_restricted_identifiers() -> None:
    restricted = [identifier for identifier in range(0x800) if is_restricted(identifier)]
    assert len(restricted) == 128 + 128 + 127 + 127 + 32 + 255
    assert all(identifier in restricted for identifier in (0, 0x7F, 0x101, 0x180, 0x585, 0x605, 0x6E0, 0x705, 0x7FF))
    assert not any(identifier in restricted for identifier in (0x80, 0x85, 0x100, 0x181, 0x580, 0x600, 0x6DF, 0x700))


@pytest.mark.parametrize(
    ("word", "entry"),
    [
        (0x0000_0205, CobEntry(0x205)),
        (0x8000_0205, CobEntry(0x205, bit31=True)),
        (0x4000_0080, CobEntry(0x80, bit30=True)),
        (0x2000_0205, CobEntry(0x205, extended=True)),
        (0x3FFF_FFFF, CobEntry(0x1FFF_FFFF, extended=True)),
    ],
)
def test_flags_of_a_cob_id_object(word: int, entry: CobEntry) -> None:
    assert CobEntry.unpack(word) == entry
    assert entry.pack() == word


@pytest.mark.parametrize("entry", [CobEntry(0x800), CobEntry(0x2000_0000, extended=True), CobEntry(-1)])
def test_an_identifier_that_does_not_fit_is_refused(entry: CobEntry) -> None:
    with pytest.raises(EncodeError, match=r"expected (11|29) bits"):
        entry.pack()


def test_a_broadcast_of_one_node_is_refused() -> None:
    with pytest.raises(EncodeError, match="SYNC has no node"):
        cob_id("SYNC", 5)
