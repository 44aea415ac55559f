# SPDX-License-Identifier: MIT
"""Semismooth Newton method for equations with residual, tangent and active sets; damping; report.

Input: equations (a protocol); output: a converged state and its report, or an error with the failed
tests. Independent of contact and finite elements.
"""
