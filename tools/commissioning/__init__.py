"""Judges `rig commission` on emulated rigs that were built wrong in one to three ways."""
