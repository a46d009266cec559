"""The Celery app of the worker, for `python -m worker` and Celery's own commands (`celery -A worker.app ...`)."""

from service.config import load_settings
from worker.factory import create_worker

app = create_worker(load_settings())
