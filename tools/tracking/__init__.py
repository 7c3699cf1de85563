"""What the tracking law is worth: on rigs drawn at random, for the detector, and in a picture.

`python -m tools.tracking` prints the tables of docs/tracking.md and draws its picture.
"""
