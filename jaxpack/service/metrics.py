"""What a service counts."""

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

BUCKETS = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1, 2, 5, 10, 30)  # seconds


class Metrics:
    """In a registry of its own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "jaxpack_requests", "Requests answered", ("route", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "jaxpack_request_seconds",
            "From a request to its answer",
            ("route",),
            registry=self.registry,
            buckets=BUCKETS,
        )
        self.queue = Gauge("jaxpack_queue", "Requests not answered yet", registry=self.registry)
        self.orders = Counter("jaxpack_orders_packed", "Orders packed", registry=self.registry)
        self.bins = Counter("jaxpack_bins_used", "Bins used by them", registry=self.registry)

    def text(self) -> bytes:
        """As Prometheus reads it."""
        return generate_latest(self.registry)
