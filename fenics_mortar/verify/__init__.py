# SPDX-License-Identifier: MIT
"""Independent checks of a state: certificate, crossings, tangent check, error estimate.

Input: an evaluated state. Output: measured defects and estimated errors, as numbers and messages.
The state is not changed.
"""
