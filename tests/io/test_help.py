"""help(), dir() and calls on a class: what a newcomer tries first."""

from __future__ import annotations

import inspect
from typing import Any, cast

import pytest

import barewire
import barewire.modbus
from barewire.canopen.lss import master as lss_master
from barewire.io.canopen.bus_methods import LssMethods, SyncMethods
from barewire.io.canopen.nmt import NodeNmtMethods
from barewire.io.canopen.objects import SdoMethods
from barewire.io.canopen.operations import Methods
from barewire.io.drive import DriveClient
from tests.helpers import every_case

CLIENTS: list[Any] = [barewire.ModbusClient, barewire.AsyncModbusClient]


@pytest.mark.parametrize(
    ("method", "result"),
    [
        *((client.read_holding_registers, "tuple[int, ...]") for client in CLIENTS),
        *((client.read, "list[Reading]") for client in CLIENTS),
        *((client.write, "None") for client in CLIENTS),
        *((client.read_device_identification, "DeviceIdentification") for client in CLIENTS),
        (SdoMethods.upload, "bytes"),
        (SdoMethods.find_channel, "canopen.Channel"),
        (NodeNmtMethods.start, "None"),
        (DriveClient.enable, "DriveStatus"),
    ],
)
def test_help_has_the_result_and_the_await(method: Any, result: str) -> None:
    assert inspect.signature(method).return_annotation == result
    text = inspect.getdoc(method)
    assert text is not None
    assert text.endswith(f"\n\nReturns {result}. With asyncio, await it.")


@pytest.mark.parametrize(
    ("method", "blocking", "awaited"),
    [
        (NodeNmtMethods.heartbeats, "Stream[canopen.HeartbeatEvent]", "AsyncStream[canopen.HeartbeatEvent]"),
        (SyncMethods.start, "Running", "AsyncRunning"),
    ],
)
def test_help_has_the_streams_and_tasks(method: Any, blocking: str, awaited: str) -> None:
    assert inspect.signature(method).return_annotation == f"{blocking} | {awaited}"
    text = inspect.getdoc(method)
    assert text is not None
    assert text.endswith(f"\n\nReturns {blocking}; with asyncio {awaited}, without await.")


def subclasses(kind: type[Any]) -> set[type[Any]]:
    return {kind}.union(*(subclasses(found) for found in kind.__subclasses__()))


CLASSES = sorted(
    {
        *(getattr(barewire, name) for name in barewire.__all__ if name.endswith(("Client", "Server"))),
        *(found for found in subclasses(Methods) if found.__module__.startswith("barewire.")),
        *(found for found in subclasses(DriveClient) if found.__module__.startswith("barewire.")),
    },
    key=lambda found: f"{found.__module__}.{found.__qualname__}",
)


@every_case("owner", CLASSES)
def test_the_first_parameter_of_a_method_is_the_object(owner: type[Any]) -> None:
    """If it were not, the signature of the bound method would lack a parameter of the caller."""
    for name, function in inspect.getmembers(owner, inspect.isfunction):
        if not name.startswith("_") and not isinstance(inspect.getattr_static(owner, name), staticmethod):
            assert next(iter(inspect.signature(function).parameters), None) == "self", name


LSS_METHODS = [name for name in vars(LssMethods) if not name.startswith("_")]


@pytest.mark.parametrize("name", LSS_METHODS)
def test_a_method_of_lss_has_the_parameters_of_its_function(name: str) -> None:
    function = inspect.signature(getattr(lss_master, name))
    method = inspect.signature(getattr(LssMethods(cast("Any", None)), name))
    assert list(method.parameters.values()) == list(function.parameters.values())
    assert f"Conversation[CanFrame, {method.return_annotation}]" == function.return_annotation


@pytest.mark.parametrize("call", ["read_coils", "read", "write", "settle"])
@pytest.mark.parametrize("client", CLIENTS)
def test_a_method_called_on_the_class_names_the_client(client: Any, call: str) -> None:
    with pytest.raises(TypeError, match=rf"{call}\(\): call it on a client, not on the class"):
        getattr(client, call)(0, 1)


def test_a_method_called_on_a_class_of_canopen_names_the_client() -> None:
    wrong: list[Any] = [barewire.CanopenClient.send, SdoMethods.upload, SyncMethods.start, NodeNmtMethods.heartbeats]
    for method in wrong:
        with pytest.raises(TypeError, match=rf"{method.__name__}\(\): call it on a client, not on the class"):
            method(0x6041)
    with pytest.raises(TypeError, match=r"enable\(\): call it on a client, not on the class"):
        DriveClient.enable(5)


@pytest.mark.parametrize("door", [barewire, barewire.modbus])
def test_dir_shows_no_tools_of_the_door(door: Any) -> None:
    names = dir(door)
    assert not {"lazy", "TYPE_CHECKING"} & set(names)
    assert "ModbusException" in names
    assert "__doc__" in names
