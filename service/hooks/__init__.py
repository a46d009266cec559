"""Files dropped in a bucket: who tells of them, what is told, and what is made of it."""
