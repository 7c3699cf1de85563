"""Feeds every reader of the product, of files and of protocols, with bytes that nobody foresaw.

`make fuzz` searches with coverage as its guide; `make test` reads a fixed set of inputs.
"""
