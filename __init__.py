# SPDX-License-Identifier: MIT
"""The folder of the clone, which is not the package: a script beside it may find it first.

Without this file Python makes a namespace package of the folder, which has no attributes. If the
package is on the path, by ``. .ci/env.sh`` or installed, it is imported instead; otherwise an error
says what to do.
"""

import importlib.util
import sys
from importlib.machinery import PathFinder
from pathlib import Path

if __name__ == "fenics_mortar":
    here = Path(__file__).resolve()
    others = [p for p in sys.path if (Path(p) / __name__ / "__init__.py").resolve() != here]
    specs = [
        finder.find_spec(__name__, others if finder is PathFinder else None)
        for finder in sys.meta_path
    ]
    spec = next((spec for spec in specs if spec is not None and spec.loader is not None), None)
    if spec is None:
        raise ImportError(
            f"{here.parent} is the folder of the clone, not the package: run `. {here.parent}/"
            ".ci/env.sh` in this shell first, or install the package"
        )
    sys.modules[__name__] = package = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(package)
