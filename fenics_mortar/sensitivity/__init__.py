# SPDX-License-Identifier: MIT
"""Sensitivities of solutions to loads, material, laws and shapes, through the steps of a path.

Input: a solved problem or a recorded path, an objective and controls. Output: the derivatives of
the objective with respect to the controls, exact at the active sets and branches of the states: by
the adjoint method (``fm.gradient``) or in one direction (``tangent_linear``). Recorded paths,
controls, quantities and functions of the values of all steps are attributes of this package.
"""

from fenics_mortar.sensitivity.controls import (
    ConductanceScale,
    Interference,
    LawParameter,
    ObstacleLoad,
    ObstaclePlace,
    ObstacleShape,
    Offset,
)
from fenics_mortar.sensitivity.forms import NodalPositions
from fenics_mortar.sensitivity.gradient import (
    Gradient,
    Simulation,
    TangentLinear,
    tangent_linear,
    to_autograd,
)
from fenics_mortar.sensitivity.objective import Kink, RecordedPath, last, least_squares, total
from fenics_mortar.sensitivity.protocols import (
    ContactLength,
    Control,
    FrictionWork,
    MeanGap,
    Moment,
    PeakPressure,
    PressureFunctional,
    PressureIntegral,
    Quantity,
    TotalForce,
    effective_length,
)

__all__ = [
    "ConductanceScale", "ContactLength", "Control", "FrictionWork", "Gradient", "Interference",
    "Kink", "LawParameter", "MeanGap", "Moment", "NodalPositions", "ObstacleLoad",
    "ObstaclePlace", "ObstacleShape", "Offset", "PeakPressure", "PressureFunctional",
    "PressureIntegral", "Quantity", "RecordedPath", "Simulation", "TangentLinear", "TotalForce",
    "effective_length", "last", "least_squares", "tangent_linear", "to_autograd", "total",
]  # fmt: skip
