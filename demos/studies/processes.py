# SPDX-License-Identifier: MIT
"""Programs on several MPI ranks, started from a process that may be one of several itself."""

import os
import sys
from pathlib import Path

# Variables of MPI in this process, which processes started by mpirun must not inherit.
OF_THIS_RUN = (
    "OMPI_COMM", "OMPI_MCA_ess", "OMPI_MCA_orte", "OMPI_MCA_pmix", "PMI", "HYDI_", "MPI_LOCAL",
)  # fmt: skip


def mpirun(ranks: int) -> list[str]:
    """Words before a command that start it on several ranks, none for one rank.

    It is the mpirun of this Python's MPI: that of the set-up, or the one beside the interpreter.
    Another MPI's would start processes of one rank each.
    """
    beside = Path(sys.executable).with_name("mpirun")
    found = os.environ.get("FENICS_MORTAR_MPIRUN", str(beside) if beside.exists() else "mpirun")
    return [found, "-n", str(ranks)] if ranks > 1 else []


def outer_environment() -> dict[str, str]:
    """The environment without the variables of MPI in this process."""
    return {k: v for k, v in os.environ.items() if not k.startswith(OF_THIS_RUN)}
