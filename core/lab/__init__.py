"""What the product is compared with and tried by: attacks, baselines, the benchmark. Only the command line is above."""
