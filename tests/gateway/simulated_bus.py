"""A bus in virtual time behind a dispatcher: units with registers, some of them silent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from barewire.gateway.dispatch import NO_RESPONSE, Dispatcher, Exchange, Query
from barewire.modbus import Caller, ModbusException, RawRequest, Table, decode_request


def read(address: int, quantity: int = 1, function: int = 3) -> RawRequest:
    return RawRequest(bytes((function,)) + address.to_bytes(2, "big") + quantity.to_bytes(2, "big"))


def write(address: int, value: int) -> RawRequest:
    return RawRequest(b"\x06" + address.to_bytes(2, "big") + value.to_bytes(2, "big"))


@dataclass
class SimulatedBus:
    """Carries out what the dispatcher lets out, one exchange after the other. Each takes `takes` seconds."""

    dispatcher: Dispatcher
    takes: float = 0.01
    silent: set[int] = field(default_factory=set)
    ignores: Callable[[RawRequest], bool] = lambda request: False
    """Which requests no unit answers, though it answers others."""
    now: float = 0.0
    log: list[Exchange] = field(default_factory=list)
    answers: list[tuple[Query, bytes]] = field(default_factory=list)
    unanswered: list[Query] = field(default_factory=list)
    """The queries that ended without a response, because their client has left."""
    units: dict[int, Table] = field(default_factory=dict)

    def submit(self, client: Caller, unit: int, request: RawRequest) -> Query:
        def respond(pdu: bytes | None) -> None:
            if pdu is None or client.is_gone:
                self.unanswered.append(query)
            else:
                self.answers.append((query, pdu))

        query = Query(client, unit, request, respond)
        self.dispatcher.submit(query, self.now)
        return query

    def answer_to(self, query: Query) -> str | None:
        """The response to a query, None before it has one. It must not have two."""
        found = [pdu for answered, pdu in self.answers if answered is query]
        assert len(found) < 2
        return found[0].hex(" ") if found else None

    def _is_silence(self, exchange: Exchange) -> bool:
        return exchange.unit in self.silent or self.ignores(exchange.request)

    def handle(self, exchange: Exchange) -> bytes | int:
        """What a unit makes of an exchange."""
        if self._is_silence(exchange):
            return NO_RESPONSE
        if exchange.unit not in self.units:
            self.units[exchange.unit] = Table(200)
        try:
            response = self.units[exchange.unit].handle(decode_request(exchange.request.pdu), self.now)
        except ModbusException as declined:
            return bytes((exchange.request.function_code | 0x80, declined.code))
        assert response is not None
        return response.encode()

    def step(self) -> bool:
        """Carry out one exchange, or let the time pass for which the dispatcher waits. False if it has nothing."""
        exchange = self.dispatcher.take(self.now)
        if exchange is None:
            if self.dispatcher.wake is None:
                return False
            self.now = self.dispatcher.wake
            return True
        self.log.append(exchange)
        self.now += exchange.timeout if self._is_silence(exchange) else self.takes
        self.dispatcher.finish(exchange, self.handle(exchange), self.now)
        return True

    def run(self) -> None:
        """Carry out everything that waits."""
        while self.step():
            pass
