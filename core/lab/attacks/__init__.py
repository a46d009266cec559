"""What a thief or a careless tool does to a watermarked mesh; plain functions on plain geometry."""
