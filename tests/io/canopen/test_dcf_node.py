"""A node with its DCF: compared and configured, blocking and with asyncio, over python-can's virtual bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import ConfigurationFailed, LocalNode, pdos_of
from barewire.errors import EncodeError
from tests.canopen.configuration.plant import dcf, described
from tests.io.canopen.either_client import KINDS, get, run_with

pytest.importorskip("can")


def device() -> LocalNode:
    objects = described().dictionary(5)
    return LocalNode(5, objects, pdos_of(objects, 5))


@KINDS
def test_a_device_is_compared_configured_and_stores(kind: str, tmp_path: Path) -> None:
    url, file = f"can://virtual/{tmp_path.name}-{kind}", tmp_path / "pump.dcf"
    file.write_bytes(dcf({"Heartbeat": 500, (0x1800, 2): 1}).encode())
    local = device()

    async def calls(client: Any) -> None:
        node = client.node(dcf=file)
        assert repr(node).startswith("<node 5 of ")
        found = await get(node.diff())
        assert [f"{one.entry.index:X}" for one in found] == ["1017", "1800", "1020", "1020"]
        assert "<td>1017h:00 Heartbeat</td><td>0</td><td>500</td>" in found._repr_html_()
        assert list((await get(node.configure(dry_run=True, store=True))).changes) == found
        assert (local.objects["Heartbeat"], local.stored.values) == (0, {})
        steps: list[str] = []
        result = await get(node.configure(store=True, progress=lambda done, total, step: steps.append(step)))
        assert repr(result) == "<ConfigurationResult: 4 changes, stored, 0 left out>"
        assert "write 1017h:00 Heartbeat = 500" in steps
        assert await get(node.diff()) == []
        assert await get(node.read("Heartbeat")) == 500
        assert local.stored.values[0x1800, 2] == 1
        local.objects.set(0x1018, 2, 8)
        with pytest.raises(ConfigurationFailed, match="node 5 is another device"):
            await get(node.configure())

    with CanopenServer(url, device=local):
        run_with(calls, kind, url)


def test_mistakes_name_what_was_expected(tmp_path: Path) -> None:
    with CanopenClient(f"can://virtual/{tmp_path.name}") as client:
        plain = described()
        with pytest.raises(EncodeError, match="expected eds= or dcf=, not both"):
            client.node(5, eds=plain, dcf=plain)  # type: ignore[call-overload]
        with pytest.raises(EncodeError, match="has no ParameterValue: expected a DCF"):
            client.node(5, dcf=plain)
        with pytest.raises(EncodeError, match=r"dcf '.*missing.dcf': No such file"):
            client.node(5, dcf=tmp_path / "missing.dcf")
        with pytest.raises(EncodeError, match="node 0: expected a number"):
            client.node(0, dcf=dcf({"Heartbeat": 1}))
        with pytest.raises(AttributeError, match=r"'configure' needs a DCF: bus.node\(5, dcf=...\)"):
            client.node(5, eds=plain).configure()  # type: ignore[attr-defined]
        assert client.node(9, dcf=dcf({"Heartbeat": 1})).number == 9
