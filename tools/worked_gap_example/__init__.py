"""What a revised model is worth to the detector: the worked example of docs/gap.md."""
