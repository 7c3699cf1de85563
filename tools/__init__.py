"""What a developer runs, a room for each purpose.

`bench` tells how fast it is, `studies` how right; `pages` writes what pages have of the code, and
`chaos` lets everything fail. `simulated` has the rigs of studies, `hidden_effects` those that share
no code with the product. `thesis_tables`, `detection_limits`, `tolerant_control` and
`worked_gap_example` make one page each.
"""
