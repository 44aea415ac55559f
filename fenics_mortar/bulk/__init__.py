# SPDX-License-Identifier: MIT
"""The bodies without contact: residual and tangent from UFL, bodies, stresses, input checks.

Input are UFL forms and Dirichlet conditions. Output are assembled vectors and matrices, the
separate bodies and their rigid motions, and tractions and moduli extracted from the forms.
"""
