"""A monitor for CANopen buses: assembles SDO transfers, names process data, follows states, reports broken rules.

        frames, one by one --> CanMonitor --+--> SdoChannels --> SdoTracker    sdo_channel, sdo_transfer
                                            +--> NodeTracker                   states, heartbeats, guarding, NMT
                                            +--> PdoTracker                    mappings and values
                                            +--> services                      SYNC, TIME, EMCY, LSS
                                            '--> events                        a line, or a dict

    events         the events, the closed list of rules that can be broken, lines and dicts
    sdo_transfer   one SDO transfer, and its blocks       sdo_channel   a channel, and all of them
    nodes, pdos, services    the other services
    monitor        CanMonitor: one bus
    recording      recordings: any file format, all buses in it, and writing one

Missing frames of a recording (`Gap`) and frames that the bus lost (`Loss`) are reported separately. The monitor never
sends, and has no files, buses or clocks.
"""

from barewire_workbench.frames.known_node import KnownNode, of_device, of_dictionary
from barewire_workbench.monitor.events import BUS_RULES, BusRule, event_as_dict, event_kind, event_line, is_repeated
from barewire_workbench.monitor.monitor import CanMonitor

__all__ = [
    "CanMonitor",
    "KnownNode",
    "of_device",
    "of_dictionary",
    "BUS_RULES",
    "BusRule",
    "event_line",
    "event_as_dict",
    "event_kind",
    "is_repeated",
]
