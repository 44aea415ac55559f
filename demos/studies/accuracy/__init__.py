# SPDX-License-Identifier: MIT
"""Errors and rates against exact solutions, published curves and other codes."""
