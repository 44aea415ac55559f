# SPDX-License-Identifier: MIT
"""Independent looks at a state: certificate, crossings, tangent check, error estimate.

In flow a state; out flow what holds of it and what does not, in numbers and words. Nothing here
changes the state.
"""
