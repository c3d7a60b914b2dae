"""The recipes of distributions: names, versions and requirements are those of the project, and their parts work."""

from __future__ import annotations

import ast
import hashlib
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.helpers import some_of
from tools import recipe_parts, rooms

ROOT = Path(__file__).parents[2]
PACKAGING = ROOT / "packaging"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
VERSION = PROJECT["version"]
YOCTO = PACKAGING / "yocto" / f"python3-barewire_{VERSION}.bb"

# Which package of the distribution has a module of the standard library; all others are in its smallest Python.
OF_OPENWRT = {
    "asyncio": "python3-asyncio",
    "fractions": "python3-decimal",  # imports decimal
    "logging": "python3-logging",
    "pathlib": "python3-urllib",  # imports urllib, until CPython 3.12
    "socket": "python3-codecs",  # a name of a host goes through the codec "idna", and that needs unicodedata
    "unicodedata": "python3-codecs",
    "urllib": "python3-urllib",
}
OF_YOCTO = {
    "asyncio": "python3-asyncio",
    "base64": "python3-netclient",
    "datetime": "python3-datetime",
    "difflib": "python3-difflib",
    "fcntl": "python3-fcntl",
    "fractions": "python3-numbers",
    "json": "python3-json",
    "logging": "python3-logging",
    "queue": "python3-threading",
    "random": "python3-math",
    "resource": "python3-resource",
    "shlex": "python3-shell",
    "socket": "python3-io",
    "sys": "python3-core",
    "termios": "python3-io",
    "tomllib": "python3-tomllib",
    "tty": "python3-terminal",
    "urllib": "python3-netclient",
}
# Needed for TLS, for the buffer of a publisher, and in a notebook: not dependencies.
OPTIONAL = {"ssl", "sqlite3", "html"}

needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="GNU make reads the recipe for OpenWrt")


def read(name: str) -> str:
    return (PACKAGING / name).read_text(encoding="utf-8")


def yocto_list(variable: str) -> list[str]:
    """Return the words of a variable of the recipe for Yocto."""
    found = re.search(rf'^{re.escape(variable)} \+?= "([^"]*)"', YOCTO.read_text(encoding="utf-8"), re.MULTILINE)
    assert found, variable
    return found[1].replace("\\\n", " ").replace("${PN}", "python3-barewire").split()


def imports(files: set[str]) -> set[str]:
    """Return the modules that these files import, wherever in them."""
    found: set[str] = set()
    for file in files:
        if file.endswith(".py"):
            for node in rooms.loading_nodes(ROOT / "src" / file):
                if isinstance(node, ast.Import):
                    found |= {alias.name.split(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module:
                    found.add(node.module.split(".")[0])
    return found - OPTIONAL


def test_versions() -> None:
    (source,) = [row for row in recipe_parts.openwrt() if row[0] == "source"]
    assert source[1:3] == ["barewire", VERSION]
    assert YOCTO.is_file()  # the version is in its name
    assert f"\npkgver={VERSION}\n" in read("alpine/APKBUILD")
    assert re.match(r"barewire \((.*)-\d+\) ", read("debian/changelog"))[1] == VERSION  # type: ignore[index]


def test_requirements() -> None:
    assert PROJECT["dependencies"] == []  # one would be a package of each distribution
    oldest = PROJECT["requires-python"].removeprefix(">=")
    assert f"python3 (>= {oldest})" in read("debian/control")


def test_checksums() -> None:
    """A release writes its own into all recipes; that of the licence and of the init script are those of the files."""
    (source,) = [row for row in recipe_parts.openwrt() if row[0] == "source"]
    assert f'SRC_URI[sha256sum] = "{source[3]}"' in YOCTO.read_text(encoding="utf-8")
    licence = hashlib.md5((ROOT / "LICENSE").read_bytes(), usedforsecurity=False).hexdigest()
    assert f"file://LICENSE;md5={licence}" in YOCTO.read_text(encoding="utf-8")
    init = hashlib.sha512((PACKAGING / "alpine" / "barewire-gateway.initd").read_bytes()).hexdigest()
    assert f"\n{init}  barewire-gateway.initd\n" in read("alpine/APKBUILD")


def test_the_unit_that_is_packed_has_no_path_of_a_venv() -> None:
    """`debian/rules` and the recipe for Yocto replace the interpreter of the how-to, and nothing else is to replace."""
    unit = read("barewire-gateway.service").replace("/opt/barewire/bin/python", "/usr/bin/python3")
    assert "/opt" not in unit
    assert unit.count("/usr/bin/python3 -m barewire.gateway") == 3


@needs_make
def test_each_file_is_in_one_part() -> None:
    of_parts = sorted(file for files in recipe_parts.parts().values() for file in files)
    assert of_parts == recipe_parts.files()


@needs_make
def test_yocto_has_the_parts_of_openwrt() -> None:
    rest = set(recipe_parts.files())
    order = re.search(r'^PACKAGES =\+ "(.*)"', YOCTO.read_text(encoding="utf-8"), re.MULTILINE)
    assert order
    for package in order[1].replace("${PN}", "python3-barewire").split():
        roots = [path.removeprefix("${PYTHON_SITEPACKAGES_DIR}/") for path in yocto_list(f"FILES:{short(package)}")]
        files = {file for file in rest for root in roots if file == root or file.startswith(f"{root}/")}
        assert files == recipe_parts.parts()[package], package
        rest -= files
    assert rest == recipe_parts.parts()["python3-barewire"]


def short(package: str) -> str:
    return package.replace("python3-barewire", "${PN}")


@needs_make
@pytest.mark.parametrize("distribution", ["openwrt", "yocto"])
def test_a_part_depends_on_what_it_imports(distribution: str) -> None:
    if distribution == "openwrt":
        given = {
            row[1]: {word.lstrip("+") for word in row[3].split()}
            for row in recipe_parts.openwrt()
            if row[0] == "package"
        }
        names = OF_OPENWRT
    else:
        given = {package: set(yocto_list(f"RDEPENDS:{short(package)}")) for package in recipe_parts.parts()}
        names = OF_YOCTO

    def with_parents(package: str) -> set[str]:
        parents = [parent for parent in given[package] if parent in given]
        return given[package].union(*(with_parents(parent) for parent in parents))

    for package, files in recipe_parts.parts().items():
        needed = {names[module] for module in imports(files) if module in names}
        parents = given[package] & set(given)
        inherited = set().union(*(with_parents(parent) for parent in parents))
        own = needed - inherited | parents
        assert given[package] - {"python3-light", "python3-pyserial"} == own, package


def test_the_gateway_has_serial_ports() -> None:
    assert "+python3-pyserial" in next(
        row[3] for row in recipe_parts.openwrt() if row[:2] == ["package", "barewire-gateway"]
    )
    assert "python3-pyserial" in yocto_list("RDEPENDS:barewire-gateway")


# A module of OpenWrt's packages that a part does not depend on cannot be imported, as on a machine without them.
WITHOUT = """
import sys
from importlib.abc import MetaPathFinder

class Missing(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
"""
NOT_IN_LIGHT = {
    "ssl",
    "_ssl",
    "sqlite3",
    "multiprocessing",
    "uuid",
    "xml",
    "unittest",
    "ctypes",
    "pydoc",
    "dbm",
    "curses",
}

CLIENT_AND_SERVER = """
import asyncio
import barewire

async def main(url):
    async with barewire.AsyncModbusServer(url, {1: barewire.Table()}) as server:
        async with barewire.AsyncModbusClient(server.url, unit=1, timeout=20) as client:
            await client.write_single_register(7, 43)
            return await client.read_holding_registers(7, 1)

for url in ("tcp://127.0.0.1:0", "udp://127.0.0.1:0", "rtu+tcp://127.0.0.1:0", "ascii+tcp://127.0.0.1:0"):
    with (
        barewire.ModbusServer(url, {1: barewire.Table()}) as server,
        barewire.ModbusClient(server.url, unit=1, timeout=20) as client,
    ):
        client.write_single_register(7, 42)
        assert client.read_holding_registers(7, 1) == (42,)
    assert asyncio.run(main(url)) == (43,)
"""
NODE = """
import barewire
from barewire.canopen import ObjectDictionary

with barewire.CanopenServer("can://memory/part?node=5", device=ObjectDictionary()) as server:
    with barewire.CanopenClient("can://memory/part", timeout=20) as bus:
        try:
            bus.node(5).sdo.upload(0x2000, 0)
        except barewire.SdoAbort as abort:
            assert abort.code == 0x06020000, abort  # this node has no such object
"""


def install(folder: Path, packages: list[str], missing: set[str], *, bytecode: bool = False) -> None:
    recipe_parts.install(folder, packages, bytecode=bytecode)
    (folder / "sitecustomize.py").write_text(WITHOUT.format(names=sorted(missing)), encoding="utf-8")


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", *arguments]
    environment = {"PYTHONPATH": str(folder), "PATH": "/usr/bin:/bin"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@needs_make
@pytest.mark.long
@pytest.mark.parametrize("bytecode", some_of([True, False], 1), ids=["bytecode", "sources"])
def test_the_smallest_part_is_a_client_and_a_server(bytecode: bool, tmp_path: Path) -> None:
    install(tmp_path, ["python3-barewire"], NOT_IN_LIGHT | {"decimal"}, bytecode=bytecode)
    assert bytecode == (not list(tmp_path.rglob("barewire/**/*.py")))
    done = run(tmp_path, "-c", CLIENT_AND_SERVER)
    assert done.returncode == 0, done.stderr
    done = run(tmp_path, "-c", "import barewire; barewire.ModbusClient('tcp://127.0.0.1?timout=1')")
    assert "did you mean 'timeout'?" in done.stderr


@needs_make
@pytest.mark.long
def test_the_gateway_runs_without_canopen_and_names_what_it_lacks(tmp_path: Path) -> None:
    install(tmp_path, ["python3-barewire", "python3-barewire-devices", "barewire-gateway"], NOT_IN_LIGHT)
    done = run(tmp_path, str(PACKAGING / "exchange.py"))
    assert done.returncode == 0, done.stderr
    assert "rtu://pty, through the gateway, (555, 0, 100)" in done.stdout
    (tmp_path / "can.toml").write_text(
        '[[listen]]\nurl = "tcp://127.0.0.1:0"\n[[backend]]\nname = "bus"\nurl = "can://socketcan/can0"\nunits = "40"\n'
    )
    done = run(tmp_path, "-m", "barewire.gateway", "--check", "can.toml")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "can.toml:5:1: " in done.stderr
    assert "the package of barewire with CANopen" in done.stderr


@needs_make
@pytest.mark.long
def test_canopen_needs_no_simulators(tmp_path: Path) -> None:
    install(tmp_path, ["python3-barewire", "python3-barewire-devices", "python3-barewire-canopen"], NOT_IN_LIGHT)
    done = run(tmp_path, "-c", NODE)
    assert done.returncode == 0, done.stderr


@needs_make
def test_sizes_on_the_page() -> None:
    """To a tenth: `python tools/recipe_parts.py` writes them anew."""
    for package, files in recipe_parts.parts().items():
        size = sum((ROOT / "src" / file).stat().st_size for file in files) / 1000
        assert recipe_parts.sizes_on_page()[package] == pytest.approx(size, rel=0.1), package


@pytest.mark.needs("shellcheck")
@pytest.mark.long
def test_scripts() -> None:
    names = ["alpine/APKBUILD", "alpine/barewire-gateway.initd", "alpine/barewire-gateway.pre-install"]
    names += ["openwrt/test.sh", "openwrt/files/barewire-gateway.init", "debian/barewire-gateway.postinst"]
    names += ["build-debian", "checksum"]
    done = subprocess.run(["shellcheck", *names], cwd=PACKAGING, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
