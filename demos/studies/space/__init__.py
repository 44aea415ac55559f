# SPDX-License-Identifier: MIT
"""Errors in three dimensions against closed forms: half-spaces, friction, ties."""
