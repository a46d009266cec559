"""The metrics of the paper's supplement and ours beside them, one a file: how good the marks are, what they cost."""
