# SPDX-License-Identifier: MIT
"""Facets in space: normals, pairs, integrals over the common parts of two surfaces, derivatives.

A facet has K nodes: 3 (tri3), 4 (quad4), 6 (tri6) or 9 (quad9). First the corners, seen from
outside of the body counter-clockwise, then the nodes on the edges 01, 12, ..., then the centre.

Each slave facet has an auxiliary plane, normal to it at its centre (Puso & Laursen 2004; Popp,
Gitterle, Gee & Wall 2010). Both facets are projected onto the plane along its normal; the common
part of the two flat images is a convex polygon, which is divided into triangles, the cells. Their
quadrature points are projected back to both facets. Curved facets are clipped by their linear
pieces, each in a plane of its own, but points are projected to the whole curved facet.

Everything is computed in the axes of the plane: xi, eta and W of a point depend on the flat images
of the nodes alone, whose derivatives are t_d . dx - h t_d . dn_0. A motion of the plane along its
normal changes nothing.

==========  ======================================================================  ============
symbol      meaning                                                                 shape
==========  ======================================================================  ============
K, K', L    nodes of a slave facet, of a master facet, of all masters of a facet    ()
x, n, m     slave positions, slave nodal normals, master positions                  (n, 3)
t_1, t_2    axes of the auxiliary plane                                             (3,)
n_0, c      its normal, its centre: the mean of the corners of the piece            (3,)
X, Y        flat images of slave and master nodes, t_d . (x - c)                    (K, 2)
h           heights above the plane, n_0 . (x - c)                                  (K + K',)
V           vertices of the polygon: nodes, or intersections of edges               (v, 2)
xi, eta     coordinates of a point on the slave and on the master facet             (2,)
N, N^m      shape functions there, then their derivatives by both coordinates       (3, K)
W           weight of a point: that of the rule times the area of its cell          ()
g           gap n^ . (N^m y - N x), n^ = N n / |N n|                                ()
De, Me      integrals of N and of N N                                               (K,), (K, K)
B, G        integrals of N N^m and of N g                                           (K, K'), (K,)
Phi         multiplier functions A N; biorthogonal with A = De Me^-1 (Cichosz &     (K,)
            Bischoff 2011)
==========  ======================================================================  ============

=============  ===================================================================================
module         contents
=============  ===================================================================================
``shapes``     shape functions; nodes of the reference facets, linear pieces of curved facets,
               quadrature rules of a triangle
``normals``    averaged nodal normals and their derivatives (Max 1999); auxiliary plane, flat
               images, projection of a point to a facet
``clipping``   common part of two convex images, with labelled vertices
``pairs``      search for the master facets of each slave facet
``integrals``  De, Me, B, G; quadrature points of the common part of two pieces, factors of their
               derivatives
``linearize``  derivatives of the integrals of functions of xi, eta and g
``inside``     winding numbers, depths of points in bodies (van Oosterom & Strackee 1983), edges
               that pierce triangles; partners behind both bodies
=============  ===================================================================================
"""
