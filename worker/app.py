"""The Celery app of the worker, for `python -m worker` and Celery's own commands (`celery -A worker.app ...`)."""

from service.config import load_settings
from service.data_folder import keep_private
from worker.factory import create_worker

settings = load_settings()
keep_private(settings)  # before the first file is made
app = create_worker(settings)
