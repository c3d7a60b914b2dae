"""The parts into which the recipes for OpenWrt and Yocto split the stack: run `python tools/recipe_parts.py`.

It writes their sizes into `docs/how-to/small-linux.md`. `tests/packaging` uses the same functions: each file of the
stack must be in one part, in the same in both recipes.
"""

from __future__ import annotations

import compileall
import lzma
import marshal
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
SRC = ROOT / "src"
OPENWRT = ROOT / "packaging" / "openwrt" / "Makefile"
PAGE = ROOT / "docs" / "how-to" / "small-linux.md"
BEGIN, END = "<!-- sizes by tools/recipe_parts.py -->\n", "<!-- end of the sizes -->\n"

# What OpenWrt's own makefiles would define, reduced to printing what the recipe says.
STUBS = {
    "rules.mk": "",
    "package.mk": """
define BuildPackage
  DEPENDS:=
  TITLE:=
  $$(eval $$(Package/$(1)))
  $$(info package|$(1)|$$(TITLE)|$$(DEPENDS))
endef
""",
    "python3-package.mk": """
PYTHON3_PKG_DIR:=
define Py3Package
  $$(foreach row,$$(Py3Package/$(1)/filespec),$$(info filespec|$(1)|$$(row)))
endef
""",
    "pypi.mk": "$(info source|$(PYPI_NAME)|$(PKG_VERSION)|$(PKG_HASH))\n",
}


@cache
def openwrt() -> list[list[str]]:
    """Return what the recipe for OpenWrt says, read by GNU make: rows of `source`, `filespec` and `package`."""
    with tempfile.TemporaryDirectory() as folder:
        recipe = Path(folder, "feed", "python-barewire")
        recipe.mkdir(parents=True)
        for name, text in STUBS.items():
            for place in (Path(folder), recipe.parent):
                (place / name).write_text(text, encoding="utf-8")
        (recipe / "Makefile").write_text(OPENWRT.read_text(encoding="utf-8") + "\nall:;@:\n", encoding="utf-8")
        command = ["make", "--no-print-directory", "-s", f"TOPDIR={folder}", f"INCLUDE_DIR={folder}", "all"]
        run = subprocess.run(command, cwd=recipe, capture_output=True, text=True, check=True)
    return [line.split("|") for line in run.stdout.splitlines()]


@cache
def files() -> list[str]:
    """Return every file of the stack that is installed, as "barewire/rtu/line.py"."""
    found = (path for path in SRC.joinpath("barewire").rglob("*") if path.is_file() and path.suffix != ".pyc")
    return sorted(path.relative_to(SRC).as_posix() for path in found)


@cache
def parts() -> Mapping[str, set[str]]:
    """Return package -> files, as the rows `filespec` of the recipe for OpenWrt choose them."""
    chosen: dict[str, set[str]] = {}
    for kind, *row in openwrt():
        if kind == "filespec":
            package, sign, path = row
            of_row = {file for file in files() if f"/{file}".startswith(f"{path}/") or f"/{file}" == path}
            if not of_row:
                raise SystemExit(f"{OPENWRT}: {package}: {path} is not in the stack")
            before = chosen.setdefault(package, set())
            chosen[package] = before | of_row if sign == "+" else before - of_row
    return chosen


def install(into: Path, packages: Collection[str], *, bytecode: bool = False) -> None:
    """Write the files of packages into a folder, compiled as by `compile_files`."""
    chosen = parts()
    for file in sorted(set().union(*(chosen[package] for package in packages))):
        target = into / file
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(SRC / file, target)
    compile_files(into, bytecode=bytecode)


def compile_files(folder: Path, *, bytecode: bool) -> None:
    """Compile what is in a folder. With `bytecode` it is without docstrings and assertions, and no source is left."""
    compileall.compile_dir(folder, quiet=1, legacy=bytecode, optimize=2 if bytecode else 0, stripdir=folder)
    for source in folder.rglob("*.py") if bytecode else ():
        source.unlink()


def kilobytes(names: set[str]) -> tuple[int, int, int]:
    """Return the sizes of files in kB: as source, with bytecode in place of source, and that compressed by xz."""
    contents = [(name, (SRC / name).read_bytes()) for name in sorted(names)]
    compiled = [
        marshal.dumps(compile(data, name, "exec", dont_inherit=True)) if name.endswith(".py") else data
        for name, data in contents
    ]
    sizes = sum(len(data) for _, data in contents), sum(map(len, compiled)), len(lzma.compress(b"".join(compiled)))
    return sizes[0] // 1000, sizes[1] // 1000, sizes[2] // 1000


def table() -> str:
    """Return the table of sizes, in Markdown."""
    rows = [f"| package | source | bytecode (CPython {platform.python_version()}) | compressed |", "|---|---|---|---|"]
    rows += [f"| `{name}` | {a} kB | {b} kB | {c} kB |" for name, of in parts().items() for a, b, c in [kilobytes(of)]]
    return "\n".join(rows) + "\n"


def sizes_on_page() -> dict[str, int]:
    """Return package -> kB of source, as the page says."""
    text = PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    return {name: int(size) for name, size in re.findall(r"^\| `(\S+)` \| (\d+) kB", text, re.MULTILINE)}


if __name__ == "__main__":
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(head + BEGIN + "\n" + table() + "\n" + END + rest.split(END)[1], encoding="utf-8")
