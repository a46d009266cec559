"""`python -m service jobs`: list the dead letters, which are jobs whose workers died at each attempt, and retry one."""

import argparse
import sys
from contextlib import closing

from kombu.exceptions import KombuError

from service.config import Settings
from service.jobs.dead import dead_jobs, retry
from service.jobs.ledger import Ledger
from service.jobs.models import ArtifactKind
from service.jobs.queue import create_queue, send
from service.jobs.stores import open_store


def add_jobs_commands(parser: argparse.ArgumentParser) -> None:
    """Add the commands to a parser."""
    commands = parser.add_subparsers(dest="action", required=True)
    dead = commands.add_parser("dead", help="print the jobs that ended with worker_lost")
    dead.add_argument("--tenant", help="only this tenant's")
    again = commands.add_parser("retry", help="send a dead job's asset again, as a new job, whose id is printed")
    again.add_argument("id", help="the dead job")


def run_jobs_command(settings: Settings, arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    with closing(Ledger(settings.ledger_url)) as ledger:
        if arguments.action == "dead":
            for job in dead_jobs(ledger.sessions, arguments.tenant):
                source = job.artifact(ArtifactKind.INPUT)
                size = f"{source.size} bytes" if source else "deleted"
                when = f"{job.finished_at:%Y-%m-%d %H:%M:%S}"
                print(job.id, job.tenant_id, when, f"{job.attempts} attempts", size, job.filename, sep="\t")
            return 0
        try:
            job = retry(ledger, open_store(settings), arguments.id)
        except LookupError as error:
            print(error.args[0], file=sys.stderr)
            return 1
        print(job.id)
        try:
            with create_queue(settings) as broker:
                send(broker, job.id, job.queue)
        except (KombuError, OSError):
            print("The broker does not answer; a worker's sweeper will find the job.", file=sys.stderr)
    return 0
