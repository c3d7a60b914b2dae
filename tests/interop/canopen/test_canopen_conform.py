"""The conformance battery against a LocalNode of the `canopen` package: it finds the known deviations and no others."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import canopen
import pytest

from barewire.io.endpoint import Endpoint
from barewire_workbench.live.canopen_conformance import conform_can
from tests.interop.canopen.can_bench import NODE, dictionary_of_theirs

URL = f"can://virtual/their-node?node={NODE}&timeout=0.5"
DEVIATIONS = {
    "SDO-07": "any sub-index of a variable is the variable",
    "SDO-32": "a frame with 29 bits is treated like one with 11",
    "SDO-44": "any sub-index of a variable is the variable",
    "SDO-46": "22h, size not indicated, is refused",
    "NMT-02": "SDO in STOPPED",
}


@pytest.fixture
def their_node() -> Iterator[Any]:
    od = canopen.objectdictionary
    objects = dictionary_of_theirs()
    for index, data_type, value in ((0x1000, od.UNSIGNED32, 0x191), (0x1001, od.UNSIGNED8, 0)):
        variable = od.ODVariable(f"object {index:04X}", index, 0)
        variable.data_type, variable.access_type, variable.value = data_type, "ro", value
        objects.add_object(variable)
    record = od.ODRecord("identity", 0x1018)
    for sub, value in enumerate((4, 0x360, 1, 2, 3)):
        variable = od.ODVariable(f"identity {sub}", 0x1018, sub)
        variable.data_type = od.UNSIGNED32 if sub else od.UNSIGNED8
        variable.access_type, variable.value = "ro", value
        record.add_member(variable)
    objects.add_object(record)
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05
    logging.getLogger("canopen").setLevel(logging.CRITICAL)  # it logs each refusal with a traceback
    network.connect(interface="virtual", channel="their-node")
    yield network.create_node(NODE, objects)
    network.disconnect()
    logging.getLogger("canopen").setLevel(logging.NOTSET)


@pytest.mark.usefixtures("their_node")
def test_the_battery_finds_exactly_the_known_deviations() -> None:
    results = list(conform_can(Endpoint.parse(URL), only=("SDO-0", "SDO-3", "SDO-44", "SDO-45", "SDO-46", "NMT-02")))
    found = {result.case.name: result.failure for result in results if result.failure}
    assert found.keys() == DEVIATIONS.keys(), found
    assert sum(result.outcome is not None for result in results) > 15
