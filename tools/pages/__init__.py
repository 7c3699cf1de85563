"""Writes those tables and pictures of the documentation's pages that follow from the code."""
