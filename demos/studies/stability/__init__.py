# SPDX-License-Identifier: MIT
"""Limits of methods: the atlas of difficult scenes and the randomised trial."""
