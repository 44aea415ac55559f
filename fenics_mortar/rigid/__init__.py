# SPDX-License-Identifier: MIT
"""Rigid motions: bodies supported by contact alone, obstacles driven by forces, loads at a point.

Input: bodies, loads and strength of the contacts. Output: rigid motions before a solve
(from limit analysis), springs along motions that contact does not resist, and the equations of
obstacles and remote loads.
"""
