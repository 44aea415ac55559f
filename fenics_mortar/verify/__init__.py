# SPDX-License-Identifier: MIT
"""Independent checks of a state: certificate, crossings, tangent check, error estimate.

Input is an evaluated state. Output are measured defects and estimated errors, in numbers and words.
Nothing here changes the state.
"""
