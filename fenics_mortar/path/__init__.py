# SPDX-License-Identifier: MIT
"""Load paths and motions: adaptive steps, initial guesses, and why a path ends.

Input are a problem and a function that sets loads for a time. Output are converged states along the
path, or the reason for its end.
"""
