"""`barewire canopen-gateway`: a CANopen network as lines of text over TCP."""

from __future__ import annotations

import asyncio
import signal
import sys
from typing import Any

import click

from barewire import AsyncCanopenClient, __version__
from barewire.canopen import LocalNode, pdos_of
from barewire.errors import EncodeError, shown
from barewire.io.canopen.node import dictionary_of
from barewire.io.endpoint import Endpoint
from barewire.io.ports.network import place_of
from barewire_workbench.ascii_gateway.own_node import GatewayNode, gateway_node
from barewire_workbench.cli.arguments import endpoint_argument
from barewire_workbench.live.ascii_gateway import serve_gateway

_LOOPBACK = "127.0.0.1:4501"


@click.command("canopen-gateway")
@endpoint_argument
@click.option("--listen", default=_LOOPBACK, metavar="HOST:PORT", show_default=True, help="Address to listen on.")
@click.option("--net", type=click.IntRange(1, 127), default=1, show_default=True, help="Number of the network.")
@click.option("--node-id", type=click.IntRange(1, 127), help="Be a node of the network too, with this node-ID.")
@click.option("--eds", type=click.Path(dir_okay=False), help="Objects of this node; by default those of CiA 301.")
@click.option("--indications", is_flag=True, help="Report boot-ups, emergencies and bus errors to every client.")
def canopen_gateway_command(
    endpoint: str, listen: str, net: int, node_id: int | None, eds: str | None, indications: bool
) -> None:
    """Serve a CANopen network as text over TCP (CiA 309-3).

    Programs such as netcat send commands to nodes and receive their answers, one per line. Lines that are not answers,
    such as boot-ups, are sent to clients that asked for them, or to all with --indications. Anyone who can connect to
    the port can command every node of the bus: listen on the loopback interface, or behind a service that authenticates
    its clients.

    With --node-id the gateway is also a node: it has an SDO server and a heartbeat, and obeys NMT commands.

    \b
    barewire canopen-gateway can://socketcan/can0 &
    echo "[1] 5 read 0x6041 0 u16" | nc -N 127.0.0.1 4501
    [1] 1591
    echo "[1] help" | nc -N 127.0.0.1 4501
    """
    if not endpoint.startswith("can://"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: the gateway is for CANopen: expected can://")
    if not listen.rpartition(":")[2].isdigit():
        raise EncodeError(f"--listen {listen}: expected HOST:PORT, such as {_LOOPBACK}")
    if eds is not None and node_id is None:
        raise EncodeError("--eds describes the gateway's own node: expected --node-id too")
    own = None if node_id is None else _own_node(node_id, eds)
    host, port = Endpoint.parse(f"tcp://{listen}").host_and_port
    settings = {"net": net, "version": f"barewire {__version__}", "own": own, "indications": indications}
    asyncio.run(_serve(endpoint, host, port, settings))


def _own_node(node: int, eds: str | None) -> GatewayNode:
    """Return the gateway's own node. Raises EncodeError for a wrong EDS."""
    if eds is None:
        return gateway_node(node)
    objects = dictionary_of(eds, node)
    refused: list[str] = []
    device = LocalNode(node, objects, pdos_of(objects, node, refused=refused))
    for reason in refused:
        print(f"{eds}: {reason}", file=sys.stderr)
    return GatewayNode(device)


async def _serve(endpoint: str, host: str, port: int, settings: dict[str, Any]) -> None:
    async with (
        AsyncCanopenClient(endpoint) as client,
        await serve_gateway(client, host, port, **settings) as gateway,
    ):
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(gateway.ended.set))
        print(f"ready {place_of(host, gateway.port)}", flush=True)
        await gateway.ended.wait()
        if gateway.failure is not None:
            raise gateway.failure
