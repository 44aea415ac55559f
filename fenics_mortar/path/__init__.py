# SPDX-License-Identifier: MIT
"""Load paths and motions: adaptive load steps, time steps, and reasons for the end of a path.

Input: a problem and a function that sets loads for a time. Output: converged states along the path,
or the reason for its end.
"""
