# SPDX-License-Identifier: MIT
"""Semismooth Newton on anything with a residual, a tangent and sets; damping; the report.

In flow equations (a protocol); out flow a converged state and its report, or an error that says
what did not converge. Contact and finite elements are unknown here.
"""
