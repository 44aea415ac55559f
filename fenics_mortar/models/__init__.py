# SPDX-License-Identifier: MIT
"""Errors of simpler models, estimated by richer ones.

Input: a solved problem. Output: estimates of the errors of its assumptions (linear strain, small
sliding, rigid obstacles, no friction, a plane or bodies of revolution).
"""
