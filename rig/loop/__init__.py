"""The compiled cycle of the rig: read, estimate, control, limit, write, record.

Nothing in it returns to Python before the run ends; knows no YAML.
"""
