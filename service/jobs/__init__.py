"""What service and worker share: the job ledger, leases, artifact storage, the name of the queue."""
