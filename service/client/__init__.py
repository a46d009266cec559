"""Python client of the service, synchronous and asynchronous.

    from service.client import Client

    with Client("http://127.0.0.1:8080") as client:
        job = client.watermark("spot.glb", text="watermark", on_progress=print)
        job.download("spot-watermarked.glb")

It needs httpx2 alone, and imports nothing else of this project.
"""

from service.client.asynchronous import AsyncClient, AsyncJob
from service.client.batches import Outcome
from service.client.jobs import JobFacts
from service.client.orders import BatchItem, Marking, Order, SourceUrl, UploadId
from service.client.problems import MeshmarkProblem
from service.client.synchronous import Client, Job
from service.client.webhooks import InvalidWebhookError, verify_webhook

__all__ = [
    "AsyncClient",
    "AsyncJob",
    "BatchItem",
    "Client",
    "InvalidWebhookError",
    "Job",
    "JobFacts",
    "Marking",
    "MeshmarkProblem",
    "Order",
    "Outcome",
    "SourceUrl",
    "UploadId",
    "verify_webhook",
]
