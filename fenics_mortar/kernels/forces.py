# SPDX-License-Identifier: MIT
"""Contact forces on nodes, and the balance of forces at the dofs."""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def add_contact_forces(D, M, z, facets, slave, master, on_slave, on_master):
    """Add D^T z on slave nodes and -M^T z on master nodes.

    Args:
        D: Slave matrices of facets, shape (f, K, K) [length].
        M: Master matrices of segments, shape (n, K, K) [length].
        z: Multipliers of c components, shape (slave nodes, c) [stress].
        facets: Slave nodes of the facets, shape (f, K).
        slave: Slave nodes of the segments, shape (n, K).
        master: Master nodes of the segments, shape (n, K).
        on_slave: Forces, shape (slave nodes, c) [stress length]; changed.
        on_master: Forces, shape (master nodes, c) [stress length]; changed.
    """
    for e in range(D.shape[0]):
        for j in range(D.shape[1]):
            for k in range(D.shape[2]):
                for c in range(z.shape[1]):
                    on_slave[facets[e, k], c] += D[e, j, k] * z[facets[e, j], c]
    for s in range(M.shape[0]):
        for j in range(M.shape[1]):
            for l in range(M.shape[2]):
                for c in range(z.shape[1]):
                    on_master[master[s, l], c] -= M[s, j, l] * z[slave[s, j], c]


@kernel
def add_forces(bulk, contact, to_force, prescribed, bounded, total):
    """Add the forces of bulk and contact, and sum the squares of forces.

    Args:
        bulk: Residual of the bulk, shape (n,) or longer [stress length].
        contact: Contact forces, shape (n,) [stress length].
        to_force: Factors that turn residuals into forces, shape (n,).
        prescribed: Whether a dof has a prescribed value, shape (n,) or longer, bool.
        bounded: Whether contact forces are at most those of the bulk in the sums, shape (n,), bool.
        total: The sum, shape (n,) [stress length]; filled.

    Returns:
        Sums of squares of total forces at free dofs, of contact forces, and of total forces at
        prescribed dofs, which are reactions.
    """
    free = on_contact = reactions = 0.0
    for i in range(total.shape[0]):
        total[i] = bulk[i] + contact[i]
        square = (to_force[i] * total[i]) ** 2
        limit = (to_force[i] * bulk[i]) ** 2 if bounded[i] else np.inf
        on_contact += min((to_force[i] * contact[i]) ** 2, limit)
        if prescribed[i]:
            reactions += min(square, limit)
        else:
            free += square
    return free, on_contact, reactions
