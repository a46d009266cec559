"""Laboratory of the product: attacks, baselines, the benchmark. Only the command line is above."""
