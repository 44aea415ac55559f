# SPDX-License-Identifier: MIT
"""The hierarchy of models: cheaper ones to start from, richer ones to measure the error by.

In flow a solved problem. Out flow an estimate of what its model leaves out (finite deformation,
sliding, elasticity of obstacles), and solutions found by way of cheaper models.
"""
