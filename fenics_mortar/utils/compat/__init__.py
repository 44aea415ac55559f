# SPDX-License-Identifier: MIT
"""All differences between dolfinx 0.5.2, 0.9 and 0.11.

Functions check the interface (``hasattr``, ``callable``), never a version number, so that other
releases work if their interface agrees. Docstrings name the release of each change. Callers import
this package, not its modules.
"""

from fenics_mortar.utils.compat.assembly import (
    assemble_matrix,
    assemble_vector,
    condition_numbers,
    create_matrix,
    create_vector,
    form,
    local_sums,
    petsc_vec,
    prescribed_value,
    set_prescribed,
)
from fenics_mortar.utils.compat.compiler import quiet_compiler
from fenics_mortar.utils.compat.expressions import (
    create_expression,
    domain_of,
    evaluate_expression,
    interpolate_expression,
)
from fenics_mortar.utils.compat.libraries import (
    cure_of_gmsh,
    gmsh_is_initialized,
    missing_gmsh,
    option_is_used,
    petsc_has,
    scalar_is_complex,
)
from fenics_mortar.utils.compat.meshes import (
    are_tags_of,
    cell_name,
    create_mesh,
    geometry_dofmap,
    model_to_mesh,
    num_corners,
    settle_coordinate_element,
)
from fenics_mortar.utils.compat.quadrature import (
    Rule,
    quadrature_points,
    quadrature_rules,
    subdomain_cells,
)
from fenics_mortar.utils.compat.spaces import (
    dofmap,
    is_part_of,
    is_sub_space,
    mixed_space,
    quadrature_degree,
    quadrature_space,
    scalar_space,
    vector_space,
)

__all__ = [
    "Rule",
    "are_tags_of",
    "assemble_matrix",
    "assemble_vector",
    "cell_name",
    "condition_numbers",
    "create_expression",
    "create_matrix",
    "create_mesh",
    "create_vector",
    "cure_of_gmsh",
    "dofmap",
    "domain_of",
    "evaluate_expression",
    "form",
    "geometry_dofmap",
    "gmsh_is_initialized",
    "interpolate_expression",
    "is_part_of",
    "is_sub_space",
    "local_sums",
    "missing_gmsh",
    "mixed_space",
    "model_to_mesh",
    "num_corners",
    "option_is_used",
    "petsc_has",
    "petsc_vec",
    "prescribed_value",
    "quadrature_degree",
    "quadrature_points",
    "quadrature_rules",
    "quadrature_space",
    "quiet_compiler",
    "scalar_is_complex",
    "scalar_space",
    "set_prescribed",
    "settle_coordinate_element",
    "subdomain_cells",
    "vector_space",
]
