"""`barewire canopen`: a simulated device, compared with its DCF and configured."""

from __future__ import annotations

import json
from pathlib import Path

from barewire.canopen import eds
from barewire.devices import load
from barewire.devices.description.export_eds import export
from tests.cli.helpers import error_of, output_of, run_command, simulated_at
from tests.helpers import free_port


def test_diff_dry_run_configure_and_no_differences(tmp_path: Path) -> None:
    file = tmp_path / "left.dcf"
    document = eds.to_dcf(export(load("az3")), 5, {(0x1017, 0): 500, (0x1800, 2): 5})
    file.write_bytes(document.encode())
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        bus = endpoint.replace("node=5&", "")  # the node-ID is that of the DCF
        done = run_command("canopen", "diff", bus, str(file))
        lines = done.stdout.splitlines()
        assert (done.returncode, done.stderr) == (1, "")
        assert [line.partition(" ")[0] for line in lines] == ["1017h:00", "1800h:02"]
        assert lines[0].endswith(": device 1000, configuration 500")
        rows = [
            json.loads(line) for line in run_command("canopen", "diff", bus, str(file), "--json").stdout.splitlines()
        ]
        assert (rows[0]["node"], rows[0]["object"], rows[0]["device"], rows[0]["configuration"]) == (
            5,
            "1017h:00",
            1000,
            500,
        )
        dry = output_of("canopen", "configure", bus, str(file), "--dry-run")
        assert dry.splitlines() == [*lines, "node 5: 2 values would be written"]
        wet = output_of("canopen", "configure", endpoint, str(file))
        assert wet.splitlines() == [*lines, "node 5: 2 values written"]
        assert output_of("canopen", "diff", endpoint, str(file)) == "node 5: no differences\n"
        assert output_of("canopen", "configure", endpoint, str(file), "--json") == ""


def test_files_that_are_not_a_dcf(tmp_path: Path) -> None:
    file = tmp_path / "az3.eds"
    url = f"can://virtual/{tmp_path.name}"
    file.write_bytes(export(load("az3")).encode())
    assert "missing.dcf: No such file" in error_of("canopen", "diff", url, str(tmp_path / "missing.dcf"))
    text = error_of("canopen", "configure", f"{url}?node=5", str(file), status=2)
    assert "the file has no ParameterValue: expected a DCF, such as eds.to_dcf makes of an EDS; " in text
    assert text.endswith("az3.eds\n")
    file.write_bytes(b"hello")
    assert "describes no object: expected a DCF" in error_of("canopen", "diff", url, str(file), status=2)
