# SPDX-License-Identifier: MIT
"""The hierarchy of models: error, estimate and cost of each."""
