"""Commands that watch rigs which run: monitor, console, router."""
