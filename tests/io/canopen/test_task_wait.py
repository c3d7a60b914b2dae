"""A wait of a task: it goes on in the round in which it is woken, it can be cancelled, and no wake-up is lost."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from contextvars import ContextVar, copy_context
from typing import Any

import pytest

from barewire import AsyncCanopenClient
from barewire.canopen import CanFrame
from barewire.io.canopen.bus.task_wait import TaskWait
from tests.io.canopen.test_async_fast_path import PairPort
from tests.io.canopen.test_fast_path import READ, VALUE

MARK: ContextVar[str] = ContextVar("MARK", default="none")


def new_wait() -> TaskWait:
    return TaskWait(asyncio.get_running_loop(), threading.get_ident())


async def note(wait: TaskWait, found: list[str]) -> None:
    found.append("waits")
    MARK.set("task")
    await wait
    found.append(f"goes on, {MARK.get()}")


def in_thread(act: Callable[[], object]) -> None:
    thread = threading.Thread(target=act)
    thread.start()
    thread.join()


@pytest.mark.parametrize("by", ["loop", "thread"])
def test_a_task_goes_on_before_what_is_called_after_the_wake_up(by: str) -> None:
    async def main() -> list[str]:
        loop, wait, found = asyncio.get_running_loop(), new_wait(), list[str]()
        task = asyncio.create_task(note(wait, found))
        await asyncio.sleep(0)

        def wake_then_mark() -> None:
            wait.wake()
            wait.wake()  # a second time is ignored
            loop.call_soon_threadsafe(found.append, "marked")

        if by == "thread":
            in_thread(wake_then_mark)
        else:
            wake_then_mark()
        await task
        await asyncio.sleep(0)
        return found

    assert asyncio.run(main()) == ["waits", "goes on, task", "marked"]


def test_a_callback_of_the_loop_can_let_it_go_on_at_once() -> None:
    async def main() -> list[str]:
        wait, found = new_wait(), list[str]()
        task = asyncio.create_task(note(wait, found))
        await asyncio.sleep(0)

        def callback() -> None:
            wait.wake_now()
            wait.wake_now()
            found.append("called")

        asyncio.get_running_loop().call_soon(callback)
        await task
        return found

    assert asyncio.run(main()) == ["waits", "goes on, task", "called"]


@pytest.mark.parametrize("wake", [TaskWait.wake, TaskWait.wake_now])
def test_one_that_was_woken_before_does_not_wait(wake: Callable[[TaskWait], None]) -> None:
    async def main() -> None:
        wait = new_wait()
        assert repr(wait) == "<TaskWait>"
        wake(wait)
        assert repr(wait) == "<TaskWait, woken>"
        await wait

    asyncio.run(main())


@pytest.mark.parametrize("woken", [False, True])
def test_a_task_that_is_cancelled_gets_the_message(woken: bool) -> None:
    async def main() -> None:
        wait, found = new_wait(), list[str]()
        task = asyncio.create_task(note(wait, found))
        await asyncio.sleep(0)
        if woken:
            wait.wake()
        task.cancel("enough")
        with pytest.raises(asyncio.CancelledError, match="enough"):
            await task
        wait.wake()
        assert found == ["waits"]

    asyncio.run(main())


def test_a_task_that_was_cancelled_before_it_waits() -> None:
    async def cancel_and_wait(wait: TaskWait) -> None:
        task = asyncio.current_task()
        assert task is not None
        task.cancel()
        await wait

    async def main() -> None:
        with pytest.raises(asyncio.CancelledError):
            await asyncio.create_task(cancel_and_wait(new_wait()))
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.001):
                await new_wait()

    asyncio.run(main())


def test_a_loop_that_is_closed_is_not_called() -> None:
    async def wait_for_ever(waits: list[TaskWait]) -> None:
        waits.append(new_wait())
        await waits[0]

    loop, waits = asyncio.new_event_loop(), list[TaskWait]()
    task = loop.create_task(wait_for_ever(waits))
    loop.run_until_complete(asyncio.sleep(0))
    resumes = list(waits[0]._resumes)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        loop.run_until_complete(task)
    waits[0]._resumes.extend(resumes)  # as if a thread woke it before it was cancelled, and was slow
    loop.close()
    in_thread(waits[0].wake)


def test_a_wake_up_between_the_first_step_of_a_wait_and_its_callback_is_not_lost() -> None:
    async def main() -> None:
        wait, found = new_wait(), list[object]()
        assert next(wait.__await__()) is wait
        in_thread(wait.wake)
        wait.add_done_callback(found.append, context=copy_context())  # asyncio calls it after the first step
        await asyncio.sleep(0)
        assert found == [wait]

    asyncio.run(main())


def with_client(main: Callable[[AsyncCanopenClient, PairPort], Coroutine[Any, Any, None]], port: PairPort) -> None:
    async def run() -> None:
        async with AsyncCanopenClient(port, node=5, timeout=5.0) as client:
            await main(client, port)

    asyncio.run(run())


def test_an_answer_read_by_the_loop_is_used_before_anything_else_is_called() -> None:
    """Of two tasks whose answers are read together the first goes on at once, the other in the next round."""
    found = list[str]()

    async def upload(client: AsyncCanopenClient, node: int) -> None:
        assert await client.node(node).sdo.upload(0x1000) == VALUE.data[4:]
        found.append(f"node {node}")

    async def main(client: AsyncCanopenClient, port: PairPort) -> None:
        loop = asyncio.get_running_loop()
        tasks = [asyncio.create_task(upload(client, node)) for node in (5, 6)]
        await asyncio.sleep(0)

        def watch(way: str, frame: CanFrame) -> None:
            if way == "received" and frame.id == 0x585:
                loop.call_soon(found.append, "marked")

        client.bus._watch = watch
        port.arrive(VALUE, CanFrame(0x586, VALUE.data))
        await asyncio.gather(*tasks)

    with_client(main, PairPort({READ: []}))
    assert found == ["node 5", "marked", "node 6"]


def test_a_task_that_fails_when_it_goes_on_leaves_the_bus_usable() -> None:
    async def main(client: AsyncCanopenClient, port: PairPort) -> None:
        async def fail() -> None:
            await client.node().sdo.upload(0x1000)
            raise ValueError("the caller's own")

        for _ in range(3):
            with pytest.raises(ValueError, match="own"):
                await asyncio.create_task(fail())
        assert await client.node().sdo.upload(0x1000) == VALUE.data[4:]

    with_client(main, PairPort({READ: [VALUE]}))
