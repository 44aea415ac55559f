# SPDX-License-Identifier: MIT
"""Bodies with mass: impacts with known solutions, conservation, rates in time, restart."""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.dynamics.scenes import E, RHO, bar, dropped_block, rings, scene
from fenics_mortar.bulk.massless import extrapolation
from fenics_mortar.path.energy_return import fraction_of_impulse
from fenics_mortar.path.time_scheme import GeneralizedAlpha
from meshes.mapped_grids import Grid, block

C = np.sqrt(E / RHO)  # speed of waves in a bar with nu = 0
