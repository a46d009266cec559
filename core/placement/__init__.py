"""Where watermarks go: candidates, fine-tuning, filters, selection."""
