"""Placement of watermarks: candidates, fine-tuning, filters, selection."""
