# SPDX-License-Identifier: MIT
"""Rigid motions: bodies supported by contact alone, obstacles that forces drive.

In flow bodies, loads and the strength of the contacts. Out flow rigid motions before a solve (found
by limit analysis), springs along motions that contact leaves free, and the equations of obstacles.
"""
