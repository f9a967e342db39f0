"""Settings of the documentation site; `make docs` builds it, and warnings are errors."""

import re

from sphinx.application import Sphinx

import robo47_qp

project = "robo47_qp"
author = "the authors of robo47_qp"
version = release = robo47_qp.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.apidoc", "sphinx.ext.napoleon"]
exclude_patterns = ["results"]

# The pages are read on a code host, too: links name files, and every heading has an anchor.
myst_heading_anchors = 3

apidoc_modules = [
    {
        "path": "../robo47_qp",
        "destination": "api",
        "follow_links": True,
        "module_first": True,
        "automodule_options": ["members"],
    }
]
# Without it, what the front door offers would be documented twice.
autodoc_default_options = {"ignore-module-all": True}
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_class_signature = "separated"
# Docstrings put code into single backticks.
default_role = "code"

html_theme = "furo"
html_title = f"robo47_qp {version}"
html_copy_source = False
html_show_copyright = False

_CODE_OR_MARK = re.compile(r"(``.+?``|`[^`]+`)|([|*])|(?<=\w)(_)(?=\W|$)")
_plain: dict[str, list[str]] = {}
"""Docstrings of fields; their first word and a colon would be taken for a type."""


def _escape(
    _app: Sphinx, what: str, name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Docstrings are plain text: outside code, |x|, a * b and q_ are no markup."""
    text = _CODE_OR_MARK.sub(lambda found: found[1] or f"\\{found[0]}", "\n".join(lines))
    lines[:] = text.split("\n")
    if what in ("attribute", "data"):
        _plain[name] = lines.copy()


def _restore(
    _app: Sphinx, _what: str, name: str, _object: object, _options: object, lines: list[str]
) -> None:
    lines[:] = _plain.pop(name, lines)


def setup(app: Sphinx) -> None:
    """Register what prepares docstrings, around the reader of Google's style."""
    app.connect("autodoc-process-docstring", _escape, priority=1)
    app.connect("autodoc-process-docstring", _restore, priority=900)
