"""Leak tests of locked cylinders drawn at random, by physics that differ from what the fit assumes.

`drawing` draws the rigs, `physics` simulates their soaks, and `trials` judges what the fit says.
"""
