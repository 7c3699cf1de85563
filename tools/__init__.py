"""Programs for developers of the software, with one package for each purpose.

`bench` measures how fast the software is, `studies` how often its verdicts are right. `chaos` makes
every part of a running rig fail in turn. `pages` writes those tables of the documentation that
follow from the code. `simulated` draws the rigs that studies run on; `hidden_effects` has a rig of
its own, which shares no code with the product. `thesis_tables`, `detection_limits`,
`tolerant_control`, `worked_gap_example` and `peers` each compute the tables of one page.
"""
