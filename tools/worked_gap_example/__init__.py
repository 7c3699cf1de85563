"""The worked example of docs/gap.md: how much a revised model improves the leak detector."""
