# SPDX-License-Identifier: MIT
"""The scenes: families of one problem each, swept over what makes it hard; in the atlas' order."""
# ruff: noqa: F401, I001 (importing a module enters its families, in this order)

from demos.studies.stability import families_steps
from demos.studies.stability import families_edges
from demos.studies.stability import families_thin
from demos.studies.stability import families_supported
from demos.studies.stability import families_parameters
from demos.studies.stability import families_physics
from demos.studies.stability.family import FAMILIES, Family, scene_of
