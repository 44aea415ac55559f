# SPDX-License-Identifier: MIT
"""Families of one problem each with a varied parameter, in their order in the table."""
# ruff: noqa: F401, I001 (importing a module enters its families, in this order)

from demos.studies.stability import families_steps
from demos.studies.stability import families_edges
from demos.studies.stability import families_thin
from demos.studies.stability import families_supported
from demos.studies.stability import families_parameters
from demos.studies.stability import families_physics
from demos.studies.stability.family import FAMILIES, Family, scene_of
