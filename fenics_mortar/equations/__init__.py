# SPDX-License-Identifier: MIT
"""All equations of bodies in contact, in general and reduced to the contact dofs.

Input: bulk, interfaces, obstacles and linear systems. Output: the equations that Newton's method
solves. Inputs of users are checked here before each solve.
"""
