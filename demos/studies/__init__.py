# SPDX-License-Identifier: MIT
"""Programs that measure, run as modules from the root of the clone."""
