"""A monitor for CANopen buses: assembles SDO transfers, names process data, follows states, reports broken rules.

        frames, one by one --> CanMonitor --+--> SdoChannels --> SdoTracker    channel, segments, block
                                            +--> NodeTracker                   states, heartbeats, guarding, NMT
                                            +--> PdoTracker                    mappings and values
                                            +--> services                      SYNC, TIME, EMCY, LSS
                                            '--> events --> event_text         a line, or a dict

    events, rules    the events, and the closed list of rules that can be broken
    monitor          CanMonitor: one bus
    transfer, block, channel_state, reserved, segments, channel, channels    SDO
    nodes, pdos, services    the other services
    event_text       the events as lines and dicts
    recording        recordings: any file format, all buses in it, and writing one

Missing frames of a recording (`Gap`) and frames that the bus lost (`Loss`) are reported separately. The monitor never
sends, and has no files, buses or clocks.
"""

from barewire_workbench.frames.known_node import KnownNode, of_device, of_dictionary
from barewire_workbench.monitor.event_text import event_as_dict, event_kind, event_line, is_repeated
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.monitor.rules import BUS_RULES, BusRule

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
