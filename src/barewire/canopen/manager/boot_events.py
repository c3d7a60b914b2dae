"""What a CANopen manager reports: the events of its nodes, and the end of a boot-up.

BootEvent(5, "failed", 1.25, result)        node 5: B: no response to the request of the device type (1000h): ...
BootEvent(0, "ready", 1.3)                  network: ready
NetworkBoot(True, (result, ...))            the result of each node, and whether the network is ready
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from barewire.canopen.manager.boot_slave import BootResult

BootEventKind = Literal[
    "booted", "failed", "waiting", "missing", "started", "ready", "lost", "rebooted", "reset", "stopped"
]


class BootEvent(NamedTuple):
    """A step of the network.

    booted      a boot slave process has succeeded
    failed      a boot slave process has failed; `result` has the letter and the reason
    waiting     a mandatory node does not respond yet, and is asked again
    missing     the boot time is over, and this mandatory node has not booted
    started     the node was started, or with node 0 all nodes
    ready       all mandatory nodes have booted
    lost        the heartbeat of the node, or its response to node guarding, did not arrive in time
    rebooted    the node has sent its boot-up message although it had booted, or while it booted
    reset       the node, or with node 0 the network, is reset
    stopped     all nodes are stopped
    """

    node: int
    kind: BootEventKind
    at: float
    result: BootResult | None = None

    def __str__(self) -> str:
        if self.result is not None and self.kind in ("booted", "failed", "waiting"):
            return f"{self.result}{'; it is asked again' if self.kind == 'waiting' else ''}"
        name = f"node {self.node}" if self.node else "network"
        text = {"missing": "mandatory, and has not booted in time", "lost": "lost: no heartbeat or guarding response"}
        return f"{name}: {text.get(self.kind, self.kind)}"

    def __repr__(self) -> str:
        return f"<BootEvent {self}>"


class NetworkBoot(NamedTuple):
    """How the boot-up of a network ended: whether it is ready, and the last result of each node. It is true if the
    network is ready."""

    ready: bool
    results: tuple[BootResult, ...]

    def __bool__(self) -> bool:
        return self.ready

    def __str__(self) -> str:
        return "\n".join(
            [*map(str, self.results), "the network is ready" if self.ready else "the network is not ready"]
        )

    def __repr__(self) -> str:
        booted = sum(one.ok for one in self.results)
        return f"<NetworkBoot: {'ready' if self.ready else 'not ready'}, {booted} nodes booted>"
