"""The gateway in virtual time: twenty minutes of the laboratory's week, and brokers that hang for long."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from barewire.gateway.config import read_config
from barewire.gateway.gateway import Gateway
from tools.gateway_lab.broker import machine, meter
from tools.gateway_lab.mqtt_broker import Broker
from tools.gateway_lab.virtual_time import run_in_virtual_time
from tools.gateway_lab.week import play


@pytest.mark.long
def test_nothing_is_lost_among_faults() -> None:
    outcome = play(1200.0, quiet=300.0)
    assert outcome.errors == []
    assert sum(outcome.faults.values()) > 200
    assert outcome.responses["right"] > 200
    assert outcome.responses["wrong"] == outcome.responses["lost"] == 0
    heard = outcome.received
    assert heard.latest > 100
    assert heard.missing == outcome.dropped
    assert heard.unmarked == heard.backwards == outcome.wrong_readings == 0


def test_a_broker_that_answers_nothing_is_left_no_connection(tmp_path: Path) -> None:
    """Or each of them, which has the last will, would say later that the publisher is offline."""

    async def main() -> None:
        broker = Broker(lambda topic, payload: None)
        await broker.open()
        broker.is_mute = True
        url = f"mqtt://127.0.0.1:{broker.port}"
        dead = machine("dead", "tcp://127.0.0.1:9", meter(tmp_path, 1), 1, 20.0)
        async with Gateway(read_config(f'[publish]\nbroker = "{url}"\nsite = "x"\n{dead}')):
            await asyncio.sleep(1800.0)
            assert len(broker.connections) <= 1
            broker.speak()
            await asyncio.sleep(60.0)
            assert len(broker.connections) == 1
        assert not broker.connections
        broker.close()

    run_in_virtual_time(main())
