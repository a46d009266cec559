"""A worker with the tests' engine: `celery -A tests.worker.apps worker`, or `python -m tests.worker.apps [PID]`."""

from service.config import Settings
from worker.__main__ import main
from worker.factory import create_worker

app = create_worker(Settings(), "tests.worker.engines:directed", "tests.worker.engines:looked_at")

if __name__ == "__main__":
    main(app)
