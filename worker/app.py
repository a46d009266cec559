"""The worker of the distributed shape: `celery -A worker.app worker`."""

from service.config import Settings
from worker.factory import create_worker

app = create_worker(Settings())
