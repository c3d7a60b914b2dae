"""The gateway: many Modbus clients in front, serial lines, connections and CAN buses behind. docs/how-to/gateway.md

    client  ->  Server  ->  Route  ->  Policy  ->  Backend: Dispatcher  ->  line
                                                            queue, joined reads, dead units

In reading order:

    dispatch            the queue of one bus: which request is next, which clients get the response; time is an argument
    policy              which client may do what
    backend             a bus: its connection, its lanes, what an error means for a client
    canopen_backend     nodes on a CAN bus as units
    config              the TOML file: checked with line and column; its schema and its example
    gateway             listeners, routes, backends; reload and end
    publish             machines polled by name, their values sent to an MQTT broker
    status  page        counters as JSON and for Prometheus; the status page
    __main__            python -m barewire.gateway CONFIG

It needs the standard library only; the status page needs microdot, the metrics prometheus_client.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.gateway.config import (
        ConfigError as ConfigError,
        GatewayConfig as GatewayConfig,
        read_config as read_config,
    )
    from barewire.gateway.gateway import Gateway as Gateway

__getattr__, __dir__, __all__ = lazy(
    __name__, {"config": "ConfigError GatewayConfig read_config", "gateway": "Gateway"}
)
