"""What Prometheus may count; one registry per application."""

from prometheus_client import CollectorRegistry, Counter, Histogram, PlatformCollector, ProcessCollector

SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
OTHER = "other"
"""Label of methods and paths that clients made up: there is no end to those."""


class Metrics:
    """Requests by route and status, time of each, diagnoses by verdict, refused keys."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        PlatformCollector(registry=self.registry)
        self.requests = Counter(
            "gearcase_requests", "Requests answered", ["method", "route", "status"], registry=self.registry
        )
        self.seconds = Histogram(
            "gearcase_request_seconds",
            "Time from the request's first byte to the answer's last [s]",
            ["method", "route"],
            buckets=SECONDS,
            registry=self.registry,
        )
        self.diagnoses = Counter("gearcase_diagnoses", "Diagnoses given", ["verdict", "label"], registry=self.registry)
        self.refused_keys = Counter(
            "gearcase_refused_keys", "Requests with a wrong or revoked key", registry=self.registry
        )
