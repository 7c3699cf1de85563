"""Commands that find out about models: gap, identify, sweep."""
