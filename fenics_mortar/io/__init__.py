# SPDX-License-Identifier: MIT
"""Files and pictures: ParaView, tables of forces, plots, checkpoints.

Input are problems and their states, output are files. A checkpoint restores all data that the next
solve depends on. Errors of writing are raised on all ranks.
"""
