# SPDX-License-Identifier: MIT
"""Demos, each a script, and the studies: programs that measure."""
