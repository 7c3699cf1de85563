"""Commands that test models or identify their parameters: gap, identify, sweep."""
