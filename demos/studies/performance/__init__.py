# SPDX-License-Identifier: MIT
"""Processor time and memory of kernels, iterations and whole solves."""
