# SPDX-License-Identifier: MIT
"""Pages of the reference: public names by group, and the members that users need."""

from __future__ import annotations

import inspect
from typing import Any

import fenics_mortar
from fenics_mortar.contact.fields import InterfaceState
from fenics_mortar.contact.view import PairSide
from fenics_mortar.equations.residual import Reaction
from fenics_mortar.newton.loop import Iteration
from fenics_mortar.path.report import PathStep
from fenics_mortar.sensitivity.protocols import Control, Quantity
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.tangent import OperatorMatrices

# Pages of the reference: title, and folders of the package whose public names they contain.
GROUPS = {
    "problem": (
        "The problem and its results",
        (
            "problem",
            "equations",
            "newton",
            "contact.view",
            "contact.fields",
            "verify.tangent",
            "io.paraview",
        ),
    ),
    "meshes": ("Meshes, spaces and supports", ("mesh", "utils.compat", "bulk.history")),
    "energies": ("Energies of the bodies", ("energies",)),
    "pairs": ("Contact pairs", ("contact",)),
    "laws": ("Contact laws", ("laws", "contact.law", "contact.law_calls", "contact.conductance")),
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
# Names that come first on their page, in this order.
FIRST = (
    "ContactProblem", "PairView", "PairSide", "contact_table", "Reaction", "NewtonReport",
    "Iteration", "NewtonOptions", "State", "read_gmsh", "mesh_from_arrays", "mesh_from_meshio",
    "MeshData", "ContactPair", "TiedPair", "Coulomb", "follow_path", "Dynamics", "gradient",
    "Gradient",
)  # fmt: skip
# Members for the package itself, which only pages of protocols show.
OF_DEVELOPERS = frozenset({
    "assess", "before", "by_before", "by_control", "check", "check_field", "check_for_tie",
    "counting_slip_from", "explicit", "followed_by", "has_adhesion", "has_closing_gap",
    "has_friction", "has_nodal_adhesion", "is_distributed",
    "jvp", "local", "local_by_shapes", "motions", "needs_nodal_state", "options",
    "prepare", "present_jump", "quantity", "replaced", "restore_data", "salient_points",
    "saved_data", "set_shape", "snapshot", "to_own_frame", "to_space",
    "towards", "varying", "visited", "vjp", "with_options", "with_settings_of",
})  # fmt: skip
PROTOCOLS = (Control, Quantity)
# Members of laws and obstacles are described once, at their base classes.
NOT_REPEATED = "ABC, BaseException, Exception, tuple, Law, Obstacle"
OF_CLASSES = ("   :members:", f"   :inherited-members: {NOT_REPEATED}")


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


def rank(name: str) -> int:
    """Place of a name on its page; others keep their order behind these."""
    return FIRST.index(name) if name in FIRST else len(FIRST)


def documented(thing: Any) -> tuple[str, str]:
    """Directive of a public name, and the first paragraph of its docstring."""
    kind = "exception" if inspect.isclass(thing) and issubclass(thing, Exception) else "class"
    about = (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
    about = about.replace("``", "`").replace(" (collective)", "")
    return kind if inspect.isclass(thing) else "function", about


def options_of(cls: type) -> list[str]:
    """Options of the directive of a class; bases are shown if the reference has one of them."""
    has_base = any(base in in_reference().values() for base in cls.__bases__)
    hidden = set() if cls in PROTOCOLS else OF_DEVELOPERS & set(dir(cls))
    return [
        *OF_CLASSES,
        *(["   :show-inheritance:"] if has_base else []),
        *([f"   :exclude-members: {', '.join(sorted(hidden))}"] if hidden else []),
    ]


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
