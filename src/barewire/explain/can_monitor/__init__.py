"""Listening in on a CAN bus: SDO transfers put together, PDOs by name, states, and every broken rule by its own name.

        frames, one by one --> Listener --+--> SdoListener (one a channel) --> block, segments, transfer
                                          +--> Nodes          states, heartbeats, guarding, NMT
                                          +--> PdoListener    what is mapped, and by whom
                                          +--> services       SYNC, TIME, EMCY, LSS
                                          '--> events --> words: a line, or a dict

    rules    the closed list of what can be wrong             known    names and types: the catalogue, or an EDS

What is missing in a recording and what was lost on the bus are two things, and are told as two. Nobody here speaks.

I know: what each service means over time.  I never know: files, buses, clocks.
"""

from barewire.explain.can_monitor.event_text import as_dict, in_words, kind, repeated
from barewire.explain.can_monitor.listener import Listener
from barewire.explain.can_monitor.node_model import KnownNode, of_device, of_dictionary
from barewire.explain.can_monitor.rules import RULES, Rule

__all__ = [
    "Listener",
    "KnownNode",
    "of_device",
    "of_dictionary",
    "RULES",
    "Rule",
    "in_words",
    "as_dict",
    "kind",
    "repeated",
]
