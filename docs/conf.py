"""Settings of Sphinx for the site. `make docs` collects the sources in build/docs first, see tools/website."""

from sphinx.domains.python import PythonDomain

from barewire import __version__

project = "barewire"
author = "the authors of barewire"
release = version = __version__
html_title = f"barewire {version}"


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


def setup(app):
    """Sphinx calls this."""
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
html_show_sphinx = html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False
html_js_files = ["site.js"]
html_theme_options = {"navigation_with_keys": True}
pygments_style = "xcode"  # of the styles with enough contrast for axe
pygments_dark_style = "github-dark"
