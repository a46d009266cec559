"""Labels: what rules ask a model to say about where it comes from, in words and for machines."""
