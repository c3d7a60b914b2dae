"""Builds a release in dist/release and tries each file of it:  make release ARGS="--files URL"

    barewire-0.1.0.tar.gz, .whl                  the stack
    barewire_workbench-0.1.0.tar.gz, .whl        the command
    barewire-0.1.0.pyz                           the command and serial ports as one file, for every Python from 3.11 on
    barewire-0.1.0-linux-x86_64                  the command, serial ports and CAN as a program, without a Python
    barewire-vectors-1.2.0.zip, .tgz             the vectors, and their package of npm
    SHA256SUMS                                   what `sha256sum --check` reads

URL is where the files of this version can be read, such as https://forge.example/barewire/blob/v0.1.0/: the description
of a package stands on the page of an index, where a link to docs/ leads nowhere, so each link gets this address.

Wheel, archive and program are tried: `devices`, `simulate` and `read` run from them, and nothing else is in reach. Each
file is made here; nothing is sent anywhere. What forbids a release (versions that differ, a changelog without this
version, changes that are not committed) is an error, and with --dry-run only printed. How to go on: packaging/README.md
"""

from __future__ import annotations

import argparse
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipapp
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from urllib.parse import urljoin
from zipfile import ZipFile

ROOT = Path(__file__).parent.parent
EXAMPLE = "https://forge.example/barewire/blob/main/"
"""The address of a dry run."""
LINK = re.compile(r"(?<=\]\()(?!https?:|#)[^)\s]+")
"""The target of a link of Markdown that is a path."""
PICTURE = re.compile(r"!\[[^]]*\]\([^)\s]+")
"""A picture of Markdown, up to the end of its address."""
SOURCES = ("LICENSE", "MANIFEST.in", "README.md", "pyproject.toml", "packaging", "src", "vectors", "workbench")
"""What both distributions are built from."""
NOT_SOURCES = shutil.ignore_patterns("__pycache__", "*.egg-info", "build", "node_modules")
LAZY = ("barewire", "barewire_workbench", "can", "serial")
"""Packages whose modules are imported by name when they are needed, which PyInstaller does not see."""


class ReleaseError(Exception):
    """A step failed; the message is for the user."""


class Program(NamedTuple):
    """One way to start the command."""

    name: str
    command: Sequence[str]


def clean_environment() -> dict[str, str]:
    """Return the environment of the programs that are run: none of Python's settings."""
    return {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}


def run(*command: str | Path, where: Path = ROOT) -> str:
    """Run a program and return what it prints on stdout. Raises ReleaseError with all that it printed if it fails."""
    words = [*map(str, command)]
    done = subprocess.run(words, cwd=where, env=clean_environment(), text=True, capture_output=True, check=False)
    if done.returncode:
        output = f"{done.stdout}{done.stderr}"
        raise ReleaseError(f"{' '.join(words)} ended with status {done.returncode}:\n{output}")
    return done.stdout


# What forbids a release -------------------------------------------------------------------------------------------


def version() -> str:
    """Return the version of both distributions."""
    return str(_project(ROOT)["version"])


def _project(folder: Path) -> dict[str, object]:
    project: dict[str, object] = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return project


def problems(new: str) -> list[str]:
    """Return what forbids a release of the version `new`, as sentences."""
    wrong = []
    for file in ("workbench/pyproject.toml", "integrations/modbus-connection/pyproject.toml"):
        other = _project((ROOT / file).parent)["version"]
        if other != new:
            wrong.append(f"{file} has version {other}, pyproject.toml {new}")
    for file in ("src/barewire/__init__.py", "workbench/src/barewire_workbench/__init__.py"):
        if f'__version__ = "{new}"' not in (ROOT / file).read_text(encoding="utf-8"):
            wrong.append(f'{file} has no line __version__ = "{new}"')
    if f"\n## [{new}]" not in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"):
        wrong.append(f"CHANGELOG.md has no section ## [{new}]")
    try:
        if run("git", "status", "--porcelain"):
            wrong.append("there are changes that are not committed: git status")
        if run("git", "tag", "--list", f"v{new}"):
            wrong.append(f"the tag v{new} exists: this version was released")
    except (ReleaseError, OSError):
        wrong.append("this folder is no checkout of git, so it cannot be tagged")
    return wrong


# Building ---------------------------------------------------------------------------------------------------------


def with_addresses(text: str, page: str) -> str:
    """Return Markdown in which each link to a path has an address. `page` is the address of the text itself.

    A forge shows a file at .../blob/... or .../src/... and sends its bytes, as a picture needs, from .../raw/...

    >>> with_addresses("[URLs](docs/endpoints.md#can), [home](https://a.example)", "https://forge.example/README.md")
    '[URLs](https://forge.example/docs/endpoints.md#can), [home](https://a.example)'
    """
    text = LINK.sub(lambda link: urljoin(page, link[0]), text)
    return PICTURE.sub(lambda picture: re.sub(r"/(blob|src)/", "/raw/", picture[0], count=1), text)


def distributions(target: Path, scratch: Path, files: str) -> None:
    """Build both source distributions, and from them both wheels. Links in their descriptions begin with `files`."""
    copy = scratch / "copy"
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, ignore=NOT_SOURCES)
        else:
            copy.mkdir(exist_ok=True)
            shutil.copy(ROOT / name, copy / name)
    for place in ("", "workbench/"):
        readme, project = copy / place / "README.md", copy / place / "pyproject.toml"
        text = with_addresses(readme.read_text(encoding="utf-8"), urljoin(files, f"{place}README.md"))
        readme.write_text(text, encoding="utf-8")
        urls = f'Source = "{files}"\nDocumentation = "{urljoin(files, "docs/index.md")}"\n'
        urls += f'Changelog = "{urljoin(files, "CHANGELOG.md")}"\n'
        project.write_text(f"{project.read_text(encoding='utf-8')}\n[project.urls]\n{urls}", encoding="utf-8")
        run(sys.executable, "-m", "build", "--outdir", target, copy / place)


def new_environment(folder: Path, *needed: str | Path) -> Path:
    """Make an environment with these packages; return its Python."""
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    run(python, "-m", "pip", "install", "-qq", *needed)
    return python


def one_file(wheels: Sequence[Path], target: Path, scratch: Path) -> None:
    """Build the archive that Python runs, of packages without compiled parts."""
    content = scratch / "pyz"
    stack, workbench = wheels
    run(sys.executable, "-m", "pip", "install", "-qq", "--target", content, f"{stack}[serial]", workbench)
    shutil.rmtree(content / "bin", ignore_errors=True)
    for compiled in content.rglob("__pycache__"):
        shutil.rmtree(compiled)
    main = "barewire_workbench.cli:main"
    zipapp.create_archive(content, target, interpreter="/usr/bin/env python3", main=main, compressed=True)


def program(wheels: Sequence[Path], target: Path, scratch: Path) -> None:
    """Build the program, which has a Python in it, for the system of this machine."""
    stack, workbench = wheels
    python = new_environment(scratch / "program", f"{stack}[serial,can,multicast]", workbench, "pyinstaller>=6.10")
    start = scratch / "start.py"
    start.write_text("from barewire_workbench.cli import main\n\nmain()\n", encoding="utf-8")
    parts = [f"--collect-all={name}" for name in LAZY]
    parts += [f"--copy-metadata={name}" for name in ("barewire", "barewire-workbench", "python-can")]
    run(
        python,
        "-m",
        "PyInstaller",
        "--onefile",
        f"--name={target.name}",
        f"--distpath={target.parent}",
        *parts,
        start,
        where=scratch,
    )


# Trying -----------------------------------------------------------------------------------------------------------


def try_program(tried: Program, where: Path) -> None:
    """Run `devices`, `simulate` and `read`. Raises ReleaseError if one of them does not do what it should."""
    devices = run(*tried.command, "devices", where=where)
    if [line.split()[0] for line in devices.splitlines() if line[:1].islower()][1:] != ["adxl", "az3", "csd-mt"]:
        raise ReleaseError(f"{tried.name}: `devices` printed\n{devices}")
    simulate = [*tried.command, "simulate", "adxl", "tcp://127.0.0.1:0"]
    environment = clean_environment()
    with subprocess.Popen(simulate, stdout=subprocess.PIPE, text=True, cwd=where, env=environment) as simulator:
        assert simulator.stdout is not None
        try:
            ready = simulator.stdout.readline().split()
            if ready[:1] != ["ready"]:
                raise ReleaseError(f"{tried.name}: `simulate` printed {' '.join(ready) or 'nothing'}")
            value = run(*tried.command, "read", f"{ready[1]}?timeout=30", "adxl", "Status", where=where)
        finally:
            simulator.terminate()
    if value != "Status = 2 (Starter ready)\n":
        raise ReleaseError(f"{tried.name}: `read` printed {value}")
    sys.stdout.write(f"tried: {tried.name}\n")


def links_without_address(wheel: Path) -> list[str]:
    """Return the links of a wheel's description that lead nowhere on an index."""
    with ZipFile(wheel) as archive:
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return LINK.findall(archive.read(metadata).decode())


def try_vectors(target: Path, scratch: Path) -> None:
    """Unpack both archives of the vectors, compare the checksums, and load the package in node if there is one."""
    (archive,), (package,) = target.glob("barewire-vectors-*.zip"), target.glob("barewire-vectors-*.tgz")
    shutil.unpack_archive(archive, scratch / "vectors")
    folder = scratch / "vectors" / archive.stem
    for line in (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines():
        digest, name = line.split("  ")
        if hashlib.sha256((folder / name).read_bytes()).hexdigest() != digest:
            raise ReleaseError(f"{archive.name}: {name} has another checksum than SHA256SUMS says")
    sys.stdout.write(f"tried: {archive.name}\n")
    with tarfile.open(package) as content:
        content.extractall(scratch / "npm", filter="data")
    if node := shutil.which("node"):
        count = run(node, "-p", "require('./package').cases.length", where=scratch / "npm").strip()
        sys.stdout.write(f"tried: {package.name}, {count} cases in node\n")


def build(target: Path, files: str, scratch: Path) -> None:
    """Build and try everything."""
    new, elsewhere = version(), scratch / "elsewhere"
    elsewhere.mkdir()
    distributions(target, scratch, files)
    wheels = (
        target / f"barewire-{new}-py3-none-any.whl",
        target / f"barewire_workbench-{new}-py3-none-any.whl",
    )
    for wheel in wheels:
        if lost := links_without_address(wheel):
            raise ReleaseError(f"{wheel.name}: links without an address: {', '.join(lost)}")
    python = new_environment(scratch / "pip", *wheels)
    try_program(Program("both wheels, by pip: python -m barewire", (str(python), "-I", "-m", "barewire")), elsewhere)
    pipx = new_environment(scratch / "pipx", "pipx>=1.7")
    from_here = f"--pip-args=--find-links={target}"
    by_pipx = (str(pipx), "-m", "pipx", "run", from_here, f"barewire-workbench=={new}")
    os.environ["PIPX_HOME"] = str(scratch / "pipx-home")  # not among the programs of the user
    try_program(Program("both wheels, by pipx run barewire-workbench", by_pipx), elsewhere)
    archive = target / f"barewire-{new}.pyz"
    one_file(wheels, archive, scratch)
    try_program(Program(archive.name, (sys.executable, "-I", "-S", str(archive))), elsewhere)
    system = {"Darwin": "macos"}.get(platform.system(), platform.system().lower())
    alone = target / f"barewire-{new}-{system}-{platform.machine().lower()}"
    program(wheels, alone, scratch)
    try_program(Program(alone.name, (str(alone),)), elsewhere)
    sys.stdout.write(run(sys.executable, "-m", "tools.vectors_release", "--to", target))
    try_vectors(target, scratch)
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in sorted(target.iterdir())]
    (target / "SHA256SUMS").write_text("".join(sums), encoding="utf-8")


def main() -> int:
    """Check what is to be released, build it and try it. Return the exit status."""
    parser = argparse.ArgumentParser(description="Build a release of barewire, and try it.")
    parser.add_argument("--files", metavar="URL", help="where the files of this version can be read")
    parser.add_argument("--dry-run", action="store_true", help="only print what forbids a release, and go on")
    parser.add_argument("--to", type=Path, default=ROOT / "dist" / "release", help="the folder (dist/release)")
    options = parser.parse_args()
    wrong = problems(version())
    if options.files is None:
        wrong.append("the links of the descriptions have no address: --files URL")
    if wrong:
        verb = "would forbid" if options.dry_run else "forbids"
        sys.stderr.write("".join(f"this {verb} a release: {problem}\n" for problem in wrong))
        if options.dry_run:
            sys.stderr.write("this is a dry run: the files are built and tried all the same\n")
        else:
            return 1
    files = (options.files or EXAMPLE).rstrip("/") + "/"
    target: Path = options.to.resolve()
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    try:
        with TemporaryDirectory() as scratch:
            build(target, files, Path(scratch))
    except ReleaseError as error:
        sys.stderr.write(f"release: {error}\n")
        return 1
    for file in sorted(target.iterdir()):
        sys.stdout.write(f"{file.stat().st_size:>10} bytes  {file.name}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
