"""`barewire canopen`: a simulated device, compared with its DCF and configured."""

from __future__ import annotations

import json
from pathlib import Path

from barewire.canopen import concise_dcf, device_configuration, eds, encode_concise_dcf
from barewire.devices import load
from barewire_workbench.eds.export import export
from tests.helpers import free_port
from tests.workbench.cli.helpers import error_of, output_of, run_here, simulated_at


def test_diff_dry_run_configure_and_no_differences(tmp_path: Path) -> None:
    file = tmp_path / "left.dcf"
    document = eds.to_dcf(export(load("az3")), 5, {(0x1017, 0): 500, (0x1800, 2): 5})
    file.write_bytes(document.encode())
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        bus = endpoint.replace("node=5&", "")  # the node-ID is that of the DCF
        done = run_here("canopen", "diff", bus, str(file))
        lines = done.stdout.splitlines()
        assert (done.returncode, done.stderr) == (1, "")
        assert [line.partition(" ")[0] for line in lines] == ["1017h:00", "1800h:02"]
        assert lines[0].endswith(": device 1000, configuration 500")
        rows = [json.loads(line) for line in run_here("canopen", "diff", bus, str(file), "--json").stdout.splitlines()]
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
        dry = output_of("canopen", "configure", endpoint, str(file), "--dry-run")
        assert dry == "node 5: no differences, nothing would be written\n"


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


def plan(tmp_path: Path, startup: int = 1, device_type: int = 0) -> Path:
    """Write the DCF of a manager: node 5 is mandatory, its concise DCF is in a file of its own."""

    def numbers(index: int, value: int) -> eds.EdsObject:
        items = [eds.EdsItem(0, "highest", "u8", "const", default=127), eds.EdsItem(5, "node 5", "u32", default=value)]
        return eds.EdsObject(index, f"object {index:X}", 8, tuple(items))

    domains = (eds.EdsItem(0, "highest", "u8", "const", default=127), eds.EdsItem(5, "node 5", "domain"))
    objects = [
        eds.EdsObject(0x1F80, "NMT startup", 7, (eds.EdsItem(0, "NMT startup", "u32", default=startup),)),
        eds.EdsObject(0x1F89, "Boot time", 7, (eds.EdsItem(0, "Boot time", "u32", default=20000),)),
        numbers(0x1F81, 0xD),
        numbers(0x1F84, device_type),
        eds.EdsObject(0x1F22, "Concise DCF", 8, domains),
    ]
    document = eds.compose(objects)
    document.put("1F22sub5", "DownloadFile", "left.concise")
    values = concise_dcf(device_configuration(eds.to_dcf(export(load("az3")), 5, {(0x1017, 0): 200})))
    (tmp_path / "left.concise").write_bytes(encode_concise_dcf(values))
    file = tmp_path / "manager.dcf"
    file.write_bytes(document.encode())
    return file


def test_boot_a_network_of_dcfs(tmp_path: Path) -> None:
    file = tmp_path / "left.dcf"
    file.write_bytes(eds.to_dcf(export(load("az3")), 5, {(0x1017, 0): 5000}).encode())
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        dry = output_of("canopen", "boot", endpoint, str(file), "--dry-run").splitlines()
        assert dry[0].startswith("node 5: 1017h:00 ")
        assert dry[0].endswith(": device 1000, configuration 5000")
        assert dry[1:] == ["the network could be ready"]
        (row,) = [
            json.loads(line)
            for line in output_of("canopen", "boot", endpoint, str(file), "--dry-run", "--json").splitlines()[:1]
        ]
        assert (row["node"], row["event"], row["error"], len(row["planned"])) == (5, "checked", None, 1)
        lines = output_of("canopen", "boot", endpoint, str(file)).splitlines()
        assert lines == ["node 5: booted, configured", "node 5: started", "the network is ready"]
        rows = [json.loads(line) for line in output_of("canopen", "boot", endpoint, str(file), "--json").splitlines()]
        assert [row["event"] for row in rows] == ["booted", "started", "ready"]
        assert (rows[0]["error"], rows[0]["configured"]) == (None, True)


def test_boot_a_network_of_a_manager(tmp_path: Path) -> None:
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        dry = output_of("canopen", "boot", endpoint, str(plan(tmp_path)), "--dry-run").splitlines()
        assert dry == ["node 5: 1 value of the concise DCF", "the network could be ready"]
        lines = output_of("canopen", "boot", endpoint, str(plan(tmp_path)), "--no-start").splitlines()
        assert lines == ["node 5: booted, configured", "the network is ready"]
        done = run_here("canopen", "boot", endpoint, str(plan(tmp_path, device_type=1)), "--boot-time", "3")
        assert (done.returncode, done.stderr) == (1, "")
        assert done.stdout.splitlines()[0].startswith(
            "node 5: C: another device type (1000h) than expected (1F84h): read "
        )
        assert done.stdout.splitlines()[-1] == "the network is not ready"
        done = run_here("canopen", "boot", endpoint, str(plan(tmp_path, device_type=1)), "--dry-run")
        assert (done.returncode, done.stdout.splitlines()[-1]) == (1, "the network would not be ready")


def test_files_from_which_no_network_boots(tmp_path: Path) -> None:
    url, manager, node = f"can://virtual/{tmp_path.name}", plan(tmp_path), tmp_path / "seven.dcf"
    node.write_bytes(eds.to_dcf(export(load("az3")), 7, {(0x1017, 0): 500}).encode())
    boot = ("canopen", "boot", url)
    assert "expected the DCF of one manager" in error_of(*boot, str(manager), str(manager), status=2)
    assert "node 7 has a DCF, but the manager does not list it (1F81h:07)" in error_of(
        *boot, str(manager), str(node), status=2
    )
    text = error_of("canopen", "boot", f"{url}?node=6", str(node), status=2)
    assert "node 6 is requested; boot boots the nodes of the files, which are 7: leave out node=" in text
    assert "a second DCF of node 7" in error_of(*boot, str(node), str(node), status=2)
    (tmp_path / "left.concise").unlink()
    assert "left.concise: No such file" in error_of(*boot, str(manager))
