# SPDX-License-Identifier: MIT
"""Files and pictures: ParaView, tables of forces, plots, checkpoints.

In flow problems and their states; out flow files. A checkpoint gives back all that the next solve
depends on.
"""
