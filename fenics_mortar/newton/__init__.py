# SPDX-License-Identifier: MIT
"""Semismooth Newton on anything with a residual, a tangent and sets; damping; the report.

Input: equations (a protocol); output: a converged state and its report, or an error with the failed
tests. Independent of contact and finite elements.
"""
