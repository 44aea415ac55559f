# SPDX-License-Identifier: MIT
"""Files and pictures: ParaView, tables of forces, plots, checkpoints.

Input: problems and their states. Output: files. A checkpoint restores all data on which the next
solve depends. Errors of writing are raised on all ranks.
"""
