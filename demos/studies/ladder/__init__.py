# SPDX-License-Identifier: MIT
"""Hierarchy of models: error, estimate and cost of each model."""
