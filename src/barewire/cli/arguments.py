"""What several commands take: an endpoint, a device. A wrong one is a usage error: status 2."""

from __future__ import annotations

from typing import Any

import click

from barewire.errors import EncodeError
from barewire.shells.endpoint import Endpoint


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
