"""`bus.lss`: node-IDs and bit rates over the bus itself.   [CiA 305, LSS]

    bus.lss.fastscan(progress=print)                   the functions of `canopen.lss`, under their own names

A bus has one LSS master, so the LSS operations of all clients are carried out one at a time.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, ParamSpec, TypeVar, cast

from barewire.canopen.cob_ids import cob_id
from barewire.canopen.lss import master as lss_master
from barewire.io.canopen.methods.nmt import ERROR_CONTROL
from barewire.io.canopen.methods.operations import BusOperation, Methods, R, operation

if TYPE_CHECKING:
    from barewire.canopen import CanFrame
    from barewire.conversation import Conversation

P = ParamSpec("P")
T = TypeVar("T")

LSS_RECEIVES = ERROR_CONTROL | {(cob_id("LSS answer"), False)}
"""Responses, and the boot-up messages of nodes that got an ID."""
LSS_LOCK = frozenset({"LSS"})


def _lss(make: Callable[P, Conversation[CanFrame, T]]) -> operation[P, T]:
    """Return a function of `canopen.lss` as a method with the same parameters."""

    def method(_: Methods[R], /, *args: P.args, **kwargs: P.kwargs) -> BusOperation[T]:
        return BusOperation(make(*args, **kwargs), LSS_LOCK, LSS_RECEIVES)

    functools.update_wrapper(method, make)
    made = operation(method)
    # `make` has no `self`. Without one in the signature, `help` and `inspect` would drop its first parameter.
    shown = inspect.signature(cast("Callable[..., T]", made))
    itself = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    vars(made)["__signature__"] = shown.replace(parameters=[itself, *shown.parameters.values()])
    return made


class LssMethods(Methods[R]):
    """The LSS master of a bus."""

    switch_global = _lss(lss_master.switch_global)
    switch_selective = _lss(lss_master.switch_selective)
    identify_slaves = _lss(lss_master.identify_slaves)
    identify_unconfigured = _lss(lss_master.identify_unconfigured)
    inquire_address = _lss(lss_master.inquire_address)
    inquire_node = _lss(lss_master.inquire_node)
    configure_node = _lss(lss_master.configure_node)
    configure_bit_timing = _lss(lss_master.configure_bit_timing)
    activate_bit_timing = _lss(lss_master.activate_bit_timing)
    store_configuration = _lss(lss_master.store_configuration)
    fastscan = _lss(lss_master.fastscan)
    assign_node_ids = _lss(lss_master.assign_node_ids)
