# SPDX-License-Identifier: MIT
"""Arrays, errors, argument checks, timing, files and what differs between releases of dolfinx.

Nothing here knows what contact is. In flow values of users and names of options; out flow checked
values and errors that are raised on all ranks or on none. Every other folder may use it.
"""
