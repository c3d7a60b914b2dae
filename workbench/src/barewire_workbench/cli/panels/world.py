"""What the page of a simulated machine changes beside its values: the environment, and the faults of its line.

Both lists are those of the simulator and of the fault model; here they become texts for the page, and back.
"""

from __future__ import annotations

import time
from typing import Any

from barewire.devices.sim import Simulator
from barewire.io.engine.locking import exclusive
from barewire.io.fault_injection.faults import KINDS, VALUED, Fault, Faults, parse_faults


class SimulatedWorld:
    """The environment of a simulated machine, and the faults in the answers of the line that a panel reads.

    >>> from random import Random
    >>> from barewire.devices.sim import simulator
    >>> from barewire.io.fault_injection.faults import ModbusWire
    >>> world = SimulatedWorld(simulator("adxl"), Faults(ModbusWire("rtu"), (), Random(1)))
    >>> world.set("line", "off"), world.set_fault("late", "late=2:0.5")
    (None, None)
    >>> [(row["name"], row["text"]) for row in world.state()["environment"]][0]
    ('line', 'off')
    >>> [(row["name"], row["share"], row["value"]) for row in world.state()["faults"] if row["share"]]
    [('late', 50.0, '2')]
    """

    def __init__(self, machine: Simulator, faults: Faults[Any]) -> None:
        self._machine, self._faults = machine, faults

    def state(self) -> dict[str, list[dict[str, Any]]]:
        """Return every property, and every fault that the line can have: what it is, and what it is set to."""
        with exclusive(self._machine):
            properties = self._machine.environment_properties()
        rows = [
            {
                "name": row.name,
                "meaning": row.meaning,
                "text": row.text,
                "expected": row.form.expected,
                "choices": row.form.choices,
            }
            for row in properties
        ]
        present = {fault.kind: fault for fault in reversed(self._faults.present)}
        return {
            "environment": rows,
            "faults": [self._fault(kind, present.get(kind)) for kind in self._faults.wire.kinds],
        }

    def _fault(self, kind: str, fault: Fault | None) -> dict[str, Any]:
        has_value = kind in VALUED and (kind != "exception" or self._faults.wire.has_addresses)
        value = self._faults.delay if kind == "late" else VALUED.get(kind, 0)
        if fault is not None and fault.value is not None:
            value = fault.value
        return {
            "name": kind,
            "meaning": KINDS[kind],
            "share": 0 if fault is None else 100 * fault.probability,
            "value": (f"{int(value):02X}" if kind == "exception" else f"{value:g}") if has_value else "",
            "count": self._faults.counts[kind],
        }

    def set(self, name: str, text: str) -> None:
        """Set a property of the environment. Raises EncodeError."""
        with exclusive(self._machine):
            self._machine.tick(time.monotonic())
            self._machine.set_environment(f"{name}={text}")

    def set_fault(self, kind: str, text: str) -> None:
        """Replace the faults of one kind by those of a text, as `--fault` takes it, or by none. Raises EncodeError."""
        others = [fault for fault in self._faults.present if fault.kind != kind]
        self._faults.replace([*others, *(parse_faults(text) if text else ())])
