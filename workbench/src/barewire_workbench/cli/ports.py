"""`barewire ports`: the serial ports and CAN interfaces of this machine."""

from __future__ import annotations

import click

from barewire_workbench.cli.output import Output, note, output_option


@click.command("ports")
@output_option
@click.pass_context
def ports_command(context: click.Context, output: Output) -> None:
    """List the serial ports and CAN interfaces of this machine.

    Each has the URL to type, and what is known of it: the USB identity, the name that it keeps whatever is plugged in
    first, the programs that have it open, and of a CAN interface state and bit rate. Exit status 1 if there is none.

    \b
    barewire ports
    barewire scan rtu:///dev/ttyUSB0
    """
    from barewire_workbench.live.ports import all_ports

    ports = all_ports()
    width = max((len(port.url) for port in ports), default=0)
    for port in ports:
        output.show(f"{port.url:{width}}  {port}", port.as_dict)
    if not ports:
        note("no serial port and no CAN interface was found")
        context.exit(1)
