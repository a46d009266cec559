"""Upload hooks: configuration, authentication and parsing of notifications about files dropped in a bucket."""
