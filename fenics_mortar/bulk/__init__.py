# SPDX-License-Identifier: MIT
"""The bodies without contact: residual and tangent from UFL, bodies, stresses, input checks.

In flow UFL forms and Dirichlet conditions; out flow assembled vectors and matrices, separate bodies
and their rigid motions, tractions and moduli read from the forms.
"""
