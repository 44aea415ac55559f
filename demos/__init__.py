# SPDX-License-Identifier: MIT
"""Demos, one script each, and studies: programs for measurements."""
