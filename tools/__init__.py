"""What a developer runs: benchmarks, the thesis tables, figures of the docs."""
