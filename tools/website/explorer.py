"""Builds the explorer of the site: `python -m tools.website.explorer` writes build/site/explorer.

    docs/explorer/sw.js                with the names of all files, which it keeps for the next visit
    docs/explorer/*.html, .css, .js    as they are; index.html with the example already explained
    docs/explorer/bridge/              in package.zip, with the rooms of both packages that need no ports
    pyodide/                           CPython as WebAssembly (tools/get-pyodide)
    manifest.json                      what the page loads, how many bytes that is, and a digest of the package

The page needs a server, because browsers load no modules from files: `python3 -m http.server --directory build/site`.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

from barewire import __version__
from docs.explorer.bridge import frames
from tools.rooms import HOUSES, ROOT

SOURCE = ROOT / "docs" / "explorer"
TARGET = ROOT / "build" / "site" / "explorer"
PYODIDE = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
_COUNTED = ("pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
"""The files that the worker fetches; the browser itself loads the modules."""

_ABOVE = {"io", "live", "cli", "__main__.py"}
"""What does not run in a browser: ports, threads and the command."""
_EXAMPLE = ("rtu", "01 04 0F B1 00 02 22 F8")
_STYLE_PLACE, _EXAMPLE_PLACE = "<!-- style of the pictures -->", "<!-- the example, explained -->"


def build(target: Path = TARGET) -> None:
    """Write the explorer."""
    target.mkdir(parents=True, exist_ok=True)
    for file in SOURCE.iterdir():
        if file.suffix in (".js", ".css"):
            shutil.copyfile(file, target / file.name)
    (target / "index.html").write_text(page(), encoding="utf-8")
    write_package(target / "package.zip")
    pyodide = Path(pyodide_folder())
    (target / "pyodide").mkdir(exist_ok=True)
    for name in PYODIDE:
        shutil.copyfile(pyodide / name, target / "pyodide" / name)
    sizes = [(target / "pyodide" / name).stat().st_size for name in _COUNTED]
    package = (target / "package.zip").read_bytes()
    manifest = {
        "version": __version__,
        "package": "package.zip",
        "bytes": sum(sizes) + len(package),
        "digest": hashlib.sha256(package).hexdigest()[:16],
    }
    (target / "manifest.json").write_text(json.dumps(manifest) + "\n", encoding="utf-8")
    (target / "sw.js").write_text(service_worker(target), encoding="utf-8")


def service_worker(target: Path) -> str:
    """Return the service worker with the names of all files, and a version that changes when one of them does."""
    names = sorted(file.relative_to(target).as_posix() for file in target.rglob("*") if file.is_file())
    kept = [name for name in names if name != "sw.js"]
    digest = hashlib.sha256(b"".join((target / name).read_bytes() for name in kept)).hexdigest()[:16]
    text = (SOURCE / "sw.js").read_text(encoding="utf-8")
    return text.replace('"VERSION"', json.dumps(digest)).replace('["FILES"]', json.dumps(kept))


def page() -> str:
    """Return the page with the style of the pictures and its first example explained, which need no Python then."""
    text = (SOURCE / "index.html").read_text(encoding="utf-8")
    found = frames.frame(*_EXAMPLE)
    example = f'<div id="frame-pictures">{"".join(found["pictures"].values())}</div>'
    for place, content in ((_STYLE_PLACE, frames.style()), (_EXAMPLE_PLACE, example)):
        if text.count(place) != 1:
            raise ValueError(f"index.html must have {place!r} once")
        text = text.replace(place, content)
    return text


def write_package(target: Path) -> None:
    """Write the rooms that run in a browser, and the bridge, as a zip file that depends on nothing but their text."""
    files = {f"bridge/{file.name}": file for file in (SOURCE / "bridge").glob("*.py")}
    for package, folder in HOUSES.items():
        for file in (folder / package).rglob("*"):
            inside = file.relative_to(folder)
            if file.is_file() and file.suffix in (".py", ".toml", ".json") and inside.parts[1] not in _ABOVE:
                files[inside.as_posix()] = file
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files):
            archive.writestr(zipfile.ZipInfo(name), files[name].read_bytes(), zipfile.ZIP_DEFLATED)


def pyodide_folder() -> str:
    """Install Pyodide if it is not there, and return its folder."""
    environment = {**os.environ, "PYTHON": sys.executable}
    done = subprocess.run(
        [ROOT / "tools" / "get-pyodide"], env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return done.stdout.strip()


if __name__ == "__main__":
    build()
    sys.stdout.write(f"{TARGET.relative_to(ROOT)}/index.html\n")
