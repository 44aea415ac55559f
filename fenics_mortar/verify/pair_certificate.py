# SPDX-License-Identifier: MIT
"""Certificate of one pair: what its checks found."""

from __future__ import annotations

from dataclasses import dataclass

from fenics_mortar.verify.finding import Finding


@dataclass(frozen=True)
class PairCertificate:
    """Findings of the checks of one pair; all methods are local.

    ``pair["penetration"]`` is the finding of this name. Names and meanings are those of the modules
    in ``fenics_mortar.verify.checks``.

    Attributes:
        pair: Names of slave and master.
        findings: One finding for each quantity that is measured for this kind of pair.
    """

    pair: str
    findings: tuple[Finding, ...]

    def __getitem__(self, name: str) -> Finding:
        """The finding of this name.

        Raises:
            KeyError: If there is none.
        """
        for finding in self.findings:
            if finding.name == name:
                return finding
        names = ", ".join(finding.name for finding in self.findings)
        raise KeyError(f"'{name}' is not measured for {self.pair}; expected one of {names}")

    def violations(self) -> list[str]:
        """Describe violated conditions; empty for a sound state."""
        return self._messages("violation")

    def remarks(self) -> list[str]:
        """Describe where the mesh is too coarse or the solution may not be unique."""
        return self._messages("remark")

    def _messages(self, verdict: str) -> list[str]:
        return [f"{self.pair}: {f.message}" for f in self.findings if f.verdict == verdict]
