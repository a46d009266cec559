"""Celery tasks: claim a job, run the engine in a child process that can be killed, publish."""
