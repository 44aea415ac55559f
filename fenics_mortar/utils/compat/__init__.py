# SPDX-License-Identifier: MIT
"""All differences between dolfinx 0.5.2, 0.9 and 0.11.

Functions check the interface (``hasattr``, ``callable``), never a version number, so that other
releases work if their interface agrees. Docstrings name the release of each change. Callers import
this package, not its modules.
"""

from fenics_mortar.utils.compat.forms import (
    Rule,
    assemble_matrix,
    assemble_vector,
    condition_numbers,
    create_expression,
    create_matrix,
    create_vector,
    domain_of,
    evaluate_expression,
    form,
    interpolate_expression,
    local_sums,
    petsc_vec,
    prescribed_value,
    quadrature_points,
    quadrature_rules,
    set_prescribed,
    subdomain_cells,
)
from fenics_mortar.utils.compat.libraries import (
    cure_of_gmsh,
    gmsh_is_initialized,
    missing_gmsh,
    option_is_used,
    petsc_has,
    quiet_compiler,
    scalar_is_complex,
)
from fenics_mortar.utils.compat.meshes import (
    are_tags_of,
    cell_name,
    collapsed,
    create_mesh,
    dofmap,
    geometry_dofmap,
    is_part_of,
    is_sub_space,
    mixed_space,
    num_corners,
    quadrature_degree,
    quadrature_space,
    scalar_space,
    settle_coordinate_element,
    vector_space,
)
