"""Makes the text of a file by its recipe, with its head. It is not formatted yet, and so not sealed."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from barewire.errors import EncodeError, shown
from barewire_workbench.vendor.head import command, comment
from barewire_workbench.vendor.one_file import OneFile
from barewire_workbench.vendor.recipes import FAMILIES, MESSAGES, NEVER_INSIDE, PARTS, RECIPES, TEXTS, Recipe
from barewire_workbench.vendor.sources import Place, Sources


def make(name: str, families: Sequence[str], version: str) -> str:
    """Return the file of this name, with further families of messages, as this version of barewire makes it.

    Raise EncodeError for a name, or a family, that does not exist.
    """
    recipe = RECIPES.get(name)
    if recipe is None:
        raise EncodeError(f"file {shown(name)}: expected one of {', '.join(RECIPES)}")
    if unknown := [family for family in families if family not in recipe.optional]:
        expected = f"expected one of {', '.join(recipe.optional)}" if recipe.optional else "this file has no options"
        raise EncodeError(f"--with {shown(unknown[0])}: {expected}", "families")
    added = tuple(family for family in FAMILIES if family in families and family not in recipe.families)
    inside = (*recipe.families, *added)
    out = [f"{MESSAGES}.{family}" for family in FAMILIES if family not in inside]
    requests = [Place(f"{MESSAGES}.{family}", request) for family in inside for request in FAMILIES[family].split()]
    # A part in place of a family that is inside after all: the probe, which is one message of the diagnostics.
    in_place = {ours: part for ours, part in recipe.in_place.items() if ours.module.rpartition(".")[2] not in added}
    patches = [recipe.patches, *(texts for family, texts in recipe.absent.items() if family not in inside)]
    by_module = {
        module: [patch for some in patches for patch in some.get(module, ())] for some in patches for module in some
    }
    file = OneFile(
        Sources(by_module, in_place),
        [*recipe.roots, *requests],
        is_public=lambda module: module.startswith(PARTS),
        left_out=[*NEVER_INSIDE, *out],
        without=recipe.without,
        docstrings=TEXTS,
    )
    modules = [module.name for module in file.modules]
    return (
        f'"""{_description(recipe, name, added, modules, version)}"""\n\n{comment(name, added, version)}\n{file.text()}'
    )


def _description(recipe: Recipe, name: str, added: Sequence[str], modules: Sequence[str], version: str) -> str:
    """Return the docstring of the file."""
    inside = [*recipe.families, *added]
    having = f", with messages of these families: {', '.join(inside)}" if inside else ""
    intro = f"{recipe.subject} in one file: Python 3.11 or later on POSIX, and its standard library{having}."
    more = [family for family in recipe.optional if family not in added]
    further = f"Further families of messages, by `--with`: {', '.join(more)}.\n\n" if more else ""
    commands = f"""\
{command(name, added)} > {recipe.file}
barewire vendor --update {recipe.file}          # makes it again, and says what changed
barewire vendor --check {recipe.file}           # runs the test vectors against it
"""
    made_of = ", ".join(module.removeprefix("barewire_workbench.") for module in modules)
    return "\n".join(
        [
            textwrap.fill(intro, 118, break_on_hyphens=False),
            "",
            textwrap.indent(recipe.usage, "    "),
            "",
            f"Made by the first of these commands, of barewire {version}:",
            "",
            textwrap.indent(commands, "    "),
            textwrap.fill(f"{further}From the bottom up, of these modules: {made_of}.", 118, break_on_hyphens=False),
            "",
        ]
    )
