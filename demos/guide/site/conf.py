# SPDX-License-Identifier: MIT
"""Settings of Sphinx for the documentation site; ``demos/guide/build.sh`` starts it."""

import os
import re
import sys
from pathlib import Path

os.environ["NUMBA_DISABLE_JIT"] = "1"  # kernels are documented as plain functions
root = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(root)]

from sphinx.util.nodes import make_refnode

import fenics_mortar

project = "fenics_mortar"
author = "fenics_mortar contributors"
copyright = author
version = release = fenics_mortar.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 4
exclude_patterns = ["files"]
smartquotes_action = "D"  # dashes only

# Reference
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"  # the docstrings give shapes and units
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 80
python_display_short_literal_types = True
add_module_names = False
toc_object_entries = False  # headings suffice
nitpicky = True
# Bases outside of the package, which this site does not describe, and variables of types.
nitpick_ignore_regex = [("py:.*", r"(?!fenics_mortar).*"), ("py:class", r"fenics_mortar\..*\.T")]
suppress_warnings = ["ref.python"]  # two internal classes of one name in signatures

# ``build.sh`` puts MathJax beside the pages.
html_static_path = ["static", str(root / "build/site/static")]
html_css_files = ["site.css"]
mathjax_path = "mathjax/tex-chtml.js"

html_theme = "sphinx_book_theme"
html_title = "fenics_mortar"
html_theme_options = {
    "show_navbar_depth": 1,
    "show_toc_level": 2,
    "use_download_button": False,
    "use_fullscreen_button": False,
}
html_show_copyright = False
html_copy_source = False


MODULES = {path.stem: path for path in (root / "fenics_mortar").rglob("*.py")}
TABLES = re.compile(r"(^=+(?: +=+)+$.*^=+(?: +=+)+$)", re.MULTILINE | re.DOTALL)
SEE = re.compile(r"\b(see|also) ``(\w+)``")


def link(match):
    """Link of "see ``module``" to the page of the module."""
    path = MODULES.get(match[2])
    if path is None:
        return match[0]
    module = ".".join(path.relative_to(root).with_suffix("").parts)
    return f"{match[1]} :py:mod:`{match[2]} <{module}>`"


# On the first page of the reference, once for all.
SAID = r"(?:Collective|All methods are collective|The constructor is collective)\."
COLLECTIVE = re.compile(
    rf"(?m)^\.\. note::\s+{SAID}\s*$| \(collective\)|; collective(?=\.)|(?: |^){SAID}"
)


def edit_docstring(app, what, name, obj, options, lines):
    """Link modules; escape |x|, which reStructuredText would treat as a substitution."""
    text = "\n".join(lines).replace("|", "\N{DIVIDES}")
    if app.env.docname.startswith("reference/"):
        text = COLLECTIVE.sub("", text)
    pieces = TABLES.split(text)
    pieces[::2] = [SEE.sub(link, piece) for piece in pieces[::2]]
    lines[:] = "".join(pieces).split("\n")


# Arrays in signatures by their short names; functions as defaults by theirs.
NUMBERS = {"Array": "float64", "Indices": "int32", "Flags": "bool_?"}
ARRAY_LIKE = r"~?[\w.]*_SupportsArray\[.*?_NestedSequence\[bool[\w |]*\]"
IN_SIGNATURES = [
    (re.compile(r"<function (\w+)>"), r"\1"),
    (re.compile(r"<factory>"), "..."),
    (re.compile(ARRAY_LIKE), "ArrayLike"),
] + [
    (re.compile(rf"~?numpy\.ndarray\[~?(typing\.)?Any, ~?numpy\.dtype\[~?numpy\.{of}\]\]"), name)
    for name, of in NUMBERS.items()
]


def edit_signature(app, what, name, obj, options, signature, returns):
    """Shorten types that readers know by a name."""
    texts = [signature, returns]
    for pattern, new in IN_SIGNATURES:
        texts = [text and pattern.sub(new, text) for text in texts]
    return tuple(texts)


def find_type(app, env, node, contnode):
    """Link types in signatures, named by their modules, to the page of the public name."""
    name = node.get("reftarget", "").rpartition(".")[2]
    objects = env.domains["py"].objects
    for package in ("fenics_mortar", "fenics_mortar.sensitivity", "fenics_mortar.laws"):
        if found := objects.get(f"{package}.{name}"):
            return make_refnode(app.builder, node["refdoc"], found.docname, found.node_id, contnode)
    return None


def skip_fields(app, what, name, obj, skip, options):
    """Skip fields of named tuples: the docstring of the class describes them."""
    return True if (getattr(obj, "__doc__", "") or "").startswith("Alias for field") else None


def setup(app):
    """Register the editing of docstrings."""
    app.connect("autodoc-process-docstring", edit_docstring)
    app.connect("autodoc-process-signature", edit_signature)
    app.connect("autodoc-skip-member", skip_fields)
    app.connect("missing-reference", find_type)
