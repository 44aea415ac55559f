# SPDX-License-Identifier: MIT
"""Whether a change of the code leaves all results as they are."""
