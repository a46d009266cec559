"""Parts shared by service and worker: job ledger, leases, artifact storage, queues."""
