"""`barewire gateway`: the gateway of the stack, `python -m barewire.gateway`, with the same arguments."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("gateway")
@click.argument("config", required=False, type=click.Path(dir_okay=False, path_type=Path))
@click.option("--check", is_flag=True, help="Say what is wrong in CONFIG, and end.")
@click.option("--status", is_flag=True, help="Print what the running gateway of CONFIG does, and end.")
@click.option("--example", is_flag=True, help="Print a commented configuration, and end.")
@click.option("--schema", is_flag=True, help="Print the JSON schema of configurations, and end.")
def gateway_command(config: Path | None, **flags: bool) -> int:
    """Serve lines and buses to many Modbus clients; publish values to MQTT.

    CONFIG is a TOML file, see docs/how-to/gateway.md. Until SIGTERM or Ctrl-C; SIGHUP reads CONFIG again.
    """
    from barewire.gateway.__main__ import run_program

    if config is None and not (flags["example"] or flags["schema"]):
        raise click.UsageError("expected CONFIG; --example prints one")
    return run_program([*(f"--{name}" for name, is_set in flags.items() if is_set), *([str(config)] if config else [])])
