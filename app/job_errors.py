"""What can go wrong with a job; apart from the job engine, so that a name does not cost its import."""


class JobError(Exception):
    """Something asked of the jobs that cannot be done."""


class JobNotFoundError(JobError):
    """There is no job of this id."""


class JobStateError(JobError):
    """The job is in a state in which this cannot be done."""


class JobFailedError(JobError):
    """A task of the job failed."""
