"""Content Credentials (C2PA): signed statements about a result, and the reading of them."""
