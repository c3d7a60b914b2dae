"""What several commands take and give: an endpoint, a device; one JSON object a line."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint


class EndpointArgument(click.ParamType[str]):
    """A URL, checked before anything is opened; it stays text."""

    name = "endpoint"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The URL itself."""
        try:
            Endpoint.parse(value)
        except EncodeError as error:
            self.fail(str(error), param, ctx)
        return str(value)


endpoint_argument = click.argument("endpoint", type=EndpointArgument())
device_argument = click.argument("device")
json_option = click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")


timing_option = click.option(
    "--timing", is_flag=True, help="Say on stderr what the line's settings and its latency mean, in milliseconds."
)


def say_timing(endpoint: str, wanted: bool) -> None:
    """What `--timing` asks for."""
    if wanted:
        from barewire.io.modbus.carriers import modbus_endpoint, timing_in_words

        print(f"barewire: {endpoint} {timing_in_words(modbus_endpoint(endpoint))}", file=sys.stderr)


def print_json(fields: Any) -> None:
    """One object on one line, at once."""
    print(json.dumps(_plain(fields), ensure_ascii=False, allow_nan=False), flush=True)


@contextmanager
def ending(as_json: bool) -> Iterator[None]:
    """A battery that could not be finished says so in JSON too, as its last object."""
    from barewire.io.engine.conformance import Unfinished

    try:
        yield
    except Unfinished as error:
        if as_json:
            print_json({"unfinished": str(error), "not_run": error.not_run})
        raise


def _plain(value: Any) -> Any:
    """JSON has no numbers for NaN and the infinities: they are told as text."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value
