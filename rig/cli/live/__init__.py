"""Commands that watch running rigs: monitor, console, router."""
