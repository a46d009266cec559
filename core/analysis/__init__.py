"""What of an asset may carry a watermark: which faces count, which side of them is out, which may be cut."""
