"""A drive, blocking: the one drive code on a client, whatever wire it has.

    with connect("tcp://192.168.1.10") as client:
        drive = client.drive(load("csd-mt"))
        drive.enable()
        drive.move(12_800, relative=True, velocity=20_000)

Reading and writing go through the client, one exchange at a time, so another thread may read values or stop the drive
while a movement is waited for. Only the waiting between two looks is done here.

With asyncio no file like this is needed: `await client.run(Drive(ModbusAccess(client.bus, 1, csd), csd).enable())`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Never, TypeVar

from barewire.codecs import Value
from barewire.conversation import Conversation, Listen
from barewire.devices.device import Device
from barewire.devices.drive.drive import Drive
from barewire.devices.drive.report import DriveProgress, DriveStatus
from barewire.devices.parameter import Reading
from barewire.io.engine.blocking import run

if TYPE_CHECKING:
    from barewire.io.canopen.client import Client

T = TypeVar("T")


class ClientAccess:
    """A drive behind a client: each exchange is the client's, which has its own way to carry it out."""

    def __init__(self, client: Client, device: Device) -> None:
        self.client, self.device = client, device

    def read(self, names: Sequence[str]) -> Conversation[Never, list[Reading]]:
        """One exchange of the client, or as many as its planner needs."""
        yield from ()
        return self.client.read(self.device, *names)

    def write(self, values: Mapping[str, Value]) -> Conversation[Never, None]:
        """The same for writing."""
        yield from ()
        self.client.write(self.device, values)

    def wait(self, until: float) -> Conversation[Never, float]:
        """The engine waits; nobody has the line meanwhile."""
        heard = yield Listen(until)
        return heard.now


class _Waiting:
    """A port on which nothing comes but time."""

    def send(self, item: Never) -> None:
        """Nothing is sent here."""

    def receive(self, timeout: float) -> None:
        """Sleep."""
        time.sleep(timeout)

    def close(self) -> None:
        """Nothing is open."""


class DriveClient:
    """The conversations of `Drive`, each carried out to its end. They raise DriveStuck, and what the client raises."""

    def __init__(
        self,
        client: Client,
        device: Device,
        *,
        timeout: float = 3.0,
        period: float = 0.02,
        progress: Callable[[DriveProgress], None] | None = None,
    ) -> None:
        access = ClientAccess(client, device)
        self.drive: Drive[Never] = Drive(access, device, timeout=timeout, period=period, progress=progress)

    def run(self, conversation: Conversation[Never, T]) -> T:
        """Carry one of the drive's conversations out."""
        return run(conversation, _Waiting())

    def status(self) -> DriveStatus:
        """Read the drive once."""
        return self.run(self.drive.status())

    def enable(self) -> DriveStatus:
        """To operation enabled."""
        return self.run(self.drive.enable())

    def disable(self) -> DriveStatus:
        """Current off."""
        return self.run(self.drive.disable())

    def quick_stop(self, *, within: float = 30.0) -> DriveStatus:
        """Brake, and wait until the shaft stands."""
        return self.run(self.drive.quick_stop(within=within))

    def reset(self) -> DriveStatus:
        """Out of a fault."""
        return self.run(self.drive.reset())

    def move(
        self,
        target: int | float,
        *,
        relative: bool = False,
        immediately: bool = False,
        velocity: int | float | None = None,
        acceleration: int | float | None = None,
        deceleration: int | float | None = None,
        within: float = 60.0,
    ) -> DriveStatus:
        """To a position, or by a distance; enables the drive first."""
        return self.run(
            self.drive.move(
                target,
                relative=relative,
                immediately=immediately,
                velocity=velocity,
                acceleration=acceleration,
                deceleration=deceleration,
                within=within,
            )
        )

    def velocity(
        self,
        target: int | float,
        *,
        acceleration: int | float | None = None,
        deceleration: int | float | None = None,
        within: float = 60.0,
    ) -> DriveStatus:
        """To a velocity, and on it goes; enables the drive first."""
        return self.run(
            self.drive.velocity(target, acceleration=acceleration, deceleration=deceleration, within=within)
        )

    def home(self, method: int | None = None, *, within: float = 60.0) -> DriveStatus:
        """Homing; enables the drive first."""
        return self.run(self.drive.home(method, within=within))
