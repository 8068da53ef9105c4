"""Rays and surfaces in closed form: beside each textbook formula, as it is written, one that keeps its digits.

The functions take Dr.Jit arrays, in single or double precision, and compute in the precision of what they are given.
Textbook forms are those of [Glassner1989] unless they say otherwise.
"""
