# SPDX-License-Identifier: MIT
"""A user's law that returns wrong values from some time on."""

import numpy as np
from small_scenes import small_blocks

import fenics_mortar as fm


class Spoilt(fm.Coulomb):
    """Coulomb's law with adhesion; one of its results is wrong from some time on."""

    def __init__(self, method, spoil, strength=0.1):
        super().__init__(0.3)
        self.strength = strength
        self.method, self._spoil, self._on = method, spoil, True

    def _answer(self, method, answer):
        return self._spoil(answer) if self._on and method == self.method else answer

    def limit(self, node):
        return self._answer("limit", super().limit(node))

    def branch(self, node, before):
        return self._answer("branch", super().branch(node, before))

    def tangential(self, node, branch):
        return self._answer("tangential", super().tangential(node, branch))

    def friction_limit(self, pressure):
        return self._answer("friction_limit", super().friction_limit(pressure))

    def adhesion(self, gap):
        pull = self.strength * np.exp(-gap / 0.1)
        return self._answer("adhesion", (pull, -pull / 0.1))


def rubbing_blocks(law, E=100.0):
    scene = small_blocks(pair={"law": law}, E=E)
    scene.loads["push"].value[:] = 0.005, -0.02
    return scene
