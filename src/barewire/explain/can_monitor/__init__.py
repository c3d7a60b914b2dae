"""Listening in on a CAN bus: SDO transfers put together, PDOs by name, states, and every broken rule by its own name.

        frames, one by one --> CanMonitor --+--> SdoListener (one a channel) --> block, segments, transfer
                                          +--> Nodes          states, heartbeats, guarding, NMT
                                          +--> PdoListener    what is mapped, and by whom
                                          +--> services       SYNC, TIME, EMCY, LSS
                                          '--> events --> words: a line, or a dict

    rules    the closed list of what can be wrong             known    names and types: the catalogue, or an EDS

What is missing in a recording and what was lost on the bus are two things, and are told as two. Nobody here speaks.

I know: what each service means over time.  I never know: files, buses, clocks.
"""

from barewire.explain.can_monitor.event_text import event_as_dict, event_kind, event_line, is_repeated
from barewire.explain.can_monitor.monitor import CanMonitor
from barewire.explain.can_monitor.rules import BUS_RULES, BusRule
from barewire.explain.canopen.known_node import KnownNode, of_device, of_dictionary

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
