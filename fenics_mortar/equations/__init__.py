# SPDX-License-Identifier: MIT
"""All equations of bodies in contact, in general and reduced to the contact dofs.

In flow bulk, interfaces, obstacles and systems; out flows the one object that Newton's method
solves. The inputs of users are checked here before each solve.
"""
