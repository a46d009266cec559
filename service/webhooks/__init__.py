"""Webhooks by the Standard Webhooks specification, version 1 (https://www.standardwebhooks.com)."""
