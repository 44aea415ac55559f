# SPDX-License-Identifier: MIT
"""Measuring programs, run as modules from the root of the clone."""
