# SPDX-License-Identifier: MIT
"""Collect the pages of the site from this repository into a folder that Sphinx reads.

Pages are the Markdown files of this folder, Markdown files elsewhere in the repository, and
literate scripts: the demos, and the tutorial with a page for each of its steps and a notebook.
Links between files are rewritten: to the page of a file if it has one, to the reference if it is a
module of the package, otherwise to a copy of the file. A broken link is an error.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path, PurePosixPath
from typing import Any

import jupytext
from gallery import Demo, all_demos, demos
from reference import (
    GROUPS,
    about_module,
    automodule,
    documented,
    group_of,
    in_reference,
    options_of,
    rank,
)

SITE = Path(__file__).resolve().parent
ROOT = SITE.parents[2]
PICTURE_OF_CARD = re.compile(r"^:img-top: (\S+)$", re.MULTILINE)
LINK = re.compile(r"(!?)\[((?:`[^`]*`|[^\]`])*)\]\(([^()#\s:]+)(#[^()\s]*)?\)")
FENCE = re.compile(r"^(```.*?^```$)", re.MULTILINE | re.DOTALL)
STEPS = ("two_blocks", "finite_strain", "friction", "errors", "research")


def pages_of_files() -> dict[str, str]:
    """The page of each file that has one, by paths within the repository and the site."""
    pages = {
        "README.md": "index.md",
        "CHANGELOG.md": "changelog.md",
        "CONTRIBUTING.md": "contributing.md",
        "demos/README.md": "demos.md",
        "demos": "demos.md",
        "demos/guide": "index.md",
        "demos/studies/README.md": "studies/index.md",
        "demos/studies": "studies/index.md",
    }
    for file in sorted((ROOT / "demos" / "guide").glob("*.md")):
        pages[str(file.relative_to(ROOT))] = file.name
    for file in sorted((ROOT / "demos" / "guide" / "features").glob("*.md")):
        pages[str(file.relative_to(ROOT))] = f"features/{file.name}"
    for file in sorted((ROOT / "demos" / "studies").glob("*/*.md")):
        study = file.parent.name
        name = study if file.name == "README.md" else f"{study}_{file.stem}"
        name = f"{study}_numbers" if file.stem == study else name
        pages[str(file.relative_to(ROOT))] = f"studies/{name}.md"
    for demo in all_demos():
        pages[str(demo.script.relative_to(ROOT))] = f"demos/{demo.name}.md"
    for file in sorted(SITE.rglob("*.md")):
        pages[str(file.relative_to(ROOT))] = str(file.relative_to(SITE))
    return pages


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
        for demo in all_demos():
            self._write_demo(demo)
        self._write_tutorial()
        self._write_gallery()
        self._write_program()
        self._write_modules()
        self._write_reference()
        self._list_pages("studies/index.md", "studies")
        self._list_pages("features.md", "features")
        self._put_below("contributing.md", ["thresholds"])
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

        def copied(match: re.Match[str]) -> str:
            picture = self._copy(((ROOT / origin).parent / match[1]).resolve())
            return f":img-top: {os.path.relpath(picture, PurePosixPath(page).parent)}"

        return LINK.sub(new, PICTURE_OF_CARD.sub(copied, text))

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

    def _write_demo(self, demo: Demo) -> None:
        origin = str(demo.script.relative_to(ROOT))
        title, rest = as_markdown(jupytext.read(demo.script).cells).split("\n", 1)
        source = f"[`{demo.script.name}`]({demo.script.name})"
        run = f"`bash demos/run.sh {demo.name}` runs it. Source: {source}"
        self._pages.pop(origin)  # the link to its source
        self._put(f"demos/{demo.name}.md", origin, "\n".join([title, "", run, "", demo.text, rest]))
        self._pages[origin] = f"demos/{demo.name}.md"

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

    def _write_gallery(self) -> None:
        """Cards of all demos by subject, instead of their texts, which are on their own pages."""
        path = self._folder / "demos.md"
        lines = [path.read_text().split("\n## ", 1)[0], ""]
        for subject, of_subject in demos().items():
            lines += [f"## {subject}", "", ":::::{grid} 1 2 2 3", ":gutter: 3", ""]
            for demo in of_subject:
                picture = self._copy(ROOT / "demos" / "pictures" / f"{demo.name}.png")
                lines += [f":::{{grid-item-card}} {demo.title}", f":link: demos/{demo.name}"]
                lines += [":link-type: doc", f":img-top: {picture}", "", demo.level, ":::", ""]
            lines += [":::::", ""]
        path.write_text("\n".join(lines))
        self._put_below("demos.md", [f"demos/{demo.name}" for demo in all_demos()])

    def _write_program(self) -> None:
        """The program of the README, which the pages of features continue."""
        path = self._folder / "start.md"
        program = re.search(r"^```python$.*?^```$", (ROOT / "README.md").read_text(), re.M | re.S)
        path.write_text(path.read_text().replace("<program>", program[0]))

    def _write_reference(self) -> None:
        """A page for each group of public names, and a table of all."""
        found: dict[str, list[str]] = {group: [] for group in GROUPS}
        for full, thing in in_reference().items():
            found[group_of(thing)].append(full)
        for names_on_page in found.values():
            names_on_page.sort(key=lambda full: rank(full.rpartition(".")[2]))
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

    def _list_pages(self, first: str, folder: str) -> None:
        """Put the pages of a folder below its first page, in the order of the links on it."""
        path = self._folder / first
        text = path.read_text()
        files = [file for file in sorted((self._folder / folder).glob("*.md")) if file != path]
        pages = [os.path.relpath(file.with_suffix(""), path.parent) for file in files]
        pages.sort(key=lambda page: text.find(f"({page}.md") % (len(text) + 1))
        self._put_below(first, pages)

    def _put_below(self, first: str, pages: list[str]) -> None:
        """Put pages below another one in the navigation."""
        path = self._folder / first
        names = "\n".join(pages)
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
