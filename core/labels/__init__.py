"""Labels that rules ask for on models, in words and for machines."""
