# SPDX-License-Identifier: MIT
"""Bodies with mass: energy, pressure and time of impacts, by scheme and step."""
