# SPDX-License-Identifier: MIT
"""Objects that are printed as Markdown, which notebooks render."""

from __future__ import annotations


class Markdown:
    """Base of objects whose ``str`` is Markdown."""

    def _repr_markdown_(self) -> str:
        """Text that a notebook renders (local)."""
        return str(self)


class MarkdownText(Markdown, str):
    """A text in Markdown."""
