# SPDX-License-Identifier: MIT
"""Rigid motions: bodies supported by contact alone, and obstacles driven by forces.

Input: bodies, loads and strength of the contacts. Output: rigid motions before a solve
(from limit analysis), springs along motions that contact does not resist, and the equations of
obstacles.
"""
