"""The dispatcher: fair order, joined and merged reads, dead units, bounds. In virtual time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import count, cycle, pairwise

import pytest
from hypothesis import given, strategies as st

from barewire.gateway.dispatch import Dispatcher, Exchange, Query, UnitConfig
from barewire.modbus import Caller, RawRequest, Table, UnitOptions
from tests.gateway.simulated_bus import SimulatedBus, read, write

A, B, C = Caller("a:1"), Caller("b:1"), Caller("c:1")


def sent(bus: SimulatedBus) -> list[tuple[str, int, int]]:
    """Who asked which unit for which address, in the order in which the exchanges went out."""
    return [(row.queries[0].client.peer[0], row.unit, int.from_bytes(row.request.pdu[1:3], "big")) for row in bus.log]


def test_clients_take_turns_however_many_requests_they_send() -> None:
    bus = SimulatedBus(Dispatcher())
    for address in range(4):
        bus.submit(A, 1, read(address))
    bus.submit(B, 1, read(10))
    bus.submit(C, 1, read(20))
    bus.submit(C, 1, read(21))
    bus.run()
    assert [(who, address) for who, _, address in sent(bus)] == [
        *[("a", 0), ("b", 10), ("c", 20), ("a", 1), ("c", 21), ("a", 2), ("a", 3)],
    ]


def test_the_units_of_a_client_take_turns() -> None:
    bus = SimulatedBus(Dispatcher())
    for unit, address in ((1, 0), (1, 1), (1, 2), (2, 3), (3, 4)):
        bus.submit(A, unit, read(address))
    bus.run()
    assert [unit for _, unit, _ in sent(bus)] == [1, 2, 3, 1, 1]


def test_a_write_goes_before_the_reads_of_all_clients() -> None:
    bus = SimulatedBus(Dispatcher())
    for address in range(3):
        bus.submit(A, 1, read(address))
        bus.submit(B, 1, read(10 + address))
    bus.submit(C, 1, write(50, 1))
    bus.run()
    assert sent(bus)[0] == ("c", 1, 50)


@pytest.mark.parametrize("pipelined", [1, 16])
@pytest.mark.parametrize("kind", ["reads", "writes", "both"])
def test_a_greedy_client_gets_no_more_than_a_polite_one(pipelined: int, kind: str) -> None:
    """A sends `pipelined` requests at once, nine others one after the other; all go on for 2000 exchanges."""
    bus, numbers = SimulatedBus(Dispatcher()), count()
    polite = [Caller(f"{name}:1") for name in "bcdefghij"]
    open_queries: dict[Query, Caller] = {}

    def ask(client: Caller) -> None:
        number = next(numbers)
        is_write = client is A and (kind == "writes" or (kind == "both" and number % 2))
        request = write(number % 200, 1) if is_write else read(number % 65536)  # no two reads are alike
        open_queries[bus.submit(client, 1, request)] = client

    for client in (*polite, *[A] * pipelined):
        ask(client)
    for _ in range(2000):
        assert bus.step()
        for query, _ in bus.answers:
            ask(open_queries.pop(query))
        bus.answers.clear()
    turns = Counter(who for who, _, _ in sent(bus))
    assert turns["a"] <= 1.2 * min(turns[client.peer[0]] for client in polite)
    assert max(turns.values()) <= 1.2 * min(turns.values())


def test_a_client_that_polls_may_send_a_command_at_once_now_and_then() -> None:
    bus = SimulatedBus(Dispatcher())
    for client in (A, B, C):
        for address in range(8):
            bus.submit(client, 1, read(address + 100 * (client is B) + 200 * (client is C)))
    for _ in range(4):
        bus.step()
    bus.submit(A, 1, write(50, 1))
    bus.step()
    assert sent(bus)[-1] == ("a", 1, 50)
    bus.submit(A, 1, write(51, 1))  # it has used up its turn
    bus.step()
    bus.step()
    assert [who for who, _, _ in sent(bus)[-2:]] == ["b", "c"]


# Joined, cached and merged reads


def test_identical_reads_on_their_way_are_one_exchange() -> None:
    bus = SimulatedBus(Dispatcher())
    queries = [bus.submit(client, 1, read(5)) for client in (A, B, C)]
    bus.submit(A, 1, read(6))
    bus.run()
    assert len(bus.log) == 2
    assert [bus.answer_to(query) for query in queries] == ["03 02 00 00"] * 3


def test_a_read_that_others_wait_for_keeps_its_own_place() -> None:
    bus = SimulatedBus(Dispatcher())
    for address in range(16):
        bus.submit(A, 1, read(address))
    asked = [bus.submit(B, 1, read(15)), bus.submit(C, 1, read(100))]
    for _ in range(3):
        bus.step()
    assert [bus.answer_to(query) for query in asked] == ["03 02 00 00"] * 2
    bus.run()
    assert len(bus.log) == 17  # and A needs no turn for it


def test_a_read_waits_for_its_own_time_and_not_for_that_of_an_identical_one() -> None:
    bus = SimulatedBus(Dispatcher(patience=1.0))
    early = bus.submit(A, 1, read(5))
    bus.now = 0.9
    late = bus.submit(B, 1, read(5))
    bus.now = 1.1
    bus.run()
    assert (bus.answer_to(early), bus.answer_to(late)) == ("83 06", "03 02 00 00")


def test_a_read_joins_an_identical_one_that_is_under_way() -> None:
    bus = SimulatedBus(Dispatcher())
    early = bus.submit(A, 1, read(5))
    exchange = bus.dispatcher.take(bus.now)
    assert exchange is not None
    late = bus.submit(B, 1, read(5))
    bus.dispatcher.finish(exchange, bus.handle(exchange), bus.now)
    assert (bus.answer_to(early), bus.answer_to(late)) == ("03 02 00 00", "03 02 00 00")


def test_a_read_behind_a_write_of_its_client_joins_none_from_before_it() -> None:
    """The client has written before and is passed over for that: the read of the other one goes first."""
    bus = SimulatedBus(Dispatcher())
    for address in (20, 21, 22):
        bus.submit(B, 1, read(address))
    bus.submit(A, 1, write(6, 1))
    bus.step()
    other = bus.submit(C, 1, read(5))
    bus.submit(A, 1, write(5, 7))
    waiting = bus.submit(A, 1, read(5))
    bus.step()
    exchange = bus.dispatcher.take(bus.now)
    assert exchange is not None
    assert exchange.queries == [other]
    later = bus.submit(A, 1, read(5))
    bus.dispatcher.finish(exchange, bus.handle(exchange), bus.now)
    bus.run()
    assert [bus.answer_to(query) for query in (other, waiting, later)] == [
        *["03 02 00 00", "03 02 00 07", "03 02 00 07"],
    ]


def test_a_full_queue_has_room_for_reads_that_need_no_exchange() -> None:
    bus = SimulatedBus(Dispatcher(capacity=4))
    for client in (A, B, C, Caller("d:1")):
        bus.submit(client, 1, read(int(client.peer[0], 16)))
    more = [bus.submit(Caller(f"x:{number}"), 1, read(0xA)) for number in range(5)]
    bus.run()
    assert {bus.answer_to(query) for query in more} == {"03 02 00 00"}
    assert len(bus.log) == 4


def test_a_read_does_not_join_one_from_before_a_write() -> None:
    bus = SimulatedBus(Dispatcher())
    early = bus.submit(A, 1, read(5))
    exchange = bus.dispatcher.take(bus.now)
    assert exchange is not None
    before = bus.handle(exchange)  # the unit has been read, and its response is on the line
    bus.submit(B, 1, write(5, 7))
    late = bus.submit(B, 1, read(5))
    bus.dispatcher.finish(exchange, before, bus.now)
    bus.run()
    assert bus.answer_to(early) == "03 02 00 00"
    assert bus.answer_to(late) == "03 02 00 07"


def test_a_response_is_kept_for_a_while_and_until_a_write() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(cache=1.0)))
    for _ in range(3):
        bus.submit(A, 1, read(5))
        bus.run()
    assert len(bus.log) == 1
    bus.submit(B, 1, write(5, 7))
    bus.run()
    fresh = bus.submit(A, 1, read(5))
    bus.run()
    assert (bus.answer_to(fresh), len(bus.log)) == ("03 02 00 07", 3)
    bus.now += 1.1
    bus.submit(A, 1, read(5))
    bus.run()
    assert len(bus.log) == 4


def test_diagnostics_with_an_effect_are_sent_each_time() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(cache=9.0)))
    clear, count_ = RawRequest(bytes.fromhex("08000A0000")), RawRequest(bytes.fromhex("08000B0000"))
    bus.handle = lambda exchange: exchange.request.pdu  # type: ignore[method-assign]
    queries = [bus.submit(client, 1, request) for request in (clear, count_) for client in (A, B)]
    bus.run()
    assert [bus.answer_to(query) for query in queries] == ["08 00 0a 00 00"] * 2 + ["08 00 0b 00 00"] * 2
    assert [row.request for row in bus.log] == [clear, clear, count_]


def test_adjacent_reads_are_merged_where_the_options_say_so() -> None:
    bus = SimulatedBus(Dispatcher({2: UnitConfig(merge=2)}))
    bus.units[2] = Table(200, holding_registers=list(range(200)))
    queries = {
        (first, quantity): bus.submit(client, 2, read(first, quantity))
        for client, first, quantity in ((A, 10, 2), (B, 12, 3), (C, 17, 1), (A, 21, 2), (B, 11, 2))
    }
    bus.submit(A, 1, read(10, 2))
    bus.run()
    assert sorted((row.unit, row.request.pdu.hex(" ")) for row in bus.log) == [
        (1, "03 00 0a 00 02"),
        (2, "03 00 0a 00 08"),
        (2, "03 00 15 00 02"),
    ]
    for (first, quantity), query in queries.items():
        expected = "".join(f"{value:04x}" for value in range(first, first + quantity))
        assert bus.answer_to(query) == bytes.fromhex(f"03 {2 * quantity:02x} {expected}").hex(" ")


def test_merged_reads_that_are_declined_together_go_out_alone() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(merge=0)))
    good, bad = bus.submit(A, 1, read(198, 2)), bus.submit(B, 1, read(200, 2))
    bus.run()
    assert (bus.answer_to(good), bus.answer_to(bad)) == ("03 04 00 00 00 00", "83 02")
    assert len(bus.log) == 3


def test_a_merged_read_is_never_longer_than_a_response_can_be() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(merge=8)))
    for first in range(0, 196, 4):
        bus.submit(A, 1, read(first, 4))
    bus.run()
    assert sum(len(row.queries) for row in bus.log) == 49
    assert all(row.request.known is not None for row in bus.log)


# Dead units, pauses


def test_a_dead_unit_is_declined_at_once_and_tried_again_after_a_pause() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(UnitOptions(timeout=0.5, dead_after=2))), silent={9})
    for _ in range(5):
        bus.submit(A, 9, read(0))
        bus.run()
    assert len(bus.log) == 2
    assert bus.now == pytest.approx(1.0)
    bus.now += 1.0
    bus.silent.clear()
    trial = bus.submit(A, 9, read(1))
    second = bus.submit(B, 9, read(2))
    bus.run()
    assert bus.answer_to(trial) == "03 02 00 00"
    assert bus.answer_to(second) == "83 0b"
    bus.submit(B, 9, read(2))
    bus.run()
    assert len(bus.log) == 4


def test_queries_to_a_unit_that_has_died_do_not_wait_any_longer() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(UnitOptions(timeout=0.5, dead_after=2))), silent={9})
    queries = [bus.submit(A, 9, read(address)) for address in range(10)]
    bus.run()
    assert len(bus.log) == 2
    assert {bus.answer_to(query) for query in queries} == {"83 0b"}


@pytest.mark.parametrize(
    ("clients", "registers"),
    [(1, 65536), (32, 65536), (200, 65536), (1, 1), pytest.param(32, 1, marks=pytest.mark.proof)],
)
def test_two_dead_units_of_ten_cost_the_others_little(clients: int, registers: int) -> None:
    """Every client asks one unit after the other. 20 ms an exchange, 0.3 s a time-out, one minute.

    With one register all reads of a unit join one exchange, and again and again nothing waits for a moment.
    """
    bus = SimulatedBus(
        Dispatcher(default=UnitConfig(UnitOptions(timeout=0.3, dead_after=2))), takes=0.02, silent={4, 8}
    )
    numbers = count()
    todo = {Caller(f"c{number}:1"): number % 10 for number in range(clients)}
    waiting: dict[Query, Caller] = {}

    def ask(client: Caller) -> None:
        todo[client] = (todo[client] + 1) % 10
        waiting[bus.submit(client, todo[client], read(next(numbers) % registers))] = client

    for client in list(todo):
        ask(client)
    while bus.now < 60.0:
        bus.step()
        replies, bus.answers = bus.answers, []
        for query, _ in replies:
            ask(waiting.pop(query))
    starts = [exchange.started for exchange in bus.log if exchange.unit not in bus.silent]
    in_first_ten = sum(start <= 10.0 for start in starts)
    assert in_first_ten >= 0.85 * 10.0 / 0.02
    assert len(starts) - in_first_ten >= 0.97 * 50.0 / 0.02


def test_a_dead_unit_of_a_bus_with_little_to_do_is_tried_after_each_pause() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(UnitOptions(timeout=0.3, dead_after=2))), takes=0.02, silent={9})
    while bus.now < 20.0:
        for unit in (1, 9):
            bus.submit(A, unit, read(0))
        bus.run()
        bus.now += 0.1
    trials = [exchange.started for exchange in bus.log if exchange.unit == 9]
    pauses = [later - earlier - 0.3 for earlier, later in pairwise(trials[1:])]
    assert pauses == pytest.approx([1.0, 2.0, 4.0, 8.0], abs=0.15)


# Requests that a unit ignores, though it answers others


UNKNOWN = RawRequest(b"\x41\x01")


def beyond(request: RawRequest) -> bool:
    """Whether a unit ignores a request: an unknown function, or a register from 500 on."""
    return request.pdu[0] == 0x41 or int.from_bytes(request.pdu[1:3], "big") >= 500


def poll(bus: SimulatedBus, until: float, *polls: tuple[Caller, float, Callable[[], RawRequest]]) -> list[list[str]]:
    """Let clients ask unit 1 one request after the other, each with its pause; return their answers."""
    due, asked = [0.0] * len(polls), [None] * len(polls)  # type: tuple[list[float], list[Query | None]]
    answers: list[list[str]] = [[] for _ in polls]
    while bus.now < until:
        for place, (client, pause, make) in enumerate(polls):
            query = asked[place]
            if query is not None and (answer := bus.answer_to(query)) is not None:
                answers[place].append(answer)
                asked[place], due[place] = None, bus.now + pause
            if asked[place] is None and bus.now >= due[place]:
                asked[place] = bus.submit(client, 1, make())
        bus.answers = [row for row in bus.answers if row[0] in asked]
        if not bus.step() and not bus.answers:
            bus.now = max(bus.now + 0.001, min(at for at, query in zip(due, asked) if query is None))
    return answers


@pytest.mark.parametrize("requests", [[UNKNOWN], [read(500)], [UNKNOWN, read(500), write(500, 1), write(500, 2)]])
@pytest.mark.parametrize("pause", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("rarely", [1.0, 10.0])
def test_what_a_unit_ignores_takes_it_from_no_other_client(
    requests: list[RawRequest], pause: float, rarely: float
) -> None:
    bus = SimulatedBus(Dispatcher(), ignores=beyond)
    good, bad = poll(bus, 600.0, (A, rarely, lambda: read(5)), (B, pause, cycle(requests).__next__))
    assert set(good) == {"03 02 00 00"}
    assert {answer[3:] for answer in bad} == {"0b"}
    assert sum(row.unit == 1 and beyond(row.request) for row in bus.log) <= 26 * len(requests)
    command = bus.submit(C, 1, write(40, 1))
    bus.run()
    assert bus.answer_to(command) == "06 00 28 00 01"


@pytest.mark.parametrize("rarely", [0.3, 1.0, 10.0])
def test_a_client_that_searches_a_unit_takes_it_from_no_other(rarely: float) -> None:
    bus, numbers = SimulatedBus(Dispatcher(), ignores=beyond), count(500)
    good, _ = poll(bus, 600.0, (A, rarely, lambda: read(5)), (B, 0.05, lambda: read(next(numbers))))
    assert set(good) == {"03 02 00 00"}


@pytest.mark.parametrize("rarely", [1.0, 10.0])
def test_a_unit_that_is_first_asked_for_what_it_ignores_is_found_soon(rarely: float) -> None:
    bus = SimulatedBus(Dispatcher(), ignores=beyond)
    poll(bus, 30.0, (B, 0.05, lambda: UNKNOWN))
    good, _ = poll(bus, 90.0, (A, rarely, lambda: read(5)), (B, 0.05, lambda: UNKNOWN))
    assert good[-1] == "03 02 00 00"
    assert good.count("83 0b") <= 31.0 / rarely + 1


@pytest.mark.parametrize("rarely", [0.3, 1.0, 10.0])
def test_a_unit_that_was_off_answers_all_again_soon_though_some_ask_for_what_it_ignores(rarely: float) -> None:
    bus = SimulatedBus(Dispatcher(), ignores=beyond)
    polls = (A, rarely, lambda: read(5)), (B, 0.05, lambda: UNKNOWN)
    poll(bus, 60.0, *polls)
    bus.silent = {1}
    poll(bus, 300.0, *polls)
    bus.silent = set()
    good, _ = poll(bus, 400.0, *polls)
    assert good[-1] == "03 02 00 00"
    assert good.count("83 0b") <= 62.0 / rarely + 1


def test_a_unit_that_was_replaced_is_found_by_those_that_ask_the_new_one() -> None:
    bus, is_new = SimulatedBus(Dispatcher()), False
    bus.ignores = lambda request: (request.pdu == read(5).pdu) is is_new
    polls = (A, 0.3, lambda: read(5)), (B, 1.0, lambda: read(6))
    poll(bus, 60.0, *polls)
    is_new = True
    _, new = poll(bus, 200.0, *polls)
    assert new[-30:] == ["03 02 00 00"] * 30


@pytest.mark.parametrize(("same", "costs"), [(True, 2), (False, 4)])
def test_a_unit_that_dies_costs_two_requests_and_twice_that_if_all_are_new(same: bool, costs: int) -> None:
    bus, numbers = SimulatedBus(Dispatcher()), count(10)
    for _ in range(5):
        bus.submit(A, 1, read(5))
        bus.run()
    bus.silent = {1}
    for _ in range(20):
        bus.submit(A, 1, read(5 if same else next(numbers)))
        bus.run()
    assert len(bus.log) == 5 + costs
    known = bus.submit(A, 1, read(5))
    bus.run()
    assert bus.answer_to(known) == "83 0b"
    assert len(bus.log) == 5 + costs + (not same)
    bus.submit(A, 1, read(5))
    bus.run()
    assert len(bus.log) == 5 + costs + (not same)


@pytest.mark.parametrize("merge", [1, 4])
def test_merged_reads_that_are_ignored_together_go_out_alone(merge: int) -> None:
    """Also if what the unit ignores is a register that none asked for."""
    bus = SimulatedBus(Dispatcher(default=UnitConfig(merge=merge)))
    bus.ignores = lambda request: 7 in range(request.pdu[2], sum(request.pdu[2:5]))
    for _ in range(100):
        queries = [bus.submit(client, 1, read(address)) for client, address in ((A, 5), (B, 7), (C, 9))]
        bus.run()
        assert [bus.answer_to(query) for query in queries] == ["03 02 00 00", "83 0b", "03 02 00 00"]
        bus.now += 0.1
    assert sum(bus.ignores(row.request) for row in bus.log) <= 12


def test_a_dead_unit_costs_no_more_if_reads_are_merged() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(merge=0)), silent={1})
    queries = [bus.submit(A, 1, read(address)) for address in range(10)]
    bus.run()
    assert len(bus.log) == 2
    assert {bus.answer_to(query) for query in queries} == {"83 0b"}


def test_the_pause_of_a_unit_does_not_delay_others() -> None:
    bus = SimulatedBus(Dispatcher({1: UnitConfig(UnitOptions(gap=0.2))}))
    for address in range(3):
        bus.submit(A, 1, read(address))
        bus.submit(B, 2, read(address))
    bus.run()
    assert [unit for _, unit, _ in sent(bus)] == [1, 2, 2, 2, 1, 1]
    starts = [row.started for row in bus.log if row.unit == 1]
    assert all(later - earlier >= 0.2 for earlier, later in pairwise(starts))


# Bounds, and clients that leave


def test_a_full_queue_declines_the_client_that_fills_it() -> None:
    bus = SimulatedBus(Dispatcher(capacity=10))
    greedy = [bus.submit(A, 1, read(address)) for address in range(12)]
    polite = bus.submit(B, 1, read(100))
    assert [bus.answer_to(query) for query in greedy] == [None] * 9 + ["83 06"] * 3
    bus.run()
    assert bus.answer_to(polite) == "03 02 00 00"


def test_a_newcomer_takes_no_place_of_a_client_that_has_only_one() -> None:
    bus = SimulatedBus(Dispatcher(capacity=4))
    clients = [Caller(f"{number}:1") for number in range(5)]
    queries = [bus.submit(client, 1, read(place)) for place, client in enumerate(clients)]
    assert [bus.answer_to(query) for query in queries] == [None] * 4 + ["83 06"]


def test_of_equal_clients_the_one_whose_turn_is_last_makes_room() -> None:
    bus = SimulatedBus(Dispatcher(capacity=4))
    queries = [bus.submit(client, 1, read(address)) for address, client in enumerate((A, B, A, B))]
    bus.submit(C, 1, read(9))
    assert [bus.answer_to(query) for query in queries] == [None, None, None, "83 06"]


def test_a_query_that_was_displaced_is_not_joined_any_more() -> None:
    bus = SimulatedBus(Dispatcher(capacity=4))
    for address in range(4):
        bus.submit(A, 1, read(address))
    bus.submit(B, 1, read(9))
    late = bus.submit(C, 1, read(3))
    bus.run()
    assert bus.answer_to(late) == "03 02 00 00"


def test_a_bus_that_ends_while_merged_reads_go_out_alone_goes_on() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(merge=4)))
    both = bus.submit(A, 1, read(199)), bus.submit(B, 1, read(200))
    bus.step()
    bus.dispatcher.decline_all(0x0A)
    assert [bus.answer_to(query) for query in both] == ["83 0a"] * 2
    assert bus.dispatcher.size == 0
    again = bus.submit(A, 1, read(199))
    bus.run()
    assert bus.answer_to(again) == "03 02 00 00"


def test_nothing_is_kept_of_clients_that_come_and_go() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(merge=4)))
    for number in range(500):
        pair = Caller(f"x:{number}"), Caller(f"y:{number}")
        for client in pair:
            bus.submit(client, 1, write(number % 100, 1))
            bus.submit(client, 1, read(number % 100))
            bus.submit(client, 1, read(number % 100 + 1))
        bus.run()
        for client in pair:
            client.is_gone = True
    assert len(bus.dispatcher._clients) <= 70


def test_a_write_to_unit_0_may_be_a_broadcast_so_nothing_that_was_read_before_is_given_to_anybody() -> None:
    bus = SimulatedBus(Dispatcher(default=UnitConfig(cache=10.0)))
    bus.submit(A, 1, read(5))
    bus.run()
    bus.submit(B, 0, write(5, 1))
    bus.run()
    bus.submit(A, 1, read(5))
    bus.run()
    assert len(bus.log) == 3


def test_trials_of_dead_units_do_not_wait_for_each_other() -> None:
    bus = SimulatedBus(
        Dispatcher(default=UnitConfig(UnitOptions(timeout=1.0, dead_after=1)), patience=10.0), silent={8, 9}
    )
    for unit in (8, 9):
        bus.submit(A, unit, read(0))
        bus.run()
    bus.now += 40.0
    numbers = count()
    for _ in range(3):  # a line that is never idle
        bus.submit(B, 1, read(next(numbers)))
    dead = [bus.submit(A, 8, read(1)), bus.submit(A, 9, read(1))]
    asked_at, waits = bus.now, {}
    for _ in range(200):
        bus.submit(B, 1, read(next(numbers)))
        bus.step()
        for query in dead:
            if query not in waits and bus.answer_to(query):
                waits[query] = bus.now - asked_at
    assert all(waits[query] <= 2.5 for query in dead)


def test_a_query_that_waits_too_long_is_not_sent() -> None:
    bus = SimulatedBus(Dispatcher(patience=1.0))
    query = bus.submit(A, 1, write(0, 1))
    bus.now += 1.0
    bus.run()
    assert (bus.answer_to(query), bus.log) == ("86 06", [])


def test_what_a_client_that_left_asked_for_is_not_sent() -> None:
    bus = SimulatedBus(Dispatcher())
    gone = Caller("x:1")
    lost = [bus.submit(gone, 1, write(5, 1)), bus.submit(gone, 1, read(5))]
    joined = bus.submit(B, 1, read(5))
    gone.is_gone = True
    bus.run()
    assert bus.unanswered == lost[1:] + lost[:1] or bus.unanswered == lost
    assert [bus.answer_to(query) for query in lost] == [None, None]
    assert bus.answer_to(joined) == "03 02 00 00"
    assert [row.request.pdu[0] for row in bus.log] == [3]
    assert bus.dispatcher.size == 0


def test_each_query_is_counted_once() -> None:
    bus = SimulatedBus(Dispatcher({2: UnitConfig(cache=9.0), 3: UnitConfig(merge=0)}, capacity=9), silent={9})
    for client in (A, B):
        bus.submit(client, 1, read(5))
    bus.submit(A, 1, read(500))
    bus.submit(A, 3, read(0))
    bus.submit(B, 3, read(1))
    bus.run()
    for _ in range(2):
        bus.submit(A, 2, read(5))
        bus.run()
    for address in range(4):
        bus.submit(A, 9, read(address))
    bus.run()
    bus.submit(A, 9, read(0))
    for address in range(12):
        bus.submit(C, 4, read(address))
    bus.run()
    counters = {number: state.counters for number, state in bus.dispatcher.units.items()}
    queries = {
        number: (row.answered, row.cached, row.unanswered, row.busy, row.joined) for number, row in counters.items()
    }
    assert queries == {
        **{1: (3, 0, 0, 0, 1), 2: (1, 1, 0, 0, 0), 3: (2, 0, 0, 0, 1)},
        **{4: (9, 0, 0, 3, 0), 9: (0, 0, 5, 0, 0)},
    }
    assert [(row.requests, row.exceptions, row.no_responses) for row in counters.values()] == [
        *[(2, 1, 0), (1, 0, 0), (1, 0, 0), (2, 0, 2), (9, 0, 0)],
    ]
    assert counters[1].total == pytest.approx(0.02)


def test_every_exchange_ends_with_a_response_or_without_one() -> None:
    """Also if the connection has ended, the gateway's own code has failed, or there must be none."""
    bus = SimulatedBus(Dispatcher())
    outcomes: list[tuple[bytes | int | None, bool]] = [(b"\x03\x02\0\0", True), (0x0B, True), (0x0B, False)]
    for response, is_silence in (*outcomes, (0x04, False), (None, True), (b"\x83\x02", True)):
        bus.submit(A, 1, read(5))
        exchange = bus.dispatcher.take(bus.now)
        assert exchange is not None
        bus.dispatcher.finish(exchange, response, bus.now, is_silence=is_silence)
    row = bus.dispatcher.unit(1).counters
    assert (row.requests, row.responses, row.exceptions, row.no_responses) == (6, 2, 1, 3)
    assert (row.answered, row.unanswered, row.failed) == (2, 2, 1)


REQUESTS = st.one_of(
    st.builds(read, st.integers(0, 12), st.integers(1, 3)),
    st.builds(read, st.integers(0, 12), st.integers(1, 9), st.just(1)),
    st.builds(write, st.integers(0, 12), st.integers(1, 9)),
)
OPTIONS = st.builds(
    UnitConfig,
    st.builds(UnitOptions, timeout=st.just(0.1), gap=st.sampled_from([0.0, 0.05]), dead_after=st.integers(0, 2)),
    cache=st.sampled_from([0.0, 0.03, 1.0]),
    merge=st.sampled_from([None, 0, 4]),
)
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("ask"), st.integers(0, 3), st.integers(1, 3), REQUESTS),
        st.tuples(st.just("take"), st.integers(0, 20)),
        st.tuples(st.just("finish"), st.integers(0, 3)),
        st.tuples(st.just("leave"), st.integers(0, 3)),
        st.tuples(st.just("silent"), st.integers(1, 3)),
    ),
    max_size=60,
)


@given(OPTIONS, EVENTS, st.integers(1, 4))
def test_every_query_has_one_answer_and_no_read_is_older_than_a_write_that_was_answered_before_it(
    options: UnitConfig, events: list[tuple[object, ...]], lanes: int
) -> None:
    bus = SimulatedBus(Dispatcher(default=options, capacity=12, patience=5.0))
    clients = [Caller(f"{number}:1") for number in range(4)]
    under_way: list[tuple[Exchange, bytes | int]] = []
    asked: list[tuple[Query, dict[tuple[int, int], int]]] = []
    written: dict[tuple[int, int], int] = {}  # the value of each register by the latest write that was answered
    versions = count(1)

    def finish(place: int) -> None:
        exchange, response = under_way.pop(place)
        bus.dispatcher.finish(exchange, response, bus.now)
        if exchange.request.function_code == 6 and isinstance(response, bytes) and response[0] == 6:
            written[exchange.unit, response[2]] = int.from_bytes(response[3:], "big")

    for event in events:
        match event:
            case ("ask", int(client), int(unit), RawRequest() as request):
                if request.function_code == 6:  # values grow, so an older one is smaller
                    request = write(request.pdu[2], next(versions))
                asked.append((bus.submit(clients[client], unit, request), dict(written)))
            case ("take", int(later)):
                bus.now += later / 100
                exchange = bus.dispatcher.take(bus.now) if len(under_way) < lanes else None
                if exchange is not None:
                    under_way.append((exchange, bus.handle(exchange)))
            case ("finish", int(place)) if under_way:
                finish(place % len(under_way))
            case ("leave", int(client)):
                clients[client].is_gone = True
                clients[client] = Caller(f"{client}:2")
            case ("silent", int(unit)):
                bus.silent ^= {unit}
    while under_way:
        finish(0)
    bus.run()
    ended = Counter([query for query, _ in bus.answers] + bus.unanswered)
    assert all(ended[query] == 1 for query, _ in asked)
    for query, known in asked:
        answer = bus.answer_to(query)
        assert answer is not None or query.client.is_gone
        if answer is None or query.request.function_code != 3 or answer.startswith("83"):
            continue
        first, quantity = query.request.pdu[2], query.request.pdu[4]
        values = bytes.fromhex(answer)[2:]
        assert len(values) == 2 * quantity
        for place in range(quantity):
            value = int.from_bytes(values[2 * place : 2 * place + 2], "big")
            assert value >= known.get((query.unit, first + place), 0)
    assert bus.dispatcher.size == 0
