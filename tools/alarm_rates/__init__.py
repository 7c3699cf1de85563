"""Trials of learnt baselines: does a rig of another maker alarm as often as its detector is set to?

`rigs` draws rigs and motions of the independent simulator, `hours` turns them into oil accounts,
`judging` learns a baseline and judges further hours and leaks, `tables` prints what came of it.
"""
