"""`barewire canopen-gateway`: a CANopen network as lines of text over TCP."""

from __future__ import annotations

import asyncio
import signal

import click

from barewire import AsyncCanopenClient, __version__
from barewire.cli.arguments import endpoint_argument
from barewire.errors import EncodeError, shown
from barewire.io.canopen.gateway_server import serve_gateway
from barewire.io.endpoint import Endpoint

_LOOPBACK = "127.0.0.1:4501"


@click.command("canopen-gateway")
@endpoint_argument
@click.option("--listen", default=_LOOPBACK, metavar="HOST:PORT", show_default=True, help="Address to listen on.")
@click.option("--net", type=click.IntRange(1, 127), default=1, show_default=True, help="Number of the network.")
def canopen_gateway_command(endpoint: str, listen: str, net: int) -> None:
    """Serve a CANopen network as text over TCP (CiA 309-3).

    Programs such as netcat send commands to nodes and receive their answers, one per line. Anyone who can connect to
    the port can command every node of the bus: listen on the loopback interface, or behind a service that authenticates
    its clients.

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
    asyncio.run(_serve(endpoint, *Endpoint.parse(f"tcp://{listen}").host_and_port, net))


async def _serve(endpoint: str, host: str, port: int, net: int) -> None:
    version = f"barewire {__version__}"
    async with (
        AsyncCanopenClient(endpoint) as client,
        await serve_gateway(client, host, port, net=net, version=version) as gateway,
    ):
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(gateway.ended.set))
        print(f"ready {host}:{gateway.port}", flush=True)
        await gateway.ended.wait()
        if gateway.failure is not None:
            raise gateway.failure
