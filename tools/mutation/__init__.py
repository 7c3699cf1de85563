"""Changes the code that keeps the rig safe, one place at a time, and sees whether a test notices.

What no test notices is a survivor: either a test is missing, or the change does not matter.
"""
