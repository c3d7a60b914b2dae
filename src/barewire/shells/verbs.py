"""The verbs under the field's names: `read_holding_registers(address, quantity)` and the others, for both clients.

    client.read_holding_registers(107, 3)                 -> (555, 0, 100)          the blocking client
    await client.read_holding_registers(107, 3)           -> (555, 0, 100)          the asyncio client
    client.at(unit=7).read_coils(0, 8)                    another unit of the same line

A verb is a message and what is wanted of its answer, on one line of `Verbs`; nothing is written twice. How the types
get there: a `Verb` is a descriptor that took its parameters from the message's own constructor (a ParamSpec), so names,
order and kinds of the arguments are the message's. What comes out depends on which client it is asked of: `__get__` has
an overload for each, value or coroutine. Unit and time-out are not arguments of a message, so they are said by `at`.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, TypeVar, overload

from barewire.modbus import (
    Diagnostics,
    GetCommEventCounter,
    GetCommEventLog,
    MaskWriteRegister,
    ReadCoils,
    ReadDiscreteInputs,
    ReadExceptionStatus,
    ReadFifoQueue,
    ReadFileRecord,
    ReadHoldingRegisters,
    ReadInputRegisters,
    ReadWriteMultipleRegisters,
    ReportServerId,
    Request,
    Response,
    WriteFileRecord,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)

if TYPE_CHECKING:
    from barewire.shells.aio_client import AsyncModbusClient
    from barewire.shells.modbus_client import ModbusClient

P = ParamSpec("P")
R = TypeVar("R", bound=Response)
V = TypeVar("V")


class Verb(Generic[P, R, V]):
    """One verb: the request that it sends, and what it takes of the answer."""

    def __init__(self, request: Callable[P, Request[R]], take: Callable[[R], V]) -> None:
        self.request = request
        self.take = take
        self.__doc__ = request.__doc__

    @overload
    def __get__(self, client: ModbusClient, kind: type) -> Callable[P, V]: ...

    @overload
    def __get__(self, client: AsyncModbusClient, kind: type) -> Callable[P, Coroutine[Any, Any, V]]: ...

    @overload
    def __get__(self, client: None, kind: type) -> Verb[P, R, V]: ...

    def __get__(self, client: Any, kind: type) -> Any:
        if client is None:
            return self

        def said(*args: P.args, **kwargs: P.kwargs) -> Any:
            return client.fetch(self.request(*args, **kwargs), self.take)

        said.__doc__ = self.__doc__
        return said


def _nothing(answer: Response) -> None:
    """A write that was answered was carried out: there is nothing more to say."""


class Verbs:
    """What both clients can say. `ask` says everything else."""

    read_coils = Verb(ReadCoils, lambda answer: answer.bits)
    read_discrete_inputs = Verb(ReadDiscreteInputs, lambda answer: answer.bits)
    read_holding_registers = Verb(ReadHoldingRegisters, lambda answer: answer.registers)
    read_input_registers = Verb(ReadInputRegisters, lambda answer: answer.registers)
    write_single_coil = Verb(WriteSingleCoil, _nothing)
    write_single_register = Verb(WriteSingleRegister, _nothing)
    write_multiple_coils = Verb(WriteMultipleCoils, _nothing)
    write_multiple_registers = Verb(WriteMultipleRegisters, _nothing)
    mask_write_register = Verb(MaskWriteRegister, _nothing)
    read_write_multiple_registers = Verb(ReadWriteMultipleRegisters, lambda answer: answer.registers)
    read_fifo_queue = Verb(ReadFifoQueue, lambda answer: answer.registers)
    read_file_record = Verb(ReadFileRecord, lambda answer: answer.records)
    write_file_record = Verb(WriteFileRecord, _nothing)
    read_exception_status = Verb(ReadExceptionStatus, lambda answer: answer.status)
    diagnostics = Verb(Diagnostics, lambda answer: answer.data)
    get_comm_event_counter = Verb(GetCommEventCounter, lambda answer: answer)
    get_comm_event_log = Verb(GetCommEventLog, lambda answer: answer)
    report_server_id = Verb(ReportServerId, lambda answer: answer.data)
