"""FastAPI: accepts, reports, delivers. No geometry."""
