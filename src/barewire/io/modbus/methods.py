"""The verbs under the field's names: `read_holding_registers(address, quantity)` and the others, for both clients.

    client.read_holding_registers(107, 3)                 -> (555, 0, 100)          the blocking client
    await client.read_holding_registers(107, 3)           -> (555, 0, 100)          the asyncio client
    client.at(unit=7).read_coils(0, 8)                    another unit of the same line

A verb is a message and what is wanted of its answer, on one line of `Verbs`; nothing is written twice. How the types
get there: a `Verb` is a descriptor that took its parameters from the message's own constructor (a ParamSpec), so names,
order and kinds of the arguments are the message's. What comes out depends on which client it is asked of: `__get__` has
an overload for each, value or coroutine. Unit and time-out are not arguments of a message, so they are said by `at`.
The file of a message is loaded when its verb is first used.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from types import MethodType
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, TypeVar, overload

from barewire import modbus

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from barewire import modbus as messages
    from barewire.io.modbus.async_client import AsyncModbusClient
    from barewire.io.modbus.client import ModbusClient
    from barewire.modbus.messages.base import Request, Response
else:

    class _Messages:
        """For a type checker `messages.ReadCoils` is the class; here it is what loads the class when it is called."""

        def __getattr__(self, name: str) -> Callable[[], Any]:
            return lambda: getattr(modbus, name)

    messages = _Messages()

P = ParamSpec("P")
R = TypeVar("R", bound="Response")
V = TypeVar("V")


class Verb(Generic[P, R, V]):
    """One verb: the request that it sends, and what it takes of the answer."""

    def __init__(self, request: Callable[P, Request[R]], take: Callable[[R], V]) -> None:
        self._find: Any = request  # what finds it, when it is needed: see `messages`
        self.take = take
        self._name = ""

    @cached_property
    def request(self) -> Callable[P, Request[R]]:
        """What makes the request: its class, loaded when the verb is first used."""
        made_by: Callable[P, Request[R]] = self._find()
        return made_by

    if TYPE_CHECKING:

        @overload
        def __get__(self, client: ModbusClient, kind: type) -> Callable[P, V]: ...

        @overload
        def __get__(self, client: AsyncModbusClient, kind: type) -> Callable[P, Coroutine[Any, Any, V]]: ...

        @overload
        def __get__(self, client: None, kind: type) -> Callable[..., V | Coroutine[Any, Any, V]]: ...

    def __get__(self, client: Any, kind: type) -> Any:
        """Asked for the first time: from now on a plain function stands in this place, which is quicker to call. What
        makes its requests is its `request`."""
        request, take = self.request, self.take

        def said(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
            return client.fetch(request(*args, **kwargs), take)

        said.__name__, said.__doc__ = self._name, request.__doc__
        said.request = request  # type: ignore[attr-defined]
        setattr(Verbs, self._name, said)
        return said if client is None else MethodType(said, client)

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name


def _nothing(answer: Response) -> None:
    """A write that was answered was carried out: there is nothing more to say."""


class Verbs:
    """What both clients can say. `ask` says everything else."""

    read_coils = Verb(messages.ReadCoils, lambda answer: answer.bits)
    read_discrete_inputs = Verb(messages.ReadDiscreteInputs, lambda answer: answer.bits)
    read_holding_registers = Verb(messages.ReadHoldingRegisters, lambda answer: answer.registers)
    read_input_registers = Verb(messages.ReadInputRegisters, lambda answer: answer.registers)
    write_single_coil = Verb(messages.WriteSingleCoil, _nothing)
    write_single_register = Verb(messages.WriteSingleRegister, _nothing)
    write_multiple_coils = Verb(messages.WriteMultipleCoils, _nothing)
    write_multiple_registers = Verb(messages.WriteMultipleRegisters, _nothing)
    mask_write_register = Verb(messages.MaskWriteRegister, _nothing)
    read_write_multiple_registers = Verb(messages.ReadWriteMultipleRegisters, lambda answer: answer.registers)
    read_fifo_queue = Verb(messages.ReadFifoQueue, lambda answer: answer.registers)
    read_file_record = Verb(messages.ReadFileRecord, lambda answer: answer.records)
    write_file_record = Verb(messages.WriteFileRecord, _nothing)
    read_exception_status = Verb(messages.ReadExceptionStatus, lambda answer: answer.status)
    diagnostics = Verb(messages.Diagnostics, lambda answer: answer.data)
    get_comm_event_counter = Verb(messages.GetCommEventCounter, lambda answer: answer)
    get_comm_event_log = Verb(messages.GetCommEventLog, lambda answer: answer)
    report_server_id = Verb(messages.ReportServerId, lambda answer: answer.data)
