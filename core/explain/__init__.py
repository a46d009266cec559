"""Why marks stand where they stand: every step of one placement, as figures, pictures and a model with layers."""
