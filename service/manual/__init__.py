"""The manual as a site: built of the pages in service/docs at set-up, served at /docs/."""

from pathlib import Path

SITE = Path(__file__).parent / "site"
