"""Outbound requests to addresses that users name: only the public internet is reachable through them."""
