"""Runs campaigns: every test through the loop, its recording, verdict and results on disk.

Everything it writes is complete as far as the run came, also after a crash or an abort.
"""
