"""Settings of Sphinx for the site. `make docs` collects the sources in build/docs first, see tools/website."""

import os
from html import escape
from pathlib import Path

from sphinx.domains.python import PythonDomain

from barewire import __version__

project = "barewire"
author = "the authors of barewire"
release = version = __version__
html_title = f"barewire {version}"
html_baseurl = os.environ.get("SITE_URL", "")
SUMMARY = (
    "Modbus (RTU, ASCII, TCP) and CANopen in pure Python, from the first bit of a CRC to a named value with its unit."
)


class QuickPythonDomain(PythonDomain):
    """The Python domain, which looks for a name in all others only if there is one that ends with it.

    Annotations name `int` and `str` thousands of times, and Sphinx compares each with all objects.
    """

    def find_obj(self, env, modname, classname, name, type, searchmode=0):
        """Return the objects of that name."""
        last = name.removesuffix("()").rpartition(".")[2]
        if len(self.objects) != getattr(self, "_counted", None):
            self._counted = len(self.objects)
            self._last = {full.rpartition(".")[2] for full in self.objects}
        return super().find_obj(env, modname, classname, name, type, searchmode) if last in self._last else []


def preview(app, pagename, templatename, context, doctree):
    """Add what other programs show of a link to a page. A picture needs the address of the site: SITE_URL."""
    shown = {"title": context.get("title") or project, "site_name": project, "type": "article", "description": SUMMARY}
    if html_baseurl:
        shown["image"] = f"{html_baseurl}_static/preview.png"
    tags = [f'<meta property="og:{name}" content="{escape(text)}">' for name, text in shown.items()]
    context["metatags"] = "\n".join([context.get("metatags", ""), *tags])


def setup(app):
    """Sphinx calls this."""
    app.connect("html-page-context", preview)
    app.add_domain(QuickPythonDomain, override=True)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


extensions = ["myst_parser", "sphinx_copybutton"]
exclude_patterns = ["README*"]
root_doc = "index"

# Markdown
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist"]
suppress_warnings = ["myst.header", "toc.empty_glob"]  # pages without a second level, rooms without a page
highlight_language = "text"

# Python names without their module. The tree of contents has no objects: it is copied for each page.
add_module_names = False
toc_object_entries = False

# The console prompt is not copied, and neither is the output behind it.
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
copybutton_only_copy_prompt_lines = True

# HTML: no request leaves the server of the site
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/favicon.svg"
html_search_scorer = str(Path(__file__).parent / "_static" / "scorer.js")
html_show_sphinx = html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False
html_js_files = ["site.js"]
html_theme_options = {"navigation_with_keys": True}
pygments_style = "xcode"  # of the styles with enough contrast for axe
pygments_dark_style = "github-dark"
