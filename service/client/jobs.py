"""Jobs as a client knows them."""

from typing import Any

from service.client.problems import MeshmarkProblem, failure_of

ENDED = ("succeeded", "failed", "canceled", "expired")


class JobFacts:
    """Facts about a job, of either kind, as the service last told them.

    `facts` has all of them, under the names of the API.
    """

    def __init__(self, facts: dict[str, Any]) -> None:
        self.facts = facts

    def __repr__(self) -> str:
        doing = f" {self.stage}" if self.stage else ""
        return f"<job {self.id} {self.state}{doing} {self.progress:.0%}>"

    @property
    def id(self) -> str:
        """Id of the job."""
        return str(self.facts["id"])

    @property
    def state(self) -> str:
        """`queued`, `running`, `succeeded`, `failed`, `canceled` or `expired`."""
        return str(self.facts["state"])

    @property
    def stage(self) -> str | None:
        """Current activity of a running job, such as `placing`."""
        stage: str | None = self.facts["stage"]
        return stage

    @property
    def progress(self) -> float:
        """Share of the job that is done, 0 to 1."""
        return float(self.facts["progress"])

    @property
    def metadata(self) -> dict[str, str]:
        """Your own notes about the job."""
        return dict(self.facts["metadata"])

    @property
    def links(self) -> dict[str, str]:
        """Paths of the parts that exist, by their names."""
        return {name: place for name, place in self.facts["links"].items() if place}

    @property
    def has_ended(self) -> bool:
        """True once the job waits and runs no more."""
        return self.state in ENDED

    @property
    def problem(self) -> MeshmarkProblem | None:
        """Why the job has no results; None where it has some, or has not ended."""
        return failure_of(self.facts)

    @property
    def place(self) -> str:
        """Path of the job itself."""
        return str(self.facts["links"]["self"])

    def path_of(self, part: str | None) -> str:
        """Path of a part, whether it exists or not; without a name of the model, or of the page of evidence."""
        return f"{self.place}/{part or ('model' if 'model' in self.facts['links'] else 'evidence')}"
