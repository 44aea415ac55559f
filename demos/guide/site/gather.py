# SPDX-License-Identifier: MIT
"""Collect the pages of the site from this repository into a folder that Sphinx reads.

Pages are the Markdown files of this folder, Markdown files elsewhere in the repository, and
literate scripts: the demos, and the tutorial with a page for each of its steps and a notebook.
Links between files are rewritten: to the page of a file if it has one, to the reference if it is a
module of the package, otherwise to a copy of the file. A broken link is an error.
"""

from __future__ import annotations

import inspect
import os
import re
import shutil
import sys
from pathlib import Path, PurePosixPath
from typing import Any

import jupytext

import fenics_mortar
from fenics_mortar.contact.pair_side import PairSide
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.equations.reaction import Reaction
from fenics_mortar.newton.report import Iteration
from fenics_mortar.path.report import PathStep
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.matrices import OperatorMatrices

SITE = Path(__file__).resolve().parent
ROOT = SITE.parents[2]
LINK = re.compile(r"(!?)\[((?:`[^`]*`|[^\]`])*)\]\(([^()#\s:]+)(#[^()\s]*)?\)")
FENCE = re.compile(r"^(```.*?^```$)", re.MULTILINE | re.DOTALL)
# Pages of the reference: title, and folders of the package whose public names they contain.
GROUPS = {
    "problem": ("The problem and its results", ("problem", "equations", "newton")),
    "meshes": ("Meshes, spaces and supports", ("mesh", "utils.compat")),
    "energies": ("Energies of the bodies", ("energies",)),
    "pairs": ("Contact pairs", ("contact",)),
    "laws": ("Contact laws", ("laws", "contact.laws", "contact.law", "contact.nodal")),
    "obstacles": ("Rigid obstacles", ("obstacles", "rigid")),
    "paths": ("Load steps and dynamics", ("path", "bulk")),
    "sensitivities": ("Sensitivities", ("sensitivity",)),
    "models": ("Choice of the model", ("models",)),
    "verification": ("Verification of results", ("verify",)),
    "files": ("Files and pictures", ("io",)),
    "errors": ("Errors", ("utils",)),
    "further": ("Further names", ()),
}
# Classes whose instances are created by the package, not by users.
MET = (Finding, Iteration, InterfaceState, PathStep, OperatorMatrices, PairSide, Reaction)
# Members of laws and obstacles are described once, at their base classes.
NOT_REPEATED = "ABC, BaseException, Exception, tuple, Law, Obstacle"
OF_CLASSES = ("   :members:", f"   :inherited-members: {NOT_REPEATED}")
STEPS = ("two_blocks", "finite_strain", "friction", "enough", "research")


def pages_of_files() -> dict[str, str]:
    """The page of each file that has one, by paths within the repository and the site."""
    pages = {
        "README.md": "index.md",
        "CHANGELOG.md": "changelog.md",
        "CONTRIBUTING.md": "contributing.md",
        "demos/README.md": "gallery.md",
        "demos": "demos.md",
        "demos/guide": "index.md",
        "demos/studies/README.md": "studies/index.md",
        "demos/studies": "studies/index.md",
    }
    for name in ("installation", "features", "laws", "limits", "thresholds"):
        pages[f"demos/guide/{name}.md"] = f"{name}.md"
    for file in sorted((ROOT / "demos" / "studies").glob("*/*.md")):
        study = file.parent.name
        name = study if file.name == "README.md" else f"{study}_{file.stem}"
        name = f"{study}_numbers" if file.stem == study else name
        pages[str(file.relative_to(ROOT))] = f"studies/{name}.md"
    for file in demos():
        pages[str(file.relative_to(ROOT))] = f"demos/{file.stem.removeprefix('demo_')}.md"
    for file in sorted(SITE.rglob("*.md")):
        pages[str(file.relative_to(ROOT))] = str(file.relative_to(SITE))
    return pages


def demos() -> list[Path]:
    """All demos, starting with the one to be read first."""
    return sorted(
        (ROOT / "demos").glob("demo_*.py"), key=lambda demo: (demo.stem != "demo_two_blocks", demo)
    )


class Gathered:
    """The folder of the collected pages.

    Args:
        folder: Output folder; it is emptied first.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._pages = pages_of_files()
        self._lost: list[str] = []
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)

    def write(self) -> None:
        """Write all pages.

        Raises:
            SystemExit: If links are broken.
        """
        for file, page in self._pages.items():
            if file.endswith(".md") and file != "README.md" and (ROOT / file).exists():
                self._put(page, file, (ROOT / file).read_text())
        for demo in demos():
            self._write_demo(demo)
        self._write_tutorial()
        self._write_index_of_demos()
        self._write_modules()
        self._write_reference()
        self._list_studies()
        if self._lost:
            raise SystemExit("links that lead nowhere:\n" + "\n".join(self._lost))

    def _put(self, page: str, origin: str, text: str) -> None:
        path = self._folder / page
        path.parent.mkdir(parents=True, exist_ok=True)
        if not text.startswith(("# ", "---")):
            text = f"# {path.stem.replace('_', ' ').capitalize()}\n\n{text}"
        pieces = FENCE.split(text)  # links are rewritten only outside code
        pieces[::2] = [self._relink(piece, page, origin) for piece in pieces[::2]]
        path.write_text("".join(pieces))

    # Links

    def _relink(self, text: str, page: str, origin: str) -> str:
        def new(match: re.Match[str]) -> str:
            picture, label, target, anchor = match.groups()
            return self._link(picture, label, target, anchor or "", page, origin)

        return LINK.sub(new, text)

    def _link(
        self, picture: str, label: str, target: str, anchor: str, page: str, origin: str
    ) -> str:
        here = PurePosixPath(page).parent
        name = os.path.normpath(PurePosixPath(origin).parent / target)
        file = ROOT / name
        if name in self._pages:
            return f"[{label}]({os.path.relpath(self._pages[name], here)}{anchor})"
        if name.startswith("..") or not file.exists():
            self._lost.append(f"{origin}: {target}")
            return target
        if picture:
            return f"![{label}]({os.path.relpath(self._copy(file), here)})"
        if name.startswith("fenics_mortar/") and file.suffix == ".py":
            module = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
            return f"{{py:mod}}`{label.replace('`', '')} <{module}>`"
        if file.is_dir():
            return label
        return f"{{download}}`{label.replace('`', '')} <{os.path.relpath(self._copy(file), here)}>`"

    def _copy(self, file: Path) -> str:
        """Copy a file of the repository; return its path within the site."""
        target = self._folder / "files" / file.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
        return str(target.relative_to(self._folder))

    # Literate scripts

    def _write_demo(self, demo: Path) -> None:
        origin = str(demo.relative_to(ROOT))
        name = demo.stem.removeprefix("demo_")
        text = as_markdown(jupytext.read(demo).cells)
        title, rest = text.split("\n", 1)
        run = f"`bash demos/run.sh {name}` runs it. Source: [`{demo.name}`]({demo.name})\n"
        pictures = [
            f"![{title.removeprefix('# ')}](pictures/{picture.name})\n"
            for picture in pictures_of(name)
        ]
        self._pages.pop(origin)  # the link to its source
        self._put(f"demos/{name}.md", origin, "\n".join([title, "", run, *pictures, rest]))
        self._pages[origin] = f"demos/{name}.md"

    def _write_tutorial(self) -> None:
        script = SITE.parent / "tutorial.py"
        notebook = jupytext.read(script)
        (self._folder / "tutorial").mkdir(exist_ok=True)
        alone = standing_alone(jupytext.read(script))
        jupytext.write(alone, self._folder / "tutorial" / "tutorial.ipynb", fmt="ipynb")
        steps: list[list] = []
        for cell in notebook.cells:
            if cell.cell_type == "markdown" and cell.source.startswith("# "):
                steps.append([])
            steps[-1].append(cell)
        if len(steps) != len(STEPS):
            raise SystemExit(f"{script} has {len(steps)} steps; the site has pages for {STEPS}")
        for name, cells in zip(STEPS, steps):
            self._put(f"tutorial/{name}.md", "demos/guide/tutorial.py", as_markdown(cells))

    def _write_index_of_demos(self) -> None:
        path = self._folder / "demos.md"
        cards = []
        for demo in demos():
            name = demo.stem.removeprefix("demo_")
            title = demo.read_text().split("\n", 1)[0].removeprefix("# # ")
            pictures = pictures_of(name)
            image = [f":img-top: {self._copy(pictures[0])}"] if pictures else []
            cards.append(
                "\n".join([f":::{{grid-item-card}} {title}", f":link: demos/{name}",
                           ":link-type: doc", *image, ":::\n"])
            )  # fmt: skip
        names = "\n".join(f"demos/{demo.stem.removeprefix('demo_')}" for demo in demos())
        text = path.read_text()
        path.write_text(text.replace("<cards>", "\n".join(cards)).replace("<names>", names))

    def _write_reference(self) -> None:
        """A page for each group of public names, and a table of all."""
        found: dict[str, list[str]] = {group: [] for group in GROUPS}
        for full, thing in in_reference().items():
            found[group_of(thing)].append(full)
        (self._folder / "reference").mkdir()
        tables = []
        groups = [group for group in GROUPS if found[group]]
        for group in groups:
            title = GROUPS[group][0]
            lines, rows = [f"# {title}", ""], ["| name | |", "|---|---|"]
            if (ROOT / "fenics_mortar" / f"{group}.py").exists():
                lines += about_module(f"fenics_mortar.{group}")
            for full in found[group]:
                name = full.rpartition(".")[2]
                kind, about = documented(in_reference()[full])
                options = [] if kind == "function" else options_of(in_reference()[full])
                lines += [f"## {name}", "", "```{eval-rst}", f".. auto{kind}:: {full}", *options,
                          "```", ""]  # fmt: skip
                rows.append(f"| {{py:obj}}`{name} <{full}>` | {about} |")
            (self._folder / "reference" / f"{group}.md").write_text("\n".join(lines))
            tables += [f"## {{doc}}`{title} <reference/{group}>`", "", *rows, ""]
        path = self._folder / "reference.md"
        names = "\n".join(f"reference/{group}" for group in groups)
        text = path.read_text().replace("<tables>", "\n".join(tables))
        path.write_text(text.replace("<names>", names))

    def _list_studies(self) -> None:
        path = self._folder / "studies" / "index.md"
        names = "\n".join(sorted(file.stem for file in path.parent.glob("*.md") if file != path))
        path.write_text(f"{path.read_text()}\n```{{toctree}}\n:hidden:\n\n{names}\n```\n")

    def _write_modules(self) -> None:
        """A page for each folder of the package, with all modules and their functions."""
        package = ROOT / "fenics_mortar"
        folders = sorted(path.parent for path in package.glob("*/**/__init__.py"))
        out = self._folder / "modules"
        out.mkdir()
        names: list[str] = []
        for folder in folders:
            name = ".".join(folder.relative_to(package).parts)
            dotted = f"fenics_mortar.{name}"
            lines = [f"# {name}", "", *about_module(dotted)]
            for module in sorted(folder.glob("*.py")):
                if module.stem != "__init__":
                    lines += [f"## {module.stem}", "", *automodule(f"{dotted}.{module.stem}")]
            (out / f"{name}.md").write_text("\n".join(lines))
            names.append(f"modules/{name}")
        path = self._folder / "modules.md"
        path.write_text(path.read_text().replace("<names>", "\n".join(names)))


def in_reference() -> dict[str, Any]:
    """All objects of the reference by full names."""
    package = fenics_mortar
    public = {f"fenics_mortar.{name}": getattr(package, name) for name in package.__all__}
    known = set(map(id, public.values()))
    modules = package.energies, package.laws, package.sensitivity
    of_modules = [getattr(module, name) for module in modules for name in module.__all__]
    met = [*(thing for thing in of_modules if id(thing) not in known), *MET]
    return public | {f"{cls.__module__}.{cls.__qualname__}": cls for cls in met}


def group_of(thing: Any) -> str:
    """The page of the reference of a public name, by the longest match of its module."""
    module = thing.__module__.removeprefix("fenics_mortar.")
    matches = [(len(place), group) for group, (_, places) in GROUPS.items() for place in places
               if f"{module}.".startswith(f"{place}.")]  # fmt: skip
    return max(matches, default=(0, "further"))[1]


def documented(thing: Any) -> tuple[str, str]:
    """Directive of a public name, and the first paragraph of its docstring."""
    kind = "exception" if inspect.isclass(thing) and issubclass(thing, Exception) else "class"
    about = (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
    return kind if inspect.isclass(thing) else "function", about.replace("``", "`")


def options_of(cls: type) -> list[str]:
    """Options of the directive of a class; bases are shown if the reference has one of them."""
    has_base = any(base in in_reference().values() for base in cls.__bases__)
    return [*OF_CLASSES, *(["   :show-inheritance:"] if has_base else [])]


def about_module(module: str) -> list[str]:
    """Directive with the docstring of a module alone."""
    return ["```{eval-rst}", f".. automodule:: {module}", "   :no-members:", "```", ""]


def automodule(module: str) -> list[str]:
    """Directive with the documentation of a module."""
    elsewhere = {full.rpartition(".")[2]: full for full, thing in in_reference().items()
                 if thing.__module__ == module}  # fmt: skip
    lines = ["```{eval-rst}", f".. automodule:: {module}", "   :members:"]
    lines += ["   :ignore-module-all:"]
    if not elsewhere:
        return [*lines, "```", ""]
    links = ", ".join(f"{{py:obj}}`{name} <{full}>`" for name, full in elsewhere.items())
    excluded = f"   :exclude-members: {', '.join(elsewhere)}"
    return [*lines, excluded, "```", "", f"In the reference: {links}.", ""]


def pictures_of(demo: str) -> list[Path]:
    """Pictures of a demo: its name, and its name followed by a word."""
    folder = ROOT / "demos" / "pictures"
    return [path for path in (folder / f"{demo}.png", *sorted(folder.glob(f"{demo}_*.png")))
            if path.exists()]  # fmt: skip


def standing_alone(notebook: Any) -> Any:
    """The notebook with pictures drawn by its cells, and without links to pages of the site."""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = cell.source.replace("](../pictures/", "](results/")
            cell.source = LINK.sub(lambda m: m[0] if m[1] else m[2], cell.source)
    return notebook


def as_markdown(cells: list) -> str:
    """Text of the cells of a literate script, code in fences."""
    return (
        "\n\n".join(
            cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```"
            for cell in cells
        )
        + "\n"
    )


if __name__ == "__main__":
    Gathered(Path(sys.argv[1])).write()
