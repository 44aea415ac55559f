# SPDX-License-Identifier: MIT
"""Importing this module puts the root of the clone first on the path of a script beside it.

``fenics_mortar`` and ``meshes`` are then those of this clone, whatever the current folder is.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
