# SPDX-License-Identifier: MIT
"""Limits of methods: difficult problems by all methods, and random ones."""
