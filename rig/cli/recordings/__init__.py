"""Commands that read recordings: replay, baseline, export, recover."""
