# SPDX-License-Identifier: MIT
"""Arrays, errors, argument checks, timing, files and the differences between dolfinx releases.

Input are options and values of users. Output are checked values, and errors that are raised on all
ranks or on none. All other folders may import it; it imports none of them.
"""
