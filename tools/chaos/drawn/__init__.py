"""Chaos by a grammar: two faults at once, drawn with their moments and parts from a seed.

Each case is judged by what the devices recorded, against the bounds of `bounds.py`.
"""
