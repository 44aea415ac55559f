# SPDX-License-Identifier: MIT
"""Where methods break: the atlas of difficult scenes and the randomised trial."""
