"""Requests to addresses that users name: nothing but the public internet is reached through them."""
