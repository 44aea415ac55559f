# SPDX-License-Identifier: MIT
"""Loops over dense blocks and rows: sparse matrices, contact forces, tables, short vectors.

``expand_rows``, ``gather_forces`` and ``pack_rows`` turn the blocks of facets and nodes, such as
rows of the contact law and derivatives of forces, into entries and rows of sparse matrices;
``pack_product``, ``sum_rows`` and ``add_rows`` multiply and add such rows. ``are_known`` compares
the couplings of slave facets and master nodes with a sparsity pattern, see ``la.coupling``.
``add_contact_forces`` and ``add_forces`` give the contact forces on nodes and the balance of forces
at the dofs. ``find_indices`` to ``turn_blocks`` serve a sparse matrix in rows and in blocks of
nodal dofs: positions of entries, copies, rotations. The remaining kernels are parts of other
kernels: rows of tables, and products of short vectors.
"""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def expand_rows(directions, nodes, values, rows, expanded):
    """Expand one row per node to one for each component of a direction.

    Args:
        directions: Direction at each node, shape (n, dim).
        nodes: Nodes of the rows, shape (b, r).
        values: Blocks, shape (b, r, c).
        rows: Numbers dim j + component, shape (b, dim r); filled.
        expanded: Blocks, shape (b, dim r, c); filled.
    """
    dim = directions.shape[1]
    for b in range(values.shape[0]):
        for r in range(values.shape[1]):
            j = nodes[b, r]
            for a in range(dim):
                rows[b, dim * r + a] = dim * j + a
                for q in range(values.shape[2]):
                    expanded[b, dim * r + a, q] = directions[j, a] * values[b, r, q]


@kernel
def gather_forces(
    D, facets, slave_rows, M, slave, master, master_rows, Z, A_z, owned, acts, dofs, i, j, v
):
    """Gather the entries of -B^T Z - A_z Z; return their number.

    Entries of B^T Z that are zero are left out.

    Args:
        D: Slave matrices of facets, shape (f, K, K) [length].
        facets: Slave nodes of the facets, shape (f, K).
        slave_rows: Rows of the slave nodes' dofs, shape (slave nodes, dim).
        M: Master matrices of segments, shape (n, K, K') [length].
        slave: Slave nodes of the segments, shape (n, K).
        master: Master nodes of the segments, shape (n, K').
        master_rows: Rows of the master nodes' dofs, shape (master nodes, dim).
        Z: Diagonal of Z, zero where no multiplier acts, shape (slave nodes, dim) [1 / length].
        A_z: Shape (slave nodes, dim, dim) [length].
        owned: Slave nodes owned by this rank, shape (k,).
        acts: Whether a multiplier acts, shape (slave nodes,), bool.
        dofs: Numbers of the multipliers' components, shape (slave nodes, dim) or more.
        i: Rows of the entries, shape (dim (D.size + M.size + dim k),); filled.
        j: Columns of the entries, of that shape; filled.
        v: Values of the entries, of that shape; filled.
    """
    dim, entries = slave_rows.shape[1], (i, j, v)
    count = _add_products(D, facets, facets, slave_rows, Z, -1.0, dofs, entries, 0)
    count = _add_products(M, slave, master, master_rows, Z, 1.0, dofs, entries, count)
    for p in owned:
        if acts[p]:
            for a in range(dim):
                for c in range(dim):
                    i[count], j[count] = slave_rows[p, a], dofs[p, c]
                    v[count] = -A_z[p, a, c] * Z[p, c]
                    count += 1
    return count


@kernel
def _add_products(X, nodes, others, rows, Z, sign, dofs, entries, count):
    """Append the entries of ``sign`` X^T Z of matrices X (n, K, K'); return their number."""
    i, j, v = entries
    for s in range(X.shape[0]):
        for p in range(X.shape[1]):
            for l in range(X.shape[2]):
                for c in range(rows.shape[1]):
                    value = X[s, p, l] * Z[nodes[s, p], c]
                    if value != 0.0:
                        i[count] = rows[others[s, l], c]
                        j[count] = dofs[nodes[s, p], c]
                        v[count] = sign * value
                        count += 1
    return count


@kernel
def pack_rows(rows, columns, values, counts, packed_rows, starts, packed_columns, packed_values):
    """Append the nonzero entries of blocks to a list of sparse rows.

    Rows without entries are dropped, as are rows and columns of -1.

    Args:
        rows: Shape (b, r).
        columns: Shape (b, c).
        values: Shape (b, r, c).
        counts: Numbers of rows and entries so far, shape (2,); increased.
        packed_rows: Number of each row in the matrix; filled.
        starts: Entries of row p are starts[p]:starts[p + 1], the first start is set; filled.
        packed_columns: Columns of the entries; filled.
        packed_values: Values of the entries; filled.
    """
    row, entry = counts
    for b in range(values.shape[0]):
        for r in range(values.shape[1]):
            if rows[b, r] >= 0:
                for c in range(values.shape[2]):
                    if values[b, r, c] != 0.0 and columns[b, c] >= 0:
                        packed_columns[entry] = columns[b, c]
                        packed_values[entry] = values[b, r, c]
                        entry += 1
                if entry > starts[row]:
                    packed_rows[row] = rows[b, r]
                    row += 1
                    starts[row] = entry
    counts[0], counts[1] = row, entry


@kernel
def sort_by_row(rows, first, count):
    """Sort entries by their ``rows`` (n,), which are ``first`` to ``first + count - 1``.

    Returns:
        Those of row r end before ends[r - first], (count + 1,), and the order of the entries, (n,).
    """
    ends, order = np.zeros(count + 1, np.int64), np.empty(rows.size, np.int64)
    for e in range(rows.size):
        ends[rows[e] - first + 1] += 1
    for r in range(count):
        ends[r + 1] += ends[r]
    for e in range(rows.size):
        order[ends[rows[e] - first]] = e
        ends[rows[e] - first] += 1
    return ends, order


@kernel
def pack_product(i, j, v, offsets, columns, values, numbers, num_columns, counts, packed_rows,
                 starts, packed_columns, packed_values):  # fmt: skip
    """As ``pack_rows``, for the product of two sparse matrices; each row is summed.

    Args:
        i: Rows of the entries of the first matrix, in any order, shape (e,).
        j: Columns of these entries, shape (e,).
        v: Values of these entries, shape (e,); duplicates are summed.
        offsets: Entries of row p of the second matrix are offsets[p]:offsets[p + 1].
        columns: Columns of the entries of the second matrix.
        values: Values of the entries of the second matrix.
        numbers: Number of each row of the product, shape (rows,).
        num_columns: Number of columns.
        counts: See ``pack_rows``.
        packed_rows: See ``pack_rows``.
        starts: See ``pack_rows``.
        packed_columns: See ``pack_rows``.
        packed_values: See ``pack_rows``.
    """
    ends, by_row = sort_by_row(i, 0, numbers.size)
    places = np.full(num_columns, -1)  # of columns among the packed ones of the row
    factors, begins = np.empty(offsets.size - 1), np.full(offsets.size - 1, -1)
    begin, (row, entry) = 0, counts
    for r in range(numbers.size):
        distinct = begin
        for p in range(begin, ends[r]):
            k, factor = j[by_row[p]], v[by_row[p]]
            if begins[k] == begin:
                factors[k] += factor
            else:
                begins[k], factors[k] = begin, factor
                by_row[distinct] = k  # instead of an entry that was read
                distinct += 1
        for p in range(begin, distinct):
            k = by_row[p]
            for q in range(offsets[k], offsets[k + 1]):
                column = columns[q]
                if values[q] != 0.0:
                    place = places[column]
                    if place >= starts[row]:
                        packed_values[place] += factors[k] * values[q]
                    else:
                        places[column] = entry
                        packed_columns[entry] = column
                        packed_values[entry] = factors[k] * values[q]
                        entry += 1
        begin = ends[r]
        if entry > starts[row]:
            packed_rows[row] = numbers[r]
            row += 1
            starts[row] = entry
    counts[0], counts[1] = row, entry


@kernel
def sum_rows(rows, starts, columns, values, first, num_columns, sum_starts, sum_columns,
             sum_values):  # fmt: skip
    """Sum packed rows into the rows of a matrix, each with an entry on the diagonal.

    Args:
        rows: Number of each packed row, in any order, shape (p,); at least ``first``.
        starts: Entries of packed row p are starts[p]:starts[p + 1].
        columns: Columns of the entries, in any order.
        values: Values of the entries.
        first: Number of the first row of the sums.
        num_columns: Number of columns.
        sum_starts: Entries of row ``first`` + i are sum_starts[i]:sum_starts[i + 1]; filled.
        sum_columns: Their columns, ascending in each row, at most entries + p; filled.
        sum_values: Their values, likewise.
    """
    ends, by_row = sort_by_row(rows, first, sum_starts.size - 1)
    places = np.full(num_columns, -1)  # of columns among the sums of the row
    entry, begin = 0, 0
    sum_starts[0] = 0
    for r in range(sum_starts.size - 1):
        start = entry
        if ends[r] > begin:
            places[first + r] = entry
            sum_columns[entry], sum_values[entry] = first + r, 0.0
            entry += 1
        for k in range(begin, ends[r]):
            for e in range(starts[by_row[k]], starts[by_row[k] + 1]):
                place = places[columns[e]]
                if place >= start:
                    sum_values[place] += values[e]
                else:
                    places[columns[e]] = entry
                    sum_columns[entry], sum_values[entry] = columns[e], values[e]
                    entry += 1
        begin = ends[r]
        sum_starts[r + 1] = entry
    sort_columns(sum_starts, sum_columns, sum_values, places)


@kernel
def sort_columns(starts, columns, values, ends):
    """Sort the entries of rows by their columns, in time proportional to their number.

    They are distributed to columns, row by row, and from these back to rows.

    Args:
        starts: Entries of row r are starts[r]:starts[r + 1].
        columns: Their columns; sorted.
        values: Their values; sorted likewise.
        ends: Shape (number of columns,); overwritten.
    """
    ends[:] = 0
    for e in range(starts[-1]):
        ends[columns[e]] += 1
    total = 0
    for c in range(ends.size):
        total, ends[c] = total + ends[c], total
    rows, sorted_values = np.empty(total, np.int32), np.empty(total)
    for r in range(starts.size - 1):
        for e in range(starts[r], starts[r + 1]):
            place = ends[columns[e]]
            rows[place], sorted_values[place] = r, values[e]
            ends[columns[e]] = place + 1
    nexts, begin = starts[:-1].copy(), 0
    for c in range(ends.size):
        for e in range(begin, ends[c]):
            place = nexts[rows[e]]
            columns[place], values[place] = c, sorted_values[e]
            nexts[rows[e]] = place + 1
        begin = ends[c]


@kernel
def add_rows(part, more, bounds, outside, sums):
    """Add rows to some columns of a matrix: those within ``bounds``, or those outside.

    Rows are starts, columns, ascending in each row, and values of their entries.

    Args:
        part: The columns of the matrix, numbered from bounds[0] on if they are within.
        more: The rows to add, with all columns.
        bounds: First column within, and the one after the last.
        outside: Whether the columns are those outside.
        sums: The sum, numbered as ``part``, with entries where one of both has them, at most the
            number of both; filled.
    """
    (starts, columns, values), (more_starts, more_columns, more_values) = part, more
    sum_starts, sum_columns, sum_values = sums
    entry, shift = 0, 0 if outside else bounds[0]
    sum_starts[0] = 0
    for r in range(starts.size - 1):
        e, end = starts[r], starts[r + 1]
        for k in range(more_starts[r], more_starts[r + 1]):
            column = more_columns[k]
            if (bounds[0] <= column < bounds[1]) == outside:
                continue
            column -= shift
            while e < end and columns[e] < column:
                sum_columns[entry], sum_values[entry] = columns[e], values[e]
                entry, e = entry + 1, e + 1
            sum_columns[entry], sum_values[entry] = column, more_values[k]
            if e < end and columns[e] == column:
                sum_values[entry] += values[e]
                e += 1
            entry += 1
        while e < end:
            sum_columns[entry], sum_values[entry] = columns[e], values[e]
            entry, e = entry + 1, e + 1
        sum_starts[r + 1] = entry


@kernel
def are_known(known, slave, master, acting, num_masters):
    """Whether a pattern contains the couplings of all segments with an acting multiplier.

    Args:
        known: Numbers of pairs of a slave facet and a master node, ascending, shape (n,): first
            slave node times (``num_masters`` + 1) plus master node, or ``num_masters`` for none.
        slave: Slave nodes of the segments, shape (s, K).
        master: Their master nodes, shape (s, L).
        acting: Slave nodes whose multipliers act, shape (slave nodes,), bool.
        num_masters: Number of master nodes.
    """
    for s in range(slave.shape[0]):
        acts = False
        for j in slave[s]:
            acts = acts or acting[j]
        if acts:
            base = slave[s, 0] * (num_masters + 1)
            if not _contains(known, base + num_masters):
                return False
            for k in master[s]:
                if not _contains(known, base + k):
                    return False
    return True


@kernel
def _contains(known, number):
    """Whether the ascending array ``known`` contains a number."""
    place = np.searchsorted(known, number)
    return place < known.shape[0] and known[place] == number


@kernel
def add_contact_forces(X, z, nodes, others, sign, forces):
    """Add ``sign`` X^T z of one side: of D with 1, of M with -1.

    Args:
        X: Matrices of facets or segments, shape (n, K, K') [length].
        z: Multipliers of c components, shape (slave nodes, c) [stress].
        nodes: Their slave nodes, shape (n, K).
        others: Nodes with the forces, shape (n, K').
        sign: Factor [1].
        forces: Forces of the side, shape (its nodes, c) [stress length]; changed.
    """
    for s in range(X.shape[0]):
        for j in range(X.shape[1]):
            for l in range(X.shape[2]):
                for c in range(z.shape[1]):
                    forces[others[s, l], c] += sign * X[s, j, l] * z[nodes[s, j], c]


@kernel
def add_forces(bulk, contact, to_force, prescribed, total):
    """Add the forces of bulk and contact, and sum the squares of forces.

    Args:
        bulk: Residual of the bulk, shape (n,) or longer [stress length].
        contact: Contact forces, shape (n,) [stress length].
        to_force: Factors that turn residuals into forces, shape (n,).
        prescribed: Whether a dof has a prescribed value, shape (n,) or longer, bool.
        total: The sum, shape (n,) [stress length]; filled.

    Returns:
        Sums of squares of total forces at free dofs, of contact forces, and of total forces at
        prescribed dofs, which are reactions.
    """
    free = on_contact = reactions = 0.0
    for i in range(total.shape[0]):
        total[i] = bulk[i] + contact[i]
        square = (to_force[i] * total[i]) ** 2
        on_contact += (to_force[i] * contact[i]) ** 2
        if prescribed[i]:
            reactions += square
        else:
            free += square
    return free, on_contact, reactions


# Rows of tables are copied by loops: numba compiles an assignment of an array to a part of another
# one with checks of shapes and overlap, up to ten times the code, which each process loads.


@kernel
def copy_row(source, target):
    """Copy the values of one row (c,) into another."""
    for k in range(source.size):
        target[k] = source[k]


@kernel
def add_row(factor, row, out):
    """Add ``factor`` times ``row`` (C,) to ``out``."""
    for k in range(out.size):
        out[k] += factor * row[k]


@kernel
def copy_rows(source, count, target, start):
    """Copy the first ``count`` rows of (r, c) into another table, from row ``start`` on."""
    for i in range(count):
        copy_row(source[i], target[start + i])


@kernel
def grown(rows, used, needed):
    """``rows`` (r, c), or a longer table with the rows ``used`` if ``needed`` are more than r."""
    if needed <= rows.shape[0]:
        return rows
    longer = np.empty((2 * needed, rows.shape[1]))
    copy_rows(rows, used, longer, 0)
    return longer


@kernel
def sort_rows(rows, count, column):
    """Sort the first ``count`` of rows (r, c) in place by one column.

    Stable insertion sort, for few rows.
    """
    for i in range(1, count):
        for j in range(i, 0, -1):
            if rows[j, column] >= rows[j - 1, column]:
                break
            for c in range(rows.shape[1]):
                rows[j, c], rows[j - 1, c] = rows[j - 1, c], rows[j, c]


@kernel
def dot(p, q):
    """P . q, without complex conjugation."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@kernel
def dot2(p, q):
    """P . q in the plane, without complex conjugation."""
    return p[0] * q[0] + p[1] * q[1]


@kernel
def cross2(ax, ay, bx, by):
    """Vector product of (ax, ay) and (bx, by) in the plane."""
    return ax * by - ay * bx


@kernel
def cross(p, q, out):
    """Fill ``out`` (3,) with p x q."""
    out[0] = p[1] * q[2] - p[2] * q[1]
    out[1] = p[2] * q[0] - p[0] * q[2]
    out[2] = p[0] * q[1] - p[1] * q[0]


@kernel
def det(a, b, c):
    """Determinant of three vectors (3,)."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@kernel
def find_indices(starts, columns, block_starts, block_columns, indices):
    """Find the entries of a matrix in rows among those of a matrix in blocks.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        block_starts: Blocks of rows 2 i and 2 i + 1, shape (n + 1,).
        block_columns: Their columns over two in ascending order, shape (blocks,).
        indices: Positions among the values in blocks of two columns each, -1 for entries outside of
            all blocks, shape (entries,); filled.
    """
    for i in range(starts.shape[0] - 1):
        block, end = block_starts[i // 2], block_starts[i // 2 + 1]
        for e in range(starts[i], starts[i + 1]):
            while block < end and block_columns[block] < columns[e] // 2:
                block += 1
            indices[e] = -1
            if block < end and block_columns[block] == columns[e] // 2:
                indices[e] = 4 * block + 2 * (columns[e] % 2) + i % 2


@kernel
def copy_to_rows(blocks, indices, rows):
    """Fill the values of the rows (entries,) from those of the blocks, with zeros outside."""
    for e in range(indices.shape[0]):
        rows[e] = blocks[indices[e]] if indices[e] >= 0 else 0.0


@kernel
def copy_to_blocks(rows, indices, blocks):
    """Overwrite the values of the blocks by those of the rows (entries,), all within blocks."""
    for e in range(indices.shape[0]):
        blocks[indices[e]] = rows[e]


@kernel
def find_entries(starts, columns, block_rows, block_columns, entries):
    """Find the values of blocks among the entries of a matrix in rows.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        block_rows: Rows of the blocks over two, shape (blocks,).
        block_columns: Columns of the blocks over two, shape (blocks,).
        entries: Positions of the values, by columns of a block, -1 where there is no entry, shape
            (4 blocks,); filled.
    """
    for b in range(block_rows.shape[0]):
        for k in range(4):
            row, column = 2 * block_rows[b] + k % 2, 2 * block_columns[b] + k // 2
            start, end = starts[row], starts[row + 1]
            e = start + np.searchsorted(columns[start:end], column)
            entries[4 * b + k] = e if e < end and columns[e] == column else -1


@kernel
def add_values(values, entries, rows):
    """Add values (k,) to those of the rows at ``entries`` (k,), without those at -1."""
    for k in range(entries.shape[0]):
        if entries[k] >= 0:
            rows[entries[k]] += values[k]


@kernel
def find_blocks(starts, columns, block_starts, block_columns):
    """Find the blocks that contain the entries of a matrix in rows.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        block_starts: Blocks of rows 2 i and 2 i + 1, shape (n + 1,); filled.
        block_columns: Their columns over two in ascending order, shape (entries,); the first
            block_starts[n] are filled.
    """
    count = 0
    block_starts[0] = 0
    for i in range(block_starts.shape[0] - 1):
        e, middle, f, end = starts[2 * i], starts[2 * i + 1], starts[2 * i + 1], starts[2 * i + 2]
        while e < middle or f < end:
            if f == end or (e < middle and columns[e] <= columns[f]):
                column = columns[e] // 2
                e += 1
            else:
                column = columns[f] // 2
                f += 1
            if count == block_starts[i] or block_columns[count - 1] != column:
                block_columns[count] = column
                count += 1
        block_starts[i + 1] = count


@kernel
def turn_blocks(starts, columns, blocks, of_rows, of_columns):
    """Replace blocks B by R_i^T B R_j, with the axes R of their nodes i and j in columns.

    Args:
        starts: Blocks of node i are starts[i]:starts[i + 1], shape (n + 1,).
        columns: Their nodes j, shape (blocks,).
        blocks: Shape (blocks, dim, dim); changed.
        of_rows: R of the nodes i, shape (n, dim, dim) [1].
        of_columns: R of the nodes j, shape (m, dim, dim) [1].
    """
    dim = blocks.shape[1]
    turned = np.empty((dim, dim))
    for i in range(len(starts) - 1):
        for b in range(starts[i], starts[i + 1]):
            for k in range(dim):
                for l in range(dim):
                    turned[k, l] = 0.0
                    for a in range(dim):
                        turned[k, l] += blocks[b, k, a] * of_columns[columns[b], a, l]
            for k in range(dim):
                for l in range(dim):
                    blocks[b, k, l] = 0.0
                    for a in range(dim):
                        blocks[b, k, l] += of_rows[i, a, k] * turned[a, l]
