"""The site that `make docs` builds: Sphinx reads the documents where they are, and the docstrings."""

from __future__ import annotations

import re
from typing import Any

from sphinx.util import logging

import gepf

logger = logging.getLogger(__name__)

project, author = "gepf", "the authors of gepf"
html_title = "gepf"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "README"
include_patterns = ["*.md", "docs/*.md", "docs/*.rst"]
html_theme = "furo"
html_copy_source = False
html_show_copyright = False
myst_heading_anchors = 4

default_role = "py:obj"  # a name in backticks leads to its description, if there is one
add_module_names = False
maximum_signature_line_length = 80
autodoc_member_order = "bysource"
napoleon_use_ivar = True
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "Indices", "Mask", "NDArray")}

CONTENTS = """
```{toctree}
:hidden:
:caption: Use
docs/library
docs/live
docs/formats
docs/service
docs/reference
```
```{toctree}
:hidden:
:caption: Understand
docs/architecture
docs/filter
docs/posterior
docs/colour
docs/states
docs/settings
docs/detection
docs/scene
docs/model
BENCHMARK
```
```{toctree}
:hidden:
:caption: Develop
CONTRIBUTING
CHANGELOG
```
"""


def add_contents(_: Any, name: str, source: list[str]) -> None:
    """Begin the README with the navigation, which is of no use elsewhere."""
    if name == root_doc:
        source[0] += CONTENTS


def check_reference(_: Any, env: Any) -> None:
    """Warn, which is an error, if the reference leaves out a public name."""
    described = {name.removeprefix("gepf.") for name in env.domains["py"].objects}
    missing = sorted(set(gepf.__all__) - described)
    if missing:
        logger.warning("docs/reference.rst leaves out %s", ", ".join(missing))


def shorten(
    _: Any, __: str, name: str, ___: Any, ____: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Signatures without the arguments of classes that functions make, and with plain names of types."""
    if name in {"gepf.Run", "gepf.LiveSource"} or signature is None:
        return None, None
    return re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", signature), returned


def setup(app: Any) -> None:
    """Connect the functions above."""
    app.connect("autodoc-process-signature", shorten)
    app.connect("source-read", add_contents)
    app.connect("env-check-consistency", check_reference)
